"""Pictures from files, folders and patterns, as the sensor saw them: arrays of light, compared with a dark one, put together by pose.

A turn that the file's EXIF data ask for is not made: pixel coordinates belong to the sensor, on which a lens sits once.

Which pictures belong to one pose: those of one sub-folder; or those named `<pose>_<number>`, where at least two poses are named so
and each has at least two pictures (`img_001 ... img_060` are 60 poses, not 60 pictures of one).
"""

from __future__ import annotations

import glob
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import numpy.typing as npt

from urdfcal.base.errors import InputError, UsageError
from urdfcal.base.native import native_stderr
from urdfcal.vision.picture_file import picture_content

Grey = npt.NDArray[np.uint8]
SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".pgm", ".ppm")
_WILD = "*?["

FULL_SCALE = 255.0
Grouping = Literal["auto", "one", "named"]
_NUMBERED = re.compile(r"(.+)_(\d+)$")
_CLIPPED = 0.98  # of full scale; lossy compression rings a little below it


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
    content = picture_content(path)
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)  # OpenCV would add lines of its own about broken files
    try:
        with native_stderr():  # libpng and libjpeg print theirs past OpenCV
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


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture whose lamps and background may have been taken off.

    Attributes:
        name: For messages.
        light: Red, green, blue, (h, w, 3) float32, full scale is 255.
        clipped: Where a colour is at full scale, and its light unknown, (h, w, 3).
        dark: Whether a dark picture was taken off.
    """

    name: str
    light: npt.NDArray[np.float32]
    clipped: npt.NDArray[np.bool_]
    dark: bool = False

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, [px]."""
        return self.light.shape[1], self.light.shape[0]

    @property
    def colourless(self) -> bool:
        """Whether it comes from a camera that sees no colour."""
        return float(np.abs(self.light - self.light.mean(axis=2, keepdims=True)).mean(axis=(0, 1)).max()) == 0.0

    def minus(self, dark: Picture) -> Picture:
        """The light that a dark picture has not; what is clipped there stays unknown.

        Raises:
            InputError: the two differ in size.
        """
        if dark.size != self.size:
            raise InputError(f"is {self.size[0]} x {self.size[1]} px, the dark picture {dark.size[0]} x {dark.size[1]}", self.name)
        return Picture(self.name, self.light - dark.light, self.clipped | dark.clipped, True)


def read_picture(path: str | Path, size: tuple[int, int] | None = None) -> Picture:
    """Read a picture of 8 or 16 bits, in colour or grey.

    Args:
        path: The file.
        size: Width and height that it must have, [px].

    Raises:
        InputError: it cannot be read, or is of another size.
    """
    pixels = decoded(picture_content(path))
    if pixels is None:
        raise InputError(f"cannot be read as a picture; expected one of {' '.join(SUFFIXES)}", path)
    if size is not None and (pixels.shape[1], pixels.shape[0]) != tuple(size):
        raise InputError(
            f"is {pixels.shape[1]} x {pixels.shape[0]} px, expected the camera's {size[0]} x {size[1]}; take the picture that "
            "the camera was calibrated for",
            path,
        )
    return picture_from(pixels, str(path))


def decoded(content: npt.NDArray[np.uint8]) -> npt.NDArray[np.generic] | None:
    """The pixels (h, w, 3) of a picture file in blue, green, red, or None where it is none."""
    if not content.size:
        return None
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)  # OpenCV would add lines of its own about broken files
    try:
        with native_stderr():
            pixels = cv2.imdecode(content, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error:
        return None
    return None if pixels is None or pixels.dtype not in (np.uint8, np.uint16) else pixels


def picture_from(pixels: npt.NDArray[np.generic], name: str = "") -> Picture:
    """A picture from pixels (h, w, 3) in OpenCV's order blue, green, red, 8 or 16 bits."""
    full = FULL_SCALE if pixels.dtype == np.uint8 else 65535.0
    light = np.ascontiguousarray(pixels[..., ::-1]).astype(np.float32) * np.float32(FULL_SCALE / full)
    return Picture(name, light, light >= _CLIPPED * FULL_SCALE)


def image_files(places: Sequence[Path], excluded: Sequence[Path] = ()) -> list[Path]:
    """The pictures that folders and file names mean, in natural order.

    Raises:
        InputError: a place is missing or holds no picture.
    """
    left_out = {path.resolve() for path in excluded}
    found: list[Path] = []
    for place in places:
        if not place.exists():
            raise InputError("does not exist; expected a picture or a folder of pictures", place)
        inside = _pictures_in(place) if place.is_dir() else [place]
        inside = [path for path in inside if path.resolve() not in left_out]
        if not inside:
            raise InputError(f"holds no picture; expected files ending in {' '.join(SUFFIXES)}", place)
        found += sorted(inside, key=lambda path: [natural(part) for part in path.parts])
    return list(dict.fromkeys(found))


def _pictures_in(folder: Path) -> list[Path]:
    deep = [path for below in folder.iterdir() if below.is_dir() and not below.name.startswith(".") for path in below.iterdir()]
    flat = [*folder.iterdir(), *deep]
    return [path for path in flat if path.is_file() and path.suffix.lower() in SUFFIXES and not path.name.startswith(".")]


def natural(text: str) -> list[tuple[int, int | str]]:
    """A key that sorts p2 before p10."""
    return [(0, int(part)) if part.isdigit() else (1, part) for part in re.split(r"(\d+)", text) if part]


def picture_name(label: str) -> str:
    """What a picture of a pose can be named: the pose's label without what file names do not take."""
    return re.sub(r"[^\w.+-]+", "_", label).strip("._") or "pose"


def by_pose(
    files: Sequence[Path], folders: Sequence[Path], grouping: Grouping = "auto", known: Collection[str] = ()
) -> dict[str, list[Path]]:
    """The pictures of each pose, by the pose's label; see the head of this module.

    Args:
        files: The pictures.
        folders: Folders that were named; what lies in a folder below one of them is one pose.
        grouping: `one`: every picture is a pose; `named`: `<pose>_<number>` always; `auto`: see above.
        known: Names of pictures or poses from elsewhere; under `auto` they decide, where they name every picture or every pose.

    Raises:
        UsageError: two poses would have the same label.
    """
    above = {folder.resolve() for folder in folders}
    below = {path: path.parent.name for path in files if path.parent.resolve().parent in above and path.parent.resolve() not in above}
    stems = {path: match[1] for path in files if path not in below and (match := _NUMBERED.match(path.stem))}
    if grouping == "auto" and known and not below:
        alone, together = ({path.stem, path.name} for path in files), ({stems.get(path, "")} for path in files)
        grouping = (
            "one" if all(names & set(known) for names in alone) else "named" if all(names & set(known) for names in together) else grouping
        )
    shared = {label: list(stems.values()).count(label) for label in stems.values()}
    named = grouping == "named" or (grouping == "auto" and len(shared) > 1 and min(shared.values()) > 1)
    groups: dict[str, list[Path]] = {}
    for path in files:
        label = path.stem if grouping == "one" else below.get(path) or (stems.get(path, path.stem) if named else path.stem)
        groups.setdefault(label, []).append(path)
    _refuse_twins(groups, grouping, below)
    return groups


def _refuse_twins(groups: Mapping[str, Sequence[Path]], grouping: Grouping, below: Mapping[Path, str]) -> None:
    for label, paths in groups.items():
        stems = [path.stem for path in paths if path not in below or grouping == "one"]
        if len(set(stems)) < len(stems) or (stems and len(stems) < len(paths)):
            raise UsageError(f"{paths[0]} and {paths[1]}: two pictures would both be pose '{label}'; give them different names")
