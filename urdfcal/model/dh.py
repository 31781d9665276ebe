"""Denavit-Hartenberg axes of a chain, derived from its URDF: equations (1) and (2).

    T_i = Trans(x, a) Trans(z, d) Rot(x, alpha) Rot(z, theta)

x belongs to the frame before the joint and is the common normal from the axis before it to its own; z is the URDF axis, so that q
counts positive. Where the URDF's own frames already have the form of (1) they are taken as they stand, signs included. For nearly
parallel axes the common normal is ill-defined and d is not seen; Hayati's

    T_i = Trans(x, a) Trans(z, d) Rot(x, alpha) Rot(y, beta) Rot(z, theta)

has a tilt beta there, with x the normal through the joint's own URDF origin and d fixed.

Sliding joints have a direction but no place: the next joint's normal is taken from the turning axis before the slide.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from urdfcal.base.geometry import SE3, Matrix, Vector, X, cross, rotation_screw, translation_screw
from urdfcal.robot.chain import Chain
from urdfcal.robot.urdf_tree import UrdfJoint

HAYATI_SINE = 0.1  # |z_prev x z| below which two axes count as nearly parallel
_PARALLEL = 1e-4  # ... as parallel: below it the common normal lies so far off that it means nothing (rpy="1.5708 ..." is 4e-6 off)
_TOUCH = 1e-7  # [m] distance below which two axes intersect
_AS_IT_STANDS = 1e-9


@dataclass(frozen=True)
class DhRow:
    """One line of a D-H table, with the axes it refers to.

    Attributes:
        name: Joint, or module link for the last line.
        a, d: [m].
        alpha, beta, theta: [rad]; beta is 0 but for nearly parallel axes by Hayati.
        slide: [m] along z after the rotations; only for the module, whose origin need not lie on the normal.
        parallel: Whether the axis is nearly parallel to the one before it.
        screws: Unit screw of each of d_a, d_b, d_d, d_alpha, d_beta, d_theta, (6,), in the joint's placement frame; d_b is the shift
            along y that (2) does not have.
        behind_slide: Whether a sliding joint stands between this axis and the one before it.
        direction: Of a sliding joint: where it slides to, (3,), in the frame where the row before ends; its other numbers are zero. None
            of all others.
    """

    name: str
    a: float
    d: float
    alpha: float
    beta: float
    theta: float
    slide: float
    parallel: bool
    behind_slide: bool
    screws: dict[str, Vector]
    direction: Vector | None = None


@dataclass(frozen=True)
class _Slide:
    """A sliding joint: how many axes stand before it, and where it slides to, (3,), in the axes of the link that the branch hangs on."""

    name: str
    behind: int
    direction: Vector


@dataclass(frozen=True)
class _Axis:
    """A line and the frame that the URDF hangs on it, at q = 0."""

    frame: SE3
    z: Vector
    point: Vector  # the D-H origin on it
    behind_slide: bool = False

    @property
    def stands_on_z(self) -> bool:
        return bool(np.abs(self.frame.rotation[:, 2] - self.z).max() < _AS_IT_STANDS)


@dataclass(frozen=True)
class _Normal:
    """Where a joint's D-H transform starts and ends: x, and the point on the new axis."""

    x: Vector
    foot: Vector


def dh_table(chain: Chain, hayati: bool = False) -> list[DhRow]:
    """Derive the table of every turning joint on the way, in URDF direction, and of the module where it moves.

    Args:
        chain: The way from the screen to the module.
        hayati: Use Hayati's transform for nearly parallel axes.

    Returns:
        One line a turning joint; a last one for the module if its branch moves.
    """
    return [row for row in table_with_slides(chain, hayati) if row.direction is None]


