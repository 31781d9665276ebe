"""What instruments beside lasers read, and what a robot predicts of it: points in the axes of the measuring frame, at every pose.

A robot is put to the measurements as it is: its measuring frame, its targets and shared places stand where they suit it best, and
nothing else is free. Whatever was read becomes a *mark*, a point where the reading has the target, beside the point where the robot
has it: of a socket the common place, of a plane the foot on it, of a wire the point at the length that was read, of a pixel the point on
its ray.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from urdfcal.error_model import ErrorModel
from urdfcal.frame_jacobian import ArmKinematics, motion_at
from urdfcal.gauge import ModelOptions, ParameterPrior, build_error_model, of_these_poses
from urdfcal.geometry import Array3, Array4, Matrix, Vector
from urdfcal.instruments import Place
from urdfcal.known_noise import noise_of
from urdfcal.measurements import Measurements
from urdfcal.noise import Block
from urdfcal.nominal import nominal_fit
from urdfcal.reading_kinds import UNITS
from urdfcal.readings import Readings
from urdfcal.robot import Robot
from urdfcal.spot_model import SpotModel
from urdfcal.target_sensors import matrices

_LEAST = 1e-12  # [m]; shorter than that has no direction


@dataclass(frozen=True)
class Mark:
    """One instrument's readings of one target beside what a robot predicts, in the measuring frame.

    Attributes:
        name: As tables have it.
        unit: Of `errors`: mm, deg or px.
        kind: What was read.
        read: Where the reading has the target, (n, 3), [m]; nan where nothing was read.
        predicted: Where the robot has it, (n, 3), [m].
        axes: Measured axes of an orientation, (n, 3, 3); None of other kinds.
        errors: How far reading and prediction are apart, (n,); nan where nothing was read.
        fixed: The other end of a wire, (3,); None of other kinds.
    """

    name: str
    unit: str
    kind: str
    read: Matrix
    predicted: Matrix
    axes: Array3 | None
    errors: Vector
    fixed: Vector | None = None

    @property
    def is_point(self) -> bool:
        """Whether it has a place of its own; an orientation is drawn at its target's."""
        return self.axes is None


@dataclass(frozen=True)
class Plane:
    """A plane that was touched: its label, a point on it and two directions along it, in the measuring frame."""

    label: str
    point: Vector
    along: Matrix


