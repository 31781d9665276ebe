"""The measurement function of a robot: J = Jac2 Jac1, equation (12), stacked over all poses, for lasers and every other sensor.

J = Jac2 Jac1 for sensors of targets: the target's pose and twist in its measuring frame, and the places that poses share.

Twists of the chain are those of everything behind a joint against the screen (or the reference), at its origin. A target moves with
those of its own way alone, and so does the measuring frame; what a sensor sees is the difference of the two, in the measuring frame's
axes at the measuring frame's origin:

    [v, w] = Ad(T_frame^-1) (V_target - V_frame)
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Array3, Mask, Matrix, Vector
from urdfcal.base.rotations import skew
from urdfcal.estimation.noise import Noise
from urdfcal.estimation.residual import Block, Linearisation
from urdfcal.model.error_model import ErrorModel, Placements
from urdfcal.model.jacobian import CHUNK, ArmKinematics, LaserMotion, motion_at
from urdfcal.sensors.measurements import Measurements, kinds_of
from urdfcal.sensors.readings import KnownLength, Readings
from urdfcal.sensors.sensor import TargetSensor, View
from urdfcal.sensors.spots import PixelSpots, spot_jacobian, spots_on_screen
from urdfcal.sensors.targets import SENSORS, PixelSensor

Rows = slice | npt.NDArray[np.intp]
_HELD = 1e-8  # [m] standard deviation of a sum that is held
_FRAME = 0  # of the chain's frames: the one that targets are seen in


class SpotModel:
    """Predicts the spots of a set of poses and their derivative by the error parameters."""

    def __init__(self, errors: ErrorModel, data: Measurements, joints: bool = False) -> None:
        """Prepare for some poses; `joints` also differentiates by the measured joints, for their noise."""
        self.errors, self.data, self.joints = errors, data, joints
        self.arm = ArmKinematics(errors.chain, errors.soft.bends if errors.soft is not None else ())
        self.positions = self.arm.chain_positions(data.q)
        self.soft_basis = errors.soft.basis(data.q, data.payload, data.approach) if errors.soft is not None else None
        targets = readings_of(errors, data, first=2 * len(data.lasers))
        self.readings: tuple[Reading | PixelSpots, ...] = (*targets, *self._pixel_spots(errors, data, targets))
        self.spots = slice(0, 2 * len(data.lasers))
        self.kinds = kinds_of(data)
        self.blocks = self._blocks()
        self.measured = np.concatenate([np.repeat(data.seen, 2, axis=1), *(each.measured for each in self.readings)], axis=1)
        stated = [np.broadcast_to(each.data.sigma[:, None], each.measured.shape) for each in self.readings]
        self.stated_sigma = np.concatenate([np.repeat(data.sigma, 2, axis=1), *stated], axis=1)
        self.parts = [part for session in errors.sessions for part in self._chunks(session)]
        self.blind = _other_lasers_rows(errors)

    def predict(self, x: Vector) -> tuple[Array3, Matrix]:
        """Spots (n, lasers, 2) and beam lengths (n, lasers) at x, [m]."""
        n, lasers = self.data.seen.shape
        spots, lengths = np.empty((n, lasers, 2)), np.empty((n, lasers))
        placed = {session: self.errors.placements(x, session).still() for session in self.errors.sessions}
        for session, rows in self.parts:
            motion = self.motion(x, placed[session], rows)
            spots[rows], lengths[rows] = spots_on_screen(motion.source, motion.direction)
        return spots, lengths

    def linearise(self, x: Vector) -> Linearisation:
        """Residual and Jacobian of every measured spot coordinate at x."""
        n, numbers = self.measured.shape
        residual, jacobian = np.empty((n, numbers)), np.empty((n, numbers, len(self.errors.names)))
        joint_jacobian = np.empty((n, numbers, len(self.data.joints) if self.joints else 0))
        reached, own = True, self.spots
        placed = {session: self.errors.placements(x, session) for session in self.errors.sessions}
        for session, rows in self.parts:
            motion = self.motion(x, placed[session], rows, self.joints)
            spots, lengths = spots_on_screen(motion.source, motion.direction)
            seen, measured = self.data.seen[rows], self.measured[rows, own]
            reached &= bool((lengths[seen] > 0).all() and np.isfinite(lengths[seen]).all())
            residual[rows, own] = np.where(measured, (self.data.spots[rows] - spots).reshape(len(spots), -1), 0.0)
            jacobian[rows, own], joint_jacobian[rows, own] = self._derivatives(motion, spots, measured)
            for each in self.readings:
                if isinstance(each, PixelSpots):
                    own_lengths = lengths[each.data.seen[rows], each.laser]
                    reached &= bool((own_lengths > 0).all() and np.isfinite(own_lengths).all())
                looked = each.look(motion, placed[session], rows, x)
                residual[rows, each.columns], jacobian[rows, each.columns], joint_jacobian[rows, each.columns] = looked
        trouble = "left_screen" if not reached else "" if np.isfinite(residual).all() else "not_finite"
        here = Linearisation(residual, jacobian, joint_jacobian, self.measured, self.stated_sigma, trouble, self.blocks)
        return known_rows(here, self.errors, self.data.lengths, x)

    @staticmethod
    def _pixel_spots(errors: ErrorModel, data: Measurements, targets: tuple[Reading, ...]) -> Iterator[PixelSpots]:
        """Spots that were read as pixels, with their numbers behind all others."""
        first = max([2 * len(data.lasers), *(each.columns.stop for each in targets)])
        for own in (each for each in data.readings if data.of_laser(each)):
            yield PixelSpots(own, data.lasers.index(own.link), data.camera, errors, first)
            first += 2

    def _blocks(self) -> tuple[Block, ...]:
        """Every spot and every reading of a pose, with the index of its noise."""
        spots = tuple(Block(laser, slice(2 * index, 2 * index + 2)) for index, laser in enumerate(self.data.lasers))
        return (*spots, *(each.block(self.kinds.index(each.data.kind)) for each in self.readings))

    def motion(self, x: Vector, placed: Placements, rows: Rows, joints: bool = False) -> LaserMotion:
        """Where everything is at some poses, and how it moves; joints give way as far as the error model has them."""
        yielding = self.errors.yielding(x, self.soft_basis[rows]) if self.soft_basis is not None else None
        return motion_at(self.arm, placed, self.positions[rows], joints, yielding)

    def unreached(self, x: Vector) -> tuple[int, int] | None:
        """Pose and laser of the first measured beam that does not meet the screen at x."""
        lengths = self.predict(x)[1]
        missing = np.argwhere(self.data.seen & ~((lengths > 0) & np.isfinite(lengths)))
        return (int(missing[0, 0]), int(missing[0, 1])) if len(missing) else None

    def _derivatives(self, motion: LaserMotion, spots: Array3, measured: Mask) -> tuple[Array3, Array3]:
        n, numbers = measured.shape
        if not numbers:
            return np.empty((n, 0, motion.jac1.shape[2])), np.empty((n, 0, motion.joint_jacobian.shape[2]))
        jac2 = spot_jacobian(spots, motion.direction).reshape(n, numbers, 6)
        if not measured.all():
            jac2[~measured] = 0.0
        jacobian = jac2 @ motion.jac1
        if self.blind is not None:
            jacobian[:, self.blind] = 0.0
        return jacobian, jac2 @ motion.joint_jacobian

    def _chunks(self, session: str) -> list[tuple[str, Rows]]:
        if len(self.errors.sessions) == 1:
            return [(session, slice(start, start + CHUNK)) for start in range(0, len(self.data), CHUNK)]
        rows = np.flatnonzero(self.data.sessions == session)
        return [(session, rows[start : start + CHUNK]) for start in range(0, len(rows), CHUNK)]


def model_for(errors: ErrorModel, data: Measurements, noise: Noise) -> SpotModel:
    """The model of some poses with what noise asks for: derivatives by the joints, too, where their readings are noisy."""
    return SpotModel(errors, data, joints=noise.of_joints)


def _other_lasers_rows(errors: ErrorModel) -> Mask | None:
    """Mask (numbers, p) of the derivatives that are zero because a beam's own parameters move that beam alone."""
    moves = np.repeat(errors.moves_laser, 2, axis=0)
    mask: Mask = ~moves
    return None if moves.all() else mask


