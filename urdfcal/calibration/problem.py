"""A robot put to its measurements: J = Jac2 Jac1, equation (12), stacked over all poses, for every sensor alike.

Twists of the chain are those of everything behind a joint against its base (the screen, or the reference), at the base's origin. A
target moves with those of its own way alone, and so does the frame that it is seen from; what a sensor sees is the difference of the
two, in the measuring frame's axes at the measuring frame's origin:

    [v, w] = Ad(T_frame^-1) (V_target - V_frame)
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Array3, Array4, Mask, Matrix, Vector
from urdfcal.calibration.asking.disturbances import progress
from urdfcal.calibration.channel import Channel, Rows, Swept, looked
from urdfcal.calibration.known_beforehand import Known, known_rows, products, stacked, with_known
from urdfcal.estimation.noise import Noise
from urdfcal.estimation.normal import Numbers, Summing
from urdfcal.estimation.residual import Block, Linearisation, Linearise, remembering
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.jacobian import CHUNK, ArmMotion, Shares
from urdfcal.model.kinematics import ArmKinematics, PlacedArm, Posture
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.sensor import Look, View

_FEW = 256  # poses, of which calls cost more than their numbers


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

    def _put_together(self, swept: Swept, x: Vector) -> Linearisation:
        """What was swept, with what is known beforehand."""
        known = known_rows(self.errors, self.data.lengths, x)

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
        linearised = with_known(linearised, known, jacobian) if known else linearised
        if swept.summing is None:
            return linearised
        return linearised.with_sums(swept.summing.sums.plus(products(known)) if known else swept.summing.sums)

    @property
    def _dense(self) -> bool:
        """Whether the noise is not a factor a number, so that its sums cannot be taken on the way."""
        return self.joints or self.data.again

    def _jacobian(self, swept: Swept, known: Sequence[Known], x: Vector) -> Array3:
        """The whole Jacobian where sums were taken of it: kept, from the only part, or by another sweep; the next one keeps it."""
        self._asked["jacobian"] = True
        whole = swept.jacobian if swept.jacobian is not None else swept.whole
        if whole is None:
            whole = self.jacobian(x)
        return np.concatenate([whole, stacked(known, *whole.shape[1:])]) if known else whole

    def jacobian(self, x: Vector) -> Array3:
        """The whole Jacobian at a state, (n, m, p), without what is known beforehand."""
        jacobian = self._swept(x, summing=False, keeping=True).jacobian
        assert jacobian is not None
        return jacobian

    @cached_property
    def _asked(self) -> dict[str, bool]:
        """Whether the whole Jacobian of the last state was asked for: who did, as robust fits do, will ask again."""
        return {}

    def _swept(self, x: Vector, summing: bool, keeping: bool) -> Swept:
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
    def _unswept(self) -> Swept:
        n, m = self.measured.shape
        return Swept(
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
        return stacked(known_rows(self.errors, self.data.lengths, x), self.measured.shape[1], len(x))

    def _sweep(self, swept: Swept, motion: ArmMotion, part: Part, x: Vector, turns: Array4 | None = None) -> Array3:
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
            for channel, view, look in zip(channels, views, looked(channels, views, rows), strict=True):
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


def _joined(parts: Sequence[View], order: npt.NDArray[np.intp]) -> View:
    """Views of parts of the poses as one of all of them, in their order."""
    p, R, place, axes = (np.concatenate([getattr(part, what) for part in parts])[order] for what in ("p", "R", "place", "axes"))
    return View(p, R, place, axes)
