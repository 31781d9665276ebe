"""What there is to see: what was measured in every pose, beside what the nominal and the calibrated robot make of it.

Beams and spots stand in the axes of the screen, targets in those of the measuring frame: there measured and predicted are compared.
Both robots share the screen, or without lasers the reference link, so the nominal robot is drawn where that one has it.

What instruments beside lasers read, and what a robot predicts of it: points in the axes of the measuring frame, at every pose.

A robot is put to the measurements as it is: its measuring frame, its targets and shared places stand where they suit it best, and
nothing else is free. Whatever was read becomes a *mark*, a point where the reading has the target, beside the point where the robot
has it: of a socket the common place, of a plane the foot on it, of a wire the point at the length that was read, of a pixel the point on
its ray.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pinocchio as pin

from urdfcal.base.geometry import MM, SE3, Array3, Array4, Mask, Matrix, Vector
from urdfcal.base.rotations import matrices
from urdfcal.calibration.problem import Problem, seen_placement
from urdfcal.calibration.start.nominal import nominal_fit
from urdfcal.estimation.residual import Block
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model, of_these_poses
from urdfcal.model.jacobian import ArmKinematics, motion_at
from urdfcal.model.options import ModelOptions
from urdfcal.robot.rig import Place
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.readings import Readings
from urdfcal.sensors.sensor import UNITS
from urdfcal.sensors.spots import LEAST_ZX, beams_at
from urdfcal.sensors.stated_noise import noise_of

_FAR = 1.1  # half sizes of the measured spots' box: predicted spots farther off are not on the sheet
_LEAST_SHEET = 0.6  # [m]
_MARGIN = 0.02  # of the sheet's size, around the spots
FINE = 5  # fine grid squares along one square of the grid
_MARK, _LEAST_MARK = 0.0095, 0.0055  # radius of a spot's disc over the width of the bulk of the spots, and over the sheet's size
_FEW = 150  # spots, of more the discs are smaller
_LONGEST_ARROW = 0.25  # of the sheet, for nine arrows out of ten, where the magnification is ours to choose
MAGNIFICATIONS = (20.0, 10.0, 5.0, 2.0, 1.0)
_MOST_OF_A_BOARD = 4  # corners
_TARGET_MARK = 0.006  # radius of a target's ball over the width of the bulk of the marks
_LEAST_WIDTH = 0.3  # [m] of the targets' marks
_LONGEST_TARGET_ARROW = 0.06  # of that width
_TARGET_MAGNIFICATIONS = (500.0, 200.0, 100.0, 50.0, *MAGNIFICATIONS)

_LEAST = 1e-12  # [m]; shorter than that has no direction


@dataclass(frozen=True)
class Beams:
    """The beams of one robot at every pose, in screen axes.

    Attributes:
        source: (n, lasers, 3), [m].
        direction: (n, lasers, 3), unit vectors.
        spots: Where they meet the plane of the screen, (n, lasers, 2), [m].
        length: (n, lasers), [m]; negative, infinite or nan where they do not.
    """

    source: Array3
    direction: Array3
    spots: Array3
    length: Matrix

    @property
    def meets(self) -> Mask:
        """Which beams meet the plane of the screen, at no grazing angle, (n, lasers)."""
        with np.errstate(invalid="ignore"):
            return np.asarray((self.length > 0) & np.isfinite(self.length) & (np.abs(self.direction[..., 0]) > LEAST_ZX / 10))


@dataclass(frozen=True)
class Sheet:
    """The piece of the screen's plane that is drawn: opposite corners (y, z), [m], and the pitch of its grid, [m]."""

    low: Vector
    high: Vector
    pitch: float

    @property
    def size(self) -> float:
        """Its longer side, [m]."""
        return float(np.max(self.high - self.low))

    def holds(self, spots: Array3) -> Mask:
        """Which spots lie on it."""
        with np.errstate(invalid="ignore"):
            return np.asarray(((spots >= self.low) & (spots <= self.high)).all(axis=-1))


@dataclass(frozen=True)
class Compared:
    """One row of the table of errors: a laser or a target.

    Attributes:
        name: Of the laser, or as tables name the reading.
        unit: mm, deg or px.
        phases: Errors of every robot that is drawn, nominal first, (n,) each; of a board the mean over corners; nan where nothing was read.
        means: Mean of all, of every robot; nan where nothing was measured at all.
    """

    name: str
    unit: str
    phases: tuple[Vector, ...]
    means: tuple[float, ...]


