"""May this calibration be used? One answer, from which terminal, reports, `--json` and the exit code all take theirs.

Every *concern* is a small function that looks at one side of a fit and yields what it finds: `no` where the result must not be used,
`reservations` where whoever uses it has to know of something that matters. The worst one decides.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np

from urdfcal.base.errors import FitRejected
from urdfcal.base.foreign_text import shown
from urdfcal.base.geometry import DEG, MM
from urdfcal.base.notebook import Tone
from urdfcal.base.terminal import many, rounded
from urdfcal.calibration.analysis.clusters import usual_tables
from urdfcal.calibration.analysis.concerns import objections, reservations
from urdfcal.calibration.analysis.full_posterior import FullPosterior, full_posterior
from urdfcal.calibration.analysis.prediction import default_far, default_tool, spot_jacobians
from urdfcal.calibration.analysis.tool_accuracy import Gain, ToolAccuracy, tool_accuracy
from urdfcal.calibration.error_table import SpotTable, main_unit, rms_in_words, rms_of
from urdfcal.calibration.result import FitResult, large_noise_warning, large_scales_warning, misfit_words, too_few_warning
from urdfcal.model.parameters import DEFAULT_PRIORS
from urdfcal.sensors.sensor import MAIN_UNIT

Use = Literal["yes", "reservations", "no"]
TONES: dict[Use, Tone] = {"yes": "good", "reservations": "warn", "no": "bad"}
SUMMARY: dict[Use, str] = {"yes": "can be used", "reservations": "can be used, with reservations", "no": "do not use"}

CLEARLY, SURELY = 0.97, 0.99  # probabilities of being better than the nominal robot
_CLEAR = 0.9  # share of the nominal robot's error, from which what is predicted is not clearly below it
_MUCH, _LIKELY, _AS_LIKELY_AS_NOT = 0.6, 0.9, 0.5
_HALF = 0.5  # share of the nominal robot's error, beyond which calibration brought little
_GOOD = 1 / 3  # share of the nominal robot's error that makes a good calibration
_ORDER: tuple[Use, ...] = ("yes", "reservations", "no")
_FIFTH = 0.2  # of the chi-squared that was stated
_FAR_OFF = 5.0  # times the usual size of a joint's errors, beyond which no robot is made
_FAR, _FARTHER = 1.5, 3.0  # times what is predicted of poses that were not fitted
_ROUNDING_MM = 1e-3  # below it nothing is worse than anything else
_CHANCE = 3.0  # standard deviations that are allowed for a few test readings


@dataclass(frozen=True)
class Finding:
    """What one concern found.

    Attributes:
        use: How grave it is.
        words: What it is.
        more: Whether more poses of the same kind would help.
    """

    use: Use
    words: str
    more: bool = False


@dataclass(frozen=True, repr=False)
class Verdict:
    """May this calibration be used?

    Attributes:
        use: `yes`, `reservations` or `no`.
        reasons: Why not, or what has to be known; of a calibration that must not be used only what forbids it.
        tool: Predicted accuracy of the link that the verdict is about; None where the fit says nothing of it.
        advice: What would make it better.
        spots: Predicted error of the spots at the fitted poses, without the noise of seeing them; None where no laser was seen.
    """

    use: Use
    reasons: tuple[str, ...] = ()
    tool: ToolAccuracy | None = field(default=None, compare=False)
    advice: tuple[str, ...] = ()
    spots: Gain | None = field(default=None, compare=False)

    def __repr__(self) -> str:
        """In a line."""
        return f"<{type(self).__name__}: {shown(self.words)}>"

    def _repr_html_(self) -> str:
        from urdfcal.base.notebook import card

        return card(self.summary, (*self.reasons, *self.advice), tone=TONES[self.use])

    @property
    def summary(self) -> str:
        """`can be used`, `can be used, with reservations` or `do not use`."""
        return SUMMARY[self.use]

    @property
    def words(self) -> str:
        """The same with its reasons."""
        return f"{self.summary}: {'; '.join(self.reasons)}" if self.reasons else self.summary

    def entry(self) -> dict[str, object]:
        """For machines."""
        return {"use": self.use, "reasons": list(self.reasons), "advice": list(self.advice)}

    def require_usable(self, beside: tuple[str, ...] = ()) -> None:
        """Raise if the calibration must not be used.

        Args:
            beside: What else the user ought to know then.

        Raises:
            FitRejected: says why.
        """
        if self.use == "no":
            raise FitRejected("; ".join((*self.reasons, *self.advice, *beside)))


@dataclass(frozen=True)
class Judged:
    """A fit, and what several concerns want to know of it.

    Attributes:
        found: The fit.
        link: The link that the verdict is about.
    """

    found: FitResult
    link: str

    @cached_property
    def posterior(self) -> FullPosterior:
        """What the data leave of every error of the robot."""
        return full_posterior(self.found)

    @cached_property
    def tool(self) -> ToolAccuracy:
        """Predicted accuracy of the link."""
        far = not self.found.tool and default_far(self.found.robot)
        return tool_accuracy(self.found.robot, self.posterior, self.link, np.random.default_rng(0), far)

    @cached_property
    def spots(self) -> Gain | None:
        """Predicted error of the spots at the fitted poses, without the noise of seeing them; None where no laser was seen."""
        if not self.found.data.has_spots:
            return None
        A = spot_jacobians(self.posterior.errors, self.posterior.x, self.found.data.q)
        A = A.reshape(-1, *A.shape[2:])
        return Gain.of(A[np.isfinite(A).all(axis=(1, 2))], self.posterior)


_KEPT = "verdict kept"
Concern = Callable[[Judged], Iterator[Finding]]


def verdict_of(found: FitResult) -> Verdict:
    """Judge a calibration, about the link that it names, or about the module, target or screen that the calibrated joints carry.

    Terminal, reports, machines and exit code ask for it: it is kept with the fit, as what `cached_property` keeps.
    """
    kept = vars(found)
    if _KEPT not in kept:
        kept[_KEPT] = _verdict_of(found)
    verdict: Verdict = kept[_KEPT]
    return verdict


def _verdict_of(found: FitResult) -> Verdict:
    judged = Judged(found, found.tool or default_tool(found.robot))
    if not (found.converged and np.isfinite(found.x).all() and np.isfinite(found.covariance).all()):
        return Verdict("no", (found.rejection or "the fit gave no finite result",))
    findings = list(_rejected(judged)) or [finding for concern in CONCERNS for finding in concern(judged)]
    more = all(finding.more for finding in findings if finding.use != "yes")
    use: Use = max((finding.use for finding in findings), key=_ORDER.index, default="yes")
    reasons = tuple(dict.fromkeys(finding.words for finding in findings if finding.use == use))
    if found.frames_alone:  # of a robot that was taken to be right nothing is predicted
        return Verdict(use, reasons)
    return Verdict(use, reasons, judged.tool, tuple(_advice(judged, use)) if more else (), judged.spots)


def _rejected(judged: Judged) -> Iterator[Finding]:
    """The fit itself went wrong."""
    if judged.found.rejection:
        yield Finding("no", judged.found.rejection)


def _few_numbers(judged: Judged) -> Iterator[Finding]:
    """Fewer numbers than unknowns, readings of one pose counted once: whatever comes out is the priors'."""
    data, errors = judged.found.data, judged.found.errors
    read = data.numbers + len(data.lengths) + len(errors.known_rows)
    if read < len(errors.names):
        found = f"{many(read, 'number')} {'was' if read == 1 else 'were'} read at {data.counted}"
        yield Finding("no", f"{found}, fewer than the {many(len(errors.names), 'unknown')}", more=True)


