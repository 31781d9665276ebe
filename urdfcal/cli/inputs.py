"""Robots and calibrations that a command line names, with what is said of them where they are read."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from urdfcal.base.errors import UsageError
from urdfcal.cli.console import asked_quiet, warn

if TYPE_CHECKING:
    from urdfcal.calibration.rig_file import RigFile
    from urdfcal.model.earlier import EarlierJoints
    from urdfcal.output.stored import StoredCalibration
    from urdfcal.robot.robot import Robot
    from urdfcal.robot.xacro_child import XacroLimit


_MOST = 1e6  # [s], [GB]
_XACRO_LIMIT = re.compile(r"(\d+(?:\.\d+)?)s(?:,(\d+(?:\.\d+)?)GB)?")
_LEAST_GB = 0.1  # Python and xacro themselves


def load(
    path: Path,
    xacro_args: list[str] | None,
    package_dirs: list[Path] | None,
    screen: str | None = None,
    lasers: list[str] | None = None,
    rig: RigFile | None = None,
    *,
    xacro_limit: str | None = None,
    quiet: bool = True,
) -> Robot:
    """The robot that a command line names; what is left out of it is said unless it is to be quiet.

    Raises:
        UsageError: a --xacro-arg is no NAME:=VALUE, or --xacro-limit is no limit.
        RobotError: the file is not a robot that can be loaded.
    """
    from urdfcal.robot.robot import load_robot

    arguments = {}
    for argument in xacro_args or ():
        name, mark, value = argument.partition(":=")
        if not mark or not name:
            raise UsageError(f"--xacro-arg {argument}: expected NAME:=VALUE")
        arguments[name] = value
    warn_if_mixed(path)
    robot = load_robot(
        path,
        xacro_args=arguments,
        package_dirs=package_dirs or (),
        screen=screen or (rig.screen if rig else None),
        lasers=lasers or (rig.lasers if rig else None),
        xacro_limit=_xacro_limit(xacro_limit),
    )
    warn([f"{robot.tree.label}: {line}" for line in robot.tree.warnings], quiet)
    return robot


def _xacro_limit(text: str | None) -> XacroLimit:
    """What --xacro-limit allows."""
    from urdfcal.robot.xacro_child import XacroLimit

    if text is None:
        return XacroLimit()
    match = _XACRO_LIMIT.fullmatch("".join(text.split()))
    limit = XacroLimit(float(match[1]), float(match[2] or XacroLimit.gigabytes)) if match else XacroLimit(0, 0)
    if not 0 < limit.seconds <= _MOST or not _LEAST_GB <= limit.gigabytes <= _MOST:
        raise UsageError(f"--xacro-limit {text}: expected a time and a memory of at least {_LEAST_GB:g}GB, such as 60s,4GB")
    return limit


def warn_if_mixed(path: Path) -> None:
    """Name a URDF, or a calibration, that does not belong to what stands beside it."""
    from urdfcal.output.pairs import mixed

    warn(mixed(path), asked_quiet())


def stored_calibration(path: Path) -> StoredCalibration:
    """A calibration read from its file; where the files beside it are not those that it was written with, that is said.

    Raises:
        CalibrationFileError: the file is not one.
        UsageError: it is a robot description.
    """
    from urdfcal.output.stored import read_calibration

    if path.suffix.lower() in (".urdf", ".xacro"):
        raise UsageError(f"{path}: is a robot description; urdfcal import ROBOT {path} -o CALIBRATION.yaml makes a calibration of it")
    stored = read_calibration(path)
    warn_if_mixed(path)
    return stored


def with_calibration(robot: Robot, path: Path, quiet: bool) -> Robot:
    """The robot with a stored calibration put on it; what it lacks of the rig is said unless it is to be quiet.

    Raises:
        CalibrationFileError: the file is none, or not of this robot as it is.
    """
    from urdfcal.output.stored import corrected_robot

    origins, missing = stored_calibration(path).origins_for(robot)
    warn(lacking(robot, missing), quiet)
    return corrected_robot(robot, origins)


def lacking(robot: Robot, missing: Sequence[str]) -> list[str]:
    """A warning of calibrated joints that a robot does not have; only those of the rig may be missing."""
    return [f"{robot.description.path} has no joint {', '.join(missing)} of the measuring rig; the rest was applied"] if missing else []


def earlier_joints(path: Path | None, robot: Robot) -> EarlierJoints | None:
    """What an earlier calibration decided of the joints, whose URDF the robot is.

    Raises:
        CalibrationFileError: the file is no calibration, or does not say.
        RobotError: the robot is not the one that it wrote.
    """
    if path is None:
        return None
    from urdfcal.calibration.known_joints import require_written

    earlier = stored_calibration(path).joints
    require_written(earlier, robot, str(path))
    return earlier


def forgotten_branch(path: Path, robot: Robot) -> tuple[str, ...]:
    """A warning where the calibration beside a URDF decided joints of this way and of another branch, which a fit would spoil."""
    from urdfcal.base.errors import CalibrationFileError, RobotError
    from urdfcal.base.opened import unnoted
    from urdfcal.calibration.known_joints import require_written
    from urdfcal.output.pairs import record_beside
    from urdfcal.output.stored import read_calibration

    beside = record_beside(path)
    if not beside.is_file():
        return ()
    try:
        with unnoted():
            earlier = read_calibration(beside).joints
        require_written(earlier, robot, str(beside))
    except (CalibrationFileError, RobotError):  # of another robot, or of another time: this one owes it nothing
        return ()
    on_way = {step.joint.name for step in robot.chain.moving}
    shared, others = (list(dict.fromkeys(joint for joint in earlier.joints if (joint in on_way) == on)) for on in (True, False))
    if not shared or not others:
        return ()
    return (
        f"{path} was written with {beside}, which calibrated {', '.join(shared)} together with {', '.join(others)}: "
        f"what changes there now makes those worse; --after {beside} keeps what it decided",
    )


def papers_arm(name: str) -> Path:
    """One of the paper's arms, which come along: arm7 of Table I, arm4 of Table IV."""
    from urdfcal.robot.packages import own_package

    return own_package() / "robots" / name / f"{name}.urdf.xacro"
