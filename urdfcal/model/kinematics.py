"""Forward kinematics of a chain for many poses at once: products of stacked matrices, an axis at a time.

Every motion is an *element*: a turn about z, or a slide along it, in axes of its own that have z along the joint's axis. What stands
between two elements is constant, so that a step of the way is one product with a constant for all poses, and a turn of two columns,

    [x y] <- [x y] [c -s; s c],        or of a slide        p <- p + q z.

Numbers of one component lie together over the poses. Pinocchio's forward kinematics of the same chain is the witness in the tests.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from urdfcal.base.errors import ShapeMismatch
from urdfcal.base.geometry import Array3, Array4, Mask, Matrix, Vector
from urdfcal.base.rotations import skew
from urdfcal.model.softness import Yielding, across
from urdfcal.model.walk import Placements
from urdfcal.robot.chain import Bend, Chain

_UNIT = np.eye(4)


@dataclass(frozen=True)
class Element:
    """One motion of the way.

    Attributes:
        joint: Index of the moving joint whose it is.
        axes: Of its own, as columns behind the element before it, (3, 3); the motion is about the third, or along it.
        slides: Whether it is along it.
        bend: Index of the bend that it is; -1 for the joint's own motion.
    """

    joint: int
    axes: Matrix
    slides: bool
    bend: int


class ArmKinematics:
    """The motions of a chain, and of joints that give way.

    Attributes:
        chain: The way.
        bends: Axes about which joints give way; each is an element of its own on the far side of its joint's motion.
        elements: Every motion, in order of the way.
        own: Of each moving joint, the element that is its own motion, (moving,).
        last: Of each body, the element behind which it follows; -1 for the screen, (moving + 1,).
        firsts: Of each moving joint the element that carries its placement, (moving,).
        before: Of each element the one that it follows; -1 for the screen, (elements,).
    """

    def __init__(self, chain: Chain, bends: Sequence[Bend] = ()) -> None:
        self.chain, self.bends = chain, tuple(bends)
        self.elements = tuple(self._elements())
        self.own = np.array([number for number, element in enumerate(self.elements) if element.bend < 0], dtype=np.intp)
        joints = [element.joint for element in self.elements]
        self.last = [-1, *(number for number, joint in enumerate(joints) if number + 1 == len(joints) or joints[number + 1] != joint)]
        self.firsts = [number + 1 for number in self.last[:-1]]
        self.before = [number - 1 for number in range(len(joints))]
        for first, parent in zip(self.firsts, chain.parents, strict=True):
            self.before[first] = self.last[parent]

    def _elements(self) -> Iterator[Element]:
        for joint, step in enumerate(self.chain.moving):
            own = [number for number, bend in enumerate(self.bends) if bend.joint == joint]
            for number in [-1, *own] if step.forward else [*own[::-1], -1]:
                axis = np.array(step.joint.axis if number < 0 else self.bends[number].axis)
                yield Element(joint, _axes_about(axis), number < 0 and step.joint.prismatic, number)

    @cached_property
    def forks(self) -> frozenset[int]:
        """Elements, or the screen as -1, behind which further branches leave."""
        return frozenset(before for number, before in enumerate(self.before) if before != number - 1)

    @cached_property
    def signs(self) -> Vector:
        """1 where a moving joint is walked from parent to child, else -1, (moving,)."""
        return np.array([1.0 if step.forward else -1.0 for step in self.chain.moving])

    @cached_property
    def backward(self) -> frozenset[int]:
        """The first elements of moving joints that are walked from child to parent: what bends them comes before their motion."""
        return frozenset(first for first, sign in zip(self.firsts, self.signs.tolist(), strict=True) if sign < 0)

    @cached_property
    def ways_across(self) -> Array3:
        """The two axes across each moving joint, in the axes of the element behind which it bends, with its sign, (moving, 2, 3)."""
        ends = [first if first in self.backward else last for first, last in zip(self.firsts, self.last[1:], strict=True)]
        ways = [np.array(across(np.array(step.joint.axis))) for step in self.chain.moving]
        return np.array([sign * way @ self.elements[end].axes for sign, way, end in zip(self.signs.tolist(), ways, ends, strict=True)])

    @cached_property
    def turned(self) -> Array3:
        """The axes of the element that each body follows, as rotations that undo them, (moving + 1, 3, 3)."""
        return np.array([np.eye(3) if number < 0 else self.elements[number].axes.T for number in self.last])

    @cached_property
    def undone(self) -> Array3:
        """The same of the body that carries each of the chain's frames, as placements, (frames, 4, 4)."""
        undone = np.tile(_UNIT, (len(self.chain.frames), 1, 1))
        undone[:, :3, :3] = self.turned[[frame.depth for frame in self.chain.frames]]
        return undone

    @cached_property
    def axes(self) -> tuple[Array3, Array3]:
        """The axes of the element before each, undone, and of each itself, as placements, (elements, 4, 4) both."""
        axes = np.tile(_UNIT, (len(self.elements) + 1, 1, 1))  # of the screen, -1, they are the last
        axes[:-1, :3, :3] = [element.axes for element in self.elements]
        return axes.transpose(0, 2, 1)[self.before], axes[:-1]

    @cached_property
    def still(self) -> Array3:
        """Placement of each element behind the one before it, where they are of one joint, (elements, 4, 4)."""
        return np.tile(_UNIT, (len(self.elements), 1, 1))

    def chain_positions(self, q: Matrix) -> Matrix:
        """Positions of the moving joints from those that were measured: mimic joints, and joints that carry the screen.

        Raises:
            ShapeMismatch: q has not one column a measured joint.
        """
        q = np.asarray(q, dtype=float)
        if q.ndim != 2 or q.shape[1] != len(self.chain.inputs):
            raise ShapeMismatch(f"expected joint positions of shape (poses, {len(self.chain.inputs)}), found {q.shape}")
        return q @ self.chain.coupling + self.chain.offset

    def posture(self, positions: Matrix, yielding: Yielding | None = None) -> Posture:
        """Every element's motion at chain positions (n, moving), in which joints give way."""
        every = np.zeros((len(self.elements), len(positions)))
        every[self.own] = positions.T
        for angle, joint, bend in zip((yielding.basis * yielding.x).T, yielding.joints, yielding.bends, strict=True) if yielding else ():
            every[self.element_of(joint, bend)] += self.signs[joint] * angle
        return Posture(every)

    def element_of(self, joint: int, bend: int) -> int:
        """The element that is a bend or, where that is -1, a joint's own motion."""
        return int(self.own[joint]) if bend < 0 else self._of_bend[bend]

    @cached_property
    def _of_bend(self) -> dict[int, int]:
        return {element.bend: number for number, element in enumerate(self.elements)}


