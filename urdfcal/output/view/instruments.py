"""Several instruments in the picture: the frame of each, how far a camera sees, and the sheet that lasers are aimed at."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from urdfcal.base.geometry import Matrix
from urdfcal.output.view.cameras import SeenCamera, draw_camera
from urdfcal.output.view.meshes import segments
from urdfcal.output.view.placed import Placed
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.readings import Readings

SHEET = 0x7B8794
_MARGIN = 0.08  # of a sheet about its spots


@dataclass(frozen=True)
class SeenInstrument:
    """Something that targets are seen from, one of several.

    Attributes:
        name: As readings have it.
        link: Link that it stands on.
        frame: Which of the chain's frames it is.
        with_marks: Whether marks are drawn in it, and its axes with them.
        camera: Its lens, a `sensors.camera.Camera`; None of what sees no pixels.
        spots: Where beams were seen on it, (k, 2) = (y, z), [m].
    """

    name: str
    link: str
    frame: int
    with_marks: bool
    camera: Any
    spots: Matrix

    @property
    def path(self) -> str:
        """Where it is in the scene."""
        return f"instruments/{self.frame}"


def seen_instruments(placed: Placed, data: Measurements) -> tuple[SeenInstrument, ...]:
    """Every instrument, where there are several; none where there is one, whose frame the marks stand in."""
    every = placed.robot.rig.instruments.every
    return tuple(_seen(index, placed, data) for index in range(len(every))) if len(every) > 1 else ()


def _seen(index: int, placed: Placed, data: Measurements) -> SeenInstrument:
    instrument = placed.robot.rig.instruments.every[index]
    own = [each for each in data.readings if placed.errors.chain.seen_from(each.instrument) == index and not each.kind.beam]
    camera = next((data.camera_of(each.instrument) for each in own if each.kind.by_camera), None)
    own_marks = index == placed.drawn_frame
    return SeenInstrument(instrument.name, instrument.link, index, own_marks, camera, np.concatenate([np.empty((0, 2)), *_spots(own)]))


def _spots(readings: list[Readings]) -> Iterator[Matrix]:
    yield from (each.values[each.seen] for each in readings if each.kind.aimed)


def draw_instruments(tab: Any, instruments: tuple[SeenInstrument, ...], depth: float) -> None:
    """Draw what cameras see, so deep [m], and sheets; axes are drawn as those of links are."""
    for own in instruments:
        if own.camera is not None:
            draw_camera(tab[f"{own.path}/camera"], SeenCamera(own.camera, "frame", pin.SE3.Identity()), depth)
        if len(own.spots):
            corners = _corners(own.spots)
            tab[f"{own.path}/sheet"].set_object(segments(corners, np.roll(corners, -1, axis=0), SHEET))


def _corners(spots: Matrix) -> Matrix:
    """Of a rectangle about some spots in the plane x = 0, (4, 3), [m]."""
    low, high = spots.min(axis=0), spots.max(axis=0)
    (left, bottom), (right, top) = low - _MARGIN * (high - low), high + _MARGIN * (high - low)
    return np.array([[0.0, y, z] for y, z in ((left, bottom), (right, bottom), (right, top), (left, top))])
