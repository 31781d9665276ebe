"""Which placements may be wrong, and how: parameters with names, units and priors, laid over the way from screen to lasers.

A *slot* is one placement that may be wrong: it holds the product of exponentials of its screws, inserted right behind a joint's
origin (or, where the URDF has no joint of its own for it, right before one). The parameters are the slots' coordinates.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from urdfcal.base.errors import ShapeMismatch
from urdfcal.base.geometry import SE3, Mask, Matrix, Vector, exponentials, product
from urdfcal.estimation.prior import Prior
from urdfcal.model.earlier import EarlierJoints
from urdfcal.model.gravity import WeighedRobot
from urdfcal.model.kinematics import ArmKinematics
from urdfcal.model.parameters import SESSION_KINDS, Kind, Parameter, PriorScale
from urdfcal.model.rig_terms import Course, Rig, RigTerm
from urdfcal.model.slots import Slot
from urdfcal.model.softness import Softness, Term, Yielding
from urdfcal.model.walk import Placements, Stretch, Walk
from urdfcal.robot.chain import Chain, Step


@dataclass(frozen=True)
class ErrorModel:
    """Parameters of a robot's geometric errors.

    Attributes:
        chain: The way from the screen to the lasers.
        slots: Placements that may be wrong, in order of the way; beams last.
        parameters: What is estimated, in the order of the state x.
        held: Slot parameters that are not estimated and differ from nothing: name -> value.
        carried: Parameters that the gauge rule leaves out: name -> what carries them.
        sessions: Session labels; the first one's screen is the URDF's.
        planes: Of each touched plane a nominal normal and two tangents, as columns (3, 3), in the measuring frame.
        soft: How joints give way with the pose, if they do: the parameters of kind `soft`.
        earlier: What an earlier calibration decided of some of the joints, and of others that follow them.
        rig: What the rig does beside standing still, if it does: the parameters of kind `rig`.
        known: Names of what the user says is known, which is more than that it is not estimated.
        held_sum: Weights of a sum of parameters that is held at zero: the arm's scale, where nothing tells it.
    """

    chain: Chain
    slots: tuple[Slot, ...]
    parameters: tuple[Parameter, ...]
    held: Mapping[str, float] = field(default_factory=dict)
    carried: Mapping[str, str] = field(default_factory=dict)
    sessions: tuple[str, ...] = ("",)
    planes: Mapping[str, Matrix] = field(default_factory=dict)
    held_sum: Mapping[str, float] = field(default_factory=dict)
    soft: Softness | None = None
    rig: Rig | None = None
    earlier: EarlierJoints | None = None
    known: frozenset[str] = frozenset()

    def __getstate__(self) -> dict[str, Any]:
        """For copies and files: without what is worked out when it is asked for."""
        return {own.name: self.__dict__[own.name] for own in fields(self)}

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of x."""
        return tuple(parameter.name for parameter in self.parameters)

    @cached_property
    def column(self) -> Mapping[str, int]:
        """Where each parameter stands in x, by name."""
        return {name: index for index, name in enumerate(self.names)}

    def value(self, name: str, x: Vector) -> float:
        """What a slot's parameter is at x, whether it is estimated or held; 0 if neither."""
        return float(x[self.column[name]] if name in self.column else self.held.get(name, 0.0))

    @cached_property
    def units(self) -> tuple[str, ...]:
        """Unit of each parameter: m or rad."""
        return tuple(parameter.unit for parameter in self.parameters)

    @cached_property
    def sigma(self) -> Vector:
        """Prior standard deviations, (p,), [m] and [rad]."""
        return np.array([parameter.sigma for parameter in self.parameters])

    @cached_property
    def mean(self) -> Vector:
        """Prior means, (p,), [m] and [rad]."""
        return np.array([parameter.mean for parameter in self.parameters])

    def prior(self, keep: Collection[str] = ()) -> Prior:
        """What is known before the data; parameters to keep are in no group whose scale the data may choose."""
        keep = {*keep, *(self.earlier.names if self.earlier is not None else ())}
        groups = tuple("" if parameter.name in keep else parameter.scale_group for parameter in self.parameters)
        return Prior(self.names, self.mean, self.sigma, groups)

    def with_prior(self, prior: Prior) -> ErrorModel:
        """The same with other standard deviations."""
        named = zip(self.parameters, prior.sigma.tolist(), strict=True)
        other = replace(self, parameters=tuple(replace(parameter, sigma=sigma) for parameter, sigma in named))
        other.__dict__.update({name: self.__dict__[name] for name in ("_walks", "_columns", "column", "arm") if name in self.__dict__})
        return other

    def check(self, x: Vector) -> Vector:
        """X as an array of floats, if it fits.

        Raises:
            ShapeMismatch: x has not one number a parameter.
        """
        x = np.asarray(x, dtype=float)
        if x.shape != (len(self.parameters),):
            raise ShapeMismatch(f"the error model has {len(self.parameters)} parameters, x has shape {x.shape}")
        return x

    def slot_values(self, x: Vector, session: str = "") -> list[Vector]:
        """The coordinates of every slot, [m] and [rad], in one session."""
        state = self.check(x)
        values = []
        for columns, held in self._columns[session]:
            value = held.copy()
            value[columns >= 0] = state[columns[columns >= 0]]
            values.append(value)
        return values

    def placements(self, x: Vector, session: str = "") -> Placements:
        """The constants of the way from screen to lasers with every slot at x."""
        return self._walks[session].at(self.check(x))

    @cached_property
    def arm(self) -> ArmKinematics:
        """Kinematics of the chain, with the bends of joints that give way."""
        return ArmKinematics(self.chain, self.soft.bends if self.soft is not None else ())

    def moves(self, session: str = "") -> Mask:
        """Which parameters move each of the chain's frames against the screen in one session, (frames, p): of those on its way all."""
        return self._walks[session].moves

    @cached_property
    def _walks(self) -> Mapping[str, Walk]:
        return {session: self._walk(session) for session in self.sessions}

    def _walk(self, session: str) -> Walk:
        """What the ways to the last motion, and on to each frame, are in one session."""
        moving, frames = [Stretch(0)], [Stretch(frame.depth) for frame in self.chain.frames]
        for station in self._way:
            if station.moves:
                moving.append(Stretch(len(moving)))
            else:
                self._pass(station, moving[-1], session)
        del moving[-1]  # what lies behind the last motion leads to frames
        for shoot, way in zip(self.chain.shoots, self._shoot_ways, strict=True):
            moving.append(Stretch(shoot.body))
            for station in way:
                self._pass(station, moving[-1], session)
        for stretch, way in zip(frames, self._frame_ways, strict=True):
            for station in way:
                self._pass(station, stretch, session)
        stretches = [*moving, *frames]
        anchors, moves = np.zeros(len(self.parameters), dtype=np.intp), np.zeros((len(frames), len(self.parameters)), dtype=bool)
        for stretch in stretches:
            anchors[stretch.columns] = stretch.anchor
        leads = [(column, joint) for joint, stretch in enumerate(moving) for column in stretch.columns]
        for column, joint in self._soft_columns:  # what they do is no constant: it comes with the poses
            anchors[column] = joint
            leads.append((column, joint))
        passed = self.chain.passed[[frame.depth for frame in self.chain.frames]]
        for column, joint in leads:
            moves[:, column] |= passed[:, joint]
        for row, stretch in enumerate(frames):
            moves[row, stretch.columns] = True
        return Walk(stretches, len(moving), anchors, moves)

    def _pass(self, station: _Station, stretch: Stretch, session: str) -> None:
        """Lengthen a stretch by what is passed."""
        if station.constant is not None:
            stretch.pass_constant(station.constant)
            return
        slot, (columns, held) = self.slots[station.slot], self._columns[session][station.slot]
        if session in slot.found:
            stretch.pass_constant(slot.found[session])  # a frame that was found is never walked backward
        own = [*zip(slot.motions, columns.tolist(), held.tolist(), strict=True)]
        if station.inverted:  # (E_1 ... E_k)^-1 = E_k^-1 ... E_1^-1
            own = [(-screw, column, value) for screw, column, value in reversed(own)]
        for screw, column, value in own:
            if column >= 0:
                stretch.pass_factor(screw, column)
            elif value:
                stretch.pass_constant(pin.exp6(screw * value))

    @cached_property
    def _columns(self) -> dict[str, list[tuple[Any, Vector]]]:
        """Per session and slot: the column of x of each coordinate (-1: held), and the values that are held."""
        plans = {}
        for session in self.sessions:
            names = iter(self._slot_names(session))
            own = [[next(names) for _ in slot.names] for slot in self.slots]
            plans[session] = [
                (np.array([self.column.get(name, -1) for name in slot], dtype=int), np.array([self.held.get(name, 0.0) for name in slot]))
                for slot in own
            ]
        return plans

    @cached_property
    def _way(self) -> list[_Station]:
        """From the screen to behind the last motion."""
        stations = [station for step in self.chain.steps for station in self._stations(step, moving=True)]
        last = max(number for number, station in enumerate(stations) if station.moves)
        return stations[: last + 1]

    def yielding(self, x: Vector, basis: Matrix) -> Yielding | None:
        """How the joints give way at x, for the basis of every soft term at some poses (n, terms); None if nothing does."""
        if self.soft is None:
            return None
        order, still = self._soft_order
        return replace(still, basis=basis[:, order], x=np.append(x[still.columns], still.x))

    @cached_property
    def _soft_order(self) -> tuple[list[int], Yielding]:
        """Numbers of the soft terms that are estimated, and of those that are held at something; how they yield at no pose."""
        assert self.soft is not None
        terms, bends, column = self.soft.terms, self.soft.bend_of, self.column
        free = [number for number, term in enumerate(terms) if term.name in column]
        held = [number for number, term in enumerate(terms) if term.name not in column and self.held.get(term.name)]
        return [*free, *held], Yielding(
            columns=np.array([column[terms[number].name] for number in free], dtype=np.intp),
            joints=tuple(terms[number].joint for number in [*free, *held]),
            bends=tuple(bends[number] for number in [*free, *held]),
            basis=np.empty((0, len(free) + len(held))),
            x=np.array([self.held[terms[number].name] for number in held]),
        )

    def yielding_at(self, x: Vector, q: Matrix) -> Yielding | None:
        """The same for joint positions (n, inputs) with no payload of their own and no direction of the last move."""
        return self.yielding(x, self.soft.basis(q)) if self.soft is not None else None

    @cached_property
    def _soft_columns(self) -> list[tuple[int, int]]:
        """Column of x and moving joint of every soft parameter."""
        terms = self.soft.terms if self.soft is not None else ()
        return [(self.column[term.name], term.joint) for term in terms if term.name in self.column]

    @cached_property
    def _shoot_ways(self) -> list[list[_Station]]:
        """From behind the motion that leads to its body to before the motion of each joint of further branches."""
        ways = []
        for shoot in self.chain.shoots:
            *steps, last = shoot.steps
            steps += [last] if last.forward else []
            ways.append([station for step in steps for station in self._stations(step, moving=False)])
        return ways

    @cached_property
    def _frame_ways(self) -> list[list[_Station]]:
        """From behind the motion that carries it to each of the chain's frames."""
        ways = []
        for index, frame in enumerate(self.chain.frames):
            way = [station for step in frame.steps for station in self._stations(step, moving=False)]
            way += [_Station(slot=number) for number, slot in enumerate(self.slots) if index in (slot.frame, *slot.also)]
            ways.append(way + ([_Station(constant=pin.SE3(np.eye(3), np.array(frame.at)))] if any(frame.at) else []))
        return ways

    def _stations(self, step: Step, *, moving: bool) -> list[_Station]:
        """What is passed at one joint: its origin with the slots on both sides and, on request, its motion; backward all inverted."""
        before, behind = self._slots_at(step.joint.name, True), self._slots_at(step.joint.name, False)
        motion = [_Station()] if moving and step.joint.moves else []
        if step.forward:
            return [*before, _Station(constant=step.joint.origin), *behind, *motion]
        return [*motion, *_inverse(behind), _Station(constant=step.joint.origin.inverse()), *_inverse(before)]

    def _slots_at(self, joint: str, before: bool) -> list[_Station]:
        return [
            _Station(slot=index)
            for index, slot in enumerate(self.slots)
            if joint in slot.joints and slot.before == before and slot.names and slot.frame is None
        ]

    def corrected_origins(self, x: Vector) -> dict[str, SE3]:
        """The URDF origins with the errors of x in them (`origin * delta`), by joint name; untouched joints are left out.

        Raises:
            ShapeMismatch: x has not one number a parameter.
        """
        deltas = [
            product(exponentials(slot.screws, values))
            for slot, values in zip(self.slots, self.slot_values(x, self.sessions[0]), strict=True)
        ]
        joints = dict(self.chain.every_joint)
        joints |= {joint.name: joint for way in self.chain.laser_joints for joint in way}
        touched = {joint for slot in self.slots if self._has_estimated(slot) for joint in slot.joints}
        origins: dict[str, SE3] = {}
        for slot, delta in zip(self.slots, deltas, strict=True):
            for joint in (joint for joint in slot.joints if joint in touched):
                origin = origins.get(joint, joints[joint].origin)
                origins[joint] = delta * origin if slot.before else origin * delta
        return origins | self._following(x)

    def frame_placement(self, number: int, x: Vector, session: str = "") -> tuple[SE3, Matrix]:
        """Placement of an instrument's or target's frame on its link, and its twist [v, w] in its own axes per unit of every parameter.

        Args:
            number: Which of the slots it is.
            x: Parameters, (p,), [m] and [rad].
            session: Of an instrument that was moved.

        Returns:
            T_link_frame, and its right Jacobian, (6, p).

        Raises:
            ShapeMismatch: x has not one number a parameter.
        """
        slot, (columns, _) = self.slots[number], self._columns[session][number]
        factors = exponentials(slot.screws, self.slot_values(x, session)[number])
        behind, jacobian = pin.SE3.Identity(), np.zeros((6, len(self.names)))
        for screw, factor, column in reversed(list(zip(slot.screws.T, factors, columns.tolist(), strict=True))):
            if column >= 0:  # what follows the k-th exponential carries its screw to the frame: Ad((E_k+1 ... E_n)^-1) s_k
                jacobian[:, column] = behind.toActionMatrixInverse() @ screw
            behind = factor * behind
        return (slot.found[session] * behind if session in slot.found else behind), jacobian

    def _following(self, x: Vector) -> dict[str, SE3]:
        """Origins of the joints that are not on the way, as far as an earlier calibration has them follow those that are."""
        if self.earlier is None:
            return {}
        twists = self.earlier.followers(self.joint_names, self.names)
        return {joint: self.earlier.origins[joint] * pin.exp6(pin.Motion(twist @ x)) for joint, twist in twists.items()}

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """The moving joints on the way and on further branches."""
        return tuple(step.joint.name for step in self.chain.moving)

    @cached_property
    def known_rows(self) -> Matrix:
        """What is known of x beyond the priors, as whitened rows, (rows, p)."""
        return self.earlier.rows(self.joint_names, self.names) if self.earlier is not None else np.empty((0, len(self.names)))

    def _has_estimated(self, slot: Slot) -> bool:
        wanted = {f"{slot.label}.{name}" for name in slot.names}
        return bool(wanted & (set(self.names) | set(self.held)))

    def _slot_names(self, session: str) -> list[str]:
        suffix = f":{session}" if session != self.sessions[0] else ""
        return [f"{slot.label}{suffix if slot.kind in SESSION_KINDS else ''}.{name}" for slot in self.slots for name in slot.names]