@dataclass(frozen=True)
class Reading:
    """One instrument's readings of one target, put to the robot.

    Attributes:
        data: What was read.
        sensor: How it is read.
        frame: Index of the target among the chain's frames.
        errors: The error model.
        first: Index of its first number among those of a pose.
        board: The board that the target is a corner of, if it is one.
    """

    data: Readings
    sensor: TargetSensor
    frame: int
    errors: ErrorModel
    first: int
    board: str = ""

    @property
    def columns(self) -> slice:
        """Its numbers among those of a pose."""
        return slice(self.first, self.first + self.sensor.numbers)

    def block(self, kind: int) -> Block:
        """What tables and gates take it for."""
        name = self.board or self.data.target
        return Block(f"{name} {self.sensor.title}".strip(), self.columns, kind, self.sensor.unit)

    @cached_property
    def measured(self) -> Mask:
        """Which of its numbers were read, (n, k)."""
        if self.data.kind == "point":
            return ~np.isnan(self.data.values)
        return np.repeat(self.data.seen[:, None], self.sensor.numbers, axis=1)

    @cached_property
    def _values(self) -> Matrix:
        """The readings with something harmless where nothing was read."""
        harmless = np.array([0.0, 0.0, 0.0, 1.0]) if self.data.kind == "orientation" else 0.0
        return np.where(np.isnan(self.data.values), harmless, self.data.values)

    @cached_property
    def _place_columns(self) -> npt.NDArray[np.intp]:
        """Columns of x that each pose's place has, (n, a); those of the first place where the pose touches none; -1 if they are held."""
        places = self.data.places
        if not places:
            return np.empty((len(self.data.labels), 0), dtype=int)
        column = {name: index for index, name in enumerate(self.errors.names)}
        table = np.array([[column.get(f"{place.name}.{name}", -1) for name in place.names] for place in places])
        return np.asarray(table[self._place_of_pose])

    @cached_property
    def _place_of_pose(self) -> npt.NDArray[np.intp]:
        index = {label: number for number, label in enumerate(self.data.touched)}
        return np.array([index.get(str(label), 0) for label in self.data.labels], dtype=int)

    @cached_property
    def _held(self) -> Matrix:
        """Values of a place's numbers that are not estimated, (n, a)."""
        table = np.array([[self.errors.held.get(f"{place.name}.{name}", 0.0) for name in place.names] for place in self.data.places])
        return np.asarray(table[self._place_of_pose]) if len(table) else np.empty((len(self.data.labels), 0))

    @cached_property
    def _axes(self) -> Array3:
        """Of planes: normal and tangents of each pose's plane, (n, 3, 3)."""
        planes = [self.errors.planes.get(place.name, np.eye(3)) for place in self.data.places] if self.data.kind == "plane" else [np.eye(3)]
        return np.asarray(
            np.array(planes)[self._place_of_pose if self.data.kind == "plane" else np.zeros(len(self.data.labels), dtype=int)]
        )

    def look(self, motion: LaserMotion, placed: Placements, rows: Rows, x: Vector) -> tuple[Matrix, Array3, Array3]:
        """Residual (n, k), Jacobian (n, k, p) and joint Jacobian (n, k, inputs) of some poses at x."""
        if not self.measured.any():  # a column that is empty everywhere
            n, k = self.measured[rows].shape
            return np.zeros((n, k)), np.zeros((n, k, len(x))), np.zeros((n, k, motion.joint_jacobian.shape[2]))
        columns = self._place_columns[rows]
        place = np.where(columns >= 0, np.append(x, 0.0)[columns], self._held[rows])
        p, R, jac1, joint_jac1 = seen_motion(self.errors, motion, placed, self.frame)
        look = self.sensor.look(View(p, R, place, self._axes[rows]), self._values[rows])
        measured = self.measured[rows]
        jac2 = np.where(measured[..., None], look.jac2, 0.0)
        jacobian = jac2 @ jac1
        pose, number = np.arange(len(p))[:, None, None], np.arange(measured.shape[1])[None, :, None]
        free = columns >= 0
        by_place = np.where(measured[..., None], look.by_place, 0.0) * free[:, None]
        jacobian[pose, number, columns[:, None]] += by_place  # a held number's -1 gets zeros
        return np.where(measured, look.residual, 0.0), jacobian, jac2 @ joint_jac1


