"""Accounts of a robot read from files: descriptions, and calibrations of one."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

from urdfcal.base.errors import CalibrationFileError, UsageError, did_you_mean
from urdfcal.calibration.analysis.comparison import Account
from urdfcal.calibration.known_joints import joints_of
from urdfcal.calibration.result import FitResult
from urdfcal.output.stored import StoredCalibration, corrected_robot
from urdfcal.robot.corrections import same_origin
from urdfcal.robot.robot import Robot

Said: TypeAlias = "Robot | StoredCalibration | FitResult"
Load: TypeAlias = Callable[[Path], Robot]


def accounts_of(one: Said, other: Said, base: Robot | None, load: Load) -> tuple[Account, Account, tuple[str, ...]]:
    """What two say of one robot.

    Args:
        one: A fit, a stored calibration or a robot.
        other: The like.
        base: The robot that stored calibrations are put on; by default the one that the other has described, else the one that is named in
            the first.
        load: Reads the description that a calibration names.

    Returns:
        Both accounts, and in words what a calibration says nothing of.

    Raises:
        CalibrationFileError: a calibration is another robot's.
        UsageError: something else was given, or the robot that was calibrated is not found.
    """
    said = tuple(_read(each) for each in (one, other))
    known = (base, *(_robot_of(each) for each in said))
    under = next((robot for robot in known if robot is not None), None)
    if under is None:
        under = load(described_in(next(each for each in said if isinstance(each, StoredCalibration))))
    accounts = tuple(each if isinstance(each, Account) else account_of(each, under) for each in said)
    words = tuple(
        f"{each.path} says nothing of {', '.join(silent)}: taken as {under.description.label} has them"
        for each, beside in zip(said, accounts[::-1], strict=True)
        if isinstance(each, StoredCalibration) and (silent := silent_joints(each, under, beside.robot))
    )
    return accounts[0], accounts[1], words


def _read(said: Said) -> Account | StoredCalibration:
    if isinstance(said, FitResult):
        origins = {name: correction.corrected for name, correction in said.corrections.items()}
        return Account(f"the fit of {said.robot.name}", corrected_robot(said.robot, origins), joints_of(said))
    if isinstance(said, Robot):
        return Account(str(said.description.path), said)
    if isinstance(said, StoredCalibration):
        return said
    raise UsageError(f"compare: found a {type(said).__name__}; expected calibrations, robots, or paths of either")


def _robot_of(said: Account | StoredCalibration) -> Robot | None:
    return said.robot if isinstance(said, Account) else None


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
