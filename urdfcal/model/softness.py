"""Joints that give way with the pose: what they yield to, about which axis, and how far.

A term turns one joint by basis(pose) times its parameter. Gravity's terms have the joint's gravity moment, divided by the largest that
it meets within its range, for a basis, so that the parameter is the deflection at that moment, [rad]:

    <joint>.sag              about the joint's own axis: drive and gears
    <joint>.sag_1, .sag_2    about the two axes across it: bearings and links

Others, on request, turn the joint about its own axis, or slide it along it:

    <joint>.scale            basis q: encoder scale, or pitch of a slide's screw or belt
    <joint>.ecc_sin, ...     basis sin q, cos q, sin 2q, cos 2q: eccentric encoders and gears
    <joint>.gear50_sin, ...  basis sin 50 q, cos 50 q: a gear's stage that turns so often with the joint
    <joint>.approach         basis +1 or -1, the direction of the last move: backlash and friction

Eccentricity is that of something that turns once with the joint, so slides have none.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Array3, Matrix, Vector, cross
from urdfcal.model.gravity import WeighedRobot
from urdfcal.robot.chain import Bend, Chain

SAG, SAG_ACROSS = 1e-3, 0.5e-3  # [rad] prior standard deviations at a joint's largest gravity moment
SCALE, ECCENTRICITY, APPROACH, GEAR = 1e-3, 1e-3, 0.5e-3, 0.2e-3  # the same of the others: a share, [rad], and [rad] or, of slides, [m]
_LEAST_SHARE = 1e-3  # of the largest moment of any joint, under which gravity has nothing to say
Axis = tuple[float, float, float]
EXTRAS = ("scale", "eccentricity", "approach")
_GEAR_NAME = re.compile(r"gear(\d+)_(sin|cos)")
_WAVES = {"sin": np.sin, "cos": np.cos}
_HARMONICS = {"ecc_sin": (np.sin, 1), "ecc_cos": (np.cos, 1), "ecc_sin2": (np.sin, 2), "ecc_cos2": (np.cos, 2)}


@dataclass(frozen=True)
class Term:
    """One way in which one joint gives way.

    Attributes:
        name: Of its parameter.
        joint: Index of the moving joint on the way.
        axis: Across the joint's own axis, in its frame; None for its own.
        sigma: Prior standard deviation of the parameter.
        largest: Moment at which a gravity term's deflection is the parameter, [N m]; 0 for other terms.
        unit: Of the parameter: `rad`, `m`, or the empty string for a share.
    """

    name: str
    joint: int
    axis: Axis | None
    sigma: float
    largest: float = 0.0
    unit: str = "rad"


@dataclass(frozen=True)
class Yielding:
    """How joints give way at some poses: each term turns (or slides) one joint by basis times its parameter.

    Attributes:
        columns: Where the terms' parameters are in the state, (f,); the first f terms are estimated, others are held.
        joints: Index of the moving joint of each term, (k,).
        bends: Index of the bend of each term; -1 where it yields about, or along, the joint's own axis, (k,).
        basis: (n, k).
        x: The terms' parameters, (k,).
    """

    columns: npt.NDArray[np.intp]
    joints: tuple[int, ...]
    bends: tuple[int, ...]
    basis: Matrix
    x: Vector


@dataclass(frozen=True)
class Softness:
    """All the ways in which the joints of a chain give way.

    Attributes:
        chain: The way.
        terms: Each of them.
        weighed: The robot with its masses, and with gravity.
        carrier: Link that a pose's payload hangs on.
    """

    chain: Chain
    terms: tuple[Term, ...]
    weighed: WeighedRobot
    carrier: str

    @property
    def bends(self) -> tuple[Bend, ...]:
        """The axes across, each once, in the order of the terms."""
        return tuple(Bend(term.joint, term.axis) for term in self.terms if term.axis is not None)

    @property
    def bend_of(self) -> tuple[int, ...]:
        """Index of each term's bend; -1 for those about the joint's own axis."""
        found, numbers = [], iter(range(len(self.terms)))
        for term in self.terms:
            found.append(-1 if term.axis is None else next(numbers))
        return tuple(found)

    def basis(self, q: Matrix, payload: Vector | None = None, approach: Matrix | None = None) -> Matrix:
        """What each term is multiplied by at each pose, (n, terms).

        Args:
            q: Positions of the measured joints, (n, inputs).
            payload: Further mass on the carrier at each pose, (n,), [kg].
            approach: Direction of each measured joint's last move, (n, inputs): -1, 0 or 1.
        """
        basis = np.zeros((len(self.terms), len(q))).T  # a term is written at once
        own = [number for number, term in enumerate(self.terms) if term.largest]
        if own:
            moments = self.weighed.moments(q)
            if payload is not None and np.any(payload):
                moments += payload[:, None, None] * self.weighed.payload_moments(q, self.carrier)
            basis[:, own] = pulled(self.chain, [self.terms[number] for number in own], moments)
        inputs = {joint.name: index for index, joint in enumerate(self.chain.inputs)}
        for number, term in enumerate(self.terms):
            what, name = term.name.rpartition(".")[2], self.chain.moving[term.joint].joint.name
            if what == "approach":
                basis[:, number] = 0.0 if approach is None else approach[:, inputs[name]]
            elif what in _HARMONICS:
                wave, order = _HARMONICS[what]
                basis[:, number] = wave(order * q[:, inputs[name]])
            elif what == "scale":
                basis[:, number] = q[:, inputs[name]]
            elif gear := _GEAR_NAME.fullmatch(what):
                basis[:, number] = _WAVES[gear[2]](int(gear[1]) * q[:, inputs[name]])
            elif what.startswith("turn"):
                basis[:, number] = 1.0
        return basis


def pulled(chain: Chain, terms: Sequence[Term], moments: Array3) -> Matrix:
    """What gravity's terms are multiplied by, (n, terms), where the joints carry moments (n, moving, 3), [N m]."""
    axes = [np.array(chain.moving[term.joint].joint.axis if term.axis is None else term.axis) / term.largest for term in terms]
    return np.asarray((moments[:, [term.joint for term in terms]] * np.array(axes)).sum(axis=2))


