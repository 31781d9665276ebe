"""`camera.yaml`: a camera as a file.

size_px: [640, 480]                                  # width, height
lens: plain                                          # plain, rational or fisheye
intrinsics: {fx: 535.9, fy: 536.0, cx: 342.3, cy: 235.6, k1: -0.27, k2: -0.04, p1: 0.0018, p2: -0.0003, k3: 0.24}
rms_px: 0.41                                         # may be missing, as all below
lens_covariance: [...]                               # in the order of the intrinsics
screen:
  side: front                                        # or back: the camera looks through the screen
  xyz: [0.1, 0.2, 2.5]                               # T_camera_screen: the screen's origin in camera axes, m
  rpy: [1.5, 0.1, -1.6]                              # and its roll, pitch, yaw as in a URDF, rad
  rms_px: 0.2
  covariance: [...]                                  # 6 x 6 of xi in T_camera_screen exp(xi), [v, w] in screen axes, m and rad

Numbers of the distortion that are not there are zero. ROS's camera_info and OpenCV's FileStorage are read, too (`camera_info`).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from urdfcal.base.errors import InputError
from urdfcal.base.files import read_yaml
from urdfcal.base.geometry import Matrix, pose, xyz_rpy
from urdfcal.base.yaml_kinds import is_not
from urdfcal.sensors.camera import Camera, Side
from urdfcal.sensors.lenses import Lens, intrinsic_names
from urdfcal.vision.camera.camera_info import LARGEST_PX, as_ours

_SHORTEST_PX = 1.0  # a focal length under which no picture tells directions apart, and numbers overflow
Finite = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, le=1e6, allow_inf_nan=False)]
Pixels = Annotated[int, Field(ge=2, le=LARGEST_PX, strict=True)]
Triple = tuple[Finite, Finite, Finite]


class _Loose(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)


class ScreenEntry(_Loose):
    """Where the screen is."""

    side: Side
    xyz: Triple
    rpy: Triple
    rms_px: NotNegative | None = None
    covariance: list[list[Finite]] | None = None


class CameraEntries(_Loose):
    """The part of the file that is read back."""

    size_px: tuple[Pixels, Pixels]
    lens: Lens = "plain"
    intrinsics: dict[str, Finite]
    rms_px: NotNegative | None = None
    lens_covariance: list[list[Finite]] | None = None
    screen: ScreenEntry | None = None


def camera_yaml(camera: Camera, provenance: Mapping[str, Any] | None = None) -> bytes:
    """A camera as YAML.

    Args:
        camera: What is written, in full double precision.
        provenance: Further entries, such as the command and the pictures that were used; they are not read back.
    """
    values = [camera.matrix[0, 0], camera.matrix[1, 1], camera.matrix[0, 2], camera.matrix[1, 2], *camera.distortion]
    content: dict[str, Any] = {
        "size_px": [int(side) for side in camera.size],
        "lens": camera.lens,
        "intrinsics": dict(zip(intrinsic_names(camera.lens), map(float, values), strict=True)),
        "rms_px": camera.rms,
        "lens_covariance": _listed(camera.lens_covariance),
        "screen": _screen_entry(camera),
        **(provenance or {}),
    }
    present = {name: value for name, value in content.items() if value is not None}
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    text = yaml.dump(present, Dumper=dumper, sort_keys=False, default_flow_style=None, width=160, allow_unicode=True)
    return f"# A camera. Metres and radians, pixels where the name says px; T_camera_screen as xyz and rpy.\n{text}".encode()


def read_camera(path: str | Path) -> Camera:
    """Read a camera.yaml, or what ROS (camera_info) or OpenCV (FileStorage) say of a camera.

    Raises:
        InputError: naming the file, the line and what was expected.
    """
    file = read_yaml(path, InputError)
    try:
        ours = as_ours(file.content)
        if not isinstance(ours, dict) or "intrinsics" not in ours:
            raise InputError(is_not("camera", file.content, "intrinsics", "camera"), path)
        return _camera(CameraEntries.model_validate(ours))
    except ValidationError as error:
        found = error.errors()[0]
        raise InputError(f"entry '{'.'.join(map(str, found['loc']))}': {_trouble(found)}", path, file.line(found["loc"])) from None
    except ValueError as error:
        raise InputError(str(error), path, file.line()) from None


def _trouble(found: Any) -> str:
    """What is wrong with an entry: a word that is none of those that it may be is told."""
    return f"found '{found['input']}', expected {found['ctx']['expected']}" if found["type"] == "literal_error" else str(found["msg"])


def _camera(entries: CameraEntries) -> Camera:
    names, found = intrinsic_names(entries.lens), entries.intrinsics
    if not set(names[:4]) <= set(found) <= set(names):
        raise ValueError(f"entry 'intrinsics': a {entries.lens} lens has {', '.join(names)}, found {', '.join(found) or 'nothing'}")
    fx, fy, cx, cy, *distortion = (found.get(name, 0.0) for name in names)
    if not min(fx, fy) >= _SHORTEST_PX:
        raise ValueError(f"entry 'intrinsics': fx = {fx:g} and fy = {fy:g}, expected positive numbers of at least {_SHORTEST_PX:g} px")
    screen = entries.screen
    return Camera(
        entries.size_px,
        np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]),
        np.array(distortion),
        entries.lens,
        pose(np.array(screen.xyz), np.array(screen.rpy)) if screen else None,
        screen.side if screen else "front",
        entries.rms_px,
        _square("lens_covariance", entries.lens_covariance, len(names)),
        screen.rms_px if screen else None,
        _square("screen.covariance", screen.covariance, 6) if screen else None,
    )


def _screen_entry(camera: Camera) -> dict[str, Any] | None:
    if camera.T_camera_screen is None:
        return None
    xyz, rpy = xyz_rpy(camera.T_camera_screen)
    entry: dict[str, Any] = {"side": camera.side, "xyz": xyz.tolist(), "rpy": rpy.tolist()}
    if camera.screen_rms is not None:
        entry["rms_px"] = camera.screen_rms
    if camera.screen_covariance is not None:
        entry["covariance"] = _listed(camera.screen_covariance)
    return entry


def _listed(matrix: Matrix | None) -> list[list[float]] | None:
    return None if matrix is None else [[float(value) for value in row] for row in matrix]


def _square(name: str, rows: list[list[float]] | None, size: int) -> Matrix | None:
    if rows is None:
        return None
    if len(rows) != size or any(len(row) != size for row in rows):
        raise ValueError(
            f"entry '{name}': expected {size} rows of {size} numbers, found {len(rows)} of {', '.join(str(len(row)) for row in rows)}"
        )
    return np.array(rows)
