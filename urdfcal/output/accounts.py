"""Accounts of a robot read from files: descriptions, and calibrations of one."""

from __future__ import annotations

from pathlib import Path

from urdfcal.base.errors import CalibrationFileError, UsageError, did_you_mean
from urdfcal.calibration.analysis.comparison import Account
from urdfcal.output.stored import StoredCalibration, corrected_robot
from urdfcal.robot.corrections import same_origin
from urdfcal.robot.robot import Robot


def account_of(stored: StoredCalibration, base: Robot) -> Account:
    """What a calibration says of a robot.

    Args:
        stored: The calibration.
        base: The robot as it was before, or as another has it; where the calibration says nothing, it counts.

    Raises:
        CalibrationFileError: the calibration is another robot's.
    """
    joints = base.tree.joints
    strange = next((name for name, own in stored.corrections.items() if own.moving and name not in joints), None)
    if strange is not None:
        raise CalibrationFileError(f"{base.description.label} has no joint '{strange}'{did_you_mean(strange, joints)}", stored.path)
    origins = {name: own.corrected for name, own in stored.corrections.items() if name in joints}
    return Account(str(stored.path), corrected_robot(base, origins), stored.joints if stored.posterior else None)


def silent_joints(stored: StoredCalibration, base: Robot, other: Robot) -> tuple[str, ...]:
    """Joints that a calibration says nothing of, where the other has them elsewhere than the base."""
    ours, theirs = base.tree.joints, other.tree.joints
    rest = (name for name in ours if name in theirs and name not in stored.corrections)
    return tuple(name for name in rest if not same_origin(ours[name].origin, theirs[name].origin))


def described_in(stored: StoredCalibration) -> Path:
    """Where the description stands that was calibrated: as it was named then, or beside the calibration.

    Raises:
        UsageError: it is in neither place.
    """
    places = [Path(stored.description), stored.path.parent / Path(stored.description).name] if stored.description else []
    for place in places:
        if place.is_file():
            return place
    raise UsageError(
        f"{stored.path}: the robot that was calibrated ({stored.description or 'not named'}) is not found; "
        "name its description with --robot"
    )
