"""What all questions to one fit stand on: its residual, and how everything that is read moves where one joint turns."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from urdfcal.base.geometry import Array3, Matrix, Vector
from urdfcal.calibration.asking.folds import clustered
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.richer import DOWN
from urdfcal.estimation.ekf import Belief, Estimate
from urdfcal.estimation.noise import Weights
from urdfcal.estimation.residual import Linearisation
from urdfcal.estimation.score import Fitted
from urdfcal.model.error_model import with_softness
from urdfcal.model.gravity import Gravity, WeighedRobot
from urdfcal.model.softness import Term, unit_terms
from urdfcal.robot.robot import Robot
from urdfcal.sensors.repeats import first_rows


@dataclass(frozen=True)
class Ground:
    """A fit.

    Attributes:
        robot: The nominal robot, as it was measured.
        model: The fit's problem.
        estimate: The fit.
        gravity: Where down is, and what is carried; if None down, or along another axis of the root link.
        anywhere: Whether those other axes are asked about.
    """

    robot: Robot
    model: Problem
    estimate: Estimate
    gravity: Gravity | None = None
    anywhere: bool = False

    @cached_property
    def linearisation(self) -> Linearisation:
        """At the estimate; its Jacobian comes with what is read more where joints turn."""
        here = self.model.linearise(self.estimate.belief.x)
        if here.known:
            return here
        return replace(here, jacobian=lambda: self._with_turns[0])

    @property
    def numbers(self) -> int:
        """How many numbers the poses have, without what is known beforehand."""
        return len(self.model.data) * int(self.linearisation.residual.shape[1])

    @property
    def rows(self) -> int:
        """How many poses there are, and below them rows of what is known beforehand; several readings of one pose are one row."""
        poses = self.linearisation.poses
        return len(self.linearisation.residual) if poses is None else int(poses.max()) + 1

    @cached_property
    def _weights(self) -> Weights:
        return self.estimate.noise.weights(self.linearisation)

    @cached_property
    def fitted(self) -> Fitted:
        """The fit before any question."""
        errors = self.model.errors
        prior = Belief.independent(errors.mean, errors.sigma)
        return Fitted.of(self.linearisation, self.estimate.noise, self.estimate.belief.x, prior)

    def foretold(self, fitted: Fitted) -> float:
        """Log density of clusters of poses that are left out in turn, less what the noise's whitening adds."""
        data = self.model.data
        first = first_rows(data.pose_of)
        lost = self.estimate.noise.log_determinant(self.linearisation) / 2
        return fitted.predicted(clustered(data.q[first], data.configuration_of[first]), self.rows) - lost

    def whitened(self, columns: Array3) -> Matrix:
        """Columns (readings, m, k) in units of the noise, (N, k) of the rows' numbers; what is known beforehand has none."""
        m, k = columns.shape[1:]
        padded = np.zeros((*self.linearisation.residual.shape, k))
        padded[: len(columns)] = columns
        padded *= np.asarray(self.linearisation.measured)[..., None]
        return self._weights.of_poses(padded).reshape(self.rows * m, k)

    def laid_out(self, whitened: Vector) -> Vector:
        """Numbers of rows, (N,), over all readings of theirs, as whitened residuals have them: with the same sum of squares."""
        means = self._weights.means
        return whitened if means is None else means.spread(whitened.reshape(self.rows, -1, 1)).ravel()

    @cached_property
    def pulls(self) -> tuple[WeighedRobot, ...]:
        """The robot with its masses, and with every gravity that is asked about."""
        usual = map(Gravity, DOWN if self.anywhere else DOWN[:1])
        return tuple(WeighedRobot(self.robot, pull) for pull in ([self.gravity] if self.gravity is not None else usual))

    @property
    def turns(self) -> tuple[Array3, tuple[Term, ...]]:
        """What is read more where a joint turns, or slides, by one, (n, m, terms), and about what."""
        return self._with_turns[1], unit_terms(self.robot.chain)

    @cached_property
    def _with_turns(self) -> tuple[Array3, Array3]:
        """Derivatives by the parameters, (n, m, p), and by turns that the fit does not have, (n, m, terms): of one sweep."""
        terms, soft = unit_terms(self.robot.chain), self.model.errors.soft
        weighed, before = (soft.weighed, soft.terms) if soft is not None else (self.pulls[0], ())
        errors = with_softness(self.model.errors, (*before, *terms), weighed, self.robot.rig.tip)
        x = dict(zip(self.model.errors.names, self.estimate.belief.x.tolist(), strict=True))
        whole = Problem(errors, self.model.data).jacobian(np.array([x.get(name, 0.0) for name in errors.names]))
        if errors.names[: len(x)] == self.model.errors.names and not before:
            return whole[:, :, : len(x)], whole[:, :, len(x) :]
        own, turned = ([errors.column[name] for name in names] for names in (x, [term.name for term in terms]))
        return whole[:, :, own], whole[:, :, turned]

    @cached_property
    def own_turns(self) -> Matrix:
        """The same, whitened, of every turning joint that was read about its own axis, (N, joints)."""
        return self.whitened(self.turns[0][:, :, [number for number, _, _ in self._turning()]])

    @cached_property
    def turning(self) -> list[tuple[str, Vector]]:
        """Names and positions (rows,) of those joints; rows of what is known beforehand have zeros."""
        found = []
        for _, name, index in self._turning():
            q = np.zeros(self.rows)
            q[self.model.data.pose_of] = self.model.data.q[:, index]
            found.append((name, q))
        return found

    def _turning(self) -> Iterator[tuple[int, str, int]]:
        """Number of the turn, name, and number among the measured joints."""
        inputs = {joint.name: index for index, joint in enumerate(self.robot.chain.inputs)}
        for number, term in enumerate(self.turns[1]):
            joint = self.robot.chain.moving[term.joint].joint
            if term.axis is None and joint.name in inputs and not joint.prismatic:
                yield number, joint.name, inputs[joint.name]
