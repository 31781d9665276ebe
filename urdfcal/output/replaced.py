"""What stands already where an output is to be written, under a name that nobody stated.

Files of others are left alone; an earlier output of urdfcal gives way, with a word where it is about something else.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from urdfcal.base.errors import CalibrationFileError, UsageError
from urdfcal.base.files import read_yaml
from urdfcal.output.calibration_yaml import sha256
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements

_MAKER = b"urdfcal"


def require_ours(places: Iterable[Path], mark: bytes = _MAKER) -> None:
    """Refuse to replace files that urdfcal has not written.

    Args:
        places: Of outputs whose names nobody stated; those that do not exist are free.
        mark: What stands in every file of that kind that urdfcal writes.

    Raises:
        UsageError: names the first of them, and the way out.
    """
    for place in places:
        if place.is_file() and mark not in place.read_bytes():
            raise UsageError(f"{place}: is there already and is no earlier output of this command; move it away or name another with -o")


def replaced(place: Path, robot: Robot, data: Measurements) -> tuple[str, ...]:
    """What to say of a calibration that another one is about to replace; nothing where it is of the same robot and measurements.

    Args:
        place: Where the file of a calibration is to be written; it need not exist.
        robot: What is calibrated now.
        data: What it is calibrated by.
    """
    try:
        before = read_yaml(place, CalibrationFileError).content if place.exists() else None
    except CalibrationFileError:
        return (f"{place}, which cannot be read, is replaced",)
    if not isinstance(before, dict):
        return ()
    of = _other_robot(_entry(before, "robot"), robot) + _other_measurements(_entry(before, "measurements"), data)
    return (f"{place}, a calibration {' and '.join(of)}, is replaced, and what stands beside it; -o OUT keeps both",) if of else ()


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
