"""What the sensors see at some poses, and why not: each sensor says what it takes, here it is put together.

Readings that are only made together are one group: all beams, all the corners of a board by one camera, all numbers of a target by one
instrument. A pose can be measured where one group is seen as a whole, and what other groups do not see there is not read. Of a pose that
cannot be measured the first reason of its first group is told.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import Mask, Matrix
from urdfcal.calibration.channel import Channel
from urdfcal.calibration.problem import Problem
from urdfcal.model.jacobian import ArmMotion, arm_motion
from urdfcal.planning.measuring import Measuring
from urdfcal.robot.robot import Robot
from urdfcal.sensors.readings import Readings
from urdfcal.sensors.sensor import Sight, View

Hidden = Callable[[Robot, Matrix, Matrix, Matrix], Mask]
_Group = tuple[str, str, str]
HIDDEN = "hide a target from what looks at it"


@dataclass(frozen=True)
class Seen:
    """What is seen at some poses.

    Attributes:
        read: Which readings are made, (n, readings).
        why: The first reason why a pose cannot be measured, (n,); the empty string where it can.
    """

    read: Mask
    why: np.ndarray

    @property
    def any(self) -> Mask:
        """At which poses something is, (n,)."""
        return np.asarray(self.why == "", dtype=bool)


@dataclass(frozen=True)
class Eyes:
    """What measures, and what it takes to be seen by it.

    Attributes:
        made: What measures.
        sight: What it takes, as far as sensors do not know it.
    """

    made: Measuring
    sight: Sight

    def geometry(self, q: Matrix) -> Seen:
        """What is seen at positions (n, inputs) if nothing is in the way."""
        return self._seen(q, lambda channel, view: self._unseen(channel, view))

    def unhidden(self, q: Matrix, hidden: Hidden) -> Seen:
        """What nothing stands before, at positions (n, inputs); whether it is seen otherwise is not asked."""
        base = self.made.robot

        def masks(channel: Channel, view: View) -> Mapping[str, Mask]:
            lines = None if channel.readings.instrument in self.made.unknown else channel.sensor.sight_lines(view)
            if lines is None:
                return {}
            begin, end = (self._in_base(q, channel, points) for points in lines)
            return {HIDDEN: hidden(base, q, begin, end)}

        return self._seen(q, masks)

    def require_heeded(self) -> None:
        """Refuse what is said of a target's opening and of an instrument's range where nothing heeds it.

        Raises:
            UsageError: no sensor does, or nobody said where the instrument stands.
        """
        if not self.sight.of_trackers:
            return
        plain, q = replace(self, sight=self.sight.without_trackers()), np.zeros((1, len(self.made.robot.chain.inputs)))
        if all(set(self._unseen(*own)) == set(plain._unseen(*own)) for own in self._views(q)):
            raise UsageError(
                "acceptance and range are those of a tracker whose place is known, and none reads here; name its link with --reference"
                if self.made.unknown
                else "acceptance and range are those of a tracker, and none reads here"
            )

    def _unseen(self, channel: Channel, view: View) -> Mapping[str, Mask]:
        """Why one target is not seen by itself."""
        if channel.readings.instrument in self.made.unknown and channel.sensor.seen_from == "frame":
            return {}
        grid = self.made.asked.boards.get(channel.readings.link)
        return channel.sensor.unseen(view, replace(self.sight, square=0.0 if grid is None else grid.square))

    def _seen(self, q: Matrix, masks: Callable[[Channel, View], Mapping[str, Mask]]) -> Seen:
        why: dict[_Group, np.ndarray] = {group: np.full(len(q), "", dtype=object) for group in self._groups}
        points: dict[str, list[Matrix]] = defaultdict(list)
        for channel, view in self._views(q):
            first = why[_group(channel.readings, self.made)]
            for reason, mask in masks(channel, view).items():
                first[mask & (first == "")] = reason
            own = channel.sensor.taken_for_each_other(view)
            if own is not None:
                points[channel.sensor.name].append(own)
                for other in points[channel.sensor.name][:-1]:
                    near = np.linalg.norm(own - other, axis=1) < self.sight.apart
                    first[near & (first == "")] = f"have spots less than {1e3 * self.sight.apart:g} mm apart"
        read = np.array([why[group] == "" for group in self._group_of]).T.reshape(len(q), -1)
        told = next(iter(why.values())) if why else np.full(len(q), "", dtype=object)
        return Seen(read, np.where(read.any(axis=1), "", told).astype(object))

    @cached_property
    def _readings(self) -> tuple[Readings, ...]:
        """All that is read of a pose."""
        return self.made.blanks(np.zeros((0, len(self.made.robot.chain.inputs)))).readings

    @cached_property
    def _group_of(self) -> list[_Group]:
        return [_group(own, self.made) for own in self._readings]

    @property
    def _groups(self) -> dict[_Group, None]:
        return dict.fromkeys(self._group_of)

    @cached_property
    def _looked_at(self) -> list[int]:
        """Readings that tell of all of their group: of a board its outermost corners."""
        return [index for index, own in enumerate(self._readings) if _outermost(own, self.made)]

    def _views(self, q: Matrix) -> Iterator[tuple[Channel, View]]:
        """Targets as what reads them sees them, at their links' origins."""
        data = self.made.blanks(q)
        data = replace(data, readings=tuple(data.readings[index] for index in self._looked_at))
        motion, errors = self._motion(q), self.made.sight
        for channel in Problem(errors, data).channels:
            yield channel, channel.view(motion, slice(None), errors.mean)

    def _motion(self, q: Matrix) -> ArmMotion:
        return arm_motion(self.made.sight, q, self.made.sight.mean, self.made.sight.sessions[0])

    def _in_base(self, q: Matrix, channel: Channel, points: Matrix) -> Matrix:
        """Points (n, 3) of the frame that a target is seen from, in the axes of the chain's base."""
        if channel.frame is None:
            return points
        frame = self._motion(q).frames[channel.frame]
        return np.asarray((frame[:, :, :3] @ points[..., None])[..., 0] + frame[:, :, 3])


def _group(own: Readings, made: Measuring) -> _Group:
    """What it is read together with."""
    target = "" if own.kind.beam else own.link if own.link in made.asked.boards else own.target
    return own.kind.role, target, own.instrument


def _outermost(own: Readings, made: Measuring) -> bool:
    grid = made.asked.boards.get(own.link)
    if grid is None:
        return True
    row, column = divmod(int(own.target.partition(":")[2]), grid.columns)
    return row in (0, grid.rows - 1) and column in (0, grid.columns - 1)