class Posture:
    """Positions of all elements at some poses.

    Attributes:
        q: (elements, n), [rad] and [m].
    """

    def __init__(self, q: Matrix) -> None:
        self.q = q
        self._known: tuple[PlacedArm, Array4] | None = None

    @cached_property
    def _moved(self) -> Mask:
        """Which elements are not at zero, as bends are where nothing gives way, (elements, 1)."""
        return np.asarray(self.q.any(axis=1, keepdims=True))

    @cached_property
    def c(self) -> Matrix:
        """Their cosines, (elements, n)."""
        return np.cos(self.q, out=np.ones_like(self.q), where=self._moved)

    @cached_property
    def s(self) -> Array4:
        """Their sines, and these with the other sign, (elements, 2, 1, n)."""
        s = np.sin(self.q, out=np.zeros_like(self.q), where=self._moved)
        return np.stack([s, -s], axis=1)[:, :, None]

    def __len__(self) -> int:
        return int(self.q.shape[1])

    def frames(self, placed: PlacedArm) -> Array4:
        """Columns x, y, z, p of the base, then behind each element, in the base, (elements + 1, 4, 3, n).

        Where the parameters do not move the joints, sweep after sweep asks the same: that is known.
        """
        if not placed.rigid:
            return placed.frames(self)
        if self._known is None or not np.array_equal(self._known[0].steps, placed.steps):
            self._known = placed, placed.frames(self)
        return self._known[1]


