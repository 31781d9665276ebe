"""What stands already where an output is to be written: an earlier result of the same inputs gives way, all else stays.

Robot and measurements are the same where their hashes are; a file that was edited by hand is no result any more.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from urdfcal.base.errors import CalibrationFileError, UsageError
from urdfcal.base.files import read_yaml, sha256
from urdfcal.base.opened import unnoted
from urdfcal.output.pairs import hashes_in, holds, same_place
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements

_WAY_OUT = "--overwrite replaces it, -o names another"


def require_marked(place: Path, marks: Iterable[str], what: str) -> None:
    """Refuse to replace a file that lacks what stands in every earlier result that may give way.

    Args:
        place: Of the output; it need not exist.
        marks: Words that all stand in such a file.
        what: Such a file, in words.

    Raises:
        UsageError: names the place, and the way out.
    """
    if place.is_file() and not _holds_all(place, marks):
        raise UsageError(f"{place}: is there already and is no {what}; {_WAY_OUT}")


def require_same(contents: Mapping[str | Path, bytes]) -> None:
    """Refuse to replace files that are not what would be written.

    Raises:
        UsageError: names the first of them, and the way out.
    """
    for place, content in contents.items():
        if Path(place).is_file() and not holds(Path(place), sha256(content)):
            raise UsageError(f"{place}: is there already and holds something else; {_WAY_OUT}")


def inputs_sha256(paths: Iterable[Path | None]) -> str:
    """One hash of the files that a result is made of, as far as they are there: a result that names it is an earlier one of the same."""
    found = [path for path in paths if path is not None and path.is_file()]
    return sha256(b"".join(hashlib.sha256(path.read_bytes()).digest() for path in found))


def require_earlier(record: Path, places: Iterable[Path], robot: Robot, data: Measurements) -> None:
    """Refuse to replace what an earlier fit of the same robot and measurements has not written.

    Args:
        record: Where the calibration goes.
        places: Where the files beside it go.
        robot: What is calibrated.
        data: What it is calibrated by.

    Raises:
        UsageError: names the first file that is another's, or was edited, and the way out.
    """
    with unnoted():
        said = _hashes_of_earlier(record, robot, data) if record.is_file() else {}
        for place in (place for place in places if place.is_file()):
            known = next((its for other, its in said.items() if same_place(other, place)), None)
            if known is not None and not holds(place, known):
                raise UsageError(f"{place}: is not what {record} was written with: it was edited since, or a run was cut short; {_WAY_OUT}")
            if known is None and not _holds_all(place, (sha256(robot.description.text), data.sha256 or "-")):
                raise UsageError(f"{place}: is there already and is no earlier result of this robot and these measurements; {_WAY_OUT}")


def _hashes_of_earlier(record: Path, robot: Robot, data: Measurements) -> dict[Path, str]:
    try:
        before = read_yaml(record, CalibrationFileError).content
    except CalibrationFileError:
        before = None
    if not isinstance(before, dict) or not {"urdfcal", "joints"} <= before.keys():
        raise UsageError(f"{record}: is there already and is no calibration by urdfcal; {_WAY_OUT}")
    of = _other_robot(_entry(before, "robot"), robot) + _other_measurements(_entry(before, "measurements"), data)
    if of:
        raise UsageError(f"{record}: is a calibration {' and '.join(of)}; {_WAY_OUT}")
    return hashes_in(record, before)


def _other_robot(before: dict[str, Any], robot: Robot) -> list[str]:
    if before.get("sha256") == sha256(robot.description.text):
        return []
    same = before.get("file") == str(robot.description.path)
    return [f"of another robot{_told(before, ' as it was, or with other xacro arguments' if same else '')}"]


def _other_measurements(before: dict[str, Any], data: Measurements) -> list[str]:
    if before.get("sha256", "") == data.sha256:
        return []
    return [f"from other measurements{_told(before, ' as it was' if before.get('file') == data.source else '')}"]


def _told(before: dict[str, Any], behind: str) -> str:
    """` (NAME, FILE ...)` as far as they are known."""
    known = ", ".join(str(before[name]) for name in ("name", "file") if name in before)
    return f" ({known}{behind})" if known else ""


def _entry(content: dict[str, Any], name: str) -> dict[str, Any]:
    found = content.get(name)
    return found if isinstance(found, dict) else {}


def _holds_all(place: Path, marks: Iterable[str]) -> bool:
    with unnoted():
        content = place.read_bytes()
    return all(mark.encode() in content for mark in marks)
