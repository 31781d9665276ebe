"""A robot put to its measurements: J = Jac2 Jac1, equation (12), stacked over all poses, for every sensor alike.

Twists of the chain are those of everything behind a joint against its base (the screen, or the reference), at the base's origin. A
target moves with those of its own way alone, and so does the frame that it is seen from; what a sensor sees is the difference of the
two, in the measuring frame's axes at the measuring frame's origin:

    [v, w] = Ad(T_frame^-1) (V_target - V_frame)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Array3, Array4, Mask, Matrix, Vector
from urdfcal.calibration.asking.disturbances import disturbed, progress
from urdfcal.estimation.noise import Noise
from urdfcal.estimation.normal import Numbers, Summing
from urdfcal.estimation.residual import Block, Linearisation, Linearise, remembering
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.jacobian import CHUNK, ArmMotion, Shares
from urdfcal.model.kinematics import ArmKinematics, PlacedArm, Posture
from urdfcal.robot.rig import Place
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.readings import KnownLength, Readings
from urdfcal.sensors.sensor import Look, Sensor, View

Rows = slice | npt.NDArray[np.intp]
Known = tuple[float, Vector, float]
_FEW = 256  # poses, of which calls cost more than their numbers
_SMALL = 1e-6  # standard deviation of a whitened row, so that it is nothing among residuals in metres
_UNIT = np.eye(3)
_HELD = 1e-8  # [m] standard deviation of a sum that is held


@dataclass(frozen=True)
class Channel:
    """The readings that one sensor made of one target, put to the robot.

    Attributes:
        readings: What was read.
        sensor: How it is read.
        target: Index of the target among the chain's frames.
        frame: Index of the frame that it is seen from; None for the chain's base.
        errors: The error model.
        block: What tables and gates take it for, with its numbers among those of a pose.
        at: Progress of each of the rig's courses, (n,).
    """

    readings: Readings
    sensor: Sensor
    target: int
    frame: int | None
    errors: ErrorModel
    block: Block
    at: Mapping[str, Vector] = field(default_factory=dict)

    @cached_property
    def values(self) -> Matrix:
        """The readings with something harmless where nothing was read."""
        return np.where(np.isnan(self.readings.values), np.asarray(self.sensor.blank), self.readings.values)

    @cached_property
    def _places(self) -> tuple[Place, ...]:
        return self.sensor.places(self.readings.target, self.readings.touched)

    @cached_property
    def _place_columns(self) -> npt.NDArray[np.intp]:
        """Columns of x that each pose's place has, (n, a); those of the first place where the pose touches none; -1 if they are held."""
        if not self._places:
            return np.empty((len(self.readings.labels), 0), dtype=int)
        column = self.errors.column
        table = np.array([[column.get(f"{place.name}.{name}", -1) for name in place.names] for place in self._places])
        return np.asarray(table[self._place_of_pose])

    @cached_property
    def _place_of_pose(self) -> npt.NDArray[np.intp]:
        index = {label: number for number, label in enumerate(self.readings.touched)}
        return np.array([index.get(str(label), 0) for label in self.readings.labels], dtype=int)

    @cached_property
    def _held(self) -> Matrix:
        """Values of a place's numbers that are not estimated, (n, a)."""
        table = np.array([[self.errors.held.get(f"{place.name}.{name}", 0.0) for name in place.names] for place in self._places])
        return np.asarray(table[self._place_of_pose]) if len(table) else np.empty((len(self.readings.labels), 0))

    @cached_property
    def _axes(self) -> Array3:
        """Axes that the numbers of each pose's place are in, (n, 3, 3): of a plane its normal and two tangents."""
        if not self._places:
            return np.broadcast_to(_UNIT, (len(self.readings.labels), 3, 3))
        axes = np.array([self.errors.planes.get(place.name, _UNIT) for place in self._places])
        return np.asarray(axes[self._place_of_pose])

    @property
    def places_of_poses(self) -> tuple[npt.NDArray[np.intp], Matrix, Array3]:
        """Of each pose's place: columns of x of its numbers, -1 where they are held, and those held, (n, a); its axes, (n, 3, 3)."""
        return self._place_columns, self._held, self._axes

    def view(self, motion: ArmMotion, rows: Rows, x: Vector) -> View:
        """The target as the measuring frame sees it at some poses."""
        p, R = motion.seen(self.target, self.frame)
        if not self._places:
            return View(p, R, self._held[rows], self._axes[rows])
        columns = self._place_columns[rows]
        place = np.where(columns >= 0, np.append(x, 0.0)[columns], self._held[rows])
        return View(p, R, place, self._axes[rows])

    def take(self, swept: _Swept, g: Array3, look: Look, of_rig: Array3, motion: ArmMotion, rows: Rows) -> Callable[[Array3], None] | None:
        """Residual of some poses into the arrays of all of them, and its derivatives by twists in the base into g (n, m, 6).

        Returns:
            What adds derivatives by parameters that are none of the arm's, once the arm's are there; None if there are no such.
        """
        measured, own = self.readings.measured[rows], self.block.columns
        whole = bool(measured.all())
        swept.residual[rows, own] = look.residual if whole else np.where(measured, look.residual, 0.0)
        g[:, own] = motion.from_base(look.jac2 if whole else np.where(measured[..., None], look.jac2, 0.0), self.frame)
        if look.lost is not None:
            swept.lost[rows, swept.blocks.index(self.block)] = look.lost if whole else look.lost & measured.any(axis=1)
        if look.by_place is None and not of_rig.shape[2]:
            return None
        return lambda columns: self._put_beside(columns[:, own], look, of_rig, rows)

    def _put_beside(self, columns: Array3, look: Look, of_rig: Array3, rows: Rows) -> None:
        """Derivatives of some poses by places that they share, and by what the rig does, into those by all parameters, (p, m, n)."""
        measured, of_place = self.readings.measured[rows], self._place_columns[rows]
        if look.by_place is not None and (of_place >= 0).any():
            pose, number = np.arange(len(measured))[:, None, None], np.arange(measured.shape[1])[None, :, None]
            by_place = np.where(measured[..., None], look.by_place, 0.0) * (of_place >= 0)[:, None]
            columns[of_place[:, None], number, pose] += by_place  # a held number's -1 gets zeros
        columns[self._rig_columns] += np.where(measured[..., None], of_rig, 0.0).transpose(2, 1, 0)

    @cached_property
    def _rig_columns(self) -> list[int]:
        """Columns of x that are the rig's."""
        return [self.errors.column[term.name] for term in self.errors.rig.terms] if self.errors.rig is not None else []

    @cached_property
    def alike(self) -> tuple[object, ...]:
        """What channels have in common that one look does for."""
        return self.readings.sensor, self.readings.instrument, self._place_columns.shape[1]

    def with_rig(self, view: View, look: Look, rows: Rows, x: Vector) -> tuple[Look, Array3]:
        """What the sensor makes of its target with what the rig does, and by how much more it reads per unit of the rig's parameters."""
        if self.errors.rig is None:
            return look, np.empty((*look.residual.shape, 0))
        at = {name: course[rows] for name, course in self.at.items()}
        return disturbed(self.errors.rig, x[self._rig_columns], self.sensor, view, look, at)


