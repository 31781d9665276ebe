"""Files that belong together: a calibration's record holds the hashes of those that were written with it, and is itself written last.

So a run that was cut short, and an edit made since, can be told: one of the pair is then not what the other says.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from urdfcal.base.errors import CalibrationFileError, MixedFilesWarning
from urdfcal.base.files import is_yaml, read_yaml, sha256
from urdfcal.base.opened import unnoted
from urdfcal.output.endings import stem_of

CORRECTED = "calibration_sha256"  # entry of a camera's file that a fit has written: the hash of its record
_CAMERA = "_camera.yaml"
ENTRY = "files"  # of the record: the hash of each file that it was written with, by its way from the record's folder


def record_beside(urdf: Path) -> Path:
    """Where the calibration stands that a URDF was written with."""
    return urdf.parent / f"{stem_of(urdf)}_calibration.yaml"


def written_with(record: Path, contents: Mapping[str | Path, bytes]) -> dict[str, str]:
    """The entry of a record about the files that are written with it."""
    return {_way(record, Path(place)): sha256(content) for place, content in contents.items()}


def hashes_in(record: Path, content: Any) -> dict[Path, str]:
    """What a record says of the files that it was written with: their hashes by their places."""
    said = content.get(ENTRY) if isinstance(content, dict) else None
    return {record.parent / str(way): str(its) for way, its in said.items()} if isinstance(said, dict) else {}


def mixed(path: Path) -> tuple[str, ...]:
    """What to say of a URDF, or of a calibration, that does not belong to what stands beside it; nothing where it does.

    Args:
        path: The URDF or the calibration that was loaded; the other of the two need not be there.
    """
    if path.name.endswith(_CAMERA):
        return _mixed_camera(path)
    record = path if is_yaml(path) else record_beside(path)
    if not record.is_file():
        return ()
    with unnoted():  # a calibration that nobody named is no input
        try:
            said = hashes_in(record, read_yaml(record, CalibrationFileError).content)
        except CalibrationFileError:  # none of ours; where it is what was asked for, that is said elsewhere
            return ()
        about = {place: its for place, its in said.items() if path == record or same_place(place, path)}
        return tuple(_said(place, record) for place, its in about.items() if place.is_file() and not holds(place, its))


def _mixed_camera(path: Path) -> tuple[str, ...]:
    """What to say of a camera that a fit has corrected, where the calibration beside it is another."""
    record = path.with_name(path.name.removesuffix(_CAMERA) + "_calibration.yaml")
    if not path.is_file() or not record.is_file():
        return ()
    with unnoted():
        try:
            content = read_yaml(path, CalibrationFileError).content
        except CalibrationFileError:  # no camera: that is said elsewhere
            return ()
        its = content.get(CORRECTED) if isinstance(content, dict) else None
        return (_said(record, path),) if isinstance(its, str) and not holds(record, its) else ()


def warn_if_mixed(path: str | Path) -> None:
    """Warn, in Python's way, of a file that does not belong to what stands beside it."""
    for line in mixed(Path(path)):
        warnings.warn(line, MixedFilesWarning, stacklevel=3)


def same_place(one: Path, other: Path) -> bool:
    """Whether two paths lead to one place."""
    return os.path.realpath(one) == os.path.realpath(other)


def holds(place: Path, its: str) -> bool:
    """Whether a file has this hash."""
    with unnoted():
        return sha256(place.read_bytes()) == its


def _said(place: Path, record: Path) -> str:
    return (
        f"{place} and {record} are a mixed pair: the one is not the file that the other was written with (edited since, or a run was "
        "cut short); fit again, or write it from the calibration with urdfcal apply"
    )


def _way(record: Path, place: Path) -> str:
    way = os.path.relpath(os.path.abspath(place), os.path.abspath(record.parent))
    return way.encode("utf-8", "backslashreplace").decode()
