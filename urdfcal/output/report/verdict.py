"""May this calibration be used? What a robotics engineer asks first, answered in plain words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from urdfcal.calibration.error_table import SpotTable, main_unit, rms_of
from urdfcal.calibration.result import FitResult
from urdfcal.estimation.noise import LEAST_FREEDOM
from urdfcal.model.parameters import INSTRUMENTS
from urdfcal.output.report.residuals import honest_covariance, used_share
from urdfcal.output.report.suspects import Suspect
from urdfcal.output.report.wording import wording_of
from urdfcal.output.text.instruments import noise_in_words

Level = Literal["good", "warn", "bad"]

WORSE = 1.5  # times what test poses are expected to lie off more than fitted ones
_CHANCE = 3.0  # standard deviations that are allowed for a few test poses
_ROUNDING_MM = 1e-3  # below it nothing is worse than anything else
_MANY = 0.05  # share of the spots that are left out
_FEW = 6  # names that a sentence can hold
_SUMMARY: dict[Level, str] = {
    "good": "This calibration can be used",
    "warn": "This calibration can be used, with reservations",
    "bad": "Do not use this calibration",
}


@dataclass(frozen=True)
class Finding:
    """One sentence, and whether it is good news."""

    level: Level
    text: str


@dataclass(frozen=True)
class Verdict:
    """The whole answer.

    Attributes:
        level: Of the worst finding.
        summary: In five words.
        headline: How far off the spots were, and are.
        findings: What the level rests on.
    """

    level: Level
    summary: str
    headline: str
    findings: tuple[Finding, ...]


def verdict_of(calibration: FitResult, suspects: Sequence[Suspect]) -> Verdict:
    """Judge a calibration."""
    findings = [
        _trust(calibration),
        _decided(calibration),
        *_tested(calibration),
        *_noise(calibration),
        *_left_out(calibration),
        _outlying(suspects, wording_of(calibration.data).one),
    ]
    findings += _warned(calibration.warnings)
    level = max((finding.level for finding in findings), key=["good", "warn", "bad"].index)
    return Verdict(level, _SUMMARY[level], _headline(calibration), tuple(findings))


def rough(value: float) -> str:
    """A figure for a sentence: two digits that count."""
    return "an unknown number of" if not math.isfinite(value) else f"{value:.0f}" if abs(value) >= 9.95 else f"{value:.2g}"


def count_of(number: int, noun: str) -> str:
    """`1 spot`, `2 spots`."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def means(table: SpotTable) -> str:
    """Mean distance over all lasers or targets, for each unit: `1.3 mm`, `0.45 mm and 0.06 deg`."""
    words = []
    for unit in dict.fromkeys(row.unit for row in table.values()):
        rows = [row for row in table.values() if row.unit == unit]
        words.append(f"{rough(sum(row.n * row.mean for row in rows) / max(sum(row.n for row in rows), 1))} {unit}")
    return " and ".join(words) or "0 mm"


def _headline(calibration: FitResult) -> str:
    before, after = means(calibration.before), means(calibration.after)
    tested = calibration.test[1] if calibration.test else {}
    test = f" ({means(tested)} on test poses, which were not fitted)" if tested else ""
    return f"The {wording_of(calibration.data).one}s lay {before} off on average; after calibration {after}{test}."


def _trust(calibration: FitResult) -> Finding:
    if calibration.rejection:
        return Finding("bad", f"Rejected: {calibration.rejection}.")
    return Finding("good", f"The fit converged after {count_of(len(calibration.estimate.history) - 1, 'sweep')}.")


def _decided(calibration: FitResult) -> Finding:
    if not honest_covariance(calibration):
        return Finding("warn", "The paper's schedule was used: its sigmas follow from Q and R and say nothing about accuracy.")
    seen, parameters = calibration.identifiability, calibration.errors.parameters
    own = [(parameter.name, flag) for parameter, flag in zip(parameters, seen.determined, strict=True) if parameter.kind not in INSTRUMENTS]
    total, left = len(own), [name for name, flag in own if not flag]
    what = "parameters of the robot" if total < len(parameters) else "parameters"
    if not left:
        return Finding("good", f"The data determine all {total} {what}.")
    if len(left) == total:
        return Finding("bad", f"The data determine none of the {total} {what} alone: too few measurements.")
    named = ", ".join(left[:_FEW]) + (f" and {len(left) - _FEW} more" if len(left) > _FEW else "")
    return Finding(
        "warn",
        f"The data determine {seen.rank} of {len(parameters)} directions; {len(left)} of {total} {what} are not determined alone ({named}) "
        "and are held by their priors.",
    )


