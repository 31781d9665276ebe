"""The whole way from pictures to labelled spots, and each picture with what was found in it drawn on."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from urdfcal.base.errors import InputError
from urdfcal.base.geometry import Array3, Vector
from urdfcal.sensors.camera import Camera
from urdfcal.vision.pictures import Picture, read_picture
from urdfcal.vision.spots.detector import PixelSpot, RefusedSpot, Sighting, SpotLimits, find_spots
from urdfcal.vision.spots.drawing import drawn
from urdfcal.vision.spots.labels import Labelled, label_spots
from urdfcal.vision.spots.series import PoseSpots, put_together, without_still

Pixels = npt.NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class SpotSearch:
    """How spots are looked for.

    Attributes:
        lasers: Names of the lasers.
        colours: Their colours, or None to find out.
        camera: The camera; None leaves everything in pixels.
        dark: A picture with the lasers off.
        limits: What a spot can be.
        rightward: Whether lasers are named from left to right as the screen's front shows them, or from right to left.
        area: Half the side of the square around the screen's origin outside of which no spot can be, [m]; None for no bound.
        still: Whether what never moves is left out.
    """

    lasers: tuple[str, ...]
    colours: tuple[str, ...] | None = None
    camera: Camera | None = None
    dark: Picture | None = None
    limits: SpotLimits = field(default_factory=SpotLimits)
    rightward: bool = True
    area: float | None = None
    still: bool = True

    def see(self, path: Path) -> Sighting:
        """What one picture shows.

        Raises:
            InputError: it cannot be read, is of another size, or has no colour to tell spots from lamps by.
        """
        picture = read_picture(path, self.camera.size if self.camera else None)
        if picture.colourless and self.dark is None:
            raise InputError("is grey: without colour a spot looks like a lamp; give a picture with the lasers off with --dark", path)
        if self.dark is not None:
            picture = picture.minus(self.dark)
        sighting = find_spots(picture, self.colours or ("red", "green"), self.limits)
        return self._on_screen(sighting)

    def place(self, spot: PixelSpot) -> Vector:
        """Where a spot is, first coordinate in the direction in which the lasers are named; on the screen or in the picture."""
        at = spot.centre if self.camera is None else self.camera.spots_of_pixels(spot.centre[None])[0] * (-1, 1)
        return np.asarray(at * (1 if self.rightward else -1, 1))

    def as_placed(self, spots: Array3) -> Array3:
        """Spots (y, z) on the screen in the coordinates of `place`."""
        return spots * (-1 if self.rightward else 1, 1)

    def _on_screen(self, sighting: Sighting) -> Sighting:
        """Refuse what the camera does not see on the screen."""
        if self.camera is None:
            return sighting
        kept, refused = [], list(sighting.refused)
        for spot in sighting.spots:
            at = self.camera.spots_of_pixels(spot.centre[None])[0]
            if np.isfinite(at).all() and (self.area is None or (np.abs(at) <= self.area).all()):
                kept.append(spot)
            else:
                refused.append(RefusedSpot(spot.centre, "beside the screen", 0.0))
        return replace(sighting, spots=tuple(kept), refused=tuple(refused))


@dataclass(frozen=True, eq=False)
class SpotsFound:
    """What a series of pictures shows.

    Attributes:
        poses: What was seen in each pose.
        labelled: Which spot is whose.
        pictures: What each picture shows.
        warnings: What was left out, and why.
    """

    poses: list[PoseSpots]
    labelled: Labelled
    pictures: Mapping[Path, Sighting]
    warnings: list[str]

    def drawings(self, groups: Mapping[str, Sequence[Path]], folder: Path) -> dict[str | Path, bytes]:
        """Every picture with what was found drawn on it, by the place where it belongs."""
        places = drawing_places(groups, folder)
        spots_of_pose = zip(groups.values(), self.labelled.spots, strict=True)
        return {places[path]: drawn(path, self.pictures[path], spots) for paths, spots in spots_of_pose for path in paths}


def drawing_places(groups: Mapping[str, Sequence[Path]], folder: Path) -> dict[Path, Path]:
    """Where the drawing of each picture belongs: `<picture>.jpg`, with the picture's own folder before it where that is taken."""
    places: dict[Path, Path] = {}
    for path in (path for paths in groups.values() for path in paths):
        own = folder / f"{path.stem}.jpg"
        places[path] = own if own not in places.values() else folder / f"{path.parent.name}_{path.stem}.jpg"
    return places


def spots_of(
    search: SpotSearch, groups: Mapping[str, Sequence[Path]], predicted: Array3 | None = None, advance: Callable[[], None] = lambda: None
) -> SpotsFound:
    """Find and label the spots of every pose.

    Args:
        search: How spots are looked for.
        groups: The pictures of each pose.
        predicted: (y, z) of the nominal robot's spots, (n, lasers, 2), [m]; nan where a beam makes none.
        advance: Called after each picture.

    Raises:
        InputError: a picture cannot be taken as it is.
    """
    pictures: dict[Path, Sighting] = {}
    for paths in groups.values():
        for path in paths:
            pictures[path] = search.see(path)
            advance()
    poses = [put_together(label, [pictures[path] for path in paths]) for label, paths in groups.items()]
    poses, warnings = without_still(poses) if search.still else (poses, [])
    places = None if predicted is None else search.as_placed(predicted)
    labelled = label_spots(poses, search.lasers, search.place, colours=search.colours, predicted=places)
    return SpotsFound(poses, labelled, pictures, [*warnings, *labelled.warnings])