@dataclass(frozen=True)
class Scene:
    """A nominal robot, perhaps a calibrated one, and measurements (spots of nan where there are none).

    Attributes:
        robot: As the URDF has it.
        calibrated: As it was found to be, or None.
        data: Joint positions and measured spots.
        magnify: How many times the arrows of the last robot's errors are longer than the errors; None to choose.
        options: What is said of the instruments.
    """

    robot: Robot
    calibrated: Robot | None
    data: Measurements
    magnify: float | None = None
    options: ModelOptions | None = None

    @property
    def solid(self) -> Robot:
        """The robot that is drawn solid: the calibrated one, else the nominal."""
        return self.calibrated or self.robot

    @cached_property
    def before(self) -> Beams:
        """The beams of the nominal robot."""
        return beams_of(self.robot, self.data.q)

    @cached_property
    def after(self) -> Beams | None:
        """The beams of the calibrated robot."""
        return None if self.calibrated is None else beams_of(self.calibrated, self.data.q)

    @property
    def shown(self) -> Beams:
        """The beams of the robot that is drawn solid."""
        return self.after or self.before

    @cached_property
    def side(self) -> float:
        """The side of the screen on which the lasers stand: -1 or 1 along its x."""
        return 1.0 if float(np.median(self.shown.source[..., 0])) > 0 else -1.0

    @cached_property
    def sheet(self) -> Sheet:
        """Holds every measured spot, and predicted ones that are not too far off."""
        return _sheet(self.data.spots[self.data.seen], [beams.spots[beams.meets] for beams in (self.before, self.after) if beams])

    @cached_property
    def mark(self) -> float:
        """Radius of a measured spot's disc, [m]: a size that can be seen and leaves room between spots."""
        spots = self.data.spots[self.data.seen]
        width = 2 * float(np.quantile(np.abs(spots - np.median(spots, axis=0)), 0.9)) if len(spots) else self.sheet.size
        crowd = float(min(1.0, (_FEW / max(len(spots), 1)) ** 0.35))
        return crowd * float(np.clip(_MARK * width, _LEAST_MARK * self.sheet.size, _MARK * self.sheet.size))

    @cached_property
    def extent(self) -> float:
        """How large all is: the sheet, or a usual beam, [m]."""
        lengths = self.shown.length[self.lands(self.shown)]
        return max(self.sheet.size, float(np.median(lengths)) if len(lengths) else 0.0)

    @cached_property
    def magnification(self) -> float:
        """How many times longer the arrows of the drawn robot's errors are than the errors."""
        if self.magnify is not None:
            return self.magnify
        usual = float(np.quantile(self._spot_errors, 0.9)) if len(self._spot_errors) else 0.0
        return next((times for times in MAGNIFICATIONS if times * usual < _LONGEST_ARROW * self.sheet.size), 1.0)

    @cached_property
    def _spot_errors(self) -> Vector:
        """Lengths of the drawn robot's errors at spots that have an arrow, [m]."""
        return np.asarray(np.linalg.norm(self.shown.spots - self.data.spots, axis=-1)[self.data.seen & self.lands(self.shown)])

    @cached_property
    def _target_errors(self) -> Vector:
        """The same at targets, [m]."""
        errors = np.concatenate([mark.predicted - mark.read for mark in self.marks if mark.is_point] or [np.empty((0, 3))])
        return np.asarray(np.linalg.norm(errors[~np.isnan(errors[:, 0])], axis=1))

    @property
    def most_magnification(self) -> float:
        """From which on the longest arrow is longer than the screen, or than the targets' marks are apart."""
        longest = [(self.sheet.size, self._spot_errors)] if self.data.lasers else []
        longest += [(self.width, self._target_errors)] if self.marks else []
        return min((room / float(errors.max()) for room, errors in longest if errors.any()), default=np.inf)

    @cached_property
    def targets(self) -> tuple[PlacedTargets, ...]:
        """The nominal robot with its instruments placed, then the calibrated one; empty where there are lasers alone."""
        robots = [self.robot] if self.calibrated is None else [self.robot, self.calibrated]
        return tuple(placed_targets(robot, self.data, self.options) for robot in robots) if not self.data.only_spots else ()

    @property
    def marks(self) -> tuple[Mark, ...]:
        """What was read of targets, as the robot that is drawn solid has it."""
        return self.targets[-1].marks if self.targets else ()

    @cached_property
    def points(self) -> Matrix:
        """Every place that was read of a target, (k, 3), in the measuring frame, [m]."""
        points = [mark for mark in self.marks if mark.is_point] or self.marks  # orientations stand at points, where there are any
        read = [mark.read[~np.isnan(mark.read[:, 0])] for mark in points]
        return np.concatenate(read) if read else np.empty((0, 3))

    @cached_property
    def width(self) -> float:
        """How far the bulk of the targets' marks extends, [m]."""
        far = np.abs(self.points - np.median(self.points, axis=0))
        return max(_LEAST_WIDTH, 2 * float(np.quantile(far, 0.9, axis=0).max()))

    @cached_property
    def ball(self) -> float:
        """Radius of a target's mark, [m]."""
        return float(min(1.0, (_FEW / max(len(self.points), 1)) ** 0.35)) * _TARGET_MARK * self.width

    @cached_property
    def target_magnification(self) -> float:
        """How many times longer the arrows of the drawn robot's errors at targets are than the errors."""
        if self.magnify is not None:
            return self.magnify
        usual = float(np.quantile(self._target_errors, 0.9)) if len(self._target_errors) else 0.0
        return next((times for times in _TARGET_MAGNIFICATIONS if times * usual < _LONGEST_TARGET_ARROW * self.width), 1.0)

    def shifted(self, phase: int, mark: int) -> Matrix:
        """Where a robot (0 the nominal one) has a target, as far from the mark that is drawn as from its own, (n, 3), [m].

        Sockets, planes and wires are not the same places for both robots: what is compared is how far each is from its own.
        """
        own, drawn = self.targets[phase].marks[mark], self.marks[mark]
        return np.asarray(drawn.read + (own.predicted - own.read))

    @cached_property
    def compared(self) -> tuple[Compared, ...]:
        """The rows of the table of errors: lasers, then targets."""
        beams = [self.errors_mm(each) for each in (self.before, self.after) if each is not None]
        lasers = [_compared(name, "mm", [own[:, laser][None] for own in beams]) for laser, name in enumerate(self.data.lasers)]
        rows = []
        for name, unit in dict.fromkeys((mark.name, mark.unit) for mark in self.marks):
            phases = [np.array([mark.errors for mark in placed.marks if mark.name == name]) for placed in self.targets]
            rows.append(_compared(name, unit, phases))
        return (*lasers, *rows)

    @cached_property
    def moving(self) -> tuple[int, ...]:
        """Which marks are drawn large in the pose shown: all, but of a board's many corners a few."""
        groups = [
            [index for index, mark in enumerate(self.marks) if mark.name == name] for name in dict.fromkeys(m.name for m in self.marks)
        ]
        picked = [np.linspace(0, len(group) - 1, min(len(group), _MOST_OF_A_BOARD)).round().astype(int) for group in groups]
        return tuple(sorted(group[place] for group, places in zip(groups, picked, strict=True) for place in places))

    def lands(self, beams: Beams) -> Mask:
        """Which beams end on the sheet, (n, lasers)."""
        return beams.meets & self.sheet.holds(beams.spots)

    def errors_mm(self, beams: Beams) -> Matrix:
        """Distance from measured to predicted spot, (n, lasers), [mm]; nan where there is none."""
        distance = np.linalg.norm(beams.spots - self.data.spots, axis=-1) / MM
        return np.where(self.data.seen & beams.meets, distance, np.nan)