@dataclass(frozen=True)
class PlacedTargets:
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

    @cached_property
    def _arm(self) -> ArmKinematics:
        return ArmKinematics(self.errors.chain)

    def frames(self, q: Matrix) -> Array4:
        """Measuring frame and targets in the axes of the rig's first link, [R | p], (frames, n, 3, 4), at joint positions (n, inputs)."""
        placed = self.errors.placements(self.x, self.errors.sessions[0]).still()
        return motion_at(self._arm, placed, self._arm.chain_positions(q)).frames

    @cached_property
    def marks(self) -> tuple[Mark, ...]:
        """Everything that was read, in the order of the tables."""
        model = SpotModel(self.errors, self.data)
        here = model.linearise(self.x)
        frames = self.frames(self.data.q)
        names = [frame.name for frame in self.errors.chain.frames]
        found: list[Mark] = []
        for reading, block in zip(model.readings, model.blocks[len(self.data.lasers) :], strict=True):
            own = reading.data
            R, p = frames[0, :, :, :3].transpose(0, 2, 1), frames[names.index(own.target, 1)]
            predicted = (R @ (p[:, :, 3] - frames[0, :, :, 3])[..., None])[..., 0]
            size = np.linalg.norm(here.residual[: len(self.data), block.columns], axis=1)
            found.append(self._mark(own, block, predicted, np.where(own.seen, size / UNITS[block.unit], np.nan)))
        return tuple(_with_points(found, self.data.readings))

    @cached_property
    def planes(self) -> tuple[Plane, ...]:
        """The planes that were touched."""
        found = []
        for own in (each for each in self.data.readings if each.kind == "plane"):
            for label, place in zip(own.touched, own.places, strict=True):
                normal, offset = self._plane(place)
                along = np.linalg.svd(normal[None])[2][1:]
                found.append(Plane(label, offset * normal, along))
        return tuple(found)

    def _mark(self, own: Readings, block: Block, predicted: Matrix, errors: Vector) -> Mark:
        read = np.where(own.seen[:, None], self._read(own, predicted), np.nan)
        fixed = self._numbers(own.places[0]) if own.kind == "distance" else None
        whole = matrices(np.where(np.isnan(own.values), (0, 0, 0, 1), own.values)) if own.kind == "orientation" else None
        return Mark(block.name, block.unit, own.kind, read, predicted, whole, errors, fixed)

    def _read(self, own: Readings, predicted: Matrix) -> Matrix:
        """Where readings have their target: what they do not say is taken from the prediction."""
        if own.kind == "point":
            return np.where(np.isnan(own.values), predicted, own.values)
        if own.kind == "socket":
            return self._of_pose(own, np.array([self._numbers(place) for place in own.places]))
        if own.kind == "plane":
            normals, offsets = zip(*(self._plane(place) for place in own.places), strict=True)
            normal, offset = self._of_pose(own, np.array(normals)), self._of_pose(own, np.array(offsets)[:, None])
            return np.asarray(predicted + normal * (offset - np.sum(normal * predicted, axis=1, keepdims=True)))
        if own.kind == "distance":
            apart = predicted - self._numbers(own.places[0])
            length = np.maximum(np.linalg.norm(apart, axis=1, keepdims=True), _LEAST)
            return np.asarray(predicted + apart / length * (own.values - length))
        if own.kind == "pixel":
            rays = self.data.camera.rays(np.where(np.isnan(own.values), 0.0, own.values))
            return np.asarray(rays * (predicted[:, 2:] / rays[:, 2:]))
        return predicted

    def _of_pose(self, own: Readings, values: Matrix) -> Matrix:
        """What belongs to the place that each pose touched, of values a place; anything where none was touched."""
        index = {label: number for number, label in enumerate(own.touched)}
        return np.asarray(values[[index.get(str(label), 0) for label in own.labels]])

    def _numbers(self, place: Place) -> Vector:
        """The numbers of a place, estimated or held."""
        value = {**self.errors.held, **dict(zip(self.errors.names, self.x.tolist(), strict=True))}
        return np.array([value.get(f"{place.name}.{name}", 0.0) for name in place.names])

    def _plane(self, place: Place) -> tuple[Vector, float]:
        """Normal and offset of a plane."""
        tilt_1, tilt_2, offset = self._numbers(place)
        lean = np.array([1.0, tilt_1, tilt_2])
        return np.asarray(self.errors.planes[place.name] @ lean / np.linalg.norm(lean)), float(offset)


def placed_targets(robot: Robot, data: Measurements, options: ModelOptions | None = None) -> PlacedTargets:
    """Put measuring frame, targets and shared places where they suit a robot best, as `urdfcal evaluate` does.

    Args:
        robot: The robot as its URDF has it, with the instruments of the measurements.
        data: Measurements of one session; spots in pixels are turned into spots before.
        options: Of which only what concerns the instruments matters.
    """
    sessions = data.session_names or ("",)
    errors = build_error_model(
        robot.chain, robot.rig, of_these_poses(robot.chain, robot.rig, options or ModelOptions(), sessions), sessions
    )
    found = nominal_fit(errors, data, noise_of(data, {}, np.zeros(len(robot.chain.inputs))))
    return PlacedTargets(robot, data, found.alone, found.instruments)


def held_instruments(errors: ErrorModel, places: Sequence[Place]) -> ModelOptions:
    """Options by which measuring frame, targets and places are held as a fit held them.

    Args:
        errors: The error model of the fit.
        places: What several poses shared.
    """
    slots = [slot for slot in errors.slots if slot.frame is not None]
    names = [f"{slot.label}.{name}" for slot in slots for name in slot.names if name not in slot.spare]
    names += [f"{place.name}.{name}" for place in places for name in place.names]
    held = [name for name in names if name not in errors.names and name not in errors.carried]
    single = {name: ParameterPrior(errors.held.get(name), fixed=True) for name in held}
    return ModelOptions(single=single, reference_known=not any(slot.kind == "reference" for slot in slots))


def _with_points(marks: list[Mark], readings: tuple[Readings, ...]) -> list[Mark]:
    """The same with orientations at the point that was measured of their target, where there is one."""
    points = {own.target: mark.read for own, mark in zip(readings, marks, strict=True) if mark.kind == "point"}
    found = []
    for own, mark in zip(readings, marks, strict=True):
        point = points.get(own.target) if mark.kind == "orientation" else None
        if point is not None:
            at = np.where(np.isnan(point), mark.predicted, point)
            mark = replace(mark, read=np.where(np.isnan(mark.errors)[:, None], np.nan, at))
        found.append(mark)
    return found