def readings_of(errors: ErrorModel, data: Measurements, first: int) -> tuple[Reading, ...]:
    """Every instrument's readings, with their numbers behind those of the spots."""
    names = [frame.name for frame in errors.chain.frames]
    found: list[Reading] = []
    for own in (each for each in data.readings if not data.of_laser(each)):
        sensor = PixelSensor(data.camera) if own.kind == "pixel" else SENSORS[own.kind]
        found.append(Reading(own, sensor, 1 + names[1:].index(own.target), errors, first, own.link if own.link in data.boards else ""))
        first += found[-1].sensor.numbers
    return tuple(found)


def seen_motion(errors: ErrorModel, motion: LaserMotion, placed: Placements, target: int) -> tuple[Matrix, Array3, Array3, Array3]:
    """A target in its measuring frame: origin (n, 3), axes (n, 3, 3), and its twists there by parameter and by measured joint."""
    frame, own = motion.frames[_FRAME], motion.frames[target]
    R, p = frame[:, :, :3], frame[:, :, 3]
    back = R.transpose(0, 2, 1)
    share = placed.moves[target].astype(float) - placed.moves[_FRAME]
    passed = np.arange(1, motion.axis_twists.shape[2] + 1)
    depths = errors.chain.frames[target].depth, errors.chain.frames[_FRAME].depth
    joints = (passed <= depths[0]).astype(float) - (passed <= depths[1])
    by_joint = (motion.axis_twists * joints) @ (errors.chain.coupling.T if len(joints) else np.empty((0, 0)))
    origin = (back @ (own[:, :, 3] - p)[..., None])[..., 0]
    return origin, back @ own[:, :, :3], _moved(back, p, motion.jac1 * share), _moved(back, p, by_joint)