@dataclass(frozen=True)
class _Station:
    """One thing to pass on the way: a constant, a slot (perhaps inverted) or, if neither, the motion of a joint."""

    constant: SE3 = None
    slot: int = -1
    inverted: bool = False

    @property
    def moves(self) -> bool:
        """Whether it is the motion of a joint."""
        return self.constant is None and self.slot < 0


def _inverse(stations: list[_Station]) -> list[_Station]:
    return [replace(station, inverted=True) for station in stations]


def parameters_of(slots: Iterable[Slot], priors: Mapping[Kind, PriorScale]) -> list[Parameter]:
    """Every parameter of some slots, joints first, then mount, screen and beams."""
    order: dict[Kind, int] = {"joint": 0, "mount": 1, "target": 1, "screen": 2, "reference": 2, "beam": 3}
    return [
        Parameter(f"{slot.label}.{name}", unit, slot.kind, 0.0, priors[slot.like or slot.kind].sigma(unit, f"{slot.label}.{name}"))
        for slot in sorted(slots, key=lambda slot: order[slot.kind])
        for name, unit in zip(slot.names, slot.units(), strict=True)
    ]


def with_softness(errors: ErrorModel, terms: Sequence[Term], weighed: WeighedRobot, carrier: str) -> ErrorModel:
    """An error model whose joints give way."""
    soft = tuple(Parameter(term.name, term.unit, "soft", 0.0, term.sigma) for term in terms)
    rigid = tuple(parameter for parameter in errors.parameters if parameter.kind != "soft")
    return replace(errors, parameters=(*rigid, *soft), soft=Softness(errors.chain, tuple(terms), weighed, carrier))


def with_rig(errors: ErrorModel, terms: Sequence[RigTerm], courses: Mapping[str, Course]) -> ErrorModel:
    """An error model with what the rig does beside standing still, what it had of that included."""
    more = tuple(Parameter(term.name, term.unit, "rig", 0.0, term.sigma) for term in terms)
    before = errors.rig or Rig((), {})
    return replace(errors, parameters=(*errors.parameters, *more), rig=Rig((*before.terms, *terms), {**before.courses, **courses}))
