"""The joints on the way from the screen to the module, as one serial arm that stands on the screen, and the branches that leave it.

A joint that carries the screen is walked against its direction: its motion, its perturbation and its origin are inverted, in that
order. So a screen on the wall and a screen in the gripper are the same case to everything that follows.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Literal

import numpy as np
import pinocchio as pin

from urdfcal.base.errors import RigError
from urdfcal.base.geometry import SE3, Mask, Matrix, Vector, X, Y, Z
from urdfcal.robot.rig import Rig
from urdfcal.robot.urdf_tree import UrdfJoint, UrdfTree


@dataclass(frozen=True)
class Step:
    """One joint of the way; `forward` when walked from parent to child."""

    joint: UrdfJoint
    forward: bool


@dataclass(frozen=True)
class Bend:
    """An axis about which a moving joint gives way, in its own frame behind its motion.

    Attributes:
        joint: Index of the moving joint on the way.
        axis: Unit vector, across the joint's own axis.
    """

    joint: int
    axis: tuple[float, float, float]


@dataclass(frozen=True)
class ModelLayout:
    """Which joints of a chain's Pinocchio model are what; indices as Pinocchio counts, 0 being the screen.

    Attributes:
        first: Per moving joint, the one that carries its placement.
        motion: Per moving joint, the one that is its motion.
        last: Per moving joint, the one behind which its body follows.
        bends: Per bend, its joint.
    """

    first: list[int]
    motion: list[int]
    last: list[int]
    bends: list[int]


Role = Literal["reference", "target", "laser"]
_BUILT = 8  # error models that a chain knows


@dataclass(frozen=True)
class ChainFrame:
    """A frame that is rigidly joined to a body of the way: a laser, a target, or the frame that targets are seen in.

    Attributes:
        role: What it is to the measurements.
        name: Of the laser or target, or of the reference link.
        depth: The body that carries it: of the moving joints that lead there, the number of the last one; 0 for the base.
        steps: Joints from behind the last motion to its link; the first one may be the moving joint, walked against its direction.
        at: Where it is on what is placed on the link: a corner on its board, [m].
    """

    role: Role
    name: str
    depth: int
    steps: tuple[Step, ...]
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Shoot:
    """A moving joint that is not on the way: what further targets hang on.

    Attributes:
        body: The body that it leaves from, as a frame's `depth`.
        steps: Joints from behind the motion that leads to that body; the last one is the moving joint.
    """

    body: int
    steps: tuple[Step, ...]


@dataclass(frozen=True)
class Chain:
    """The way from screen to module and on to the lasers, and the branches on which further targets are.

    Attributes:
        steps: Every joint between screen and module, screen first.
        laser_joints: For each laser, the fixed joints from the module to it.
        inputs: The joints that a measurement states, in order of the way; mimic joints are replaced by their leaders.
        coupling: (inputs, moving): chain positions are `q @ coupling + offset`; -1 where a joint is walked backward.
        offset: (moving,), from mimic joints.
        frames: The frame that targets are seen in and the targets, if there are any; then the lasers.
        shoots: The moving joints of further branches, each behind those that lead to it.
    """

    steps: tuple[Step, ...]
    laser_joints: tuple[tuple[UrdfJoint, ...], ...]
    inputs: tuple[UrdfJoint, ...]
    coupling: Matrix
    offset: Vector
    frames: tuple[ChainFrame, ...] = ()
    shoots: tuple[Shoot, ...] = ()

    def __getstate__(self) -> dict[str, Any]:
        """For copies and files: without what was worked out."""
        return {own.name: self.__dict__[own.name] for own in fields(self)}

    @cached_property
    def built(self) -> deque[Any]:
        """The last error models that were built of it: fit after fit asks for the same (`model/gauge.py`)."""
        return deque(maxlen=_BUILT)

    @cached_property
    def moving(self) -> tuple[Step, ...]:
        """The steps that move: those of the way, screen first, then those of further branches, each behind what leads to it."""
        return (*self._trunk, *(shoot.steps[-1] for shoot in self.shoots))

    @cached_property
    def _trunk(self) -> tuple[Step, ...]:
        return tuple(step for step in self.steps if step.joint.moves)

    @cached_property
    def parents(self) -> tuple[int, ...]:
        """The body that each moving joint leaves from, (moving,)."""
        return (*range(len(self._trunk)), *(shoot.body for shoot in self.shoots))

    @cached_property
    def passed(self) -> Mask:
        """Which moving joints lead from the base to each body, (moving + 1, moving)."""
        passed = np.zeros((len(self.moving) + 1, len(self.moving)), dtype=bool)
        for joint, parent in enumerate(self.parents):
            passed[joint + 1] = passed[parent]
            passed[joint + 1, joint] = True
        return passed

    @cached_property
    def farthest(self) -> int:
        """Which of the frames most moving joints lead to."""
        return int(np.argmax([self.passed[frame.depth].sum() for frame in self.frames]))

    @cached_property
    def every_joint(self) -> dict[str, UrdfJoint]:
        """All joints between the two ends, and of further branches, by name."""
        return {step.joint.name: step.joint for step in (*self.steps, *(step for shoot in self.shoots for step in shoot.steps))}

    @property
    def measuring_frame(self) -> int:
        """Which of the frames targets are seen from, where nothing else is said."""
        return 0

    def seen_from(self, instrument: str) -> int:
        """Which of the frames an instrument's is; the first one's for the empty string."""
        return self.frame_index("reference", instrument) if instrument else self.measuring_frame

    @cached_property
    def instrument_frames(self) -> list[int]:
        """Which of the frames are instruments', in order."""
        return [index for index, frame in enumerate(self.frames) if frame.role == "reference"]

    def frame_index(self, role: Role, name: str) -> int:
        """Which of the frames one is."""
        return next(index for index, frame in enumerate(self.frames) if (frame.role, frame.name) == (role, name))

    @cached_property
    def laser_frames(self) -> list[int]:
        """Which of the frames are lasers, in order."""
        return [index for index, frame in enumerate(self.frames) if frame.role == "laser"]

    @property
    def laser_names(self) -> tuple[str, ...]:
        """The laser links, in order."""
        return tuple(self.frames[index].name for index in self.laser_frames)

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the joints that a measurement states."""
        return tuple(joint.name for joint in self.inputs)

    @cached_property
    def mount_joint(self) -> UrdfJoint | None:
        """The module's own fixed joint, where the way leads over it."""
        last = self.steps[-1]
        return last.joint if last.forward and not last.joint.moves else None

    @cached_property
    def screen_joint(self) -> Step | None:
        """The fixed joint nearest to the screen on the way to the first moving joint, if there is one."""
        return self.steps[0] if not self.steps[0].joint.moves else None

    @cached_property
    def T_last_module(self) -> SE3:
        """Placement of the module behind the last moving joint, as the URDF has it."""
        placement = pin.SE3.Identity()
        for step in self.steps:
            if step.forward:
                placement = placement * step.joint.origin
            if step.joint.moves:
                placement = pin.SE3.Identity()
            if not step.forward:
                placement = placement * step.joint.origin.inverse()
        return placement

    def laser_axes(self, laser: int) -> Matrix:
        """Axes of a laser in the module's, as the URDF has them, (3, 3); its beam is the third."""
        rotation = np.eye(3)
        for joint in self.laser_joints[laser]:
            rotation = rotation @ joint.origin.rotation
        return rotation

    def branches(self) -> list[list[UrdfJoint]]:
        """The moving joints of the way in their URDF direction: those that carry the screen, then those that carry the module."""
        backward = [step.joint for step in self._trunk if not step.forward][::-1]
        forward = [step.joint for step in self._trunk if step.forward]
        return [branch for branch in (backward, forward) if branch]

    def limbs(self) -> list[list[UrdfJoint]]:
        """Joints that lead to the end of each further branch, fixed ones included, in URDF direction from the first moving one on."""
        above, found, covered = {joint.child: joint for joint in self.every_joint.values()}, list[list[UrdfJoint]](), set[str]()
        for shoot in reversed(self.shoots):
            joint: UrdfJoint | None = shoot.steps[-1].joint
            if shoot.steps[-1].joint.name in covered:
                continue
            path = list[UrdfJoint]()
            while joint is not None:
                path.insert(0, joint)
                joint = above.get(joint.parent)
            path = path[next(index for index, own in enumerate(path) if own.moves) :]
            covered |= {own.name for own in path}
            found.append(path)
        return found

    def meetings(self, count: int) -> set[str]:
        """Names of the moving joints next to links where branches meet, so many of each branch."""
        branches = self.branches()
        near = {joint.name for branch in branches for joint in branch[:count]} if len(branches) == 2 else set()
        for body in (body for body in set(self.parents) if self.parents.count(body) > 1):
            leads = np.flatnonzero(self.passed[body])
            depth = self.passed.sum(axis=1) - len(leads)
            behind = [joint for joint in range(len(self.moving)) if depth[joint + 1] <= count and self._leaves(joint, body)]
            near |= {self.moving[joint].joint.name for joint in [*leads[-count:].tolist(), *behind]}
        return near

    def _leaves(self, joint: int, body: int) -> bool:
        """Whether a moving joint is behind a body."""
        return not self.passed[body, joint] and bool((self.passed[joint + 1] >= self.passed[body]).all())

    def new_model(self, bends: Sequence[Bend] = ()) -> tuple[Any, ModelLayout]:
        """A fresh Pinocchio model of the moving joints of the tree alone, with identity placements, standing on the screen.

        Args:
            bends: Axes about which joints give way; each becomes a joint of its own on the far side of its joint's motion.
        """
        model, bend = pin.Model(), [0] * len(bends)
        first, motion, last = list[int](), list[int](), list[int]()
        for index, step in enumerate(self.moving):
            own = [number for number, each in enumerate(bends) if each.joint == index]
            first.append(model.njoints)
            behind = last[self.parents[index] - 1] if self.parents[index] else 0
            for number in [None, *own] if step.forward else [*own[::-1], None]:
                if number is None:
                    motion.append(model.addJoint(behind, _joint_model(step.joint), pin.SE3.Identity(), step.joint.name))
                else:
                    axis = pin.JointModelRevoluteUnaligned(np.array(bends[number].axis))
                    bend[number] = model.addJoint(behind, axis, pin.SE3.Identity(), f"{step.joint.name}:{number}")
                behind = model.njoints - 1
            last.append(model.njoints - 1)
        return model, ModelLayout(first, motion, last, bend)