def table_with_slides(chain: Chain, hayati: bool = False) -> list[DhRow]:
    """The same table with a line for every sliding joint, too, where it stands on the way.

    The product of all lines, each turning joint's with Rot(z, q) and each sliding one's with Trans(direction q) behind it, is the robot.
    """
    rows: list[DhRow] = []
    for branch in chain.branches():
        rows += _branch_rows(chain, branch, hayati)
    return rows


def rows_of_limbs(chain: Chain, hayati: bool = False) -> dict[str, DhRow]:
    """Lines of the turning joints of further branches by name, each behind those that lead to it in URDF direction."""
    moving, on_way = set(chain.every_joint), {joint.name for branch in chain.branches() for joint in branch}
    rows = [row for path in chain.limbs() for row in _rows(path, True, hayati) if row.direction is None]
    return {row.name: row for row in rows if row.name in moving and row.name not in on_way}


def _branch_rows(chain: Chain, branch: list[UrdfJoint], hayati: bool) -> list[DhRow]:
    forward = {step.joint.name: step for step in chain.steps}[branch[0].name].forward
    ordered = [step.joint for step in (chain.steps if forward else chain.steps[::-1]) if step.forward == forward]
    return _rows(ordered[ordered.index(branch[0]) :], forward, hayati)  # fixed joints before the first moving one do not count


def _rows(ordered: list[UrdfJoint], ends: bool, hayati: bool) -> list[DhRow]:
    """Lines of joints in their order; where the branch ends in a link that matters, a last one for that."""
    axes, names, slides = _axes_at_zero(ordered, ends)
    turning = sum(joint.moves and not joint.prismatic for joint in ordered)
    tilted = [hayati] * turning + [True] * (len(names) - turning)  # a module nearly parallel to the last axis has no useful normal either
    normals: list[_Normal] = []
    for index, tilts in enumerate(tilted):
        normal = _normal(axes[index], axes[index + 1], tilts)
        normals.append(normal)
        axes[index + 1] = replace(axes[index + 1], point=normal.foot)
    x_axes = [*(normal.x for normal in normals), axes[-1].frame.rotation[:, 0]]  # where each line begins, and the last one ends
    rows = [_row(name, axes[k], axes[k + 1], normals[k], x_axes[k + 1], tilted[k]) for k, name in enumerate(names)]
    rows = [replace(row, slide=0.0) for row in rows[:turning]] + rows[turning:]  # a joint's D-H origin is the foot of its normal
    for slide in reversed(slides):
        at = slide.behind - 1
        rows.insert(at, _slide_row(slide, axes[at].z, x_axes[at::-1]))
    return rows


def _slide_row(slide: _Slide, z: Vector, x_axes: list[Vector]) -> DhRow:
    """The line of a sliding joint behind an axis z, from which the next line starts along the first x that is not along z.

    Where no line follows and the joint's own x is along z, theta is zero: x stays that of the line before.
    """
    across = next(across for across in (_across(x, z) for x in x_axes) if np.any(across))
    across = across / np.linalg.norm(across)
    direction = np.stack([across, cross(z, across), z]) @ slide.direction
    zeros = dict.fromkeys(("a", "d", "alpha", "beta", "theta", "slide"), 0.0)
    return DhRow(slide.name, **zeros, parallel=False, behind_slide=False, screws={}, direction=np.round(direction, 15) + 0.0)


def _axes_at_zero(ordered: list[UrdfJoint], ends: bool) -> tuple[list[_Axis], list[str], list[_Slide]]:
    """The z axis of the link that the branch hangs on, its turning joints and, on the module's side, the module's z; its slides beside."""
    frame = pin.SE3.Identity()
    axes, names, slid = [_Axis(frame, frame.rotation[:, 2], frame.translation)], [], False
    slides: list[_Slide] = []
    for joint in ordered:
        frame = frame * joint.origin
        if joint.moves and not joint.prismatic:
            axes.append(_Axis(frame, frame.rotation @ np.array(joint.axis), frame.translation, slid))
            names.append(joint.name)
        elif joint.moves:
            slides.append(_Slide(joint.name, len(axes), frame.rotation @ np.array(joint.axis)))
        slid = joint.prismatic or (slid and not joint.moves)
    if ends:
        axes.append(_Axis(frame, frame.rotation[:, 2], frame.translation))
        names.append(ordered[-1].child)
    return axes, names, slides


