"""What a report says, section by section, before it is HTML or Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from urdfcal.base.minus import with_minus
from urdfcal.base.terminal import displayed, many, value_and_sigma
from urdfcal.calibration.analysis.prediction import SpotAccuracy
from urdfcal.calibration.analysis.verdict import honest_covariance
from urdfcal.calibration.error_table import SpotTable
from urdfcal.calibration.outliers import Outlier
from urdfcal.calibration.result import FitResult
from urdfcal.estimation.identifiability import DETERMINED, Combination
from urdfcal.model.parameters import INSTRUMENTS, Parameter
from urdfcal.output.report.document import Block, Cell, Gallery, Points, Section, Share, Table
from urdfcal.output.report.plots.maps import map_words
from urdfcal.output.report.residuals import Residuals, residuals_of
from urdfcal.output.report.sections import fixed, frames_section, places_section, prior_text, provenance_table
from urdfcal.output.report.suspects import Suspect, spreads, suspect_limit, suspects
from urdfcal.output.report.verdict import Opening, opening_of
from urdfcal.output.text.dh import carried_lines
from urdfcal.output.text.instruments import first_kind, measuring_frame, parameters_in_words
from urdfcal.output.text.outliers import COLUMNS, fit_heading, outlier_groups, short_pose, test_heading, together_words
from urdfcal.output.text.result import STRONG, combinations_of_robot, strongly_correlated
from urdfcal.output.text.stands_out import COLUMNS as STANDS_OUT
from urdfcal.output.text.stands_out import stands_out_rows
from urdfcal.output.text.wording import wording_of
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.sensor import MAIN_UNIT

_MOST_OUTLIERS = 10
_PHASES = ("mean", "std", "max")


@dataclass(frozen=True)
class Report:
    """A whole report.

    Attributes:
        title: Its heading.
        subtitle: Which data, which estimator.
        opening: Whether the calibration may be used.
        sections: Everything else.
        residuals: Of every reading at the fitted and the test poses, for pictures.
        suspects: Readings that do not belong to the rest, for pictures.
    """

    title: str
    subtitle: str
    opening: Opening
    sections: tuple[Section, ...]
    residuals: tuple[Residuals, ...]
    suspects: tuple[Suspect, ...]


def report_of(calibration: FitResult, command: Sequence[str], sag: Section | None = None, spots: SpotAccuracy | None = None) -> Report:
    """Gather everything that there is to say about a calibration, with what gravity does to the robot and how far off spots will be."""
    sets = residuals_of(calibration)
    found = suspects(calibration, sets)
    sections = [
        _measured(calibration, sets),
        frames_section(calibration),
        places_section(calibration, sets),
        _parameters(calibration),
        _combinations(calibration),
        _carried(calibration),
        _correlations(calibration),
        _convergence(calibration),
        _asked(calibration),
        _outliers(calibration, sets, found),
        *([sag] if sag is not None else []),
        Section("warnings", "Warnings", (Points(calibration.warnings),) if calibration.warnings else ()),
        Section("provenance", "Where this comes from", (provenance_table(calibration, command),)),
    ]
    data = calibration.data
    subtitle = f"{data.counted} with {data.summary}; {parameters_in_words(calibration.errors)}; {calibration.estimator}"
    title = f"Calibration of {calibration.robot.name}"
    shown = tuple(each for each in sections if each.blocks)
    return Report(title, subtitle, opening_of(calibration, found, spots), shown, tuple(sets), tuple(found))


def _measured(calibration: FitResult, sets: Sequence[Residuals]) -> Section:
    rows = _distance_rows("fit", calibration.before, calibration.after)
    rows += _distance_rows("test", *calibration.test) if calibration.test else []
    rows += _distance_rows("test, trimmed", *calibration.test_trimmed) if calibration.test_trimmed else []
    if calibration.folds:
        rows += _distance_rows(f"{calibration.folds.folds}-fold", calibration.folds.before, calibration.folds.after)
    words = wording_of(calibration.data)
    source = f"{words.source}, in mm" if words.units and _millimetres(calibration.before) else words.source
    columns = ("poses", source, words.count, *_PHASES, *_PHASES)
    table = Table(columns, tuple(rows), words=2, groups=(("", 3), ("before", 3), ("after", 3)))
    intro = f"{words.intro}: before with the nominal robot, after with the calibrated one.{words.note}"
    numbers = "Residuals are measured less predicted by the calibrated robot, number by number."
    maps: list[Block] = [*map_words(sets, measuring_frame(calibration)), Gallery("maps"), Gallery("histograms")]
    return Section("spots", words.title, (intro, table, *maps, *([numbers] if sets else []), Gallery("components")))


def _distance_rows(label: str, before: SpotTable, after: SpotTable) -> list[tuple[Cell, ...]]:
    all_mm = _millimetres(before)
    return [
        (
            label,
            name if all_mm else f"{name}, {row.unit}",
            str(row.n),
            *(fixed(value) for own in (row, after[name]) for value in (own.mean, own.std, own.max)),
        )
        for name, row in before.items()
    ]


def _convergence(calibration: FitResult) -> Section:
    history = calibration.estimate.history
    what, unit, size = first_kind(calibration)
    first, last = fixed(history[0].residual_rms / size), fixed(history[-1].residual_rms / size)
    went = f" The RMS of {what} went from {first} {unit} to {last} {unit}." if history[0].residual_rms else ""
    text = f"{many(len(history) - 1, 'sweep')}; stopped because {calibration.stop_reason}.{went} Sweep 0 is where the estimator started."
    return Section("convergence", "Convergence", (text, Gallery("convergence")))


def _parameters(calibration: FitResult) -> Section:
    text = (
        "Errors of the robot against its URDF. The last column is how much of the stated prior's uncertainty the data leave; a parameter "
        f"is determined when that is under {DETERMINED * 100:.0f} % and it is no term of a sum that is determined alone. "
        "The truth lies within 1.96 sigma 95 times in 100."
    )
    if calibration.evidence is not None:
        text += " The prior sigmas of the joints are those that the data made most probable."
    if not honest_covariance(calibration):
        text += " That does not hold here: the sigmas of the paper's schedule follow from its Q and R."
    seen = calibration.identifiability
    every = zip(calibration.errors.parameters, calibration.x, calibration.sigma, seen.left, seen.determined, strict=True)
    rows = tuple(_parameter_row(*row) for row in every if row[0].kind not in INSTRUMENTS)
    table = Table(("parameter", "value ± sigma", "prior sigma", "left of prior"), rows)
    return Section("parameters", "Parameters", (text, Gallery("parameters"), table) if rows else ())


def _parameter_row(parameter: Parameter, value: float, sigma: float, left: float, determined: bool) -> tuple[Cell, ...]:
    unit, size = displayed(parameter.unit)
    told = f"{value_and_sigma(value / size, sigma / size)} {unit}" if determined else "not determined"
    return (parameter.name, told, prior_text(parameter.sigma, parameter.unit), Share(left, DETERMINED))


def _combinations(calibration: FitResult) -> Section:
    combinations = [each for each in combinations_of_robot(calibration) if len(each.terms) > 1 or not each.determined]
    sums = [each for each in combinations if each.determined]
    open_ = [each for each in combinations if not each.determined]
    blocks: list[Block] = []
    if sums:
        several = wording_of(calibration.data).several
        blocks += [f"Determined as sums alone. The {several} tell these sums, not their terms:", _combination_table(calibration, sums)]
    if open_:
        blocks += [
            "Not determined. The data say little or nothing about these; the priors hold them:",
            _combination_table(calibration, open_),
        ]
    return Section("combinations", "What the data do not tell apart", tuple(blocks))


def _combination_table(calibration: FitResult, combinations: Sequence[Combination]) -> Table:
    return Table(("combination", "value ± sigma", "left of prior"), tuple(_combination_row(calibration, each) for each in combinations))


def _combination_row(calibration: FitResult, combination: Combination) -> tuple[Cell, ...]:
    parameters = {parameter.name: parameter for parameter in calibration.errors.parameters}
    units = {parameters[name].unit for name in combination.terms}
    unit, size = displayed(units.pop()) if len(units) == 1 else ("m and rad", 1.0)
    value = f"{value_and_sigma(combination.value / size, combination.sigma / size)} {unit}"
    return (combination.words(), value if combination.determined else "not determined", Share(combination.left, DETERMINED))


def _carried(calibration: FitResult) -> Section:
    text = "Not estimated, because no measurement of any kind could tell them from others; their errors are part of what carries them:"
    lines = tuple(carried_lines(calibration.errors.carried))
    return Section("carried", "Carried parameters", (text, Points(lines)) if lines else ())


def _correlations(calibration: FitResult) -> Section:
    groups = strongly_correlated(calibration)
    if not groups:
        return Section("correlations", "Correlated parameters", ())
    text = f"Linked by correlations above {STRONG:g}: combinations of them are known better than each alone."
    return Section("correlations", "Correlated parameters", (text, Points(tuple(_group_line(calibration, each) for each in groups))))


def _group_line(calibration: FitResult, group: Sequence[str]) -> str:
    rows = [calibration.errors.names.index(name) for name in group]
    block = calibration.covariance[np.ix_(rows, rows)] / np.outer(calibration.sigma[rows], calibration.sigma[rows])
    np.fill_diagonal(block, 0.0)
    first, second = sorted(divmod(int(np.argmax(np.abs(block))), len(rows)))
    strongest = "" if len(group) == 2 else f", strongest {group[first]} with {group[second]}"
    return f"{', '.join(group)} (correlation {with_minus(f'{block[first, second]:+.3f}')}{strongest})"


def _asked(calibration: FitResult) -> Section:
    text = (
        "What the residuals say that geometry has no word for, strongest first, each beside those above it. A gain is in nats of log "
        "evidence: odds of e to that power. What is in neither fit nor compensation is in the sigmas."
    )
    rows = tuple(stands_out_rows(calibration))
    return Section("asked", "Beside geometry", (text, Table(STANDS_OUT, rows, words=4)) if rows else ())


def _outliers(calibration: FitResult, sets: Sequence[Residuals], found: Sequence[Suspect]) -> Section:
    measured, words = calibration.read, wording_of(calibration.data)
    blocks = _left_out(fit_heading(calibration), calibration.outliers, measured, words.source)
    if calibration.together:
        blocks.append(f"{together_words(calibration)}.")
    if calibration.test_outliers:
        blocks += _left_out(test_heading(calibration), calibration.test_outliers, calibration.test_data or measured, words.source)
    limit = _limit_in_words(calibration, sets, words.limit)
    if not found:
        blocks += [f"Among the {words.used} that were used, none stands out: no {limit}"]
    else:
        blocks += [f"Used, but far from the rest; their {limit}", _suspect_table(found, words.source), *_more(len(found))]
    return Section("outliers", "Outliers", tuple(blocks))


def _left_out(heading: str, outliers: Sequence[Outlier], data: Measurements, source: str) -> list[Block]:
    if not outliers:
        return []
    rows = [group.cells() for group in outlier_groups(outliers)]
    named: tuple[tuple[Cell, ...], ...] = tuple((short_pose(pose, data.source), name, why, *figures) for name, why, *figures, pose in rows)
    columns = (COLUMNS[-1], source, COLUMNS[0], *COLUMNS[1:-1])
    return [f"{heading}; the report as .json names each.", Table(columns, named, words=3)]


def _limit_in_words(calibration: FitResult, sets: Sequence[Residuals], text: str) -> str:
    """The words of a limit with its figures: those of the first kind of reading, where the words have room for them."""
    numbers = sets[0].sensor.numbers if sets else 0
    usual = next(iter(spreads(calibration, sets).values()), 1.0)
    uncertain = " and uncertain parameters" if calibration.test_data is not None else ""
    return text.format(limit=suspect_limit(sets, numbers), spread=usual, uncertain=uncertain)


def _suspect_table(found: Sequence[Suspect], source: str) -> Table:
    in_mm = all(suspect.unit == MAIN_UNIT for suspect in found)
    rows = tuple(_suspect_row(suspect, "" if in_mm else f" {suspect.unit}") for suspect in found[:_MOST_OUTLIERS])
    return Table(("poses", "pose", source, "distance in mm" if in_mm else "distance", "sigmas"), rows, words=3)


def _suspect_row(suspect: Suspect, unit: str) -> tuple[Cell, ...]:
    return (suspect.set, suspect.pose, suspect.name, f"{fixed(suspect.distance)}{unit}", f"{suspect.length:.1f}")


def _millimetres(table: SpotTable) -> bool:
    return all(row.unit == MAIN_UNIT for row in table.values())


def _more(number: int) -> list[str]:
    return [f"{number - _MOST_OUTLIERS} more are not listed."] if number > _MOST_OUTLIERS else []