def _compared(name: str, unit: str, errors: list[Matrix]) -> Compared:
    """One row of the table from errors (k, n) of k marks."""
    count = [np.maximum((~np.isnan(own)).sum(axis=0), 1e-9) for own in errors]
    phases = [
        np.where(np.isnan(own).all(axis=0), np.nan, np.nansum(own, axis=0) / number) for own, number in zip(errors, count, strict=True)
    ]
    means = [float(np.nanmean(own)) if np.isfinite(own).any() else np.nan for own in errors]
    return Compared(name, unit, tuple(phases), tuple(means))


def beams_of(robot: Robot, q: Matrix) -> Beams:
    """The beams of a robot as its URDF has it, at joint positions (n, inputs)."""
    beams = beams_at(ErrorModel(robot.chain, (), ()), np.empty(0), q)
    return Beams(beams.source, beams.direction, beams.spots, beams.length)


def screen_placements(robot: Robot, whole: Matrix) -> list[SE3]:
    """T_root_screen of a robot at configurations (n, model.nq)."""
    model, data = robot.model, robot.model.createData()
    index = model.getFrameId(robot.rig.screen, pin.FrameType.BODY)
    found = []
    for q in whole:
        pin.forwardKinematics(model, data, q)
        found.append(pin.updateFramePlacement(model, data, index).copy())
    return found


