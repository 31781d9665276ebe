"""Pictures from files, folders and patterns, as the sensor saw them.

A turn that the file's EXIF data ask for is not made: pixel coordinates belong to the sensor, on which a lens sits once.
"""

from __future__ import annotations

import glob
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from urdfcal.errors import InputError, UsageError

Grey = npt.NDArray[np.uint8]
SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".pgm", ".ppm")
_WILD = "*?["


def picture_files(places: Iterable[str | Path]) -> list[Path]:
    """The pictures that files, folders and glob patterns name, each once, in the order of the places and of their names.

    Args:
        places: A folder stands for every file in it that ends like a picture.

    Raises:
        InputError: a file is missing, a folder holds no picture, nothing matches a pattern.
    """
    found: dict[Path, None] = {}
    for place in map(Path, places):
        if place.is_dir():
            files = sorted(path for path in place.iterdir() if path.suffix.lower() in SUFFIXES and path.is_file())
            if not files:
                raise InputError(f"the folder holds no picture ({', '.join(SUFFIXES)})", place)
        elif place.exists():
            files = [place]
        elif any(letter in str(place) for letter in _WILD):
            files = sorted(path for path in map(Path, glob.glob(str(place), recursive=True)) if path.is_file())
            if not files:
                raise InputError("no file matches this pattern", place)
        else:
            raise InputError("no such file or folder", place)
        found.update(dict.fromkeys(files))
    if not found:
        raise UsageError("no pictures; name files, folders or patterns such as 'views/*.png'")
    return list(found)


def read_grey(path: str | Path) -> Grey:
    """A picture's brightness, 0 to 255, (height, width).

    Raises:
        InputError: the file cannot be read as a picture.
    """
    try:
        content = np.frombuffer(Path(path).read_bytes(), dtype=np.uint8)
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}", path) from None
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)  # OpenCV would add lines of its own about broken files
    try:
        picture = cv2.imdecode(content, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION) if len(content) else None
    except cv2.error:
        picture = None
    if picture is None:
        raise InputError("is not readable as a picture", path)
    return np.asarray(picture, dtype=np.uint8)


def size_of(picture: Grey) -> tuple[int, int]:
    """Width and height, [px]."""
    return picture.shape[1], picture.shape[0]


def require_size(path: str | Path, picture: Grey, size: tuple[int, int], whose: str) -> None:
    """Refuse a picture of another size.

    Raises:
        InputError: naming both sizes.
    """
    width, height = size_of(picture)
    if (width, height) != tuple(size):
        raise InputError(f"is {width} x {height} px, expected {size[0]} x {size[1]} px as {whose}", path)
