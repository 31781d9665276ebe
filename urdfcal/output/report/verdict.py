"""What stands first in a report: may this calibration be used, how far off is it, and what does that rest on? In plain words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from urdfcal.base.terminal import many
from urdfcal.calibration.analysis.prediction import SpotAccuracy
from urdfcal.calibration.analysis.verdict import Use, Verdict, honest_covariance, verdict_of
from urdfcal.calibration.error_table import main_unit, rms_of
from urdfcal.calibration.result import FitResult
from urdfcal.estimation.noise import LEAST_FREEDOM
from urdfcal.model.parameters import INSTRUMENTS
from urdfcal.output.report.document import Table
from urdfcal.output.report.suspects import Suspect
from urdfcal.output.text.headline import headline, rough
from urdfcal.output.text.instruments import noise_in_words
from urdfcal.output.text.verdict import FIGURES, PREDICTED, accuracy_rows, constant_words, rough_mm, verdict_words
from urdfcal.output.text.wording import wording_of

Level = Literal["good", "note", "warn", "bad"]

_LEVELS: dict[Use, Level] = {"yes": "good", "reservations": "warn", "no": "bad"}
_FEW = 6  # names that a sentence can hold


@dataclass(frozen=True)
class Sentence:
    """One sentence, and whether it is good news, bad, or neither."""

    level: Level
    text: str


@dataclass(frozen=True)
class Opening:
    """What stands first.

    Attributes:
        level: Of the verdict.
        summary: The verdict, as the terminal has it.
        headline: How far off the readings were, and are.
        findings: The verdict's reasons, what would help, and what else there is to know of it.
        predicted: Table of the predicted accuracy, with what stands under it; None where nothing is predicted.
        constant: What the constant may be that it leaves out.
    """

    level: Level
    summary: str
    headline: str
    findings: tuple[Sentence, ...]
    predicted: Table | None
    constant: str


def opening_of(calibration: FitResult, suspects: Sequence[Suspect], spots: SpotAccuracy | None = None) -> Opening:
    """Say whether a calibration may be used, and how far off the spots are predicted to be over the workspace, if that is known."""
    verdict = verdict_of(calibration)
    level, rejected = _LEVELS[verdict.use], bool(calibration.rejection)
    findings = [
        *(Sentence(level, _sentence(reason)) for reason in verdict.reasons),
        *(Sentence("note", _sentence(advice)) for advice in verdict.advice),
        *([] if rejected else _good(calibration)),
        *_noted(calibration),
        _outlying(suspects, wording_of(calibration.data).one),
        *_warned(calibration.warnings),
    ]
    table, constant = _predicted(verdict, spots)
    return Opening(level, verdict_words(verdict), headline(calibration), tuple(findings), table, constant)


def _predicted(verdict: Verdict, spots: SpotAccuracy | None) -> tuple[Table | None, str]:
    rows = (*accuracy_rows(verdict), *_spot_rows(spots))
    groups = (("", 1), ("before", 3), ("after", 3))
    table = Table((PREDICTED, *FIGURES, *FIGURES), rows, groups=groups) if rows else None
    return table, f"{constant_words(verdict.tool)}." if verdict.tool is not None else ""


def _spot_rows(spots: SpotAccuracy | None) -> Iterator[tuple[str, ...]]:
    """What is predicted of each laser's spots anywhere in the workspace; of the nominal robot nothing is."""
    if spots is None:
        return
    for laser, *figures in zip(spots.lasers, spots.median.tolist(), spots.most.tolist(), spots.worst.tolist(), strict=True):
        yield (f"spots of {laser} over the workspace", "–", "–", "–", *map(rough_mm, figures))


def _good(calibration: FitResult) -> Iterator[Sentence]:
    """What speaks for it."""
    yield Sentence("good", f"The fit converged after {many(len(calibration.estimate.history) - 1, 'sweep')}.")
    yield from _tested(calibration)
    noise = calibration.estimate.noise
    if not honest_covariance(calibration) or calibration.disagreements or calibration.extra_noise:
        return
    if noise.all_stated:
        yield Sentence("good", f"Residuals agree with the stated noise: chi-square is {calibration.chi_squared:.3g} per degree of freedom.")
    elif calibration.freedom >= LEAST_FREEDOM:
        yield Sentence("good", _sentence(noise_in_words(calibration)))


def _tested(calibration: FitResult) -> Iterator[Sentence]:
    """How far off poses are that were not fitted; where that is too far the verdict says so."""
    tables = [(calibration.test[1], "Test poses")] if calibration.test and calibration.test[1] else []
    if calibration.folds is not None:
        tables.append((calibration.folds.after, f"Poses left out in turn ({calibration.folds.folds} fits)"))
    for table, what in tables:
        unit, fitted = main_unit(table), rms_of(calibration.after)
        yield Sentence("note", f"{what} are {rms_of(table):.3g} {unit} off (RMS), fitted ones {fitted:.3g} {unit}.")
    if not tables:
        yield Sentence("note", "No test poses: how well other poses are predicted has not been checked.")


def _noted(calibration: FitResult) -> Iterator[Sentence]:
    """What whoever reads the numbers ought to know."""
    if honest_covariance(calibration):
        yield _decided(calibration)
    number, used = len(calibration.outliers), sum(row.n for row in calibration.after.values())
    if number:
        words = f"{many(number, wording_of(calibration.data).one)} left out or mended as outliers; the fit rests on {used}."
        yield Sentence("note", words)


def _decided(calibration: FitResult) -> Sentence:
    seen, parameters = calibration.identifiability, calibration.errors.parameters
    own = [(parameter.name, flag) for parameter, flag in zip(parameters, seen.determined, strict=True) if parameter.kind not in INSTRUMENTS]
    total, left = len(own), [name for name, flag in own if not flag]
    what = "parameters of the robot" if total < len(parameters) else "parameters"
    if not left:
        return Sentence("good", f"The data determine all {total} {what}.")
    named = ", ".join(left[:_FEW]) + (f" and {len(left) - _FEW} more" if len(left) > _FEW else "")
    return Sentence(
        "note",
        f"The data determine {seen.rank} of {len(parameters)} directions; {len(left)} of {total} {what} are not determined alone ({named}) "
        "and are held by their priors.",
    )


def _warned(warnings: Sequence[str]) -> Iterator[Sentence]:
    if warnings:
        yield Sentence("note", f"{many(len(warnings), 'warning')}, listed below.")


def _sentence(words: str) -> str:
    return f"{words[0].upper()}{words[1:]}."


def _outlying(suspects: Sequence[Suspect], noun: str) -> Sentence:
    if not suspects:
        return Sentence("good", f"No {noun} that was used stands out from the rest.")
    worst = suspects[0]
    farthest = f"{worst.set} pose {worst.pose}, {worst.name}, {rough(worst.distance)} {worst.unit}"
    return Sentence("note", f"{many(len(suspects), noun)} far from the rest; the farthest: {farthest}.")