@dataclass
class _Swept:
    """What a linearisation is made of, to be filled by the channels.

    Attributes:
        residual, joint_jacobian, lost, blocks: As of a `Linearisation`.
        jacobian: The same; None where it is not kept.
        summing: Takes sums; None where there are none to be taken.
        last: Columns [J r] of the only part, (p + 1, m, n), if there is no other.
    """

    residual: Matrix
    joint_jacobian: Array3
    lost: Mask
    blocks: tuple[Block, ...]
    jacobian: Array3 | None
    summing: Summing | None
    last: Array3 | None = None

    @property
    def whole(self) -> Array3 | None:
        """The Jacobian, where there is only one part of it."""
        return None if self.last is None else np.ascontiguousarray(self.last[:-1].transpose(2, 1, 0))


@dataclass(frozen=True)
class Part:
    """Poses of one session that are worked on at once.

    Attributes:
        session: Which.
        rows: Which poses.
        posture: The joints, where none gives way.
        looks: Channels that read something there; where poses are few, those that one look does for together.
    """

    session: str
    rows: Rows
    posture: Posture
    looks: tuple[tuple[Channel, ...], ...] = ()


@dataclass(frozen=True, eq=False)
class Problem:
    """A robot put to its measurements.

    Attributes:
        errors: The error model.
        data: The measurements.
        joints: Whether to differentiate by the measured joints, too, for their noise.
    """

    errors: ErrorModel
    data: Measurements
    joints: bool = False

    @cached_property
    def channels(self) -> tuple[Channel, ...]:
        """Everything that was measured, in the order of the readings."""
        return tuple(self._channels())

    def _channels(self) -> Iterator[Channel]:
        chain, data, first = self.errors.chain, self.data, 0
        at = progress(data, self.errors.rig.courses) if self.errors.rig is not None else {}
        for reading in data.readings:
            sensor = data.sensor_of(reading)
            name = reading.label.replace(reading.target, reading.link) if reading.link in data.boards else reading.label
            columns = slice(first, first + sensor.numbers)
            block = Block(f"{name} {sensor.title}".strip(), columns, data.kinds.index(sensor.noise), sensor.words.unit)
            target = chain.frame_index(sensor.role, reading.target)
            frame = None if sensor.seen_from == "screen" else chain.seen_from(reading.instrument)
            yield Channel(reading, sensor, target, frame, self.errors, block, at)
            first = columns.stop

    @cached_property
    def arm(self) -> ArmKinematics:
        """Kinematics of the chain."""
        return self.errors.arm

    @cached_property
    def positions(self) -> Matrix:
        """Positions of the moving joints, (n, moving)."""
        return self.arm.chain_positions(self.data.q)

    @cached_property
    def _soft_basis(self) -> Matrix | None:
        data, soft = self.data, self.errors.soft
        return soft.basis(data.q, data.payload, data.approach) if soft is not None else None

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """The numbers of a pose that are one reading, channel by channel."""
        return tuple(channel.block for channel in self.channels)

    @cached_property
    def measured(self) -> Mask:
        """Which numbers of each pose were measured, (n, m)."""
        columns = [reading.measured for reading in self.data.readings]
        return np.concatenate(columns, axis=1) if columns else np.zeros((len(self.data), 0), dtype=bool)

    @cached_property
    def stated_sigma(self) -> Matrix:
        """Standard deviation stated with each number, (n, m), nan for none."""
        stated = [np.broadcast_to(reading.sigma[:, None], reading.measured.shape) for reading in self.data.readings]
        return np.concatenate(stated, axis=1) if stated else np.empty((len(self.data), 0))

    @cached_property
    def parts(self) -> tuple[Part, ...]:
        """Poses of one session that are worked on at once."""
        chunks = [(session, rows) for session in self.errors.sessions for rows in self._chunks(session)]
        return tuple(Part(session, rows, self.arm.posture(self.positions[rows]), self._looks_at(rows)) for session, rows in chunks)

    def _looks_at(self, rows: Rows) -> tuple[tuple[Channel, ...], ...]:
        """Channels of which something was read at some poses; where these are few, those together that one look does for."""
        read = [channel for channel in self.channels if channel.readings.measured[rows].any()]
        if len(self.data.q[rows]) > _FEW:
            return tuple((channel,) for channel in read)
        return tuple(tuple(group) for _, group in groupby(read, key=lambda channel: channel.alike))

    def _chunks(self, session: str) -> list[Rows]:
        if len(self.errors.sessions) == 1:
            return [slice(start, start + CHUNK) for start in range(0, len(self.data), CHUNK)]
        rows = np.flatnonzero(self.data.sessions == session)
        return [rows[start : start + CHUNK] for start in range(0, len(rows), CHUNK)]

    @cached_property
    def linearise(self) -> Linearise:
        """Residual and Jacobian of everything that was measured, as a function of x."""
        return remembering(self._linearised)

    def residuals(self, x: Vector) -> Linearisation:
        """The same where residuals are what is wanted: derivatives by the parameters are worked out if they are asked for after all."""
        return self._put_together(self._swept(x, summing=False, keeping=False), x)

    def _linearised(self, x: Vector) -> Linearisation:
        keeping = self._dense or self._asked.pop("jacobian", False)
        return self._put_together(self._swept(x, summing=not self._dense, keeping=keeping), x)

    def _put_together(self, swept: _Swept, x: Vector) -> Linearisation:
        """What was swept, with what is known beforehand."""
        known = _known_rows(self.errors, self.data.lengths, x)

        def jacobian() -> Array3:
            return self._jacobian(swept, known, x)

        linearised = Linearisation(
            swept.residual,
            jacobian,
            swept.joint_jacobian,
            self.measured,
            self.stated_sigma,
            self.blocks,
            swept.lost,
            poses=self.data.pose_of if self.data.again else None,
        )
        linearised = _with_known(linearised, known, jacobian) if known else linearised
        if swept.summing is None:
            return linearised
        return linearised.with_sums(swept.summing.sums.plus(_products(known)) if known else swept.summing.sums)

    @property
    def _dense(self) -> bool:
        """Whether the noise is not a factor a number, so that its sums cannot be taken on the way."""
        return self.joints or self.data.again

    def _jacobian(self, swept: _Swept, known: Sequence[Known], x: Vector) -> Array3:
        """The whole Jacobian where sums were taken of it: kept, from the only part, or by another sweep; the next one keeps it."""
        self._asked["jacobian"] = True
        whole = swept.jacobian if swept.jacobian is not None else swept.whole
        if whole is None:
            whole = self.jacobian(x)
        return np.concatenate([whole, _stacked(known, *whole.shape[1:])]) if known else whole

    def jacobian(self, x: Vector) -> Array3:
        """The whole Jacobian at a state, (n, m, p), without what is known beforehand."""
        jacobian = self._swept(x, summing=False, keeping=True).jacobian
        assert jacobian is not None
        return jacobian

    @cached_property
    def _asked(self) -> dict[str, bool]:
        """Whether the whole Jacobian of the last state was asked for: who did, as robust fits do, will ask again."""
        return {}

    def _swept(self, x: Vector, summing: bool, keeping: bool) -> _Swept:
        """One sweep over all poses: sums of what is read, the whole Jacobian, or both."""
        n, m, p = *self.measured.shape, len(self.errors.names)
        swept = self._unswept
        swept.jacobian = np.zeros((n, m, p)) if keeping else None
        swept.summing = Summing(p, self._numbers) if summing else None
        for part, motion in self._motions(x):
            columns = self._sweep(swept, motion, part, x)
            if swept.summing is not None:
                columns[-1] = swept.residual[part.rows].T
                swept.summing.add(columns, part.rows)
                swept.last = columns if len(self.parts) == 1 and swept.jacobian is None else None
        return swept

    @property
    def _unswept(self) -> _Swept:
        n, m = self.measured.shape
        return _Swept(
            residual=np.zeros((n, m)),
            joint_jacobian=np.zeros((n, m, len(self.data.joints) if self.joints else 0)),
            lost=np.zeros((n, len(self.blocks)), dtype=bool),
            blocks=self.blocks,
            jacobian=None,
            summing=None,
        )

    def by_parts(self, x: Vector) -> Iterator[tuple[Part, ArmMotion, Array3, Array3]]:
        """The poses, one part after the other: how they move, and derivatives of what is read.

        Yields:
            Part of the poses, how they move, derivatives by the parameters (p, m, n) and by `softness.unit_terms` (3 moving, m, n).
        """
        swept, moving = self._unswept, len(self.errors.chain.moving)
        for part, motion in self._motions(x):
            turns = np.empty((moving, 3, self.measured.shape[1], len(motion.posture)))
            columns = self._sweep(swept, motion, part, x, turns)[:-1]
            yield part, motion, columns, turns.reshape(3 * moving, *turns.shape[2:])

    def known_beforehand(self, x: Vector) -> Array3:
        """Gradients of what is known beforehand, each in the first number of its row, (rows, m, p)."""
        return _stacked(_known_rows(self.errors, self.data.lengths, x), self.measured.shape[1], len(x))

    def _sweep(self, swept: _Swept, motion: ArmMotion, part: Part, x: Vector, turns: Array4 | None = None) -> Array3:
        """One part of the poses: what every channel reads, and once for all of them how it goes with the arm, (p + 1, m, n).

        Where there is an array (moving, 3, m, n) for turns of the joints about all axes, it is filled.
        """
        rows, (n, m) = part.rows, (len(motion.posture), self.measured.shape[1])
        g = np.zeros((n, m, 6))
        beside = [channel.take(swept, g, look, of_rig, motion, rows) for channel, look, of_rig in self._looks(motion, part, x)]
        if swept.jacobian is None and swept.summing is None and not self.joints and turns is None:
            return np.empty((len(x) + 1, m, 0))
        columns, by_axis = motion.derivatives(g, axes=self.joints or turns is not None, more=1, behind=turns)
        self._shares[part.session].apply(columns)
        for put in filter(None, beside):
            put(columns)
        if swept.jacobian is not None:
            swept.jacobian[rows] = columns[:-1].transpose(2, 1, 0)
        if turns is not None:
            motion.unit_turns(by_axis, turns)
            self._axis_shares.apply(turns)
        if self.joints:
            self._axis_shares.apply(by_axis)
            swept.joint_jacobian[rows] = motion.by_inputs(by_axis)
        return columns

    def _looks(self, motion: ArmMotion, part: Part, x: Vector) -> Iterator[tuple[Channel, Look, Array3]]:
        """What each sensor makes of its target at some poses."""
        rows = part.rows
        for channels in part.looks:
            views = [channel.view(motion, rows, x) for channel in channels]
            for channel, view, look in zip(channels, views, _looked(channels, views, rows), strict=True):
                yield channel, *channel.with_rig(view, look, rows, x)

    @cached_property
    def _numbers(self) -> Numbers:
        kinds = [channel.block.kind for channel in self.channels for _ in range(channel.sensor.numbers)]
        return Numbers(np.array(kinds, dtype=np.intp), self.stated_sigma)

    @cached_property
    def _shares(self) -> Mapping[str, Shares]:
        """By session: whether each parameter moves what each number is of against what it is seen from, (p, m)."""
        return {session: Shares.of(self.shares_of_parameters(session)) for session in self.errors.sessions}

    @cached_property
    def _axis_shares(self) -> Shares:
        """The same of each moving joint, (moving, m)."""
        return Shares.of(self.shares_of_joints)

    def shares_of_parameters(self, session: str) -> Matrix:
        """How much each parameter moves what each number is of against what it is seen from, (p, m): 1, 0 or -1."""
        return self._of_numbers(self.errors.moves(session))

    @property
    def shares_of_joints(self) -> Matrix:
        """The same of each moving joint, (moving, m)."""
        return self._of_numbers(self.errors.chain.passed[[frame.depth for frame in self.errors.chain.frames]])

    def _of_numbers(self, moves: Mask) -> Matrix:
        moved = moves.astype(float)
        own = [self._against(moved, channel) for channel in self.channels for _ in range(channel.sensor.numbers)]
        return np.array(own).reshape(len(own), moved.shape[1]).T

    @staticmethod
    def _against(moves: Matrix, channel: Channel) -> Vector:
        return np.asarray(moves[channel.target] - (0.0 if channel.frame is None else moves[channel.frame]))

    def _motion(self, x: Vector, arm: PlacedArm, part: Part) -> ArmMotion:
        """Where everything is at some poses, and how it moves; joints give way as far as the error model has them."""
        if self._soft_basis is None:
            return ArmMotion(arm, part.posture)
        yielding = self.errors.yielding(x, self._soft_basis[part.rows])
        return ArmMotion(arm, self.arm.posture(self.positions[part.rows], yielding), yielding)

    def motion(self, x: Vector) -> ArmMotion:
        """The same of all poses at once, as if they were of the first session."""
        session, rows = self.errors.sessions[0], slice(len(self.data))
        whole = Part(session, rows, self.arm.posture(self.positions))
        return self._motion(x, PlacedArm(self.arm, self.errors.placements(x, session)), whole)

    def _motions(self, x: Vector) -> Iterator[tuple[Part, ArmMotion]]:
        """The same of all poses, by parts."""
        arms = {session: PlacedArm(self.arm, self.errors.placements(x, session)) for session in self.errors.sessions}
        for part in self.parts:
            yield part, self._motion(x, arms[part.session], part)

    def motions(self, x: Vector) -> Iterator[tuple[Rows, ArmMotion]]:
        """The same, with the rows of the poses."""
        for part, motion in self._motions(x):
            yield part.rows, motion

    def views(self, x: Vector) -> tuple[View, ...]:
        """What every channel looks at, at all poses."""
        parts = list(self.motions(x))
        order = np.argsort(np.concatenate([np.arange(len(self.data))[rows] for rows, _ in parts])) if parts else np.empty(0, dtype=int)
        return tuple(_joined([channel.view(motion, rows, x) for rows, motion in parts], order) for channel in self.channels)

    def read(self, x: Vector) -> tuple[Matrix, ...]:
        """What every channel would read at x without noise, as readings keep it, (n, stored)."""
        return tuple(channel.sensor.read(view) for channel, view in zip(self.channels, self.views(x), strict=True))

    def with_data(self, data: Measurements) -> Problem:
        """The same robot put to other measurements."""
        return replace(self, data=data)

    def with_prior(self, errors: ErrorModel) -> Problem:
        """The same where other standard deviations are expected: what was worked out stays."""
        other = replace(self, errors=errors)
        other.__dict__.update({name: value for name, value in self.__dict__.items() if name != "errors"})
        return other