def _moved(back: Array3, p: Matrix, twists: Array3) -> Array3:
    """Twists at the common origin as the measuring frame at p has them, (n, 6, columns)."""
    v, w = twists[:, :3], twists[:, 3:]
    return np.concatenate([back @ (v - skew(p) @ w), back @ w], axis=1)


def known_rows(here: Linearisation, errors: ErrorModel, lengths: Sequence[KnownLength], x: Vector) -> Linearisation:
    """The same with what is known beforehand as further rows: distances between places, and a sum of parameters that is held.

    Each stands in the first number of its row.
    """
    known = [_length_row(errors, length, x) for length in lengths] + ([_sum_row(errors, x)] if errors.held_sum else [])
    if not known:
        return here
    rows, m, p = len(known), here.residual.shape[1], len(x)
    residual, jacobian, sigma = np.zeros((rows, m)), np.zeros((rows, m, p)), np.full((rows, m), np.nan)
    for row, (left, gradient, deviation) in enumerate(known):
        residual[row, 0], jacobian[row, 0], sigma[row, 0] = left, gradient, deviation
    return replace(
        here,
        residual=np.vstack([here.residual, residual]),
        jacobian=np.concatenate([here.jacobian, jacobian]),
        joint_jacobian=np.concatenate([here.joint_jacobian, np.zeros((rows, m, here.joint_jacobian.shape[2]))]),
        measured=np.vstack([here.measured, ~np.isnan(sigma)]),
        stated_sigma=np.vstack([here.stated_sigma, sigma]),
    )


def _length_row(errors: ErrorModel, known: KnownLength, x: Vector) -> tuple[float, Vector, float]:
    """Residual, gradient and standard deviation of a known distance; its places are free, or held."""
    column = {name: index for index, name in enumerate(errors.names)}
    ends = [[f"{place}.{axis}" for axis in "xyz"] for place in (known.one, known.other)]
    one, other = ([x[column[name]] if name in column else errors.held.get(name, 0.0) for name in end] for end in ends)
    apart = np.subtract(one, other)
    length = max(float(np.linalg.norm(apart)), 1e-9)
    gradient = np.zeros(len(x))
    for sign, end in zip((1.0, -1.0), ends, strict=True):
        for name, share in zip(end, apart / length, strict=True):
            if name in column:
                gradient[column[name]] = sign * share
    return known.length - length, gradient, known.sigma


def _sum_row(errors: ErrorModel, x: Vector) -> tuple[float, Vector, float]:
    gradient = np.array([errors.held_sum.get(name, 0.0) for name in errors.names])
    return -float(gradient @ x), gradient, _HELD
