"""The placements of a chain that may be wrong, and the screws along which each error model lets them move."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from urdfcal.base.errors import RigError, UsageError
from urdfcal.base.geometry import SE3, Matrix, Vector, X, Z, cross, rotation_screw, six_screws, translation_screw
from urdfcal.model.dh import DhRow, dh_table, rows_of_limbs
from urdfcal.model.parameters import Kind
from urdfcal.robot.chain import Chain
from urdfcal.robot.rig import SIX, Rig
from urdfcal.robot.urdf_tree import UrdfJoint

MODELS = ("auto", "dh", "hayati", "placement", "offset")
PAPER_MOUNT = ("trans_x", "trans_z", "rot_x", "rot_y", "rot_z")
FRAME = ":frame"  # behind the name of a measuring frame that something else already has
_COINCIDENT = 1e-6  # [m] distance between parallel axes below which they are one line
_SLIDE = ("rot_1", "rot_2")
BEAMS = ("rot_x", "rot_y")
BEAMS4 = ("trans_x", "trans_y", "rot_x", "rot_y")


@dataclass(frozen=True)
class Slot:
    """One placement that may be wrong.

    Attributes:
        label: First half of the parameters' names: joint, module, screen or laser link.
        kind: What sort of placement it is.
        names: Second halves, in the order of the product.
        screws: (6, k) in the slot's own frame.
        joints: URDF joint next to it; of a module that has no fixed joint of its own, the first joint of every laser alike; none for an
            instrument's.
        before: Whether the slot stands before the joint's origin (in the parent link's axes) and not behind it.
        spare: Those of the names that the gauge rule considers after everything else.
        last: The rest of a joint's six numbers, which it considers after those.
        frame: Index of the chain's frame that it ends the way to; such a slot is an instrument's, and goes into no URDF.
        also: Further frames that it ends the way to: all the corners of a board share one placement.
        found: Where the frame was found to stand before any fit, by session: the slot's own placement, ahead of its screws.
        like: What sort its prior is that of; its own where nothing is said.
    """

    label: str
    kind: Kind
    names: tuple[str, ...]
    screws: Matrix
    joints: tuple[str, ...]
    before: bool = False
    spare: tuple[str, ...] = ()
    last: tuple[str, ...] = ()
    frame: int | None = None
    also: tuple[int, ...] = ()
    found: Mapping[str, SE3] = field(default_factory=dict)
    like: Kind | None = None

    @cached_property
    def motions(self) -> tuple[Any, ...]:
        """The screws as Pinocchio motions."""
        return tuple(pin.Motion(screw) for screw in self.screws.T)

    def units(self) -> tuple[str, ...]:
        """`m` or `rad` for each parameter: a screw with no angular part is a translation."""
        return tuple("rad" if np.any(screw[3:]) else "m" for screw in self.screws.T)


class _AxisTables:
    """The D-H tables of a chain by joint name, each derived when it is first needed."""

    def __init__(self, chain: Chain) -> None:
        self.chain = chain

    @cached_property
    def dh(self) -> dict[str, DhRow]:
        return {row.name: row for row in dh_table(self.chain)} | rows_of_limbs(self.chain)

    @cached_property
    def hayati(self) -> dict[str, DhRow]:
        return {row.name: row for row in dh_table(self.chain, hayati=True)} | rows_of_limbs(self.chain, hayati=True)


def slots_of(chain: Chain, rig: Rig, model: str = "auto", per_joint: Mapping[str, str] | None = None) -> tuple[Slot, ...]:
    """All placements of a chain that may be wrong under an error model, in order of the way; beams are not among them.

    Args:
        chain: The way from screen to module.
        rig: Names of screen and module.
        model: One of MODELS; decides the joints' parameters and, for `dh`, the module's.
        per_joint: Other models for single joints.

    Raises:
        UsageError: no such model.
    """
    per_joint = per_joint or {}
    rows = _AxisTables(chain)
    joints = [_joint_slot(step.joint, per_joint.get(step.joint.name, model), rows) for step in chain.moving]
    instruments = _frame_slots(chain, rig)
    if not rig.lasers:
        return (*joints, *instruments)
    slots = [_screen_slot(chain, rig), *joints, *instruments]
    names, screws = (PAPER_MOUNT, _paper_mount(chain, rows)) if model == "dh" else (SIX, six_screws())
    return (*slots, _mount_slot(chain, rig, names, screws))


def _mount_slot(chain: Chain, rig: Rig, names: tuple[str, ...], screws: Matrix) -> Slot:
    """The module's placement: on its own fixed joint or, where it is the moving link itself, before the first joint of every laser."""
    if chain.mount_joint is not None:
        return Slot(rig.tip, "mount", names, screws, (chain.mount_joint.name,))
    firsts = tuple(dict.fromkeys(way[0].name for way in chain.laser_joints))
    return Slot(rig.tip, "mount", names, screws, firsts, before=True)


def _frame_slots(chain: Chain, rig: Rig) -> list[Slot]:
    """The placement of every measuring frame, and the offset of every target on its link."""
    seen = rig.instruments
    taken = {step.joint.name for step in chain.moving} | ({rig.base} if rig.lasers else set())  # by joints and the screen
    taken |= {target.placed_by for target in seen.targets}  # a hand may see, and be seen
    slots = [
        Slot(
            f"{own.name}{FRAME}" if own.name in taken else own.name,
            "reference",
            SIX,
            six_screws(),
            (),
            frame=index,
            like="screen" if own.aimed else None,
        )
        for index, own in enumerate(seen.every)
        if own.placed
    ]
    places: dict[str, list[int]] = {}
    first_target = len(seen.every)
    for index, target in enumerate(seen.targets, start=first_target):
        places.setdefault(target.placed_by, []).append(index)
    for label, (first, *others) in places.items():
        target = seen.targets[first - first_target]
        names = SIX if target.board else target.offset
        screws = six_screws()[:, [SIX.index(name) for name in names]]
        like: Kind | None = "mount" if target.aimed else None
        slots.append(Slot(label, "target", names, screws, (), frame=first, also=tuple(others), like=like))
    return slots