def _stated_noise(judged: Judged) -> Iterator[Finding]:
    """Readings that scatter otherwise than was stated of them."""
    found = judged.found
    for kind, stated in zip(found.kinds, found.estimate.noise.stated.tolist(), strict=True):
        own = found.misfits[kind]
        if not own.odd or not (stated or kind in found.stating or found.estimate.noise.of_joints):
            continue
        words = misfit_words(found.misfits, kind, stated or kind in found.stating)
        low = own.chi_squared < _FIFTH
        yield Finding("no" if low else "reservations", f"{words}{'; is the noise stated in another unit?' if low else ''}")
    if found.extra_noise:
        scatter = ", ".join(f"{kind} {value:.2g}" for kind, value in found.extra_noise.items())
        yield Finding("reservations", f"readings scatter more than they state ({scatter} beyond it, in SI)")


def _frames_alone(judged: Judged) -> Iterator[Finding]:
    """Where every joint was held the robot is no better than it was, and was not meant to be: what was found are frames."""
    if judged.found.frames_alone:
        yield Finding(
            "reservations", "nothing of the robot was estimated, frames alone were: their sigmas hold only where its joints are right"
        )


def _is_better(judged: Judged) -> Iterator[Finding]:
    """What the user cares about is not clearly nearer to the truth than with the nominal robot.

    Spots, and a link up to a constant, are what was measured. Where the link is in the base frame, measuring frames and targets that
    are free do not tell: unless that very link was asked for it is enough that it is not likely to be worse, and how likely is said.
    """
    if judged.found.frames_alone:
        return
    tool, asked = judged.tool, bool(judged.found.tool)
    cases = [
        (f"{tool.link} in the frame of {tool.base}", tool.in_base, _LIKELY if asked else _AS_LIKELY_AS_NOT),
        (f"{tool.link} up to a constant", tool.up_to_constant, CLEARLY),
    ]
    cases += [("the spots", judged.spots, CLEARLY)] if judged.spots is not None else []
    if judged.found.data.only_angles:
        yield from _turns_better(tool)
        return
    for what, gain, least in cases:
        off, nominal = _mm(gain.after.rms), _mm(gain.before.rms)
        clear = gain.better >= least and (gain.left < _CLEAR or (gain is tool.in_base and not asked))
        if not clear and gain is tool.up_to_constant and _constants_were_wrong(judged):
            continue  # the shape was right already, and what was wrong is a constant that the data tell
        if not clear:
            yield Finding("no", f"{what}: predicted {off} off, which is not clearly below the nominal robot's {nominal}", more=True)
        elif gain.better < SURELY:
            yield Finding(
                "reservations", f"{what}: predicted {off} off, the nominal robot {nominal}; {gain.better:.0%} sure to be better", more=True
            )
    if tool.up_to_constant.left > _HALF and not _constants_were_wrong(judged):
        off, nominal = _mm(tool.up_to_constant.after.rms), _mm(tool.up_to_constant.before.rms)
        yield Finding(
            "reservations", f"{tool.link} is predicted {off} off up to a constant, much of the nominal robot's {nominal}", more=True
        )


