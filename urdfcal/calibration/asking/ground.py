"""What all questions to one fit stand on: its residual, and how everything that is read moves where one joint turns."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Vector
from urdfcal.calibration.asking.folds import clustered
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.richer import DOWN
from urdfcal.estimation.ekf import Estimate
from urdfcal.estimation.noise import Weights
from urdfcal.estimation.residual import Linearisation
from urdfcal.estimation.score import Fitted
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
        """At the estimate."""
        return self.model.linearise(self.estimate.belief.x)

    @cached_property
    def rows(self) -> int:
        """How many poses there are, and below them rows of what is known beforehand; several readings of one pose are one row."""
        poses = self.linearisation.poses
        return len(self.linearisation.residual) if poses is None else int(poses.max()) + 1

    @cached_property
    def weights(self) -> Weights:
        """What whitens the linearisation."""
        return self.estimate.noise.weights(self.linearisation)

    @cached_property
    def at(self) -> Vector:
        """The estimate less what the prior expects, in units of the prior sigmas, (p,)."""
        errors = self.model.errors
        return np.asarray((self.estimate.belief.x - errors.mean) / errors.sigma)

    @cached_property
    def fitted(self) -> Fitted:
        """The fit before any question."""
        normal, sigma = self.estimate.noise.normal(self.linearisation), self.model.errors.sigma
        b = normal.b * sigma
        products = np.block([[normal.A * np.outer(sigma, sigma), b[:, None]], [b, normal.c]])
        return Fitted.of(products, self.at, self.linearisation.count)

    @cached_property
    def clusters(self) -> tuple[npt.NDArray[np.intp], int]:
        """Of every row, the cluster of poses that it is of, -1 for none, (rows,), and how many clusters there are."""
        data, cluster_of = self.model.data, np.full(self.rows, -1)
        first = first_rows(data.pose_of)
        clusters = clustered(data.q[first], data.configuration_of[first])
        for number, own in enumerate(clusters):
            cluster_of[own] = number
        return cluster_of, len(clusters)

    @property
    def lost(self) -> float:
        """What the noise's whitening adds to the log density of what was measured."""
        return self.estimate.noise.log_determinant(self.linearisation) / 2

    def laid_out(self, whitened: Vector) -> Vector:
        """Numbers of rows, (N,), over all readings of theirs, as whitened residuals have them: with the same sum of squares."""
        means = self.weights.means
        return whitened if means is None else means.spread(whitened.reshape(self.rows, -1, 1)).ravel()

    @cached_property
    def pulls(self) -> tuple[WeighedRobot, ...]:
        """The robot with its masses, and with every gravity that is asked about."""
        usual = map(Gravity, DOWN if self.anywhere else DOWN[:1])
        return tuple(WeighedRobot(self.robot, pull) for pull in ([self.gravity] if self.gravity is not None else usual))

    @cached_property
    def turns(self) -> tuple[Term, ...]:
        """Every joint turned, or slid, by one, about each axis."""
        return unit_terms(self.robot.chain)

    @cached_property
    def joints(self) -> dict[str, tuple[int, Vector]]:
        """Turning joints that were read: number of the turn about the own axis, and positions (rows,), 0 of what is known beforehand."""
        inputs = {joint.name: index for index, joint in enumerate(self.robot.chain.inputs)}
        found = {}
        for number, term in enumerate(self.turns):
            joint = self.robot.chain.moving[term.joint].joint
            if term.axis is None and joint.name in inputs and not joint.prismatic:
                q = np.zeros(self.rows)
                q[self.model.data.pose_of] = self.model.data.q[:, inputs[joint.name]]
                found[joint.name] = number, q
        return found
