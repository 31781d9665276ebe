"""What others say of a camera, as camera.yaml says it: ROS's camera_info, as a file or as it is echoed, and OpenCV's FileStorage.

    image_width: 640            # or width
    image_height: 480
    camera_matrix: {rows: 3, cols: 3, data: [fx, 0, cx, 0, fy, cy, 0, 0, 1]}     # or K, k, or three rows
    distortion_model: plumb_bob                                                  # OpenCV says none
    distortion_coefficients: {rows: 1, cols: 5, data: [k1, k2, p1, p2, k3]}      # or D, d, dist_coeffs

Where no model is named, the number of coefficients tells which: none, 4 or 5 are plain, 8 rational. More of them are thin prisms or
tilted sensors, which none of the lenses here has, and must be zero. What a picture was rectified to (R, P) is not for raw pictures.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from urdfcal.base.geometry import Vector
from urdfcal.sensors.lenses import DISTORTION_NAMES, Lens

_MATRIX = ("camera_matrix", "Camera_Matrix", "cameraMatrix", "K", "k")
_COEFFICIENTS = ("distortion_coefficients", "Distortion_Coefficients", "distCoeffs", "dist_coeffs", "dist_coeff", "D", "d")
_SIZES = (("image_width", "image_height"), ("image_Width", "image_Height"), ("width", "height"))
_MODELS: dict[str, Lens] = {"plumb_bob": "plain", "rational_polynomial": "rational", "equidistant": "fisheye", "fisheye": "fisheye"}
_UNBENT = ("", "none")
LARGEST_PX = 100_000  # side of a picture
_LISTED = 20  # numbers of an entry; a matrix has nine


def as_ours(content: Any) -> Any:
    """The same entries as camera.yaml has them; what has none of the others' is given back as it is.

    Raises:
        ValueError: which entry is none, what was found and what is expected.
    """
    matrix = None if not isinstance(content, dict) or "intrinsics" in content else _first(content, _MATRIX)
    if matrix is None:
        return content
    _require_whole(content)
    lens, bent = _lens(content)
    return {
        "size_px": _size(content),
        "lens": lens,
        "intrinsics": dict(zip(("fx", "fy", "cx", "cy"), _pinhole(matrix, content[matrix]), strict=True)) | bent,
        **({"screen": content["screen"]} if "screen" in content else {}),
    }


def _first(content: dict[str, Any], names: tuple[str, ...]) -> str | None:
    return next((name for name in names if name in content), None)


def _require_whole(content: dict[str, Any]) -> None:
    for name in ("binning_x", "binning_y"):
        if content.get(name, 0) not in (0, 1):
            raise ValueError(f"entry '{name}': found {content[name]}, expected 1: the numbers are of pictures that are not binned")


def _size(content: dict[str, Any]) -> list[Any]:
    for names in _SIZES:
        if all(name in content for name in names):
            return [_side(name, content[name]) for name in names]
    raise ValueError("has no entries 'image_width' and 'image_height', the size of its pictures in px")


def _side(name: str, value: Any) -> int:
    if type(value) is not int or not 2 <= value <= LARGEST_PX:
        raise ValueError(f"entry '{name}': found {value!r}, expected a whole number of px, from 2 to {LARGEST_PX}")
    return value


def _pinhole(name: str, value: Any) -> list[float]:
    """fx, fy, cx, cy of a camera matrix."""
    numbers = _numbers(name, value)
    if len(numbers) != 9:
        raise ValueError(f"entry '{name}': expected 9 numbers, found {len(numbers)}")
    fx, skew, cx, *_ = numbers.tolist()
    _, fy, cy = numbers[3:6].tolist()
    if skew or numbers[3] or numbers[6:].tolist() != [0.0, 0.0, 1.0]:
        raise ValueError(f"entry '{name}': expected [fx, 0, cx, 0, fy, cy, 0, 0, 1], found {[float(f'{each:.6g}') for each in numbers]}")
    return [fx, fy, cx, cy]


def _lens(content: dict[str, Any]) -> tuple[Lens, dict[str, float]]:
    """Which lens it is, and its numbers by their names."""
    name = _first(content, _COEFFICIENTS)
    numbers = np.zeros(0) if name is None else _numbers(name, content[name])
    lens = _named(content["distortion_model"], numbers) if "distortion_model" in content else _by_number(numbers)
    names = DISTORTION_NAMES[lens]
    if numbers[len(names) :].any():
        raise ValueError(
            f"entry '{name}': {len(numbers)} coefficients, of which a {lens} lens has {len(names)}; the others are expected to be 0"
        )
    return lens, dict(zip(names, numbers.tolist(), strict=False))


def _named(model: Any, numbers: Vector) -> Lens:
    if (model is None or str(model).lower() in _UNBENT) and not numbers.any():
        return "plain"
    if str(model) not in _MODELS:
        raise ValueError(f"entry 'distortion_model': found '{model}', expected {', '.join(_MODELS)}, or none without coefficients")
    return _MODELS[str(model)]


def _by_number(numbers: Vector) -> Lens:
    return "rational" if len(numbers) > len(DISTORTION_NAMES["plain"]) else "plain"


def _numbers(name: str, value: Any) -> Vector:
    """The numbers of a matrix: of `data`, of rows, or one after the other."""
    data = value.get("data") if isinstance(value, dict) else value
    rows = data if isinstance(data, list) else []
    flat = [number for row in rows for number in (row if isinstance(row, list) else [row])]
    if (data != [] and not flat) or any(isinstance(number, bool) or not isinstance(number, (int, float)) for number in flat):
        raise ValueError(f"entry '{name}': expected numbers, as in data: [0.1, 0.2]")
    if len(flat) > _LISTED or not all(abs(number) < 1e6 for number in flat):
        raise ValueError(f"entry '{name}': expected at most {_LISTED} numbers below 1e6")
    return np.array(flat, dtype=float)
