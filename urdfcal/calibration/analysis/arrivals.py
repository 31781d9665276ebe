"""What an online calibration knows beside its belief: the robot as the readings so far see it, and the poses that came."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from urdfcal.base.errors import RigError, UsageError
from urdfcal.base.geometry import Matrix, Vector
from urdfcal.calibration.analysis.stream import Row, as_measurements
from urdfcal.calibration.reach import draw_poses
from urdfcal.calibration.start.nominal import NominalFit, nominal_fit
from urdfcal.estimation.noise import Noise
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.jacobian import CHUNK
from urdfcal.robot.robot import Robot
from urdfcal.sensors.joined import joined
from urdfcal.sensors.measurements import Measurements, spots_measured
from urdfcal.sensors.repeats import read_again

WORKSPACE = 50  # configurations over which accuracy is predicted


class NotYet(Exception):
    """Something cannot be placed yet; says what it takes."""


@dataclass(frozen=True)
class Seen:
    """The robot as the readings so far see it.

    Attributes:
        robot: With its instruments.
        errors: The error model, with everything placed that is.
        kinds: Of noise, in its order.
        tool: Link whose accuracy is predicted.
        workspace: Configurations over which it is, (n, inputs).
        views: Poses with every beam on the screen, (n, inputs).
        placed: Whether measuring frames, targets and places are where they were found.
    """

    robot: Robot
    errors: ErrorModel
    kinds: tuple[str, ...]
    tool: str
    workspace: Matrix
    views: Matrix
    placed: bool

    def knows(self, pose: Measurements) -> bool:
        """Whether a pose shows nothing but what was placed before."""
        seen = pose.instruments
        return (
            self.placed
            and pose.joints == self.robot.chain.input_names
            and set(pose.session_names) <= set(self.errors.sessions)
            and set(pose.kinds) <= set(self.kinds)
            and set(pose.lasers) <= set(self.robot.rig.lasers)
            and all(set(target.offset) <= self._offsets.get(target.name, set()) for target in seen.targets)
            and {place.name for place in seen.places} <= self._places
            and (self.robot.instruments.placed or not seen.placed)
        )

    @cached_property
    def _offsets(self) -> dict[str, set[str]]:
        return {target.name: set(target.offset) for target in self.robot.instruments.targets}

    @cached_property
    def _places(self) -> set[str]:
        return {name.rpartition(".")[0] for name in (*self.errors.names, *self.errors.held)}


class History:
    """All poses that the belief holds; joint positions in an array that grows by doubling."""

    def __init__(self) -> None:
        self.parts, self.count, self.numbers = list[tuple[int, Measurements | Row]](), 0, 0
        self._q = np.empty((0, 0))

    def __len__(self) -> int:
        """Number of poses."""
        return self.count

    def holds(self, q: Vector) -> bool:
        """Whether this is a further reading of a pose that is held."""
        return bool(self.count) and read_again(self._q[: self.count], q)

    def add(self, number: int, poses: Measurements, again: bool) -> None:
        """A pose, by the number in which it came; or a set without any, for what it would be of."""
        self.parts.append((number, poses))
        for q in poses.q:
            self._keep(q)
        self.numbers += 0 if again else poses.numbers

    def add_row(self, number: int, row: Row, numbers: int) -> None:
        """The same of a pose in its layout, and how many numbers it adds."""
        self.parts.append((number, row))
        self._keep(row.q)
        self.numbers += numbers

    def _keep(self, q: Vector) -> None:
        if self.count == len(self._q):
            old = self._q if self.count else np.empty((0, len(q)))
            self._q = np.concatenate([old, np.empty((max(self.count, CHUNK), len(q)))])
        self._q[self.count] = q
        self.count += 1

    def measurements(self) -> Measurements:
        """All of them, in the order in which they came.

        Raises:
            UsageError: there are none, nor lasers that they could be of.
        """
        if not self.parts:
            raise UsageError("no pose was taken yet")
        return in_order(self.parts)


def in_order(parts: Sequence[tuple[int, Measurements | Row]]) -> Measurements:
    """Poses in the order in which they came."""
    return joined(as_measurements([part for _, part in sorted(parts, key=lambda part: part[0])]))


def no_spots(robot: Robot) -> Measurements | None:
    """No poses of a robot's lasers; None where it has none that could be read."""
    try:
        lasers = len(robot.rig.lasers)
    except RigError:  # a tracker or a camera needs neither lasers nor a screen, and what is read will tell
        return None
    return spots_measured(robot, np.empty((0, len(robot.chain.inputs))), np.empty((0, lasers, 2)))


def poses_on_screen(robot: Robot, errors: ErrorModel, rng: np.random.Generator) -> Matrix:
    """Random configurations with every beam on the screen, (WORKSPACE, inputs); none where they are too rare, or there are no lasers."""
    none = np.empty((0, len(robot.chain.inputs)))
    if not robot.rig.lasers:
        return none
    try:
        return draw_poses(robot, errors, errors.mean, WORKSPACE, rng)
    except UsageError:  # too rare to be found at random: the error of the spots stays unknown, that of the tool does not
        return none


def placed_instruments(errors: ErrorModel, data: Measurements, noise: Noise) -> NominalFit:
    """Everything that measures, where it suits the nominal robot best.

    Raises:
        NotYet: it was seen or touched too seldom.
    """
    try:
        return nominal_fit(errors, data, noise)
    except UsageError as told:
        raise NotYet(str(told)) from None
