"""A robot put to its measurements as it is: whatever was read becomes a mark beside the point where the robot has it.

Its measuring frame, its targets and shared places stand where they suit it best, and nothing else is free. A mark is a point where the
reading has the target, as its sensor says: a spot on the screen, a socket's common place, the foot on a plane, the point of a wire at
the length that was read, the point on a pixel's ray.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pinocchio as pin

from urdfcal.base.geometry import SE3, Array3, Array4, Labels, Mask, Matrix, Vector
from urdfcal.calibration.channel import Channel
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.start.nominal import nominal_fit
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model, of_these_poses
from urdfcal.model.jacobian import motion_at
from urdfcal.model.kinematics import ArmKinematics
from urdfcal.model.options import ModelOptions
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.sensor import UNITS, Sensor, View
from urdfcal.sensors.spots import Beams, beams_at
from urdfcal.sensors.stated_noise import noise_of


@dataclass(frozen=True)
class Mark:
    """One sensor's readings of one target beside what a robot predicts: points in the axes of the screen, or of the measuring frame.

    Attributes:
        name: As tables have it.
        unit: Of `errors`: mm, deg or px.
        sensor: What read it.
        target: What was read.
        read: Where the reading has the target, (n, 3), [m]; nan where nothing was read.
        predicted: Where the robot has it, (n, 3), [m]; nan where it has it nowhere: of a beam that misses.
        errors: How far reading and prediction are apart, (n,); nan where there are not both.
        axes: Measured axes of an orientation, (n, 3, 3); None of other kinds.
        start: Where the line to the target begins, (n, 3), [m]; None where nothing looks at it.
        normals: Normals of the planes that were touched, (n, 3); None of other kinds.
        labels: Which place was touched, (n,).
    """

    name: str
    unit: str
    sensor: Sensor
    target: str
    read: Matrix
    predicted: Matrix
    errors: Vector
    axes: Array3 | None
    start: Matrix | None
    normals: Matrix | None
    labels: Labels

    @property
    def on_screen(self) -> bool:
        """Whether it lies on the screen; others are in the measuring frame."""
        return self.sensor.seen_from == "screen"

    @property
    def is_point(self) -> bool:
        """Whether it has a place of its own; an orientation is drawn at its target's."""
        return bool(self.sensor.mark)

    @property
    def was_read(self) -> Mask:
        """At which poses, (n,)."""
        return ~np.asarray(np.isnan(self.read[:, 0]))


@dataclass(frozen=True)
class TouchedPlane:
    """A plane that was touched: its label, its normal, and the feet of the touches on it, (k, 3), in the measuring frame, [m]."""

    label: str
    normal: Vector
    feet: Matrix


@dataclass(frozen=True)
class Placed:
    """A robot with its instruments where they suit it best.

    Attributes:
        robot: The robot.
        data: What was measured.
        errors: Its error model, of which instruments alone are free.
        x: Their state.
    """

    robot: Robot
    data: Measurements
    errors: ErrorModel
    x: Vector

    def frames(self, q: Matrix) -> Array4:
        """The frames of its chain in the axes of its base, [R | p], (frames, n, 3, 4), at joint positions (n, inputs)."""
        placed = self.errors.placements(self.x, self.errors.sessions[0])
        arm = ArmKinematics(self.errors.chain)
        return motion_at(arm, placed, arm.chain_positions(q)).frames

    @cached_property
    def drawn_frame(self) -> int:
        """Which of the chain's frames marks are drawn in: of several instruments the first that stands still, so that they do, too."""
        tree, every = self.robot.tree, self.robot.rig.instruments.every
        still = [index for index, own in enumerate(every) if own.link and tree.moving_link(own.link) == tree.moving_link(tree.root)]
        return still[0] if still else self.errors.chain.measuring_frame

    def _as_drawn(self, mark: Mark, channel: Channel) -> Mark:
        """A mark in the frame in which all are drawn, wherever that of its own is at each pose."""
        if channel.frame in (None, self.drawn_frame):
            return mark
        here, there = self._frames[self.drawn_frame], self._frames[channel.frame]
        R = here[:, :, :3].transpose(0, 2, 1) @ there[:, :, :3]
        p = np.einsum("nji,nj->ni", here[:, :, :3], there[:, :, 3] - here[:, :, 3])

        def turned(directions: Matrix) -> Matrix:
            return np.asarray(np.einsum("nij,nj->ni", R, directions))

        return replace(
            mark,
            read=turned(mark.read) + p,
            predicted=turned(mark.predicted) + p,
            axes=None if mark.axes is None else R @ mark.axes,
            start=None if mark.start is None else turned(mark.start) + p,
            normals=None if mark.normals is None else turned(mark.normals),
        )

    @cached_property
    def _frames(self) -> Array4:
        return self.frames(self.data.q)

    def beams(self, q: Matrix) -> Beams:
        """Its beams at joint positions (n, inputs)."""
        return beams_at(self.errors, self.x, q)

    @cached_property
    def marks(self) -> tuple[Mark, ...]:
        """Everything that was read, in the order of the tables."""
        problem = Problem(self.errors, self.data)
        with np.errstate(divide="ignore", invalid="ignore"):  # beams along the screen
            marks = [_mark(channel, view) for channel, view in zip(problem.channels, problem.views(self.x), strict=True)]
            marks = [self._as_drawn(mark, channel) for mark, channel in zip(marks, problem.channels, strict=True)]
        return _at_their_targets(marks)

    @cached_property
    def planes(self) -> tuple[TouchedPlane, ...]:
        """The planes that were touched."""
        touches = [(mark, mark.normals) for mark in self.marks if mark.normals is not None]
        labels = dict.fromkeys(str(label) for mark, _ in touches for label in mark.labels[mark.was_read])
        return tuple(_plane(label, touches) for label in labels)