def gravity_terms(chain: Chain, moments: Array3) -> tuple[Term, ...]:
    """The ways in which gravity bends the joints of a chain.

    Args:
        chain: The way.
        moments: Gravity's moments over the joints' range, (n, moving, 3), [N m].
    """
    largest = float(np.max(np.linalg.norm(moments, axis=2), initial=0.0))
    terms: list[Term] = []
    for index, step in enumerate(chain.moving):
        axis, name = np.array(step.joint.axis), step.joint.name
        about = float(np.max(np.abs(moments[:, index] @ axis), initial=0.0))
        if not step.joint.prismatic and about > _LEAST_SHARE * largest:
            terms.append(Term(f"{name}.sag", index, None, SAG, about))
        axes = across(axis)
        sideways = float(np.max(np.linalg.norm(moments[:, index] @ np.array(axes).T, axis=1), initial=0.0))
        if sideways > _LEAST_SHARE * largest:
            terms += [Term(f"{name}.sag_{number}", index, own, SAG_ACROSS, sideways) for number, own in enumerate(axes, start=1)]
    return tuple(terms)


def extra_terms(chain: Chain, wanted: Sequence[str]) -> tuple[Term, ...]:
    """Terms beside gravity's, of every measured joint; those of `wanted` among EXTRAS."""
    inputs = {joint.name for joint in chain.inputs}
    joints = [step.joint for step in chain.moving]
    terms: list[Term] = []
    for index, joint in enumerate(joints):
        if joint.name not in inputs:
            continue
        turns, unit = "eccentricity" in wanted and not joint.prismatic, "m" if joint.prismatic else "rad"
        terms += [Term(f"{joint.name}.scale", index, None, SCALE, unit="")] if "scale" in wanted else []
        terms += [Term(f"{joint.name}.{wave}", index, None, ECCENTRICITY) for wave in _HARMONICS] if turns else []
        terms += [Term(f"{joint.name}.approach", index, None, APPROACH, unit=unit)] if "approach" in wanted else []
    return tuple(terms)


def gear_terms(chain: Chain, gears: Sequence[tuple[str, int]]) -> tuple[Term, ...]:
    """Waves of a gear, for each joint and how often a turn of it the wave comes."""
    index = {step.joint.name: number for number, step in enumerate(chain.moving)}
    return tuple(Term(f"{joint}.gear{cycles}_{wave}", index[joint], None, GEAR) for joint, cycles in gears for wave in _WAVES)


def unit_terms(chain: Chain) -> tuple[Term, ...]:
    """Each moving joint turned about its own axis, or slid along it, and about the two across it, by one whatever the pose."""
    terms: list[Term] = []
    for index, step in enumerate(chain.moving):
        name, axes = step.joint.name, across(np.array(step.joint.axis))
        terms.append(Term(f"{name}.turn", index, None, 1.0))
        terms += [Term(f"{name}.turn_{number}", index, own, 1.0) for number, own in enumerate(axes, start=1)]
    return tuple(terms)


def is_known(term: Term) -> bool:
    """Whether a term's name says what it is multiplied by: gravity's have a largest moment, and those across an axis of their own."""
    what = term.name.rpartition(".")[2]
    if what in ("sag", "sag_1", "sag_2"):
        return term.largest > 0 and (term.axis is None) == (what == "sag")
    return not term.largest and term.axis is None and (what in ("scale", "approach", *_HARMONICS) or bool(_GEAR_NAME.fullmatch(what)))


def across(axis: Vector) -> tuple[Axis, Axis]:
    """Two unit vectors perpendicular to an axis and to each other."""
    least = np.eye(3)[int(np.argmin(np.abs(axis)))]
    one = least - axis * float(axis @ least)
    one /= np.linalg.norm(one)
    x, y, z = one.tolist()
    u, v, w = cross(axis, one).tolist()
    return (x, y, z), (u, v, w)
