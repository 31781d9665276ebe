"""What can go wrong, as exceptions.

    UrdfcalError
    ├── UsageError              an option or argument that cannot be taken as it is
    ├── ShapeMismatch           an array that does not fit the robot or error model
    ├── InputError              a file that cannot be taken as it is: `FILE:LINE: what, what was expected`
    │   ├── RobotError          URDF or xacro
    │   ├── MeasurementError    measurements.csv
    │   ├── RigError            rig.yaml, screen and lasers
    │   └── CalibrationFileError
    └── FitRejected             the data were read, but no trustworthy calibration came of them

The command line turns the last into exit code 3, every other into exit code 2, each with one line.
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path


class UrdfcalError(Exception):
    """Base of everything that urdfcal raises on purpose."""

    exit_code = 2

    def __init__(self, message: str) -> None:
        super().__init__(" ".join(message.split()))


class UsageError(UrdfcalError, ValueError):
    """An option or argument that cannot be taken as it is."""


class ShapeMismatch(UrdfcalError, ValueError):
    """An array whose shape does not fit the robot or the error model."""


class InputError(UrdfcalError, ValueError):
    """A file that cannot be taken as it is; the message starts with `FILE:LINE:`, without a line where it is not of one."""

    def __init__(self, message: str, path: str | Path | None = None, line: int | None = None) -> None:
        where = "" if path is None else f"{path}: " if not line else f"{path}:{line}: "
        super().__init__(where + message)


class RobotError(InputError):
    """A URDF or xacro file that does not describe a robot which can be calibrated."""


class MeasurementError(InputError):
    """A measurements file that cannot be taken as it is."""


class RigError(InputError):
    """Screen, lasers, priors or noise that do not fit the robot."""


class CalibrationFileError(InputError):
    """A stored calibration that cannot be read or does not fit the robot."""


class FitRejected(UrdfcalError):
    """A fit that did not converge, or whose result must not be trusted."""

    exit_code = 3

    def __init__(self, message: str, forceable: bool = True) -> None:
        """`forceable` says whether there is a result at all that could be written all the same."""
        super().__init__(message)
        self.forceable = forceable


def nearest_of(name: str, known: Iterable[str]) -> str:
    """`; did you mean 'tool0'?`, or nothing."""
    close = get_close_matches(name, sorted(known), n=1, cutoff=0.6)
    return f"; did you mean '{close[0]}'?" if close else ""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """The way out for a misspelt name: `; did you mean 'tool0'?`, or the known names, or nothing."""
    names = list(known)
    if hint := nearest_of(name, names):
        return hint
    return f"; there are: {', '.join(names)}" if 0 < len(names) <= 12 else ""


def no_such(kind: str, name: str, known: Iterable[str]) -> str:
    """`no link named 'tool_0' among 14 links; did you mean 'tool0'?`."""
    names = list(known)
    return f"no {kind} named '{name}' among {len(names)} {kind}s{did_you_mean(name, names)}"


class MixedFilesWarning(UserWarning):
    """Files that were written together, and no longer belong together."""
