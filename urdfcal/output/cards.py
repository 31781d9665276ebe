"""What a notebook shows of a calibration, of what one would be worth, and of a stored one."""

from __future__ import annotations

from collections.abc import Iterator

from urdfcal.base.notebook import Listing, card
from urdfcal.base.terminal import displayed, rounded, value_and_sigma
from urdfcal.calibration.analysis.check import Check
from urdfcal.calibration.analysis.comparison import Comparison
from urdfcal.calibration.analysis.verdict import TONES, Verdict
from urdfcal.calibration.error_table import SpotTable
from urdfcal.calibration.result import FitResult
from urdfcal.model.parameters import INSTRUMENTS
from urdfcal.output.report.sections import fixed, prior_text
from urdfcal.output.text.comparison import JOINT_BY_JOINT, at_tool, finding, joint_rows, tool_rows
from urdfcal.output.text.verdict import FIGURES, PREDICTED, accuracy_rows


def calibration_card(calibration: FitResult, verdict: Verdict) -> str:
    """Verdict, distances before and after, what is predicted, and parameters on a click."""
    data = calibration.data
    lines = [verdict.words, f"{data.counted} with {data.summary}; {calibration.estimator}; {calibration.stop_reason}"]
    lines += [f"{len(calibration.warnings)} warnings: .warnings has them"] if calibration.warnings else []
    predicted = list(accuracy_rows(verdict)) if verdict.tool is not None else []
    listings = (
        Listing(_DISTANCES, list(_distances(calibration)), words=2),
        Listing((PREDICTED, *(f"{name}, {phase}" for phase in ("before", "after") for name in FIGURES)), predicted),
        Listing(
            ("parameter", "value \u00b1 sigma", "unit", "prior sigma"), list(_parameters(calibration)), title="Parameters", folded=True
        ),
    )
    return card(f"Calibration of {calibration.robot.name}", lines, listings, TONES[verdict.use])


_DISTANCES = ("poses", "read", "readings", "before: mean", "max", "after: mean", "max", "unit")


def _distances(calibration: FitResult) -> Iterator[tuple[object, ...]]:
    tables: list[tuple[str, SpotTable, SpotTable]] = [("fit", calibration.before, calibration.after)]
    tables += [("test", *calibration.test)] if calibration.test else []
    for poses, before, after in tables:
        for name, row in before.items():
            figures = (fixed(value) for own in (row, after[name]) for value in (own.mean, own.max))
            yield (poses, name, row.n, *figures, row.unit)


def _parameters(calibration: FitResult) -> Iterator[tuple[object, ...]]:
    seen = calibration.identifiability.determined
    for parameter, value, sigma, determined in zip(calibration.errors.parameters, calibration.x, calibration.sigma, seen, strict=True):
        if parameter.kind not in INSTRUMENTS:
            unit, size = displayed(parameter.unit)
            told = value_and_sigma(value / size, sigma / size) if determined else "not determined"
            yield parameter.name, told, unit, prior_text(parameter.sigma, parameter.unit)


def comparison_card(found: Comparison) -> str:
    """Whether the two are the same, and how far apart joint by joint and at the tool."""
    listings = (Listing(*tool_rows(found), title=at_tool(found)), Listing(*joint_rows(found), title=JOINT_BY_JOINT, folded=True))
    return card("Two accounts of one robot", [finding(found), *found.notes], listings)


def check_card(check: Check) -> str:
    """What would be determined, what would help, and expected sigmas on a click."""
    decided = f"a fit would determine {check.predicted.rank} of {len(check.errors.names)} directions"
    lines = [f"{check.data.counted} with {check.data.summary}: {decided}", *check.warnings]
    rows = []
    for parameter, sigma, determined in zip(check.errors.parameters, check.sigma, check.predicted.determined, strict=True):
        if parameter.kind not in INSTRUMENTS:
            unit, size = displayed(parameter.unit)
            told = rounded(sigma / size, 3) if determined else "not determined"
            rows.append((parameter.name, prior_text(parameter.sigma, parameter.unit), told, unit))
    helps = [(each.words, ", ".join(each.determines)) for each in check.suggestions]
    listings = (
        Listing(("what would help", "would determine"), helps, words=2),
        Listing(("parameter", "prior sigma", "sigma after a fit", "unit"), rows, title="Expected sigmas", folded=True),
    )
    return card(f"What these measurements of {check.robot.name} determine", lines, listings)