def _paper_mount(chain: Chain, rows: _AxisTables) -> Matrix:
    """The paper's five, (6, 5): translations along x and z of the last joint's D-H frame as in (2), rotations the module's own."""
    module = rows.dh.get(chain.steps[-1].joint.child) if chain.steps[-1].forward else None
    if module is None:  # the lasers stand still: the frame behind the last joint is as good as any
        along = [translation_screw(chain.T_last_module.rotation.T @ direction) for direction in (X, Z)]
    else:
        along = [module.screws["d_a"], module.screws["d_d"]]
    return np.column_stack([*along, six_screws()[:, 3:]])


def beam_slots(chain: Chain, names: tuple[str, ...]) -> tuple[Slot, ...]:
    """The beams' slots: two angles, or two angles and two offsets, on each laser's own joint."""
    screws = six_screws()[:, [SIX.index(name) for name in names]]
    return tuple(Slot(way[-1].child, "beam", names, screws, (way[-1].name,)) for way in chain.laser_joints)


def _screen_slot(chain: Chain, rig: Rig) -> Slot:
    own = chain.screen_joint
    if own is not None:
        return Slot(rig.base, "screen", SIX, six_screws(), (own.joint.name,))
    first = chain.steps[0]
    if not first.forward:  # the screen is the very link that a moving joint carries: no origin stands for it
        return Slot(rig.base, "screen", (), np.empty((6, 0)), (first.joint.name,), before=True)
    return Slot(rig.base, "screen", SIX, six_screws(), (first.joint.name,), before=True)


def _joint_slot(joint: UrdfJoint, model: str, rows: _AxisTables) -> Slot:
    if model not in MODELS:
        raise UsageError(f"no error model '{model}'; there are: {', '.join(MODELS)}")
    named = _offset(joint) if model == "offset" else _placement() if model == "placement" else _dh(joint, model, rows)
    screws = np.column_stack(list(named.values()))
    spare, last = _spare(joint, model, rows), _last(joint, model, rows)
    return Slot(joint.name, "joint", tuple(named), screws, (joint.name,), spare=spare, last=last)


def _placement() -> dict[str, Vector]:
    return dict(zip(SIX, six_screws().T, strict=True))


def _offset(joint: UrdfJoint) -> dict[str, Vector]:
    axis = np.array(joint.axis)
    return {"d_q": translation_screw(axis)} if joint.prismatic else {"d_theta": rotation_screw(axis, np.zeros(3))}


def _dh(joint: UrdfJoint, model: str, rows: _AxisTables) -> dict[str, Vector]:
    if joint.prismatic:
        return {name: screw for name, screw in _slide(joint).items() if name in _SLIDE or model == "auto"}
    row = (rows.dh if model == "dh" else rows.hayati)[joint.name]
    return {name: screw for name, screw in row.screws.items() if name in _regular(row, model) or model == "auto"}


def _regular(row: DhRow, model: str) -> tuple[str, ...]:
    """A turning joint's four: Hayati's have the tilt in place of the offset d where the axis is nearly parallel to the one before it."""
    tilts = model != "dh" and row.parallel
    return ("d_a", "d_d" if not tilts else "d_beta", "d_alpha", "d_theta")


def _spare(joint: UrdfJoint, model: str, rows: _AxisTables) -> tuple[str, ...]:
    """What is missing behind a slide, which has no angle about itself, and on one line, which has no normal to turn."""
    row = None if joint.prismatic or model != "auto" else rows.hayati[joint.name]
    if row is None:
        return ()
    behind_slide = (("d_d",) if row.parallel else ("d_beta",)) if row.behind_slide else ()
    return behind_slide + (("d_b",) if row.parallel and abs(row.a) < _COINCIDENT else ())


def _last(joint: UrdfJoint, model: str, rows: _AxisTables) -> tuple[str, ...]:
    """What completes the six numbers of a joint, of which most are carried by its neighbours."""
    if model != "auto":
        return ()
    regular = _SLIDE if joint.prismatic else (*_regular(rows.hayati[joint.name], model), *_spare(joint, model, rows))
    return tuple(name for name in _dh(joint, model, rows) if name not in regular)


def _slide(joint: UrdfJoint) -> dict[str, Vector]:
    """The six of a slide: turns about two axes across it and about itself through its origin, shifts across it, and its zero."""
    axis = np.array(joint.axis)
    least = np.eye(3)[int(np.argmin(np.abs(axis)))]
    across = least - axis * float(axis @ least)
    across /= np.linalg.norm(across)
    axes = (across, cross(axis, across), axis)
    turns = {f"rot_{number}": rotation_screw(direction, np.zeros(3)) for number, direction in enumerate(axes, start=1)}
    shifts = {f"trans_{number}": translation_screw(direction) for number, direction in enumerate(axes[:2], start=1)}
    return turns | shifts | {"d_q": translation_screw(axis)}


def require_screen_slot(chain: Chain, rig: Rig) -> None:
    """Refuse to estimate the placement of a screen that is the very link a moving joint carries.

    Raises:
        RigError: naming screen and joint.
    """
    first = chain.steps[0]
    if first.joint.moves and not first.forward:
        raise RigError(
            f"screen '{rig.base}' is the link that joint '{first.joint.name}' moves; hang it on a fixed joint to estimate its placement"
        )