def frame_placements(placed: PlacedTargets, whole: Matrix, q: Matrix) -> list[SE3]:
    """T_root_frame of the measuring frame at configurations (n, model.nq), which joint positions (n, inputs) lead to."""
    frames = placed.frames(q)[0]
    there = screen_placements(placed.robot, whole)
    return [T_root_screen * pin.SE3(own[:, :3], own[:, 3]) for T_root_screen, own in zip(there, frames, strict=True)]


def _sheet(measured: Matrix, predicted: list[Matrix]) -> Sheet:
    base = measured if len(measured) else np.concatenate([*predicted, np.zeros((1, 2))])
    low, high = base.min(axis=0), base.max(axis=0)
    centre, half = (low + high) / 2, np.maximum((high - low) / 2, _LEAST_SHEET / 2)
    near = [spots[(np.abs(spots - centre) < _FAR * half.max()).all(axis=1)] for spots in predicted]
    held = np.concatenate([base, *near, [centre - half, centre + half]])
    low, high = held.min(axis=0), held.max(axis=0)
    size = float(np.max(high - low))
    pitch, margin = _pitch(size / 10), _MARGIN * size
    fine = pitch / FINE
    return Sheet(fine * np.floor((low - margin) / fine), fine * np.ceil((high + margin) / fine), pitch)


def _pitch(wanted: float) -> float:
    """1, 2 or 5 times a power of ten, at least `wanted`."""
    decade = 10.0 ** np.floor(np.log10(wanted))
    return float(next(step * decade for step in (1, 2, 5, 10) if step * decade >= wanted * (1 - 1e-9)))


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
        model = Problem(self.errors, self.data)
        here = model.linearise(self.x)
        frames = self.frames(self.data.q)
        chain = self.errors.chain
        found: list[Mark] = []
        for channel in (channel for channel in model.channels if not channel.sensor.beam):
            own, block = channel.readings, channel.block
            predicted, _ = seen_placement(frames, channel.target, chain.measuring_frame)
            size = np.linalg.norm(here.residual[: len(self.data), block.columns], axis=1)
            found.append(self._mark(own, block, predicted, np.where(own.seen, size / UNITS[block.unit], np.nan)))
        return tuple(_with_points(found, tuple(each for each in self.data.readings if not each.kind.beam)))

    @cached_property
    def planes(self) -> tuple[Plane, ...]:
        """The planes that were touched."""
        found = []
        for own in (each for each in self.data.readings if each.sensor == "plane"):
            for label, place in zip(own.touched, own.places, strict=True):
                normal, offset = self._plane(place)
                along = np.linalg.svd(normal[None])[2][1:]
                found.append(Plane(label, offset * normal, along))
        return tuple(found)

    def _mark(self, own: Readings, block: Block, predicted: Matrix, errors: Vector) -> Mark:
        read = np.where(own.seen[:, None], self._read(own, predicted), np.nan)
        fixed = self._numbers(own.places[0]) if own.sensor == "distance" else None
        whole = matrices(np.where(np.isnan(own.values), (0, 0, 0, 1), own.values)) if own.sensor == "orientation" else None
        return Mark(block.name, block.unit, own.sensor, read, predicted, whole, errors, fixed)

    def _read(self, own: Readings, predicted: Matrix) -> Matrix:
        """Where readings have their target: what they do not say is taken from the prediction."""
        if own.sensor == "point":
            return np.where(np.isnan(own.values), predicted, own.values)
        if own.sensor == "socket":
            return self._of_pose(own, np.array([self._numbers(place) for place in own.places]))
        if own.sensor == "plane":
            normals, offsets = zip(*(self._plane(place) for place in own.places), strict=True)
            normal, offset = self._of_pose(own, np.array(normals)), self._of_pose(own, np.array(offsets)[:, None])
            return np.asarray(predicted + normal * (offset - np.sum(normal * predicted, axis=1, keepdims=True)))
        if own.sensor == "distance":
            apart = predicted - self._numbers(own.places[0])
            length = np.maximum(np.linalg.norm(apart, axis=1, keepdims=True), _LEAST)
            return np.asarray(predicted + apart / length * (own.values - length))
        if own.sensor == "pixel":
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