def problem_of(errors: ErrorModel, data: Measurements, noise: Noise) -> Problem:
    """The problem of some poses with what noise asks for: derivatives by the joints, too, where their readings are noisy."""
    return Problem(errors, data, joints=noise.of_joints)


def _looked(channels: Sequence[Channel], views: Sequence[View], rows: Rows) -> list[Look]:
    """What a sensor makes of each of its targets."""
    sensor = channels[0].sensor
    if len(channels) == 1:
        return [sensor.look(views[0], channels[0].values[rows])]
    n, view = len(views[0].p), View(*(np.concatenate([getattr(own, what) for own in views]) for what in ("p", "R", "place", "axes")))
    every = sensor.look(view, np.concatenate([channel.values[rows] for channel in channels]))
    return [every.of(slice(first, first + n)) for first in range(0, n * len(channels), n)]


def _joined(parts: Sequence[View], order: npt.NDArray[np.intp]) -> View:
    """Views of parts of the poses as one of all of them, in their order."""
    p, R, place, axes = (np.concatenate([getattr(part, what) for part in parts])[order] for what in ("p", "R", "place", "axes"))
    return View(p, R, place, axes)


def _known_rows(errors: ErrorModel, lengths: Sequence[KnownLength], x: Vector) -> list[Known]:
    """What is known beforehand: distances between places, a sum of parameters that is held, and what an earlier calibration decided.

    Residual, gradient and standard deviation of each.
    """
    known = [_length_row(errors, length, x) for length in lengths] + ([_sum_row(errors, x)] if errors.held_sum else [])
    return known + [(-_SMALL * float(row @ x), _SMALL * row, _SMALL) for row in errors.known_rows]