def build_chain(tree: UrdfTree, rig: Rig) -> Chain:
    """Lay out the way from the screen to the lasers.

    Raises:
        RigError: a joint on the way is of a kind that cannot be calibrated.
    """
    steps = _way(tree, rig)
    _require_calibrable(tree, steps, rig.base, rig.tip)
    growth = _Growth(tree, rig.base, steps)
    frames = tuple(_target_frames(rig, growth))
    moving = [*(step for step in steps if step.joint.moves), *(shoot.steps[-1] for shoot in growth.shoots)]
    leaders = [leader_of(tree, step.joint) for step in moving]
    inputs = {joint.name: joint for joint, _, _ in leaders}
    coupling, offset = np.zeros((len(inputs), len(moving))), np.zeros(len(moving))
    for column, (step, (joint, multiplier, shift)) in enumerate(zip(moving, leaders, strict=True)):
        sign = 1.0 if step.forward else -1.0
        coupling[list(inputs).index(joint.name), column] = sign * multiplier
        offset[column] = sign * shift
    lasers = tuple(tuple(_below(tree, rig.tip, laser)) for laser in rig.lasers)
    return Chain(steps, lasers, tuple(inputs.values()), coupling, offset, (*frames, *_laser_frames(steps, lasers)), tuple(growth.shoots))


