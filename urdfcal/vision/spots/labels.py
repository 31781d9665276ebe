"""Which spot is whose: by colour where the lasers' differ, else by where the nominal robot has them, else from left to right.

Nothing is guessed: where a second way to label the spots of a pose is nearly as good, they stay without a label and the pose is named.
The nominal robot may be off by decimetres. So its predictions are first compared by their differences alone (a common offset cancels);
an affine map from predicted to seen, fitted to the poses labelled so, then places the predictions for the rest.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import permutations

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Array3, Matrix
from urdfcal.vision.spots.detector import PixelSpot
from urdfcal.vision.spots.series import PoseSpots

Place = Callable[[PixelSpot], Matrix]
_SURE = 0.6  # the best way to label must be so much better than the next, as a ratio of RMS distances
_SIDEWAYS = 0.2  # of their distance, which two spots must be apart sideways to be left and right
_BOTH_COLOURS = 0.2  # of all spots must be of the rarer colour for the lasers to be of two
_MOST = 5  # spots of a pose that are considered, the brightest
_FOR_MAP, _GATE = 8, 8.0  # spots for an affine map; spreads beyond which a spot is nobody's


@dataclass
class Labelled:
    """Which spot is whose.

    Attributes:
        spots: For each pose, the spot of each laser.
        warnings: What was left without a label, and why.
        ordered: Whether lasers of one colour were told apart by nothing but their order from left to right.
    """

    spots: list[dict[str, PixelSpot]]
    warnings: list[str] = field(default_factory=list)
    ordered: bool = False


def label_spots(
    poses: Sequence[PoseSpots],
    lasers: Sequence[str],
    place: Place,
    *,
    colours: Sequence[str] | None = None,
    predicted: Array3 | None = None,
) -> Labelled:
    """Label the spots of a series of poses.

    Args:
        poses: What was seen.
        lasers: Names of the lasers.
        place: Where a spot is; the first coordinate grows to the right as the labels from left to right have it.
        colours: The lasers' colours; found from the spots where None.
        predicted: Places of the nominal robot's spots, (n, lasers, 2), in the coordinates of `place`; nan where a beam makes none.
    """
    result = Labelled([{} for _ in poses])
    colours = list(colours) if colours is not None else _colours(poses, lasers, place, predicted, result)
    result.ordered = predicted is None and len(set(colours)) < len(colours)
    for colour in dict.fromkeys(colours):
        mine = [index for index, own in enumerate(colours) if own == colour]
        group = _Group(poses, [lasers[index] for index in mine], colour, place, None if predicted is None else predicted[:, mine])
        group.label(result)
    _name_strangers(poses, colours, result)
    return result


def _colours(poses: Sequence[PoseSpots], lasers: Sequence[str], place: Place, predicted: Array3 | None, result: Labelled) -> list[str]:
    """The lasers' colours from the spots: of two colours, the first laser is red, unless the nominal robot says otherwise."""
    counts = Counter(spot.colour for pose in poses for spot in pose.spots).most_common()
    if not counts:
        return ["red"] * len(lasers)
    if len(counts) < 2 or len(lasers) != 2 or counts[1][1] < _BOTH_COLOURS * sum(count for _, count in counts):
        return [counts[0][0]] * len(lasers)
    colours = sorted((colour for colour, _ in counts[:2]), key=["red", "green", "blue"].index)
    if predicted is not None and _reversed(poses, colours, place, predicted):
        colours = colours[::-1]
    result.warnings.append(
        f"spots of two colours: {lasers[0]} is taken as {colours[0]}, {lasers[1]} as {colours[1]} (--colours says otherwise)"
    )
    return colours


def _reversed(poses: Sequence[PoseSpots], colours: Sequence[str], place: Place, predicted: Array3) -> bool:
    """Whether the nominal robot's beams fit the colours the other way round."""
    votes = 0
    for pose, ideal in zip(poses, predicted, strict=True):
        one, other = ([spot for spot in pose.spots if spot.colour == colour] for colour in colours)
        if len(one) == len(other) == 1 and np.isfinite(ideal).all():
            seen, meant = place(one[0]) - place(other[0]), ideal[0] - ideal[1]
            votes += 1 if np.linalg.norm(seen - meant) < np.linalg.norm(seen + meant) else -1
    return votes < 0


def _name_strangers(poses: Sequence[PoseSpots], colours: Sequence[str], result: Labelled) -> None:
    """Say which spots are of a colour that no laser has."""
    for pose in poses:
        strange = [spot for spot in pose.spots if spot.colour not in colours]
        if strange:
            at = ", ".join(f"{spot.colour} at ({spot.centre[0]:.0f}, {spot.centre[1]:.0f})" for spot in strange)
            result.warnings.append(f"pose {pose.label}: {at} is of no laser's colour and was left out")