def _products(known: Sequence[Known]) -> Matrix:
    """[J r]'[J r] of what is known beforehand, whitened, (p + 1, p + 1)."""
    rows = np.array([np.append(gradient, left) / deviation for left, gradient, deviation in known])
    return np.asarray(rows.T @ rows)


def _stacked(known: Sequence[Known], m: int, p: int) -> Array3:
    """Gradients of what is known beforehand, each in the first number of its row, (rows, m, p)."""
    rows = np.zeros((len(known), m, p))
    rows[:, 0] = [gradient for _, gradient, _ in known]
    return rows


def _with_known(linearisation: Linearisation, known: Sequence[Known], jacobian: Callable[[], Array3]) -> Linearisation:
    """The same with what is known beforehand as further rows; they are in the Jacobian, which is worked out when it is asked for."""
    rows, m = len(known), linearisation.residual.shape[1]
    residual, sigma = np.zeros((rows, m)), np.full((rows, m), np.nan)
    for row, (left, _, deviation) in enumerate(known):
        residual[row, 0], sigma[row, 0] = left, deviation
    return replace(
        linearisation,
        jacobian=jacobian,
        known=rows,
        residual=np.vstack([linearisation.residual, residual]),
        joint_jacobian=np.concatenate([linearisation.joint_jacobian, np.zeros((rows, m, linearisation.joint_jacobian.shape[2]))]),
        measured=np.vstack([linearisation.measured, ~np.isnan(sigma)]),
        stated_sigma=np.vstack([linearisation.stated_sigma, sigma]),
        lost=None
        if linearisation.lost is None
        else np.vstack([linearisation.lost, np.zeros((rows, len(linearisation.blocks)), dtype=bool)]),
        poses=None
        if linearisation.poses is None
        else np.concatenate([linearisation.poses, linearisation.poses.max() + 1 + np.arange(rows)]),
    )


def _length_row(errors: ErrorModel, known: KnownLength, x: Vector) -> tuple[float, Vector, float]:
    """Residual, gradient and standard deviation of a known distance; its places are free, or held."""
    ends = [[f"{place}.{axis}" for axis in "xyz"] for place in (known.one, known.other)]
    one, other = ([errors.value(name, x) for name in end] for end in ends)
    apart = np.subtract(one, other)
    length = max(float(np.linalg.norm(apart)), 1e-9)
    gradient = np.zeros(len(x))
    for sign, end in zip((1.0, -1.0), ends, strict=True):
        for name, share in zip(end, apart / length, strict=True):
            if name in errors.column:
                gradient[errors.column[name]] = sign * share
    return known.length - length, gradient, known.sigma


def _sum_row(errors: ErrorModel, x: Vector) -> tuple[float, Vector, float]:
    gradient = np.array([errors.held_sum.get(name, 0.0) for name in errors.names])
    return -float(gradient @ x), gradient, _HELD
