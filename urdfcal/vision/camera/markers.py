"""ArUco markers on the screen: `screen.yaml`, which sits where.

    dictionary: DICT_4X4_50
    size_mm: 100                         # side of the black square
    side: front                          # from which side the camera looks; back: through a translucent screen. Default: front
    placement_mm: 0.5                    # sigma of y and z of a marker that was put up by hand; 0: exact. Default: 0.5
    markers: {0: [550, 400], 1: [-550, 400], 2: [550, -400], 3: [-550, -400]}     # centre (y, z) in mm, in the screen frame

The markers stand upright, their top edge toward +z, seen from the front (the -x side), where +y is to the left. Corner 0 of a
marker (top left) is at (+y, +z) of its centre.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from urdfcal.base.errors import InputError, did_you_mean
from urdfcal.base.files import YamlFile, read_yaml
from urdfcal.base.geometry import MM, Matrix
from urdfcal.base.yaml_kinds import kind_of
from urdfcal.sensors.camera import Side

_CORNER_SIGNS = np.array([[0, 1, 1], [0, -1, 1], [0, -1, -1], [0, 1, -1]]) / 2  # top left, top right, bottom right, bottom left
_FARTHEST_MM = 1e5
MarkerId = Annotated[int, Field(ge=0, le=100_000)]
Millimetres = Annotated[float, Field(ge=-_FARTHEST_MM, le=_FARTHEST_MM, allow_inf_nan=False)]


@dataclass(frozen=True)
class ScreenMarkers:
    """Markers on the screen.

    Attributes:
        dictionary: Name of OpenCV's ArUco dictionary.
        size: Side of a marker's black square, [m].
        centres: (y, z) of every marker's centre by its id, [m].
        side: From which side the camera looks.
        placement: Sigma of y and z of a marker's centre, [m]; 0 where it is exactly where it is said to be.
    """

    dictionary: str
    size: float
    centres: Mapping[int, tuple[float, float]]
    side: Side = "front"
    placement: float = 0.5 * MM

    def corners_of(self, marker: int) -> Matrix:
        """Corners (4, 3) in the screen frame [m]: top left, top right, bottom right, bottom left, seen from the front."""
        return np.asarray(np.array([0.0, *self.centres[marker]]) + self.size * _CORNER_SIGNS)

    def cells_of(self, marker: int) -> npt.NDArray[np.bool_]:
        """Which cells of a marker are white, with its black border, row 0 at the top, seen from the front."""
        return cells_of(self.dictionary, marker)


class ScreenEntries(BaseModel):
    """The whole file."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    dictionary: str
    size_mm: Annotated[float, Field(gt=0, le=_FARTHEST_MM, allow_inf_nan=False)]
    side: Side = "front"
    placement_mm: Annotated[float, Field(ge=0, le=1e3, allow_inf_nan=False)] = 0.5
    markers: dict[MarkerId, tuple[Millimetres, Millimetres]] = Field(min_length=1)


def dictionary_names() -> list[str]:
    """Names of the ArUco dictionaries that OpenCV has."""
    return sorted(name for name in dir(cv2.aruco) if name.startswith("DICT_"))


def aruco_dictionary(name: str) -> Any:
    """OpenCV's dictionary of that name, which must be one of `dictionary_names`."""
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def cells_of(name: str, marker: int) -> npt.NDArray[np.bool_]:
    """Which cells of a dictionary's marker are white, with its black border, row 0 at the top."""
    dictionary = aruco_dictionary(name)
    image = cv2.aruco.generateImageMarker(dictionary, marker, dictionary.markerSize + 2)
    return np.asarray(image > 127)


def read_screen_markers(path: str | Path) -> ScreenMarkers:
    """Read a screen.yaml.

    Raises:
        InputError: naming the file, the line and what was expected.
    """
    file = read_yaml(path, InputError)
    if not isinstance(file.content, dict) or "dictionary" not in file.content:
        other = f": it is {kind}" if (kind := kind_of(file.content)) else ""
        expected = "entries dictionary, size_mm and markers: {id: [y_mm, z_mm]}"
        raise InputError(f"is no screen.yaml{other}; expected {expected}", path, file.line())
    try:
        entries = ScreenEntries.model_validate(file.content)
    except ValidationError as error:
        raise _in_words(error.errors()[0], file) from None
    _check(entries, file)
    centres = {marker: (y * MM, z * MM) for marker, (y, z) in entries.markers.items()}
    return ScreenMarkers(entries.dictionary, entries.size_mm * MM, centres, entries.side, entries.placement_mm * MM)


def _check(entries: ScreenEntries, file: YamlFile) -> None:
    """Refuse a dictionary that OpenCV lacks, ids that the dictionary lacks, and markers that lie upon each other."""
    names = dictionary_names()
    if entries.dictionary not in names:
        way_out = did_you_mean(entries.dictionary, names) or "; expected one of OpenCV's, such as DICT_4X4_50"
        raise InputError(f"entry 'dictionary': '{entries.dictionary}' is unknown{way_out}", file.path, file.line(["dictionary"]))
    count = len(aruco_dictionary(entries.dictionary).bytesList)
    for marker in entries.markers:
        if marker >= count:
            raise InputError(
                f"marker {marker} is not in {entries.dictionary}, which has 0 to {count - 1}", file.path, file.line(["markers", marker])
            )
    ids, centres = list(entries.markers), np.array(list(entries.markers.values()))
    apart = np.abs(centres[:, None] - centres[None]).max(axis=2) + np.diag(np.full(len(ids), np.inf))
    if apart.min(initial=np.inf) < entries.size_mm:
        one, other = sorted(ids[index] for index in np.unravel_index(apart.argmin(), apart.shape))
        raise InputError(
            f"markers {one} and {other} lie upon each other: centres {apart.min():g} mm apart, size {entries.size_mm:g} mm",
            file.path,
            file.line(["markers", other]),
        )


def _in_words(found: Mapping[str, Any], file: YamlFile) -> InputError:
    place = [step for step in found["loc"] if step != "[key]"]
    name = ".".join(map(str, place))
    if found["type"] == "extra_forbidden":
        return InputError(f"entry '{name}' is unknown{did_you_mean(name, ScreenEntries.model_fields)}", file.path, file.line(place))
    if found["type"] == "missing":
        return InputError(f"entry '{name}' is missing", file.path, file.line())
    return InputError(f"entry '{name}': {found['msg']}, found {found.get('input')!r}", file.path, file.line(place))
