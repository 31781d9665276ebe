"""The same problem, one pose after the other: J = Jac2 Jac1 of a pose with what was read at it, linearised where it was decided once.

All poses of a *layout*, the same sensors reading the same targets from the same instruments, differ in nothing but numbers. So what a
`Problem` works out of them is worked out once, for the first; a sensor looks at all of its targets at once, as else at all poses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from urdfcal.base.geometry import Array3, Mask, Matrix, Vector
from urdfcal.calibration.channel import Channel
from urdfcal.calibration.problem import Problem
from urdfcal.model.kinematics import PlacedArm
from urdfcal.model.single_pose import Index, SinglePoses, brought_to_base, seen_from
from urdfcal.sensors.sensor import Look, Sensor, View


@dataclass(frozen=True)
class OfPose:
    """Residual and Jacobians of one pose; of numbers that were not read they mean nothing.

    Attributes:
        residual: m - h(x), (m,).
        H: Derivatives of h by the parameters, (m, p).
        by_joints: By the measured joints, (m, inputs); none where they were not asked for.
        lost: Which numbers are out of the sensor's reach in the model, (m,); None where that cannot be.
    """

    residual: Vector
    H: Matrix
    by_joints: Matrix
    lost: Mask | None


@dataclass(frozen=True)
class _Group:
    """What one sensor reads of several targets from one instrument.

    Attributes:
        sensor: How.
        readings: Which of those of a pose.
        targets, frames: Among the chain's frames; the base is -1.
        place, axes: Of a `View`, which do not change from pose to pose.
        place_columns: Columns of x that each place has, (k, a), -1 where it is held.
        moves: Whether any is seen from elsewhere than the base.
    """

    sensor: Sensor
    readings: slice
    targets: Index
    frames: Index
    place: Matrix
    axes: Array3
    place_columns: Index
    moves: bool

    def look(self, frames: Array3, values: Sequence[Vector]) -> tuple[Look, Matrix]:
        """What the sensor makes of its targets, and derivatives by twists in the base, (numbers, 6)."""
        own, read = frames[self.targets], np.array(values[self.readings])
        unread = np.isnan(read)
        if unread.any():
            read = np.where(unread, np.asarray(self.sensor.blank), read)
        if not self.moves:
            look = self.sensor.look(View(own[:, :3, 3], own[:, :3, :3], self.place, self.axes), read)
            return look, look.jac2.reshape(-1, 6)
        there = frames[self.frames]
        look = self.sensor.look(View(*seen_from(own, there), self.place, self.axes), read)
        return look, brought_to_base(look.jac2, there).reshape(-1, 6)

    def put_places(self, columns: Matrix, by_place: Array3) -> None:
        """Derivatives (k, m, a) by the places' numbers into those by all parameters, (k m, p ...)."""
        k, m, _ = by_place.shape
        of_place = self.place_columns[:, None]
        columns[np.arange(k * m).reshape(k, m, 1), of_place] += by_place * (of_place >= 0)


class PoseByPose:
    """A problem at one state, pose by pose; of its numbers those m that can be read at all: not those of what is not touched.

    Attributes:
        kind: Index of the noise of each number, (m,).
        reading: Index of the reading that it is of, (m,).
    """

    def __init__(self, problem: Problem, x: Vector) -> None:
        """Of a problem of one pose, of an error model in which no joint gives way and the rig does nothing, and a state, (p,)."""
        session = problem.data.session_names[0]
        self._chain, self._p, self._joints = problem.arm.chain, len(x), problem.joints
        self._poses = SinglePoses(PlacedArm(problem.arm, problem.errors.placements(x, session)))
        self._channels = [(index, channel) for index, channel in enumerate(problem.channels) if _readable(channel).any()]
        self._groups = [_grouped(list(own), x) for (*_, read), own in groupby(enumerate(problem.channels), _looks_alike) if read]
        widths = [channel.sensor.numbers for _, channel in self._channels]
        self.kind = np.repeat([channel.block.kind for _, channel in self._channels], widths).astype(np.intp)
        self.reading = np.repeat([index for index, _ in self._channels], widths).astype(np.intp)
        shares = np.vstack([problem.shares_of_parameters(session), problem.shares_of_joints])
        shares = shares[:, [number for _, channel in self._channels for number in range(*channel.block.columns.indices(shares.shape[1]))]]
        self._shares = np.ascontiguousarray(shares.T) if (shares != 1).any() else None

    def measured(self, values: Sequence[Vector]) -> Mask | None:
        """Which numbers were read, (m,), where these are the readings, (stored,) each, nan for nothing; None for all."""
        if not np.isnan(np.concatenate(values)).any():
            return None
        own = [channel.sensor.measured(values[index][None], channel.readings.labels)[0] for index, channel in self._channels]
        return np.concatenate(own)

    def at(self, q: Vector, values: Sequence[Vector]) -> OfPose:
        """Linearised at joint positions (inputs,) at which this was read, (stored,) each, nan for nothing."""
        frames = self._poses.move(q @ self._chain.coupling + self._chain.offset)
        looks = [group.look(frames, values) for group in self._groups]
        columns = self._poses.derivatives(_together([g for _, g in looks]))
        if self._shares is not None:
            columns *= self._shares
        first = 0
        for group, (look, g) in zip(self._groups, looks, strict=True):
            if look.by_place is not None:
                group.put_places(columns[first : first + len(g)], look.by_place)
            first += len(g)
        by_joints = columns[:, self._p :] @ self._chain.coupling.T if self._joints else columns[:, :0]
        return OfPose(_together([look.residual.ravel() for look, _ in looks]), columns[:, : self._p], by_joints, _lost(looks))


def _together(parts: Sequence[Matrix]) -> Matrix:
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _lost(looks: Sequence[tuple[Look, Matrix]]) -> Mask | None:
    if all(look.lost is None for look, _ in looks):
        return None
    every = [np.zeros(len(look.residual), dtype=bool) if look.lost is None else look.lost for look, _ in looks]
    return np.concatenate([np.repeat(own, look.residual.shape[1]) for own, (look, _) in zip(every, looks, strict=True)])


def _readable(channel: Channel) -> Mask:
    """Which numbers are read where anything is, (numbers,); none where nothing was touched."""
    sensor = channel.sensor
    return np.asarray(
        sensor.measured(np.broadcast_to(np.asarray(sensor.blank, dtype=float), (1, sensor.stored)), channel.readings.labels)[0]
    )


def _looks_alike(numbered: tuple[int, Channel]) -> tuple[object, ...]:
    _, channel = numbered
    return *channel.alike, bool(_readable(channel).any())


def _grouped(numbered: Sequence[tuple[int, Channel]], x: Vector) -> _Group:
    channels = [channel for _, channel in numbered]
    columns, held, axes = (np.concatenate(each) for each in zip(*(channel.places_of_poses for channel in channels), strict=True))
    frames = np.array([-1 if channel.frame is None else channel.frame for channel in channels], dtype=np.intp)
    return _Group(
        channels[0].sensor,
        slice(numbered[0][0], numbered[-1][0] + 1),
        np.array([channel.target for channel in channels], dtype=np.intp),
        frames,
        np.where(columns >= 0, np.append(x, 0.0)[columns], held),
        axes,
        columns,
        bool((frames >= 0).any()),
    )
