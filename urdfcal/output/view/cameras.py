"""The camera in the picture: a pyramid from its centre to the edges of what it sees, with a mark at the upper edge."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from urdfcal.base.geometry import SE3, Matrix
from urdfcal.output.view.meshes import segments
from urdfcal.sensors.camera import Camera

CAMERA = 0x3B4652
_UP = 0.25  # height of the mark over the picture's
_ALONG_AN_EDGE = 9  # rays, since lenses bend edges


@dataclass(frozen=True)
class SeenCamera:
    """A camera in one of the frames that marks stand in.

    Attributes:
        camera: Its lens.
        frame: `screen` or `frame`.
        T_frame_camera: Where it is there.
    """

    camera: Camera
    frame: Literal["screen", "frame"]
    T_frame_camera: SE3


def draw_camera(node: Any, seen: SeenCamera, depth: float) -> None:
    """Draw it as lines, so deep, [m]."""
    rim, up = depth * _rim(seen.camera), depth * _mark(seen.camera)
    corners = rim[:: _ALONG_AN_EDGE - 1][:4]
    starts = np.concatenate([np.zeros((4, 3)), rim, up])
    ends = np.concatenate([corners, np.roll(rim, -1, axis=0), np.roll(up, -1, axis=0)])
    T = seen.T_frame_camera
    starts, ends = (points @ T.rotation.T + T.translation for points in (starts, ends))
    node.set_object(segments(starts, ends, CAMERA))


def _rim(camera: Camera) -> Matrix:
    """The edge of the picture one ahead of the camera, (k, 3), from its upper left corner on."""
    width, height = camera.size
    corners = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], dtype=float)
    shares = np.linspace(0, 1, _ALONG_AN_EDGE)[:-1, None]
    pixels = np.concatenate([a + shares * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)])
    rays = camera.rays(pixels)
    pinhole = np.column_stack([(pixels - camera.matrix[:2, 2]) / np.diag(camera.matrix)[:2], np.ones(len(pixels))])
    return np.where(np.isnan(rays) | (rays[:, 2:] <= 0.1), pinhole, rays / np.maximum(rays[:, 2:], 0.1))  # where the lens model has none


def _mark(camera: Camera) -> Matrix:
    """A triangle over the upper edge."""
    (left, top), (right, bottom) = (
        (pixel - camera.matrix[:2, 2]) / np.diag(camera.matrix)[:2] for pixel in (np.zeros(2), np.array(camera.size) - 1.0)
    )
    middle, height = (left + right) / 2, _UP * (bottom - top)
    return np.array([[middle - height, top, 1.0], [middle, top - height, 1.0], [middle + height, top, 1.0]])
