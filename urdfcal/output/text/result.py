"""A fit as text and as the dictionary of `--json`, with what was asked beyond: accuracy of a tool or of spots, cross-validation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from urdfcal.base.geometry import DEG, MM
from urdfcal.base.terminal import as_text, displayed, distance, figures_table, many, rounded, titled, value_and_sigma
from urdfcal.calibration.analysis.prediction import SpotAccuracy
from urdfcal.calibration.analysis.verdict import verdict_of
from urdfcal.calibration.error_table import main_unit, rms_of
from urdfcal.calibration.result import CrossValidation
from urdfcal.estimation.identifiability import Combination, correlated_groups
from urdfcal.model.parameters import INSTRUMENTS
from urdfcal.output.calibration_yaml import parameter_entries
from urdfcal.output.text.dh import carried_lines
from urdfcal.output.text.headline import headline
from urdfcal.output.text.instruments import (
    frame_entries,
    length_entries,
    noise_in_common,
    noise_in_words,
    parameters_in_words,
    place_entries,
)
from urdfcal.output.text.lenses import lens_blocks
from urdfcal.output.text.outliers import outlier_blocks
from urdfcal.output.text.stands_out import stands_out_blocks
from urdfcal.output.text.verdict import verdict_blocks
from urdfcal.sensors.sensor import MAIN_UNIT

if TYPE_CHECKING:
    from rich.console import RenderableType

    from urdfcal.calibration.error_table import SpotTable
    from urdfcal.calibration.result import FitResult
    from urdfcal.estimation.evidence import Evidence

_MOST_SUMS = 12  # that a terminal is asked to hold
STRONG = 0.95  # correlation above which parameters are named together


@dataclass(frozen=True)
class Extras:
    """What is said beyond the fit itself.

    Attributes:
        folds: Cross-validation, if it was asked for.
        spots: Predicted accuracy of the spots, where there are lasers.
    """

    folds: CrossValidation | None
    spots: SpotAccuracy | None = None

    def accuracy(self) -> list[RenderableType]:
        """How far off the spots are predicted to be, for people."""
        blocks: list[RenderableType] = []
        if self.spots is not None:
            rows = zip(self.spots.lasers, self.spots.median / MM, self.spots.most / MM, self.spots.worst / MM, strict=True)
            words = "; ".join(
                f"{laser} {rounded(median, 2)}, {rounded(most, 2)}, {rounded(worst, 2)} mm" for laser, median, most, worst in rows
            )
            blocks += [f"Predicted error of the spots over the workspace (median, 95 %, worst): {words}"]
        return blocks

    def blocks(self) -> list[RenderableType]:
        """What comes after the fit itself, for people."""
        blocks: list[RenderableType] = []
        if self.folds is not None:
            blocks += ["", "Cross-validation: every pose predicted by a fit that did not see it", ""]
            blocks += [spot_table_block([(f"{self.folds.folds}-fold", self.folds.before, self.folds.after)], self.folds.spots)]
            blocks += [f"fold rejected: {reason}" for reason in self.folds.rejected]
        return blocks

    def machine(self) -> dict[str, Any]:
        """For machines."""
        machine: dict[str, Any] = {}
        if self.spots is not None:
            rows = zip(self.spots.lasers, self.spots.median, self.spots.most, self.spots.worst, strict=True)
            machine["predicted_spots"] = {
                laser: {"median": float(median), "quantile_95": float(most), "worst": float(worst)} for laser, median, most, worst in rows
            }
        if self.folds is not None:
            machine["kfold"] = {
                "folds": self.folds.folds,
                "before": table_json(self.folds.before),
                "after": table_json(self.folds.after),
                f"rms_{main_unit(self.folds.after)}": rms_of(self.folds.after),
                "rejected": list(self.folds.rejected),
            }
        return machine


def text_report(calibration: FitResult) -> str:
    """The whole result as text."""
    return as_text(calibration_blocks(calibration))


def calibration_blocks(calibration: FitResult, accuracy: Iterable[RenderableType] = ()) -> list[RenderableType]:
    """Verdict, predicted accuracy, headline, spot table, parameters, and what the data did not decide."""
    tables = [("fit", calibration.before, calibration.after)]
    if calibration.test:
        tables.append(("test", *calibration.test))
    if calibration.test_trimmed:
        tables.append(("test, trimmed", *calibration.test_trimmed))
    return [
        *verdict_blocks(verdict_of(calibration), headline(calibration)),
        *accuracy,
        "",
        _headline(calibration),
        "",
        spot_table_block(tables, calibration.data.only_spots),
        *(() if calibration.frames_alone else ("", parameter_table(calibration))),
        *_frames(calibration),
        *lens_blocks(calibration),
        *stands_out_blocks(calibration),
        *outlier_blocks(calibration),
        *_undecided(calibration),
        *_correlated(calibration),
        *_carried(calibration.errors.carried),
    ]


def spot_table_block(tables: Iterable[tuple[str, SpotTable, SpotTable | None]], spots: bool = True) -> RenderableType:
    """Distance between measured and predicted spot per laser, or point per target, before and after."""
    rows = list(tables)
    table = figures_table("poses", "laser" if spots else "what")
    both = any(after is not None for _, _, after in rows)
    phases = ("before", "after") if both else ("",)
    for name in ("spots" if spots else "number", *(f"{figure}\n{phase}".strip() for phase in phases for figure in ("mean", "std", "max"))):
        table.add_column(name, justify="right")
    for label, before, after in rows:
        for laser, row in before.items():
            figures = [row.mean, row.std, row.max]
            figures += [after[laser].mean, after[laser].std, after[laser].max] if after is not None else []
            unit = "" if row.unit == MAIN_UNIT else f" in {row.unit}"
            table.add_row(label, f"{laser}{unit}", str(row.n), *map(distance, figures))
    units = dict.fromkeys(row.unit for _, before, _ in rows for row in before.values())
    return titled(f"Distance from measured to predicted{' spot' if spots else ''}, in {' and '.join(units) or 'mm'}", table)


def parameter_table(calibration: FitResult) -> RenderableType:
    """Value and sigma of every parameter, or that the data did not determine it."""
    table = figures_table("parameter")
    table.add_column("value ± sigma", justify="right")
    table.add_column("unit")
    rows = zip(calibration.errors.parameters, calibration.x, calibration.sigma, calibration.identifiability.determined, strict=True)
    for parameter, value, sigma, determined in rows:
        if parameter.kind in (*INSTRUMENTS, "lens"):  # frames and lenses have tables of their own; places in the room are nobody's errors
            continue
        unit, size = displayed(parameter.unit)
        table.add_row(
            parameter.name, value_and_sigma(value / size, sigma / size) if determined else "not determined", unit if determined else ""
        )
    return titled("Estimated errors", table)


def calibration_json(calibration: FitResult) -> dict[str, Any]:
    """The result for machines: what the contract promises, and more; SI but for names that say otherwise."""
    noise, spot_noise, trimmed = calibration.estimate.noise, calibration.noise_of("spot"), calibration.test_trimmed
    verdict = verdict_of(calibration)
    return {
        "verdict": verdict.entry(),
        "headline": headline(calibration),
        "tool": verdict.tool.entry() if calibration.tool and verdict.tool is not None else None,
        "converged": calibration.converged,
        "stop": calibration.stop_reason,
        "rejected": calibration.rejection or None,
        "iterations": len(calibration.estimate.history) - 1,
        "rank": calibration.identifiability.rank,
        "estimator": calibration.estimator,
        "spot_sigma_mm": None if spot_noise is None else spot_noise / MM,
        "noise": dict(zip(calibration.data.kinds, noise.sigma.tolist(), strict=True)),
        "poses": {"count": calibration.data.pose_count, "readings": len(calibration.data)},
        "noise_in_common": noise_in_common(calibration),
        "joint_sigma": dict(zip(calibration.data.joints, noise.joint_sigma.tolist(), strict=True)),
        "frames": frame_entries(calibration),
        "places": place_entries(calibration),
        "lengths": length_entries(calibration),
        "spot_sigma_stated": noise.all_stated,
        "extra_noise": dict(calibration.extra_noise),
        "chi_squared_per_degree_of_freedom": calibration.chi_squared,
        "parameters": parameter_entries(calibration),
        "combinations": [asdict(combination) for combination in calibration.identifiability.combinations],
        "correlated": [list(group) for group in strongly_correlated(calibration)],
        "carried": dict(calibration.errors.carried),
        "before": table_json(calibration.before),
        "after": table_json(calibration.after),
        "test": {"before": table_json(calibration.test[0]), "after": table_json(calibration.test[1])} if calibration.test else None,
        "test_trimmed": None if trimmed is None else {"before": table_json(trimmed[0]), "after": table_json(trimmed[1])},
        "prior_scales": None if calibration.evidence is None else dict(calibration.evidence.scales),
        "outliers": [asdict(outlier) for outlier in calibration.outliers],
        "stands_out": [own.entry() for own in calibration.stands_out],
        "outliers_explained_by": list(calibration.beyond),
        "outliers_together": list(calibration.together),
        "test_outliers": [asdict(outlier) for outlier in calibration.test_outliers],
        "warnings": list(calibration.warnings),
    }


def table_json(table: SpotTable) -> dict[str, Any]:
    """A spot table for machines."""
    return {name: row.entry() for name, row in table.items()}


def _headline(calibration: FitResult) -> str:
    data = calibration.data
    sweeps = len(calibration.estimate.history) - 1
    verdict = "converged" if calibration.converged else f"NOT CONVERGED: {calibration.stop_reason}"
    directions = many(calibration.identifiability.rank, "direction")
    chosen = calibration.evidence
    scales = "" if chosen is None else "\n" + _scales(chosen)
    return (
        f"{calibration.robot.name}: {parameters_in_words(calibration.errors)} from {data.counted} with {data.summary}\n"
        f"{calibration.estimator}: {verdict} after {many(sweeps, 'sweep')}; the data determine {directions}\n"
        f"{noise_in_words(calibration)}, chi-square {calibration.chi_squared:.2f} per degree of freedom{scales}"
    )


def _frames(calibration: FitResult) -> list[RenderableType]:
    """Where measuring frames and targets were found."""
    entries = frame_entries(calibration)
    if not entries:
        return []
    table, turned = figures_table("frame", "on link"), any(entry["rotation_sigma"] is not None for entry in entries)
    names = ("x\nmm", "y\nmm", "z\nmm", "sigma\nmm", *(("roll\ndeg", "pitch\ndeg", "yaw\ndeg", "sigma\ndeg") if turned else ()))
    for name in names:
        table.add_column(name, justify="right", no_wrap=True)
    for entry in entries:
        placed = entry["sigma"] is not None
        lengths = [*(f"{length / MM:.2f}" for length in entry["xyz"]), f"{entry['sigma'] / MM:.2g}"] if placed else [""] * 4
        whole = entry["rotation_sigma"] is not None
        angles = (
            [*(f"{angle / DEG:.3f}" for angle in entry["rpy"]), f"{entry['rotation_sigma'] / DEG:.2g}"] if whole else [""] * (4 * turned)
        )
        table.add_row(entry["name"], entry["link"], *lengths, *angles)
    return ["", titled("Frames found with the fit", table)]


def _scales(chosen: Evidence) -> str:
    mm, mrad = chosen.scales["translation"] / MM, 1e3
    return (
        f"priors chosen by evidence: joint translations {rounded(mm, 2)} mm, "
        f"rotations {rounded(chosen.scales['rotation'] * mrad, 2)} mrad, "
        f"zeros {rounded(chosen.scales['zero'] * mrad, 2)} mrad"
    )


def _undecided(calibration: FitResult) -> list[RenderableType]:
    units, lines = dict(zip(calibration.errors.names, calibration.errors.units, strict=True)), []
    alone = dict(zip(calibration.errors.names, calibration.identifiability.determined, strict=True))
    for combination in combinations_of_robot(calibration):
        if combination.determined and len(combination.terms) > 1 and not all(alone[name] for name in combination.terms):
            unit, size = _display_of({units[name] for name in combination.terms})
            lines.append(f"  only {combination.words()} = {value_and_sigma(combination.value / size, combination.sigma / size)} {unit}")
    more = [f"  and {len(lines) - _MOST_SUMS} more (--json has all)"] if len(lines) > _MOST_SUMS else []
    return ["", "Determined as sums alone:", *lines[:_MOST_SUMS], *more] if lines else []


def _correlated(calibration: FitResult) -> list[RenderableType]:
    lines = [f"  {', '.join(group)}" for group in strongly_correlated(calibration)]
    heading = f"Linked by correlations above {STRONG:g}, so that their combinations are known better than each alone:"
    return ["", heading, *lines] if lines else []


def strongly_correlated(calibration: FitResult) -> list[tuple[str, ...]]:
    """Groups of parameters that hang together by correlations above STRONG; frames, targets and places are nobody's errors."""
    own = [index for index, parameter in enumerate(calibration.errors.parameters) if parameter.kind not in INSTRUMENTS]
    names, covariance = [calibration.errors.names[index] for index in own], calibration.covariance[np.ix_(own, own)]
    return correlated_groups(names, covariance, STRONG) if (np.diag(covariance) > 0).all() else []


def combinations_of_robot(calibration: FitResult) -> list[Combination]:
    """What the data decided of the robot's own errors: combinations of frames, targets and places alone are left out."""
    own = {parameter.name for parameter in calibration.errors.parameters if parameter.kind not in INSTRUMENTS}
    return [combination for combination in calibration.identifiability.combinations if not own.isdisjoint(combination.terms)]


def _carried(carried: Mapping[str, str]) -> list[RenderableType]:
    lines = [f"  {line}" for line in carried_lines(carried)]
    return ["", "Not in the state, since no measurement could tell them from others:", *lines] if lines else []


def _display_of(units: set[str]) -> tuple[str, float]:
    return displayed(units.pop()) if len(units) == 1 else ("(m and rad)", 1.0)