def _constants_were_wrong(judged: Judged) -> bool:
    """Whether the link is surely and much nearer in the base frame, and as likely as not no farther up to a constant."""
    whole, apart = judged.tool.in_base, judged.tool.up_to_constant
    return whole.better >= SURELY and whole.left < _MUCH and apart.better >= _AS_LIKELY_AS_NOT


def _turns_better(tool: ToolAccuracy) -> Iterator[Finding]:
    """Of a link that was seen to turn and never to move: angles tell no lengths."""
    gain, mrad = tool.turning, 1e-3
    if not (gain.better >= CLEARLY and gain.left < _CLEAR):
        off, nominal = gain.after.rms / mrad, gain.before.rms / mrad
        yield Finding(
            "no",
            f"{tool.link}: predicted {rounded(off, 2)} mrad off, which is not clearly below the nominal robot's {rounded(nominal, 2)} mrad",
        )
    else:
        yield Finding(
            "reservations", f"angles alone tell no lengths: {tool.link} stays {_mm(tool.in_base.after.rms)} off in the base frame"
        )


def _tested(judged: Judged) -> Iterator[Finding]:
    """Poses that were not fitted; a few scattered bad readings among them are said on their own."""
    found = judged.found
    usual = usual_tables(found)
    if found.test is not None and found.test[1]:
        yield from _compared(found, *usual.get("test", found.test), "test readings")
    if found.folds is not None and found.folds.after:
        tables = usual.get("k-fold", (found.folds.before, found.folds.after))
        yield from _compared(found, *tables, f"readings left out in turn ({found.folds.folds} fits)")