def _require_calibrable(tree: UrdfTree, steps: Sequence[Step], start: str, end: str) -> None:
    """Refuse joints of a kind that cannot be calibrated.

    Raises:
        RigError: names the first one.
    """
    for step in steps:
        if step.joint.type in ("floating", "planar"):
            raise RigError(
                f"joint '{step.joint.name}' on the way from '{start}' to '{end}' is {step.joint.type}; "
                "expected revolute, continuous, prismatic or fixed joints",
                tree.label,
                step.joint.line,
            )


def _laser_frames(steps: Sequence[Step], lasers: Sequence[Sequence[UrdfJoint]]) -> Iterator[ChainFrame]:
    """Every laser behind the last motion, by way of the module."""
    moving = [index for index, step in enumerate(steps) if step.joint.moves]
    tail = steps[moving[-1] + steps[moving[-1]].forward :]
    for way in lasers:
        yield ChainFrame("laser", way[-1].child, len(moving), (*tail, *(Step(joint, forward=True) for joint in way)))


class _Growth:
    """The tree of bodies that ways from the base lead to, growing by a branch where a way leaves those before it.

    Attributes:
        tree: All links and joints.
        base: The link where every way begins.
        shoots: Moving joints beside those of the first way.
    """

    def __init__(self, tree: UrdfTree, base: str, steps: Sequence[Step]) -> None:
        self.tree, self.base = tree, base
        self.shoots: list[Shoot] = []
        self._bodies = {step.joint.name: body for body, step in enumerate((step for step in steps if step.joint.moves), start=1)}

    def reach(self, link: str) -> tuple[int, tuple[Step, ...]]:
        """The body that carries a link, and the joints from behind the motion that leads there to the link.

        Raises:
            RigError: a joint on the way is of a kind that cannot be calibrated.
        """
        steps = _between(self.tree, self.base, link)
        _require_calibrable(self.tree, steps, self.base, link)
        body, own = 0, list[Step]()
        for step in steps:
            own.append(step)
            if step.joint.moves:
                if step.joint.name not in self._bodies:
                    self.shoots.append(Shoot(body, tuple(own)))
                    self._bodies[step.joint.name] = len(self._bodies) + 1
                body, own = self._bodies[step.joint.name], [] if step.forward else [step]
        return body, tuple(own)


