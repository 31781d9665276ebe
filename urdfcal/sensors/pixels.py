"""Targets in a camera's pictures: pixels in place of metres. The measuring frame is the camera's: x right, y down, z ahead."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from urdfcal.base.geometry import Mask, Matrix, Vector
from urdfcal.robot.rig import Place
from urdfcal.sensors.sensor import (
    Change,
    Disturbance,
    Look,
    Quantity,
    Sensor,
    Sight,
    View,
    Words,
    bent_by_a_lens,
    leaning,
    point_jacobian,
    require_pair,
)

PIXEL_WORDS = Words("spot or target in a picture", "spots or targets in pictures", "pixel noise", "px", 0.3, 20.0)

_LENS = (5e-3, 1e-3)  # residual distortion of a lens that was calibrated, at a slope of one


def out_of_picture(camera: Any, pixels: Matrix) -> Mask:
    """Which pixels (n, 2) a camera's picture does not have, (n,)."""
    with np.errstate(invalid="ignore"):
        inside = (pixels >= -0.5) & (pixels <= np.array(camera.size) - 0.5)
    return ~np.asarray(inside.all(axis=1), dtype=bool)


class PixelSensor(Sensor):
    """A target in a picture, h = project(p)."""

    name = noise = "pixel"
    words = PIXEL_WORDS
    title = "pixels"
    stored = numbers = 2
    components = "uv"
    endings: ClassVar[Mapping[str, Quantity]] = {"u": "pixel", "v": "pixel"}
    sigma_ending = "sigma_px"
    by_camera = True
    simulated: ClassVar[tuple[str, ...]] = ("pixels",)
    mark = "target, on the ray of its pixel"
    line = "line of sight"

    def __init__(self, camera: Any = None, lens: str = "") -> None:
        """Of one camera: a `sensors.camera.Camera`, whose lens is refined if it has a name."""
        self.camera, self.lens = camera, lens

    def with_camera(self, camera: Any) -> Sensor:
        """See the base class."""
        return type(self)(camera)

    def refining(self, lens: str) -> Sensor:
        """See the base class."""
        return type(self)(self.camera, lens)

    def places(self, target: str, labels: Sequence[str]) -> tuple[Place, ...]:
        """What the lens is off by, if it is refined: of all that the camera reads alike."""
        count = len(self.camera.intrinsics) if self.lens else 0
        return (Place(self.lens, tuple(f"lens_{number}" for number in range(1, count + 1)), ("",) * count, "lens"),) if self.lens else ()

    def _seen_by(self, view: View) -> Any:
        """The camera with its lens as it is at some state."""
        return self.camera.refined(view.place[0]) if self.lens and len(view.place) else self.camera

    def look(self, view: View, values: Matrix) -> Look:
        """See the base class."""
        pixels, by_point, by_lens = self._seen_by(view).projected(view.p)
        return Look(values - pixels, by_point @ point_jacobian(view.p), by_lens @ self.camera.lens_factor if self.lens else None)

    def read(self, view: View) -> Matrix:
        """See the base class."""
        pixels: Matrix = self._seen_by(view).project(view.p)
        return pixels

    def disturbances(self, view: View) -> tuple[Disturbance, ...]:
        """See the base class: what the lens does beyond its calibration."""
        focal, centre = np.diag(self.camera.matrix)[:2], self.camera.matrix[:2, 2]
        bent = bent_by_a_lens((self.read(view) - centre) / focal, _LENS, "")
        return (replace(bent, columns=bent.columns * focal[:, None], slopes=bent.slopes * focal[:, None] / focal),)

    def mistakes(self) -> Mapping[str, Change]:
        """See the base class."""
        width, height = self.camera.size
        return {
            "u and v of the pixels swapped": lambda values: values[:, ::-1],
            "u of the pixels mirrored": lambda values: [width - 1, 0] + values * [-1, 1],
            "v of the pixels counted from below": lambda values: [0, height - 1] + values * [1, -1],
        }

    def shown(self, view: View, values: Matrix) -> Matrix:
        """See the base class; on the ray of its pixel, as far ahead of the camera as predicted."""
        rays = self._seen_by(view).rays(np.nan_to_num(values))
        return np.asarray(rays * (view.p[:, 2:] / rays[:, 2:]))

    def rays(self, values: Matrix) -> Matrix | None:
        """See the base class; those of the lens."""
        rays: Matrix = self.camera.rays(values)
        return rays

    def looks_from(self, view: View) -> Matrix | None:
        """The camera."""
        return np.zeros_like(view.p)

    def unseen(self, view: View, sight: Sight) -> Mapping[str, Mask]:
        """See the base class: in the picture; of a board with its front to the camera, too, and in squares that are large enough."""
        pixels = self.read(view)
        out = {"are out of the picture": out_of_picture(self.camera, pixels)}
        if not sight.square:
            return out
        across = [self.camera.project(view.p + sign * sight.square * view.R[:, :, axis]) for axis in (0, 1) for sign in (1, -1)]
        sides = np.array([np.linalg.norm(other - pixels, axis=1) for other in across])
        with np.errstate(invalid="ignore"):
            turned = ~(leaning(view.p, view.R[:, :, 2]) <= sight.flattest)
            small = ~(np.nanmin(np.where(np.isfinite(sides), sides, np.inf), axis=0) >= sight.least_square)
        return {
            **out,
            f"show the board over {np.degrees(sight.flattest):.0f} deg turned away": turned,
            f"show squares below {sight.least_square:g} px": small,
        }

    def lacking(self, target: str, given: Collection[str]) -> tuple[str, str] | None:
        """See the base class."""
        missing = [ending for ending in self.endings if ending not in given]
        return (missing[0], "is missing; a spot or target in a picture needs .u and .v") if missing else None

    def kept(self, columns: Mapping[str, Vector]) -> Matrix:
        """See the base class."""
        require_pair(columns, "and its other one is not; leave both empty if it was not seen")
        return super().kept(columns)