def _compared(found: FitResult, before: SpotTable, after: SpotTable, what: str) -> Iterator[Finding]:
    """Whether poses that were not fitted are off by more than the nominal robot's, or than can be expected."""
    off, least = rms_of(after), _ROUNDING_MM if main_unit(after) == MAIN_UNIT else 0.0
    if not found.frames_alone and off > max(_CLEAR * rms_of(before), least):
        nearer = "" if off > max(rms_of(before), least) else "hardly nearer than "
        nominal = f"with the nominal robot{',' if nearer else ''} {rms_in_words(before)}"
        yield Finding("no", f"{what} are {rms_in_words(after)} off (RMS), {nearer}{nominal}")
        return
    expected = expected_ratio(found) * max(rms_of(found.after), least, 1e-12)
    times, readings = off / expected, sum(row.n for row in after.values())
    by_chance = 1 + _CHANCE / math.sqrt(4 * max(readings, 1))  # an RMS of 2 n numbers scatters by 1 / sqrt(4 n)
    if off > least and times > _FAR * by_chance:
        words = f"{what} are {rms_in_words(after)} off (RMS), {rounded(times, 2)} times what can be expected"
        yield Finding("no" if times > _FARTHER * by_chance else "reservations", words)


def expected_ratio(found: FitResult) -> float:
    """Of test to fitted RMS when p of n numbers went into the parameters: sqrt((1 + p/n) / (1 - p/n))."""
    share = min(used_share(found), 0.99)
    return math.sqrt((1 + share) / (1 - share))


def used_share(found: FitResult) -> float:
    """Which part of the numbers that were fitted the parameters used up: p - tr(P P0^-1) of them."""
    measured = found.data.numbers
    used = max(measured - found.freedom, 0.0) if honest_covariance(found) else float(found.identifiability.rank)
    return used / max(measured, 1)


def honest_covariance(found: FitResult) -> bool:
    """Whether sigmas are statements about accuracy; those of the paper's schedule are the filter's own."""
    return "paper" not in found.estimator


def _residuals(judged: Judged) -> Iterator[Finding]:
    """What the readings themselves say against it, those included that were left out."""
    for words in objections(judged.found):
        yield Finding("no", words)
    for words in reservations(judged.found):
        yield Finding("reservations", words)


def _assumed(judged: Judged) -> Iterator[Finding]:
    """What a figure rests on that nobody measured."""
    found = judged.found
    if not honest_covariance(found):
        yield Finding("reservations", "the paper's schedule was used: its sigmas follow from Q and R and say nothing about accuracy")
    for words in too_few_warning(found.data, found.estimate.noise, found.freedom):
        yield Finding("reservations", words, more=True)
    for words in (*large_noise_warning(found), *large_scales_warning(found.evidence)):
        yield Finding("reservations", words)


def _far_off(judged: Judged) -> Iterator[Finding]:
    """Joints that were found where no maker puts them: the URDF is another robot's, or what was measured is on another link."""
    slides = tuple(f"{joint.name}." for joint in judged.found.robot.chain.inputs if joint.prismatic)  # where one begins may be anywhere
    usual, far = DEFAULT_PRIORS["joint"], []
    for parameter, value, sigma in zip(judged.found.errors.parameters, judged.found.x.tolist(), judged.found.sigma.tolist(), strict=True):
        if (
            parameter.kind == "joint"
            and abs(value) > _FAR_OFF * max(usual.sigma(parameter.unit), sigma)
            and not parameter.name.startswith(slides)
        ):
            far.append(f"{parameter.name} {value / MM:.0f} mm" if parameter.unit == "m" else f"{parameter.name} {value / DEG:.1f} deg")
    if far:
        yield Finding("reservations", f"joints were found far off the URDF ({', '.join(far[:3])}); is it this robot's, and the link right?")


CONCERNS: tuple[Concern, ...] = (_few_numbers, _stated_noise, _frames_alone, _is_better, _tested, _residuals, _far_off, _assumed)


def _advice(judged: Judged, use: Use) -> Iterator[str]:
    """How many poses of the same kind would do."""
    tool = judged.tool
    if use == "yes" or tool.up_to_constant.left < _HALF:
        return
    needed = tool.poses_for(_GOOD, judged.found.data.pose_count)
    yield (
        f"more poses: about {needed} of the same kind would bring {tool.link} under {_GOOD:.0%} of the nominal robot's error"
        if needed
        else "more poses of the same kind would not do; move every joint through more of its range"
    )


def _mm(length: float) -> str:
    return f"{length / MM:.2g} mm" if length < 0.1 else f"{length / MM:.0f} mm"
