"""The spots of many poses: several pictures of a pose put together, and what never moves left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from urdfcal.base.geometry import Matrix, Vector
from urdfcal.vision.spots.detector import PixelSpot, RefusedSpot, Sighting

_SAME = 3.0  # [px]: spots of two pictures of a pose are one if no farther apart, or than their widths
_STILL_POSES, _STILL_SHARE, _STILL_PX = 4, 0.5, 1.5
_FIT_COUNTS = 4.0  # the fit's own sigma counts like so many further pictures beside their scatter


@dataclass(frozen=True, eq=False)
class PoseSpots:
    """What was seen in one pose.

    Attributes:
        label: The pose.
        spots: Spots, the brightest first.
        refused: What is none, and why.
        pictures: How many pictures were taken.
    """

    label: str
    spots: tuple[PixelSpot, ...]
    refused: tuple[RefusedSpot, ...]
    pictures: int = 1


def put_together(label: str, sightings: Sequence[Sighting]) -> PoseSpots:
    """The spots of a pose from its pictures: means, with the scatter in their covariance.

    With n pictures the variance of a mean is s^2 / n; s^2 is the scatter with n - 1 degrees of freedom put together with the fits'
    own variance, which counts for four, since the scatter of two or three pictures is no sigma. A spot that is missing in half of the
    pictures or more is refused.
    """
    refused = [other for sighting in sightings for other in sighting.refused]
    if len(sightings) == 1:
        return PoseSpots(label, sightings[0].spots, tuple(refused), 1)
    kept = []
    for group in _groups(sightings):
        spot = _mean(group)
        if 2 * len(group) <= len(sightings):
            refused.append(RefusedSpot(spot.centre, f"seen in {len(group)} of {len(sightings)} pictures of the pose", 0.0))
        else:
            kept.append(spot)
    return PoseSpots(label, tuple(sorted(kept, key=lambda spot: -spot.light)), tuple(refused), len(sightings))


def _groups(sightings: Sequence[Sighting]) -> list[list[PixelSpot]]:
    groups: list[list[PixelSpot]] = []
    for sighting in sightings:
        free = list(groups)
        for spot in sighting.spots:
            near = [group for group in free if group[0].colour == spot.colour and _apart(group[0], spot) < max(_SAME, spot.width)]
            if near:
                nearest = min(near, key=lambda group: _apart(group[0], spot))
                nearest.append(spot)
                free = [group for group in free if group is not nearest]
            else:
                groups.append([spot])
    return groups


def _apart(one: PixelSpot, other: PixelSpot) -> float:
    return float(np.linalg.norm(one.centre - other.centre))


def _mean(group: Sequence[PixelSpot]) -> PixelSpot:
    n = len(group)
    centres = np.array([spot.centre for spot in group])
    own: Matrix = np.mean([spot.covariance for spot in group], axis=0)
    away = centres - centres.mean(axis=0)
    covariance = (_FIT_COUNTS * own + away.T @ away) / (_FIT_COUNTS + n - 1) / n
    return replace(
        group[0],
        centre=centres.mean(axis=0),
        covariance=covariance,
        width=float(np.mean([spot.width for spot in group])),
        light=float(np.mean([spot.light for spot in group])),
        clipped=round(float(np.mean([spot.clipped for spot in group]))),
    )


def without_still(poses: Sequence[PoseSpots]) -> tuple[list[PoseSpots], list[str]]:
    """Refuse what shines from the same place in half of the poses or more: a spot moves with the robot, a lamp does not.

    Returns:
        The poses, and a warning for each such place.
    """
    if len(poses) < _STILL_POSES:
        return list(poses), []
    places = _still_places(poses)
    cleaned = [_without(pose, places) for pose in poses]
    return cleaned, [
        f"a light at pixel ({place[0]:.0f}, {place[1]:.0f}) stands still in {count} of {len(poses)} poses and was taken for no spot"
        for place, count in places
    ]


def _still_places(poses: Sequence[PoseSpots]) -> list[tuple[Vector, int]]:
    spots = [(index, spot.centre) for index, pose in enumerate(poses) for spot in pose.spots]
    if not spots:
        return []
    owners, centres = np.array([index for index, _ in spots]), np.array([centre for _, centre in spots])
    found: list[tuple[Vector, int]] = []
    for centre in centres:
        count = len(set(owners[np.linalg.norm(centres - centre, axis=1) < _STILL_PX].tolist()))
        known = any(np.linalg.norm(place - centre) < 2 * _STILL_PX for place, _ in found)
        if not known and count >= _STILL_POSES and count >= _STILL_SHARE * len(poses):
            found.append((centre, count))
    return found


def _without(pose: PoseSpots, places: Sequence[tuple[Vector, int]]) -> PoseSpots:
    still = [any(np.linalg.norm(spot.centre - place) < 2 * _STILL_PX for place, _ in places) for spot in pose.spots]
    refused = [RefusedSpot(spot.centre, "stands still from pose to pose", 0.0) for spot, out in zip(pose.spots, still, strict=True) if out]
    kept = tuple(spot for spot, out in zip(pose.spots, still, strict=True) if not out)
    return replace(pose, spots=kept, refused=(*refused, *pose.refused))
