"""Gravity's moments at the joints of a tree, for many poses at once: what stands still against a joint is one body with it.

Of every body that moves as one with a joint i, h_i is its mass times its centre in the joint's frame. With M the mass of all that a joint
carries, p and R the placement of joint j in the frame of joint i that carries it, and g gravity,

    h_i <- h_i + sum over j of (R_j h_j + M_j p_j),    g_j = R_j' g_i,    moment at i = h_i x g_i.

Pinocchio's recursive Newton-Euler algorithm at rest says the same of one pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from urdfcal.base.geometry import Array3, Matrix, Vector
from urdfcal.base.rotations import skew
from urdfcal.robot.configurations import WholeRobot


@dataclass
class _Moved:
    """One joint that moves, with what moves as one with it.

    Attributes:
        before: Number of the joint that carries it; -1 for none.
        R, p: Placement there where the joint stands at 0, (3, 3) and (3,).
        along: What it slides along, (3,); 0 of a turn.
        about: The axis a that it turns about, (3,); 0 of a slide.
        first: Mass times its centre, in the joint's frame, (3,), [kg m].
        mass: Of it and, in the end, all that it carries, [kg].
    """

    before: int
    R: Matrix
    p: Vector
    along: Vector
    about: Vector
    first: Vector
    mass: float

    def turned(self, vectors: Matrix, c: Vector, s: Vector) -> Matrix:
        """Vectors (3, n) turned about the axis, by Rodrigues' formula, from cosines and sines of the angles."""
        if not self.about.any():
            return vectors
        across, ahead = skew(self.about[None])[0] @ vectors, np.outer(self.about, self.about) @ vectors
        return np.asarray(ahead + c * (vectors - ahead) + s * across)


class StaticMoments:
    """Moments of a model's weight about some of its joints."""

    def __init__(self, model: Any, whole: WholeRobot, joints: Sequence[int]) -> None:
        """Put together what moves as one.

        Args:
            model: Pinocchio's, with inertias and gravity.
            whole: Its joints' positions from those that were measured.
            joints: Indices of the joints whose moments are wanted.
        """
        self.gravity, data, moves = np.array(model.gravity.linear), model.createData(), {*whole.joints, *joints}
        pin.forwardKinematics(model, data, whole.neutral)
        places, number, self.moved = {0: (-1, pin.SE3.Identity())}, dict[int, int](), list[_Moved]()
        for index in range(1, model.njoints):
            before, place = places[model.parents[index]]
            inertia, place = model.inertias[index], place * (model.jointPlacements[index] if index in moves else data.liMi[index])
            first = inertia.mass * np.array(inertia.lever)
            if index in moves:
                axis = np.array(model.joints[index].createData().S).ravel()
                self.moved.append(_Moved(before, place.rotation, place.translation, axis[:3], axis[3:], first, inertia.mass))
                before, place, number[index] = len(self.moved) - 1, pin.SE3.Identity(), len(self.moved) - 1
            elif before >= 0:
                self.moved[before].first = self.moved[before].first + place.rotation @ first + inertia.mass * place.translation
                self.moved[before].mass += inertia.mass
            places[index] = before, place
        for own in reversed(self.moved):
            if own.before >= 0:
                self.moved[own.before].mass += own.mass
        self.wanted, columns = [number[joint] for joint in joints], {joint: column for column, joint in enumerate(whole.joints)}
        self.gain, self.shift = np.zeros((len(self.moved), whole.gain.shape[0])), np.zeros((len(self.moved), 1))
        for joint, row in number.items():
            if joint in columns:
                self.gain[row], self.shift[row] = whole.gain[:, columns[joint]], whole.shift[columns[joint]]

    def at(self, q: Matrix) -> Array3:
        """Moments of gravity on what each joint carries, about its origin in its own frame, (n, joints, 3), [N m].

        Args:
            q: Positions of the measured joints, (n, inputs), [rad] or [m].
        """
        positions = self.gain @ q.T + self.shift
        c, s, pulls = np.cos(positions), np.sin(positions), list[Matrix]()
        for own, cosine, sine in zip(self.moved, c, s, strict=True):
            before = self.gravity[:, None] if own.before < 0 else pulls[own.before]
            pulls.append(own.turned(own.R.T @ before, cosine, -sine))
        firsts = [own.first[:, None] for own in self.moved]
        for number, own in reversed([*enumerate(self.moved)]):
            if own.before >= 0:
                away = own.turned(firsts[number], c[number], s[number]) + own.mass * np.outer(own.along, positions[number])
                firsts[own.before] = firsts[own.before] + own.R @ away + (own.mass * own.p)[:, None]
        moments = np.empty((len(self.wanted), 3, len(q)))
        for out, number in zip(moments, self.wanted, strict=True):
            (x, y, z), (u, v, w) = firsts[number], pulls[number]
            out[0], out[1], out[2] = y * w - z * v, z * u - x * w, x * v - y * u
        return moments.transpose(2, 0, 1)