def _normal(before: _Axis, after: _Axis, hayati: bool) -> _Normal:
    origin = after.frame.translation
    if _is_dh(before, after):
        return _Normal(before.frame.rotation[:, 0], origin)
    both = cross(before.z, after.z)
    sine = float(np.linalg.norm(both))
    if sine < (HAYATI_SINE if hayati else _PARALLEL):
        gap = _across(origin - before.point, before.z)
        if np.linalg.norm(gap) < _TOUCH:  # coincident: the URDF's own x, or whatever of it lies across
            own = _across(before.frame.rotation[:, 0], before.z)
            gap = own if np.linalg.norm(own) > _AS_IT_STANDS else _across(before.frame.rotation[:, 1], before.z)
        return _Normal(gap / np.linalg.norm(gap), origin)
    x = both / sine
    apart = float((origin - before.point) @ x)
    if abs(apart) < _TOUCH:
        apart = float(before.frame.rotation[:, 0] @ x)
        apart = 1.0 if abs(apart) < _AS_IT_STANDS else apart
    along = cross(before.z, both) / sine**2  # foot of the normal on the new axis
    foot = origin - after.z * float((origin - before.point) @ along) / float(after.z @ along)
    return _Normal(x * np.sign(apart), foot)


def _is_dh(before: _Axis, after: _Axis) -> bool:
    """Whether the URDF's placement is Trans(x, a) Trans(z, d) Rot(x, alpha) Rot(z, theta) as it stands."""
    step = before.frame.actInv(after.frame)
    straight = abs(step.rotation[0, 2]) < _AS_IT_STANDS and abs(step.translation[1]) < _AS_IT_STANDS
    return straight and before.stands_on_z and after.stands_on_z


def _across(vector: Vector, axis: Vector) -> Vector:
    result: Vector = vector - axis * float(axis @ vector)
    return result


def _row(name: str, before: _Axis, after: _Axis, normal: _Normal, x_after: Vector, hayati: bool) -> DhRow:
    start = np.column_stack([normal.x, cross(before.z, normal.x), before.z])
    a, _, d = start.T @ (normal.foot - before.point)
    z = start.T @ after.z
    parallel = bool(np.linalg.norm(cross(before.z, after.z)) < HAYATI_SINE)
    beta = float(np.arcsin(np.clip(z[0], -1, 1))) if hayati and parallel else 0.0
    alpha = float(np.arctan2(-z[1], z[2]))
    tilted = start @ pin.exp3(X * alpha) @ pin.exp3(np.array([0.0, beta, 0.0]))
    across = _across(x_after, after.z)
    theta = float(np.arctan2(across @ tilted[:, 1], across @ tilted[:, 0]))
    slide = float((after.frame.translation - normal.foot) @ after.z)
    in_world = {
        "d_a": translation_screw(normal.x),
        "d_b": translation_screw(cross(before.z, normal.x)),
        "d_d": translation_screw(before.z),
        "d_alpha": rotation_screw(normal.x, normal.foot),
        "d_beta": rotation_screw(tilted[:, 1], normal.foot),
        "d_theta": rotation_screw(after.z, normal.foot),
    }
    to_frame: Matrix = after.frame.inverse().action
    screws = {key: to_frame @ screw for key, screw in in_world.items()}
    a, d, alpha, beta, theta, slide = (float(value) + 0.0 for value in (a, d, alpha, beta, theta, slide))  # + 0.0: no "-0.0" in the table
    return DhRow(name, a, d, alpha, beta, theta, slide, parallel, after.behind_slide, screws)
