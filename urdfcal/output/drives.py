"""Planned poses as something that drives a robot through them: a ROS 2 trajectory, a URScript program, or a table in degrees."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import DEG, MM, Matrix, Vector
from urdfcal.base.tables import csv_text
from urdfcal.planning.approach import from_both_sides
from urdfcal.planning.plan import PosePlan
from urdfcal.planning.roads import times_between
from urdfcal.planning.tour import Tour, legs, speeds_of
from urdfcal.robot.robot import Robot

_DECIMALS = 6
_SCRIPT_JOINTS = 6  # that URScript's movej takes
_ACCELERATION = 0.8  # [rad/s^2] of URScript's movej, gentle
_SCRIPT_PAUSE = 2.0  # [s] to stand still and be read, where none is stated


@dataclass(frozen=True)
class Drive:
    """Where a robot goes, one station after the other.

    Attributes:
        robot: As the sensors see it.
        names: What is read at each station; the empty string where it only passes.
        q: Positions of the measured joints, (stations, inputs), [rad] or [m].
        speed: Share of the joints' full speed.
        pause: How long it stands where something is read, [s].
        made_of: The sha256 of what the plan was made of.
    """

    robot: Robot
    names: tuple[str, ...]
    q: Matrix
    speed: float
    pause: float
    made_of: str

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the measured joints."""
        return self.robot.chain.input_names

    @property
    def seconds(self) -> Vector:
        """What each way to a station takes, (stations,); nothing to the first."""
        speeds = speeds_of(self.robot) * self.speed
        return np.array([0.0, *(times_between(a[None], b[None], speeds)[0, 0] for a, b in zip(self.q[:-1], self.q[1:], strict=True))])

    @property
    def head(self) -> list[str]:
        """Comments that every form begins with."""
        return [
            f"poses for {self.robot.name}, chosen by urdfcal poses; it begins at its first station",
            f"sha256 of what it was made of: {self.made_of}",
        ]


def pose_names(count: int, both_sides: bool) -> list[tuple[str, ...]]:
    """What the poses of a tour are called, once for every time that they are read."""
    sides = ("a", "b") if both_sides else ("",)
    return [tuple(f"p{number:02d}{side}" for side in sides) for number in range(1, count + 1)]


def drive_of(plan: PosePlan, tour: Tour, *, both_sides: bool, speed: float, pause: float, made_of: str) -> Drive:
    """The tour as stations, as far as it can be driven without a break; each pose from both sides, if that is wanted."""
    names: list[str] = []
    stations: list[Vector] = []
    part = tour.drivable
    ways = [plan.q[tour.order][part[:1]], *(leg[1:] for leg in legs(plan.q, tour)[part.start : part.stop - 1])]
    for read, way in zip(pose_names(len(plan), both_sides)[part.start : part.stop], ways, strict=True):
        names += [""] * (len(way) - 1)
        stations += list(way[:-1])
        names += ["", read[0], "", read[1]] if both_sides else list(read)
        stations += list(from_both_sides(way[-1], plan.robot)) if both_sides else [way[-1]]
    return Drive(plan.robot, tuple(names), np.array(stations), speed, pause, made_of)


def trajectory_yaml(drive: Drive) -> bytes:
    """As trajectory_msgs/JointTrajectory; where it pauses, a pose is two points."""
    points: list[dict[str, Any]] = []
    clock, where = 0.0, []
    for name, q, seconds in zip(drive.names, drive.q, drive.seconds.tolist(), strict=True):
        clock += seconds
        points.append(_point(q, clock))
        if name:
            where.append(f"{name} {len(points) - 1}")
            if drive.pause:
                clock += drive.pause
                points.append(_point(q, clock))
    head = [*drive.head, "trajectory_msgs/JointTrajectory; poses are the points (counted from 0)", *_lines(where)]
    body = yaml.safe_dump({"joint_names": list(drive.joints), "points": points}, sort_keys=False, default_flow_style=None, width=160)
    return ("".join(f"# {line}\n" for line in head) + body).encode()


def _point(q: Vector, clock: float) -> dict[str, Any]:
    nanoseconds = round(clock * 1e9)
    return {
        "positions": [round(float(position), _DECIMALS) + 0.0 for position in q],
        "time_from_start": {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9},
    }


def _lines(words: list[str], per_line: int = 12) -> list[str]:
    return ["  " + ", ".join(words[start : start + per_line]) for start in range(0, len(words), per_line)]


def require_urscript(robot: Robot) -> None:
    """Refuse a robot that URScript's movej cannot move.

    Raises:
        UsageError: and why.
    """
    joints = robot.chain.inputs
    slides = [joint.name for joint in joints if joint.prismatic]
    if len(joints) != _SCRIPT_JOINTS or slides:
        found = f"'{slides[0]}' slides" if slides else f"{robot.name} has {len(joints)}: {', '.join(robot.chain.input_names)}"
        raise UsageError(f"URScript's movej takes six joints that turn, and {found}; write a .yaml or a .csv in place of the .script")


def urscript(drive: Drive) -> bytes:
    """A URScript program of movej to every station, with a message and a pause where something is read.

    Raises:
        UsageError: the robot is not one that URScript moves.
    """
    require_urscript(drive.robot)
    speed = float(speeds_of(drive.robot).min()) * drive.speed
    lines = [f"# {line}" for line in drive.head] + [f"# joints, in this order: {', '.join(drive.joints)}", "def urdfcal_poses():"]
    for name, q in zip(drive.names, drive.q, strict=True):
        lines.append(f"  movej([{', '.join(_written(position) for position in q)}], a={_ACCELERATION:g}, v={speed:.4f})")
        if name:
            lines += [f'  textmsg("{name}")', f"  sleep({drive.pause or _SCRIPT_PAUSE:g})"]
    return "\n".join([*lines, "end", "urdfcal_poses()", ""]).encode()


def degrees_csv(drive: Drive) -> bytes:
    """A row a station, in degrees, or millimetres where a joint slides; `via` where it only passes."""
    units = [(MM, "mm") if joint.prismatic else (DEG, "deg") for joint in drive.robot.chain.inputs]
    header = ["pose", *(f"{name} [{unit}]" for name, (_, unit) in zip(drive.joints, units, strict=True))]
    scaled = drive.q / np.array([size for size, _ in units])
    rows = [[name or "via", *map(_written, row)] for name, row in zip(drive.names, scaled, strict=True)]
    return csv_text(header, rows, drive.head)


def _written(position: float) -> str:
    return f"{round(float(position), _DECIMALS) + 0.0:.{_DECIMALS}f}"


FORMS: Mapping[str, Callable[[Drive], bytes]] = {
    ".yaml": trajectory_yaml,
    ".yml": trajectory_yaml,
    ".script": urscript,
    ".csv": degrees_csv,
}


def require_form(path: Path, robot: Robot) -> None:
    """Refuse a file whose ending is of no form, and a form that is not for this robot.

    Raises:
        UsageError: and what there is.
    """
    if path.suffix.lower() not in FORMS:
        raise UsageError(f"{path}: ends in '{path.suffix}', expected .yaml (ROS 2), .script (URScript) or .csv (degrees)")
    if FORMS[path.suffix.lower()] is urscript:
        require_urscript(robot)