def _target_frames(rig: Rig, growth: _Growth) -> Iterator[ChainFrame]:
    """The measuring frame and the targets, each on the body that carries it."""
    instruments, origin = rig.instruments, (0.0, 0.0, 0.0)
    named: list[tuple[Role, str, str, tuple[float, float, float]]] = [
        ("reference", own.name, own.link, origin) for own in instruments.every
    ]
    named += [("target", target.name, target.link, target.at) for target in instruments.targets]
    for role, name, link, at in named if instruments.targets else ():
        body, steps = growth.reach(link)
        yield ChainFrame(role, name, body, steps, at)


def _way(tree: UrdfTree, rig: Rig) -> tuple[Step, ...]:
    return _between(tree, rig.base, rig.tip)


def _between(tree: UrdfTree, start: str, end: str) -> tuple[Step, ...]:
    up, down = tree.path_from_root(start), tree.path_from_root(end)
    shared = 0
    while shared < min(len(up), len(down)) and up[shared] is down[shared]:
        shared += 1
    return tuple([Step(joint, forward=False) for joint in up[shared:][::-1]] + [Step(joint, forward=True) for joint in down[shared:]])


def _below(tree: UrdfTree, ancestor: str, link: str) -> list[UrdfJoint]:
    path = tree.path_from_root(link)
    return path[len(tree.path_from_root(ancestor)) :]


def leader_of(tree: UrdfTree, joint: UrdfJoint) -> tuple[UrdfJoint, float, float]:
    """The joint that drives this one, with the factor and the shift of its position."""
    multiplier, shift = 1.0, 0.0
    while joint.mimic is not None:
        shift += multiplier * joint.mimic.offset
        multiplier *= joint.mimic.multiplier
        joint = tree.joints[joint.mimic.joint]
    return joint, multiplier, shift


def _joint_model(joint: UrdfJoint) -> Any:
    axis = np.array(joint.axis)
    kind = "P" if joint.prismatic else "R"
    for letter, direction in zip("XYZ", (X, Y, Z), strict=True):
        if np.array_equal(axis, direction):
            return getattr(pin, f"JointModel{kind}{letter}")()
    return pin.JointModelPrismaticUnaligned(axis) if joint.prismatic else pin.JointModelRevoluteUnaligned(axis)