def placed_robot(robot: Robot, data: Measurements, options: ModelOptions | None = None) -> Placed:
    """Put measuring frame, targets and shared places where they suit a robot best, as `urdfcal evaluate` does.

    Args:
        robot: The robot as its URDF has it, with the instruments of the measurements.
        data: Measurements of one session where anything beside spots was read; spots in pixels are turned into spots before.
        options: Of which only what concerns the instruments matters.
    """
    sessions = data.session_names or ("",)
    if not data.instruments.needed:
        return Placed(robot, data, ErrorModel(robot.chain, (), (), sessions=sessions), np.empty(0))
    errors = build_error_model(
        robot.chain, robot.rig, of_these_poses(robot.chain, robot.rig, options or ModelOptions(), sessions), sessions
    )
    found = nominal_fit(errors, data, noise_of(data, {}, np.zeros(len(robot.chain.inputs))))
    return Placed(robot, data, found.alone, found.instruments)


def screen_placements(robot: Robot, whole: Matrix) -> list[SE3]:
    """T_root_screen of a robot at configurations (n, model.nq)."""
    return link_placements(robot, robot.rig.base, whole)


def link_placements(robot: Robot, link: str, whole: Matrix) -> list[SE3]:
    """T_root_link of a robot at configurations (n, model.nq)."""
    model, data = robot.model, robot.model.createData()
    index = model.getFrameId(link, pin.FrameType.BODY)
    found = []
    for q in whole:
        pin.forwardKinematics(model, data, q)
        found.append(pin.updateFramePlacement(model, data, index).copy())
    return found


def frame_placements(placed: Placed, whole: Matrix, q: Matrix, frame: int | None = None) -> list[SE3]:
    """T_root_frame of the frame that marks are drawn in, or another, at configurations (n, model.nq) of joint positions (n, inputs)."""
    frames = placed.frames(q)[placed.drawn_frame if frame is None else frame]
    there = screen_placements(placed.robot, whole)
    return [T_root_screen * pin.SE3(own[:, :3], own[:, 3]) for T_root_screen, own in zip(there, frames, strict=True)]


def _mark(channel: Channel, view: View) -> Mark:
    readings, sensor, seen = channel.readings, channel.sensor, channel.readings.seen
    predicted = sensor.predicted(view)
    residual = np.where(readings.measured, sensor.look(view, channel.values).residual, 0.0)
    both = seen & ~np.isnan(predicted[:, 0])
    return Mark(
        name=channel.block.name,
        unit=channel.block.unit,
        sensor=sensor,
        target=readings.target,
        read=np.where(seen[:, None], sensor.shown(view, readings.values), np.nan),
        predicted=predicted,
        errors=np.where(both, np.linalg.norm(residual, axis=1) / UNITS[channel.block.unit], np.nan),
        axes=sensor.axes(channel.values),
        start=sensor.looks_from(view),
        normals=sensor.normals(view),
        labels=readings.labels,
    )


def _at_their_targets(marks: Sequence[Mark]) -> tuple[Mark, ...]:
    """The same with what has no place of its own at the point that was read of their target, where there is one."""
    points = {mark.target: mark.read for mark in reversed(marks) if mark.is_point and not mark.on_screen}
    return tuple(mark if mark.is_point or mark.target not in points else _moved(mark, points[mark.target]) for mark in marks)


def _moved(mark: Mark, point: Matrix) -> Mark:
    at = np.where(np.isnan(point), mark.predicted, point)
    return replace(mark, read=np.where(mark.was_read[:, None], at, np.nan))


def _plane(label: str, touches: Sequence[tuple[Mark, Matrix]]) -> TouchedPlane:
    rows = [(mark.read[on], normals[on]) for mark, normals in touches if (on := mark.was_read & (mark.labels == label)).any()]
    return TouchedPlane(label, rows[0][1][0], np.concatenate([feet for feet, _ in rows]))
