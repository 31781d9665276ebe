"""What a simulated camera has in its picture, and where it stands so that it sees much of it.

A corner of a board is read where it is inside the picture and the board turns its front to the camera, not too flatly. Nothing hides
anything: where the robot itself would stand between them is not known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import SE3, Array3, Mask, Matrix, Vector
from urdfcal.sensors.pixels import out_of_picture

if TYPE_CHECKING:
    from urdfcal.sensors.camera import Camera

_LEAST_FACING = 0.3  # cosine between the line of sight and a board's normal: flatter, no corner is found in a picture
_LEAST_CORNERS, _LEAST_SHARE = 4, 0.5  # of a board that counts as seen
_VIEWS, _FARTHEST = 120, 5.0  # places that are tried, and how far they are in distances from which a board fills the picture
_LONE = 0.2  # [m] what a target without a board is taken for, to stand far enough away
_RARE = 1 / 400


@dataclass(frozen=True)
class Subject:
    """A board, or a target alone, at some poses, in the axes of what looks at it.

    Attributes:
        p: Its origin, (n, 3), [m].
        R: Its axes, (n, 3, 3).
        corners: What is read of it, in these axes, (k, 3), [m].
        board: Whether it can be seen from one side only: that from which its z axis points away.
    """

    p: Matrix
    R: Array3
    corners: Matrix
    board: bool

    @property
    def outline(self) -> Subject:
        """Its outermost corners alone."""
        x, y = self.corners[:, 0], self.corners[:, 1]
        outer = {int(np.argmax(sign * (x + slope * y))) for sign in (1, -1) for slope in (1, -1)}
        return replace(self, corners=self.corners[sorted(outer)])

    @property
    def middle(self) -> Matrix:
        """Of its corners, (n, 3), [m]."""
        return np.asarray(self.p + self.R @ self.corners.mean(axis=0))

    def seen_from(self, T_frame_camera: SE3) -> Subject:
        """The same in the axes of a camera that stands somewhere in this frame."""
        R = T_frame_camera.rotation.T
        return replace(self, p=(self.p - T_frame_camera.translation) @ R.T, R=R @ self.R)

    def read(self, camera: Camera) -> Mask:
        """Which corners the camera can read, (n, k)."""
        points = self.p[:, None] + np.einsum("nij,kj->nki", self.R, self.corners)
        pixels = camera.project(points.reshape(-1, 3))
        inside = ~out_of_picture(camera, pixels).reshape(points.shape[:2])
        return np.asarray(inside & (self._faces[:, None] | (not self.board)))

    def in_view(self, camera: Camera) -> Mask:
        """At which poses the camera sees it, most of a board, (n,)."""
        corners = len(self.corners)
        return np.asarray(self.read(camera).sum(axis=1) >= max(min(_LEAST_CORNERS, corners), _LEAST_SHARE * corners))

    @property
    def _faces(self) -> Mask:
        towards = self.middle
        return np.asarray(np.sum(self.R[:, :, 2] * towards, axis=1) > _LEAST_FACING * np.linalg.norm(towards, axis=1))


def camera_place(camera: Camera, subjects: Sequence[Subject], rng: np.random.Generator) -> SE3:
    """Where a camera stands that sees each of its subjects at as many poses as can be: before it in one of them, here or farther off.

    Raises:
        UsageError: from everywhere it sees them too rarely.
    """
    fills = [max(float(np.linalg.norm(np.ptp(own.corners, axis=0))), _LONE) * camera.matrix[0, 0] / camera.size[0] for own in subjects]
    places = []
    for _ in range(_VIEWS):
        index = int(rng.integers(len(subjects)))
        subject, pose = subjects[index], int(rng.integers(len(subjects[index].p)))
        back = -subject.R[pose, :, 2] if subject.board else rng.normal(0, 1, 3)
        back = back / np.linalg.norm(back) + 0.3 * rng.normal(0, 1, 3)
        places.append(_looking(subject.middle[pose], back, fills[index] * rng.uniform(1, _FARTHEST), rng))
    seen = np.array([[own.outline.seen_from(place).in_view(camera) for own in subjects] for place in places])
    each, some = seen.mean(axis=2).min(axis=1), seen.any(axis=1).mean(axis=1)  # all of its subjects, if there is such a place
    best = int(np.argmax(each)) if each.max() >= _RARE else int(np.argmax(some))
    if some[best] < _RARE:
        raise UsageError(
            f"the camera sees its target at {some[best]:.1%} of random poses at most, wherever it stands; "
            "check that its lens is that of CAMERA.yaml, and that board and camera are on different links"
        )
    return places[best]


def _looking(at: Vector, back: Vector, far: float, rng: np.random.Generator) -> SE3:
    """A camera that looks at a point from some distance, with z ahead, upright in any direction."""
    z = -back / np.linalg.norm(back)
    x = np.cross(rng.normal(0, 1, 3), z)
    x /= np.linalg.norm(x)
    return pin.SE3(np.column_stack([x, np.cross(z, x), z]), at - far * z)