class _Group:
    """The lasers of one colour."""

    def __init__(self, poses: Sequence[PoseSpots], lasers: list[str], colour: str, place: Place, predicted: Array3 | None) -> None:
        self.poses, self.lasers, self.predicted = poses, lasers, predicted
        self.spots = [[spot for spot in pose.spots if spot.colour == colour][:_MOST] for pose in poses]
        self.places = [np.array([place(spot) for spot in spots]).reshape(-1, 2) for spots in self.spots]

    def label(self, result: Labelled) -> None:
        """Add this group's labels and warnings."""
        ways = self._by_model() if self.predicted is not None else [self._by_order(pose) for pose in range(len(self.poses))]
        for pose, (way, trouble) in enumerate(ways):
            result.spots[pose] |= {laser: self.spots[pose][spot] for laser, spot in zip(self.lasers, way, strict=True) if spot >= 0}
            if trouble:
                result.warnings.append(f"pose {self.poses[pose].label}: {trouble}; left empty")

    def _nobody(self) -> list[int]:
        return [-1] * len(self.lasers)

    def _by_order(self, pose: int) -> tuple[list[int], str]:
        places, names = self.places[pose], " and ".join(self.lasers)
        if not len(places):
            return self._nobody(), ""
        if len(places) != len(self.lasers):
            return self._nobody(), f"{_spots(len(places))}, and nothing says which of {names} (--robot with --poses would)"
        order = np.argsort(places[:, 0])
        steps = np.diff(places[order], axis=0)
        if (steps[:, 0] < _SIDEWAYS * np.linalg.norm(steps, axis=1)).any():
            return self._nobody(), f"the spots lie one above the other, and nothing says which is which of {names}"
        return [int(spot) for spot in order], ""

    def _by_model(self) -> list[tuple[list[int], str]]:
        assert self.predicted is not None
        firsts = [_best(places, ideal, True) for places, ideal in zip(self.places, self.predicted, strict=True)]
        pairs = [
            (pose, laser, spot)
            for pose, (way, sure, centred) in enumerate(firsts)
            if sure and centred
            for laser, spot in enumerate(way)
            if spot >= 0
        ]
        mapped, gate = self._mapped(pairs)
        return [self._second(pose, mapped[pose], gate) for pose in range(len(self.poses))]

    def _mapped(self, pairs: list[tuple[int, int, int]]) -> tuple[Array3, float]:
        """The predictions moved to where spots are seen, and how far from them a spot can be."""
        assert self.predicted is not None
        if len(pairs) < _FOR_MAP:
            return self.predicted, np.inf
        ideal = np.array([self.predicted[pose, laser] for pose, laser, _ in pairs])
        seen = np.array([self.places[pose][spot] for pose, _, spot in pairs])
        basis, kept = np.column_stack([np.ones(len(ideal)), ideal]), np.ones(len(ideal), dtype=bool)
        for _ in range(4):
            numbers = np.linalg.lstsq(basis[kept], seen[kept], rcond=None)[0]
            away = np.linalg.norm(seen - basis @ numbers, axis=1)
            spread = 1.4826 * float(np.median(away))
            kept = away <= 4 * spread + 1e-12
        return numbers[0] + self.predicted @ numbers[1:], _GATE * spread + 1e-9

    def _second(self, pose: int, ideal: Matrix, gate: float) -> tuple[list[int], str]:
        places = self.places[pose]
        if not len(places):
            return self._nobody(), ""
        if not np.isfinite(ideal).any():
            return self._nobody(), f"{_spots(len(places))}, and the nominal beams make none"
        near = np.nanmin(np.linalg.norm(places[:, None] - ideal, axis=2), axis=1) <= gate
        if not near.any():
            return self._nobody(), f"{_spots(len(places))}, far from where the others let expect any"
        way, sure, centred = _best(places[near], ideal, not np.isfinite(gate))
        if not sure:
            return (
                self._nobody(),
                f"{_spots(len(places))}, and {'two ways' if centred or len(places) > 1 else 'two lasers'} to label are as good",
            )
        kept = np.flatnonzero(near)
        return [int(kept[spot]) if spot >= 0 else -1 for spot in way], ""


def _spots(count: int) -> str:
    return "one spot" if count == 1 else f"{count} spots"


def _best(places: Matrix, ideal: Matrix, centred: bool) -> tuple[list[int], bool, bool]:
    """The spot of each laser (-1 for none) that fits best, whether the next best way is clearly worse, and whether means were taken off.

    Args:
        places: (k, 2) of the spots.
        ideal: (lasers, 2), nan for a beam that makes no spot.
        centred: Whether a common offset counts for nothing, where every laser has a spot.
    """
    there = np.flatnonzero(np.isfinite(ideal).all(axis=1))
    centred = centred and len(places) == len(there) > 1
    count = min(len(places), len(there))
    if not count:
        return [-1] * len(ideal), False, centred
    ways = []
    for chosen in permutations(range(len(places)), count):
        for lasers in _subsets(there, count):
            off = places[list(chosen)] - ideal[list(lasers)]
            off = off - off.mean(axis=0) if centred else off
            way = [-1] * len(ideal)
            for laser, spot in zip(lasers, chosen, strict=True):
                way[laser] = spot
            ways.append((float(np.sqrt((off**2).mean())), way))
    ways.sort(key=lambda way: way[0])
    sure = len(ways) == 1 or ways[0][0] < _SURE * ways[1][0]
    return ways[0][1], sure, centred


def _subsets(lasers: npt.NDArray[np.intp], count: int) -> list[tuple[int, ...]]:
    from itertools import combinations

    return [tuple(int(laser) for laser in chosen) for chosen in combinations(lasers, count)]