class PlacedArm:
    """An arm with its constants at one value of the parameters.

    Attributes:
        arm: Its motions.
        placed: Its constants.
        steps: From each element to the next one, (elements, 4, 4).
        rigid: Whether they are these whatever the parameters are.
    """

    def __init__(self, arm: ArmKinematics, placed: Placements) -> None:
        self.arm, self.placed, self.rigid = arm, placed, placed.walk.rigid
        self.steps = arm.still.copy()
        self.steps[arm.firsts] = placed.joints
        before, axes = arm.axes
        self.steps = before @ self.steps @ axes

    @cached_property
    def locals(self) -> Array3:
        """Placement of each of the chain's frames behind the element that its body follows, (frames, 4, 4)."""
        return np.asarray(self.arm.undone @ self.placed.frames)

    @cached_property
    def _of_base(self) -> dict[int, tuple[Matrix, Vector, Matrix]]:
        """By frame that stands in the base: R', p, and Ad(T^-1), what brings twists at the base's origin to its own."""
        found = {}
        for index, (frame, local) in enumerate(zip(self.arm.chain.frames, self.locals, strict=True)):
            if frame.depth == 0:
                found[index] = local[:3, :3].T, local[:3, 3], inverse_actions(local[None, :3])[0]
        return found

    def standing(self, frame: int) -> tuple[Matrix, Vector, Matrix] | None:
        """R', p and Ad(T^-1) of one of the chain's frames if it stands in the base; None if it moves."""
        return self._of_base.get(frame)

    @cached_property
    def actions(self) -> Array3:
        """Ad(T)' of every step: what brings derivatives by twists in pairs from one element to the next, (elements, 6, 6)."""
        halves = inverse_actions(self.steps[:, :3]).reshape(-1, 2, 3, 2, 3)  # Ad(T)' is Ad(T^-1) with v and w in each other's place
        return np.ascontiguousarray(halves[:, ::-1, :, ::-1].transpose(0, 2, 1, 4, 3)).reshape(-1, 6, 6)

    @cached_property
    def screws(self) -> Matrix:
        """Screws of the parameters in the axes of the element that their body follows, (6, p)."""
        return np.asarray(self._screws.transpose(2, 1, 0).reshape(6, -1))

    @cached_property
    def screws_in_pairs(self) -> Matrix:
        """The same with rows v_x, w_x, v_y, w_y, v_z, w_z, (6, p)."""
        return np.asarray(self._screws.transpose(1, 2, 0).reshape(6, -1))

    @cached_property
    def _screws(self) -> Array3:
        """The same, (p, 3, 2)."""
        return np.asarray(self.arm.turned[self.placed.anchors] @ self.placed.screws.reshape(2, 3, -1).transpose(2, 1, 0))

    def frames(self, posture: Posture) -> Array4:
        """Columns x, y, z, p of the base, then behind each element, in the base, (elements + 1, 4, 3, n)."""
        n = posture.q.shape[1]
        frames = np.empty((len(self.steps) + 1, 4, 3 * n))
        frames[0].reshape(4, 3, n)[:] = _UNIT[:, :3, None]
        for number, (element, step) in enumerate(zip(self.arm.elements, self.steps, strict=True)):
            np.matmul(step.T, frames[self.arm.before[number] + 1], out=frames[number + 1])
            columns = frames[number + 1].reshape(4, 3, n)
            if element.slides:
                columns[3] += posture.q[number] * columns[2]
            else:
                turn(columns[:2], posture.c[number], posture.s[number])
        return frames.reshape(len(frames), 4, 3, n)


def turn(pair: Array3, c: Vector, s: Array3) -> None:
    """[a, b] <- [c a + s b, c b - s a] of a pair (2, ...) of components."""
    other = pair[::-1] * s
    pair *= c
    pair += other


def inverse_actions(frames: Array3) -> Array3:
    """Ad(T^-1) of frames [R | p] (n, 3, 4): what brings twists at the base's origin to theirs, (n, 6, 6)."""
    back = frames[:, :, :3].transpose(0, 2, 1)
    action = np.zeros((len(frames), 6, 6))
    action[:, :3, :3] = action[:, 3:, 3:] = back
    action[:, :3, 3:] = -back @ skew(frames[:, :, 3])
    return action


def _axes_about(axis: Vector) -> Matrix:
    """Right-handed axes with z along a unit vector, as columns, (3, 3); the identity where it is z itself."""
    if axis[2] == 1.0:
        return np.eye(3)
    return np.column_stack([*across(axis), axis])
