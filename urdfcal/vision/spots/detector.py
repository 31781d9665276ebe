"""Laser spots in a picture, to sub-pixel, and why everything else is none.

A candidate is a spot when all of this holds:

    inside       it is not cut by the picture's edge, and its neighbourhood is not clipped away
    small, round its width and elongation are a spot's
    light        it adds light: it is not print, which takes the other colours away
    colour       its flanks, where nothing is clipped, have the laser's colour; those of lamps and glare are neutral
    peak         it stands out from its own neighbourhood by many times that neighbourhood's noise
    shape        a Gaussian with a halo explains it
    strength     it is not far weaker than the brightest spot of its colour, as reflections of a spot are

What fails is kept with its reason. What a picture alone cannot tell from a spot, such as the small lamp of a switch, is left to the dark
picture and to `series`, which knows that spots move from pose to pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Matrix, Vector
from urdfcal.vision.pictures import Picture
from urdfcal.vision.spots.centre import FittedSpot, fit_spot
from urdfcal.vision.spots.search import COLOURS, Candidate, candidates

_FLAT = 3.0  # a neighbourhood whose neutral light varies by more than so many noises is not flat
_VAGUE = 1.0  # [px]: a centre known no better than that is none
_CLIPPED_WELL = 0.1  # of the area at half height
_CORE_PIXELS, _LOPSIDED = 12, 0.4  # a clipped core has a middle from so many pixels on; it may be off by so much of its radius
_LEAST_WIDTH = 0.3  # [px]: a hot pixel is narrower than any lens makes a spot


@dataclass(frozen=True)
class SpotLimits:
    """What a spot can be.

    Attributes:
        largest: Greatest standard width along the longer axis, [px].
        unclipped: The same where the core is not clipped, of `largest`: laser light that spreads widely is bright, a reflection is not.
        elongation: Greatest ratio of the axes: beams and camera at 60 deg make 4.
        peak: Least height over the neighbourhood, in its noise.
        height: The same in grey levels of 255.
        taken: Greatest loss of the other two colours together, of the gain in the laser's: cameras' colour correction takes some.
        neutral: Greatest mean gain of the other two colours, of the gain in the laser's.
        neutral_one: The same for the larger of the two.
        explained: Least share of the light's variation that the fitted spot explains.
        explained_clipped: The same where the core is well clipped.
        misfit: Greatest RMS residual near the centre, of the height.
        misfit_clipped: The same where the core is well clipped.
        strength: Least light, of the brightest spot of the same colour in the picture.
        speckle: Uncertainty of the centre that no fit sees, of the spot's width.
        clipping: The same, of the radius of the clipped core.
    """

    largest: float = 15.0
    unclipped: float = 1 / 3
    elongation: float = 4.5
    peak: float = 12.0
    height: float = 10.0
    taken: float = 0.45
    neutral: float = 0.45
    neutral_one: float = 0.72
    explained: float = 0.75
    misfit: float = 0.09
    misfit_clipped: float = 0.25
    explained_clipped: float = 0.5
    strength: float = 0.12
    speckle: float = 0.01
    clipping: float = 0.01


@dataclass(frozen=True, eq=False)
class PixelSpot:
    """A laser spot in a picture.

    Attributes:
        colour: red, green or blue.
        centre: (u, v), [px]; (0, 0) is the centre of the first pixel.
        covariance: (2, 2), [px^2].
        width: Standard width along the longer axis, [px].
        light: Excess of the laser's colour over the neighbourhood, summed; clipped where the picture is.
        clipped: Pixels of the core that are at full scale.
        peak: Height over the neighbourhood, in its noise.
    """

    colour: str
    centre: Vector
    covariance: Matrix
    width: float
    light: float
    clipped: int
    peak: float


@dataclass(frozen=True, eq=False)
class RefusedSpot:
    """A candidate that is no spot.

    Attributes:
        centre: (u, v), [px].
        reason: Why.
        height: How much it stood out, of 255.
    """

    centre: Vector
    reason: str
    height: float


@dataclass(frozen=True, eq=False)
class Sighting:
    """What was found in a picture.

    Attributes:
        spots: The brightest first.
        refused: The highest first.
    """

    spots: tuple[PixelSpot, ...]
    refused: tuple[RefusedSpot, ...]


def find_spots(picture: Picture, colours: Sequence[str] = ("red", "green"), limits: SpotLimits | None = None) -> Sighting:
    """Find every laser spot in a picture.

    Args:
        picture: The picture, perhaps with a dark picture taken off.
        colours: Which lasers there can be: red, green, blue.
        limits: What a spot can be.
    """
    limits = limits or SpotLimits()
    found: list[PixelSpot] = []
    refused: list[RefusedSpot] = []
    for colour in dict.fromkeys(colours):
        for candidate in candidates(picture, COLOURS.index(colour), 1.6 * limits.largest):
            judged = _Window(picture, candidate, limits).judge()
            (found if isinstance(judged, PixelSpot) else refused).append(judged)  # type: ignore[arg-type]
    spots, weaker = _strong_ones(found, limits)
    return Sighting(tuple(spots), tuple(sorted([*refused, *weaker], key=lambda other: -other.height)))


def _strong_ones(found: list[PixelSpot], limits: SpotLimits) -> tuple[list[PixelSpot], list[RefusedSpot]]:
    kept: list[PixelSpot] = []
    refused: list[RefusedSpot] = []
    for spot in sorted(found, key=lambda spot: -spot.light):
        same = [other for other in kept if other.colour == spot.colour]
        close = [other for other in kept if np.linalg.norm(other.centre - spot.centre) < 3 * max(other.width, spot.width)]
        if same and spot.light < limits.strength * same[0].light:
            refused.append(RefusedSpot(spot.centre, f"{spot.light / same[0].light:.0%} of the brightest spot's light", 0.0))
        elif close:
            refused.append(RefusedSpot(spot.centre, "part of a brighter spot", 0.0))
        else:
            kept.append(spot)
    return kept, refused


class _Window:
    """A candidate's neighbourhood, and the tests in order of their cost."""

    def __init__(self, picture: Picture, candidate: Candidate, limits: SpotLimits) -> None:
        half = int(np.ceil(3.2 * candidate.radius + 5))
        u, v = round(candidate.u), round(candidate.v)
        self.left, self.above = max(u - half, 0), max(v - half, 0)
        self.light = np.asarray(picture.light[self.above : v + half + 1, self.left : u + half + 1], dtype=float)
        self.clipped = picture.clipped[self.above : v + half + 1, self.left : u + half + 1]
        self.candidate, self.limits, self.size = candidate, limits, picture.size
        self.others = [channel for channel in range(3) if channel != candidate.colour]
        rows, columns = np.mgrid[: self.light.shape[0], : self.light.shape[1]]
        self.away = np.hypot(columns - (candidate.u - self.left), rows - (candidate.v - self.above))

    def judge(self) -> PixelSpot | RefusedSpot:
        """The spot, or why there is none."""
        reason = self._surroundings() or self._light_and_colour()
        if reason:
            return self._refused(reason)
        fitted = self._fit()
        if fitted is None:
            return self._refused("no spot could be fitted")
        reason = self._shape(fitted)
        return self._refused(reason) if reason else self._spot(fitted)

    def _refused(self, reason: str) -> RefusedSpot:
        return RefusedSpot(np.array([self.candidate.u, self.candidate.v]), reason, self.candidate.height)

    def _surroundings(self) -> str:
        """Background and noise of the ring around the candidate; refuses where there is no ring."""
        ring = (self.away > 2.4 * self.candidate.radius + 2) & ~self.clipped.any(axis=2)
        if ring.sum() < 0.3 * (self.away > 2.4 * self.candidate.radius + 2).sum():
            return "in the middle of clipped light"
        self.ring = ring
        values = self.light[ring]
        self.level = np.median(values, axis=0)
        self.noise = np.maximum(1.4826 * np.median(np.abs(values - self.level), axis=0), 0.5)
        colour = self.candidate.colour
        self.grain = _grain(self.light[..., colour], ring)
        opponent = self.light[..., colour] - self.light[..., self.others].mean(axis=2)
        self.opponent_level = float(np.median(opponent[ring]))
        self.opponent = opponent - self.opponent_level
        self.opponent_noise = max(1.4826 * float(np.median(np.abs(self.opponent[ring]))), 0.5)
        self.gain = self.light - self.level
        self.clipped_core = int((self.clipped[..., colour] & (self.away < 1.6 * self.candidate.radius + 2)).sum())
        return ""

    def _light_and_colour(self) -> str:
        """Whether the flanks add light, and of the laser's colour."""
        colour, limits = self.candidate.colour, self.limits
        near = self.away < 1.8 * self.candidate.radius + 2
        flank = near & ~self.clipped[..., colour]
        top = float(self.opponent[flank].max(initial=0.0))
        flank &= self.opponent > 0.25 * top
        if flank.sum() < 3 or top < max(limits.peak * self.opponent_noise, limits.height):
            return f"{top / self.opponent_noise:.1f} noises high"
        flat = bool((self.noise < _FLAT * self.opponent_noise).all())
        self.flat = flat
        self.top = top
        own = float(self.gain[..., colour][flank].sum())
        other = self.gain[..., self.others][flank].sum(axis=0)
        unsure = 0.0 if flat else 1.5 * float(flank.sum()) * self.noise[self.others]
        if own <= 0 or (other + unsure).sum() < -limits.taken * own:
            return "takes light away as print does"
        if other.mean() > limits.neutral * own or other.max() > limits.neutral_one * own:
            return "flanks are neutral as a lamp's or glare's"
        if not flat and self.light[..., colour][near].max() < float(np.quantile(self.light[..., colour][self.ring], 0.9)) + limits.height:
            return "no brighter than what is around it"
        return ""

    def _fit(self) -> FittedSpot | None:
        colour = self.candidate.colour
        start = np.array([self.candidate.u - self.left, self.candidate.v - self.above])
        if self.flat:
            order = [colour, *self.others]
            return fit_spot(
                np.moveaxis(self.gain[..., order], 2, 0),
                ~np.moveaxis(self.clipped[..., order], 2, 0),
                start,
                self.candidate.radius,
                self.grain,
            )
        return fit_spot(self.opponent[None], np.asarray(~self.clipped.any(axis=2))[None], start, self.candidate.radius, self.grain)

    def _shape(self, fitted: FittedSpot) -> str:
        """Whether the fitted light is where, as large, as round and as smooth as a spot's."""
        limits, (longer, shorter) = self.limits, fitted.widths
        at = fitted.centre + np.array([self.left, self.above])
        wandered = np.linalg.norm(at - np.array([self.candidate.u, self.candidate.v])) > self.candidate.radius + 1.5
        if fitted.core[0] <= 0 or wandered:
            return "no peak"
        if float(np.minimum(at - 1, np.array(self.size) - 2 - at).min()) < shorter:
            return "cut by the picture's edge"
        share = self._clipped_share(fitted)
        if longer > limits.largest * _between(limits.unclipped, 1.0, share):
            return f"{longer:.0f} px wide{' and hardly clipped' if longer <= limits.largest else ''}"
        if shorter < _LEAST_WIDTH:
            return "a single pixel"
        if longer > limits.elongation * max(shorter, 0.7):
            return f"{longer / shorter:.1f} times as long as wide"
        noisy = 2.5 * self.grain
        if fitted.misfit > max(_between(limits.misfit, limits.misfit_clipped, share) * self.top, noisy):
            return "no spot's shape"
        if fitted.explained < _between(limits.explained, limits.explained_clipped, share):
            return f"a spot explains {max(fitted.explained, 0):.0%} of it"
        if np.sqrt(np.linalg.eigvalsh(fitted.covariance)[-1]) > _VAGUE:
            return "too faint to be placed"
        return ""

    def _clipped_share(self, fitted: FittedSpot) -> float:
        """How far the core is clipped, 0 to 1: print and objects rarely are, and what is may be misshapen by the camera."""
        half = np.pi * 2 * np.log(2) * float(np.prod(fitted.widths))
        return float(min(self.clipped_core / (_CLIPPED_WELL * half), 1.0))

    def _spot(self, fitted: FittedSpot) -> PixelSpot:
        """The spot, with what no fit sees added to its covariance."""
        near = self.away < 2.4 * self.candidate.radius + 2
        centre, between = self._with_core(fitted)
        unseen = self.limits.speckle**2 * fitted.shape + (self.limits.clipping**2 * self.clipped_core / np.pi + between**2) * np.eye(2)
        return PixelSpot(
            COLOURS[self.candidate.colour],
            centre + np.array([self.left, self.above]),
            fitted.covariance + unseen,
            float(fitted.widths[0]),
            float(np.clip(self.gain[..., self.candidate.colour], 0, None)[near].sum()),
            self.clipped_core,
            self.top / self.opponent_noise,
        )

    def _with_core(self, fitted: FittedSpot) -> tuple[Vector, float]:
        """The centre and how far flanks and clipped core disagree, halved: where they do, the halo is lopsided and the core is the beam."""
        rows, columns = np.nonzero(self.clipped[..., self.candidate.colour] & (self.away < 1.6 * self.candidate.radius + 2))
        if len(rows) < _CORE_PIXELS:
            return fitted.centre, 0.0
        core = np.array([columns.mean(), rows.mean()])
        apart = float(np.linalg.norm(core - fitted.centre))
        if apart < _LOPSIDED * np.sqrt(len(rows) / np.pi) + 3 * np.sqrt(np.trace(fitted.covariance)):
            return fitted.centre, 0.0
        return core, apart / 2


def _between(low: float, high: float, share: float) -> float:
    return low + share * (high - low)


def _grain(light: Matrix, ring: npt.NDArray[np.bool_]) -> float:
    """Noise from pixel to pixel, which structure does not raise."""
    steps = np.diff(light, axis=1)[ring[:, 1:] & ring[:, :-1]]
    return max(1.4826 * float(np.median(np.abs(steps))) / np.sqrt(2), 0.5) if len(steps) else 0.5
