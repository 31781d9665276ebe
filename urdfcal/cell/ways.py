"""Straight ways between joint positions: how far a robot can go on them, looked at so closely that nothing is passed by.

Two shapes that are d apart cannot touch before they have moved d towards each other (conservative advancement, Mirtich, 1996). On the way
from a to b joint i turns at the rate |b_i - a_i| per share of the way. Let n lead from a point of one shape to the nearest of the other:
what joint i adds to the speed at which these come nearer is n (w_i x p), the same for both points, since p differs between them along n.
So it is no more than the rate times the lesser of the two shapes' reaches, the farthest that any of their points ever is from the joint:

    speed <= sum_i |b_i - a_i| min(reach_i(one), reach_i(other)),     i over the joints that move one against the other.

Every pair is looked at again once it could have moved as far as it was apart; pairs that almost touch, each STEP that they could have.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from urdfcal.base.geometry import MM, Matrix, Vector
from urdfcal.cell.collisions import Cell
from urdfcal.robot.configurations import WholeRobot, joint_limits

STEP = 1 * MM  # that two shapes may move against each other between two looks, at most, when they are not as far apart
_ROUNDING = 1e-6  # [m] of distances
_TOGETHER = 5.0  # steps of the fastest pair within which pairs are looked at together


class Ways:
    """Straight ways of a robot in its cell."""

    def __init__(self, cell: Cell) -> None:
        """Prepare for a cell; positions must be within the joint limits."""
        self.cell, self.model = cell, cell.robot.model
        self._whole = WholeRobot(cell.robot, cell.robot.chain.input_names)
        self._margins = np.array(cell.margins)
        self._data, self._hulls, self._exact = self.model.createData(), cell.model.createData(), cell.exact.createData()

    def free_until(self, a: Vector, b: Vector) -> float:
        """Up to which share of the straight way from one position (inputs,) to another nothing touches; 1 where all of it is free.

        A share below 0 says that not even the first position is free.
        """
        one, other = self._whole.configurations(np.stack([a, b]))
        speeds = self.reaches @ np.abs(self._rates(one, other))
        wait = STEP / np.maximum(speeds, STEP)
        due, slack, last, t = np.zeros(len(speeds)), _TOGETHER * float(wait.min(initial=1.0)), -1.0, 0.0
        while True:
            rows = np.flatnonzero(due <= t + slack)
            apart = self._apart(a + t * (b - a), rows)
            if (apart < -_ROUNDING).any():
                return last
            if t >= 1:
                return 1.0
            due[rows] = t + np.maximum(apart / np.maximum(speeds[rows], STEP), wait[rows])
            last, t = t, min(float(due.min(initial=1.0)), 1.0)

    def _rates(self, one: Vector, other: Vector) -> Vector:
        """How far each joint of the model goes, (nv,), [rad] or [m]."""
        return np.asarray(pin.difference(self.model, one, other))

    def _apart(self, q: Vector, pairs: Any) -> Vector:
        """By how much some pairs are farther apart than they must be, [m]: of hulls, and where these touch of what is in them."""
        configuration = self._whole.configurations(q[None])[0]
        pin.updateGeometryPlacements(self.model, self._data, self.cell.model, self._hulls, configuration)
        numbers, margins = pairs.tolist(), self._margins[pairs]
        found = np.array([pin.computeDistance(self.cell.model, self._hulls, number).min_distance for number in numbers]) - margins
        near = np.flatnonzero(found < 0).tolist()
        if near:
            pin.updateGeometryPlacements(self.model, self._data, self.cell.exact, self._exact)
            exact = [pin.computeDistance(self.cell.exact, self._exact, numbers[place]).min_distance for place in near]
            found[near] = exact - margins[near]
        return np.asarray(found)

    @cached_property
    def reaches(self) -> Matrix:
        """How fast each joint at 1 rad/s, or 1 m/s, can bring each pair nearer, (pairs, nv), [m/rad] or 1; 0 where it cannot."""
        shapes, pairs = self.cell.model.geometryObjects, self.cell.model.collisionPairs
        far = self._farthest(shapes)
        single = {index: joint.idx_v for index, joint in enumerate(self.model.joints) if joint.nv == 1}
        moves = np.zeros(far.shape, dtype=bool)
        for row, shape in enumerate(shapes):
            moves[row, [single[joint] for joint in self._above(shape.parentJoint) if joint in single]] = True
        first, second = [pair.first for pair in pairs], [pair.second for pair in pairs]
        return np.where(moves[first] != moves[second], np.minimum(far[first], far[second]), 0.0).reshape(len(pairs), self.model.nv)

    def _farthest(self, shapes: Any) -> Matrix:
        """How far from each joint any point of each shape can be, (shapes, nv); 1 for joints that slide."""
        far = np.ones((len(shapes), self.model.nv))
        lengths = self._lengths
        for row, shape in enumerate(shapes):
            shape.geometry.computeLocalAABB()
            with np.errstate(over="ignore", invalid="ignore"):  # a plane has no end
                own = float(np.linalg.norm(shape.placement.act(shape.geometry.aabb_center)) + shape.geometry.aabb_radius)
            for joint in range(1, self.model.njoints):
                if not _slides(self.model.joints[joint]) and self.model.joints[joint].nv == 1:
                    far[row, self.model.joints[joint].idx_v] = own + self._between(joint, shape.parentJoint, lengths)
        return np.where(np.isfinite(far), far, np.inf)

    def _between(self, one: int, other: int, lengths: Vector) -> float:
        """How far two joints' origins can be apart: along the links between them."""
        return float(sum(lengths[joint] for joint in set(self._above(one)) ^ set(self._above(other))))

    def _above(self, joint: int) -> list[int]:
        """A joint and those that move it."""
        return [index for index in self.model.supports[joint] if index > 0]

    @cached_property
    def _lengths(self) -> Vector:
        """How far every joint's origin can be from its parent's, (njoints,), [m]."""
        at_limits = np.abs(self._whole.configurations(joint_limits(self.cell.robot))).max(axis=0)
        lengths = np.array([np.linalg.norm(placement.translation) for placement in self.model.jointPlacements])
        slide = [at_limits[joint.idx_q] if _slides(joint) else 0.0 for joint in self.model.joints]
        return np.asarray(lengths + slide)


def _slides(joint: Any) -> bool:
    """Whether a joint of Pinocchio's slides along one axis, whichever: JointModelPX, JointModelPrismaticUnaligned."""
    return joint.nv == 1 and str(joint.shortname()).startswith("JointModelP")