def _tested(calibration: FitResult) -> list[Finding]:
    if (calibration.test is None or not calibration.test[1]) and calibration.folds is not None:
        after, folds = calibration.folds.after, calibration.folds.folds
        unit, apart, fitted = main_unit(after), rms_of(after), rms_of(calibration.after)
        text = f"Left out in turn ({folds} fits), poses are {apart:.3g} {unit} off (RMS), fitted ones {fitted:.3g} {unit}"
        worse = apart > WORSE * _expected_ratio(calibration) * max(fitted, _ROUNDING_MM)
        return [Finding("warn" if worse else "good", f"{text}{': the error model cannot follow this robot' if worse else ''}.")]
    if calibration.test is None or not calibration.test[1]:
        return [Finding("warn", "No test poses: how well other poses are predicted has not been checked.")]
    ratio, expected = rms_of(calibration.test[1]) / max(rms_of(calibration.after), 1e-12), _expected_ratio(calibration)
    spots = sum(row.n for row in calibration.test[1].values())
    by_chance = 1 + _CHANCE / math.sqrt(4 * max(spots, 1))  # an RMS of 2 n numbers scatters by 1 / sqrt(4 n)
    if ratio < WORSE * expected * by_chance or rms_of(calibration.test[1]) < _ROUNDING_MM:
        return [Finding("good", f"Test poses are predicted as well as can be expected: {ratio:.2f} times the RMS of the fitted poses.")]
    text = f"Test poses are {ratio:.3g} times as far off (RMS) as fitted ones, where {expected:.2f} times can be expected"
    return [Finding("warn", f"{text}: the fitted poses do not cover them, or the error model cannot follow this robot.")]


def _expected_ratio(calibration: FitResult) -> float:
    """Of test to fitted RMS when p of n numbers went into the parameters: sqrt((1 + p/n) / (1 - p/n))."""
    share = min(used_share(calibration), 0.99)
    return math.sqrt((1 + share) / (1 - share))


def _sentence(words: str) -> str:
    return f"{words[0].upper()}{words[1:]}."


def _noise(calibration: FitResult) -> list[Finding]:
    noise = calibration.estimate.noise
    if calibration.rejection or not honest_covariance(calibration):
        return []
    if calibration.disagreements:
        return [Finding("warn", _sentence(words)) for words in calibration.disagreements]
    if calibration.extra_noise:
        return [Finding("warn", f"Readings scatter more than they state: {noise_in_words(calibration)}.")]
    if not noise.all_stated and calibration.freedom < LEAST_FREEDOM:
        return [Finding("warn", f"Too few measurements to estimate their noise: {noise_in_words(calibration)}.")]
    if not noise.all_stated:
        return [Finding("good", _sentence(noise_in_words(calibration)))]
    return [Finding("good", f"Residuals agree with the stated noise: chi-square is {calibration.chi_squared:.3g} per degree of freedom.")]


def _left_out(calibration: FitResult) -> list[Finding]:
    """A few outliers are everyday life."""
    number, spots = len(calibration.outliers), sum(row.n for row in calibration.after.values())
    if not number:
        return []
    text = f"{count_of(number, wording_of(calibration.data).one)} left out or mended as outliers; the fit rests on {spots}."
    return [Finding("warn" if number > _MANY * (number + spots) else "good", text)]


def _outlying(suspects: Sequence[Suspect], noun: str) -> Finding:
    if not suspects:
        return Finding("good", f"No {noun} that was used stands out from the rest.")
    worst = suspects[0]
    farthest = f"{worst.set} pose {worst.pose}, {worst.name}, {rough(worst.distance)} {worst.unit}"
    return Finding("warn", f"{count_of(len(suspects), noun)} far from the rest; the farthest: {farthest}.")


def _warned(warnings: Sequence[str]) -> list[Finding]:
    if len(warnings) < 2:
        return [Finding("warn", f"Warning: {warning}.") for warning in warnings]
    return [Finding("warn", f"{len(warnings)} warnings, listed below.")]
