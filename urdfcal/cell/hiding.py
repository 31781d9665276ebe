"""What hides a target: whether a robot's own bodies, or what stands around it, are between it and what looks at it.

A line is a thin capsule, from which a little is left out at either end, so that a reflector on a flange is not hidden by what it sits on,
but is from behind. A body that an end is well inside of is its housing, as a camera's, and hides nothing; neither do lasers and screen.
Most bodies are far from most lines, which their bounding spheres tell of all poses at once; the others are looked at by coal, meshes first
by their hulls.
"""

from __future__ import annotations

from typing import Any

import coal
import numpy as np
import pinocchio as pin

from urdfcal.base.geometry import MM, Array3, Mask, Matrix, Vector
from urdfcal.cell.collisions import Cell, is_scenery
from urdfcal.robot.configurations import whole_configurations

_THICK = 1 * MM  # radius of a line
_LEFT_OUT = 20 * MM  # at either end
_INSIDE = 5 * MM  # how deep an end is in its housing, at least
_POINT = 1e-6  # [m] radius of the ball that an end is taken for
_SHORT = 1e-6  # [m] of what is left of a line


def hidden(cell: Cell, q: Matrix, begin: Matrix, end: Matrix) -> Mask:
    """At which positions of the measured joints (n, inputs) something stands between two points, (n,).

    Args:
        cell: The robot among what stands around it.
        q: Positions, (n, inputs), [rad] or [m].
        begin: Where each line begins, (n, 3), [m], in the axes of the chain's base, the screen or the reference; nan for no line.
        end: Where it ends.
    """
    joints, base = _placed(cell, q)
    begin, end = (_moved(base, points) for points in (begin, end))
    there, blocked = np.isfinite(begin).all(axis=1) & np.isfinite(end).all(axis=1), np.zeros(len(q), dtype=bool)
    own = {cell.robot.rig.base, *cell.robot.rig.lasers} if cell.robot.rig.lasers else set()
    for solid, exact in zip(cell.model.geometryObjects, cell.exact.geometryObjects, strict=True):
        if cell.robot.model.frames[solid.parentFrame].name in own and not is_scenery(solid.name):
            continue
        at = joints[:, solid.parentJoint] @ solid.placement.homogeneous
        ends = np.stack([_seen_from(at, begin), _seen_from(at, end)], axis=1)
        for row in np.flatnonzero(there & ~blocked & _near(solid.geometry, ends)):
            blocked[row] = _crosses(solid.geometry, exact.geometry, *ends[row])
    return blocked


def _placed(cell: Cell, q: Matrix) -> tuple[Any, Array3]:
    """Where the joints of the model are in the root's axes, (n, joints, 4, 4), and the chain's base, (n, 4, 4)."""
    model = cell.robot.model
    data, frame = model.createData(), model.frames[model.getFrameId(cell.robot.rig.base, pin.FrameType.BODY)]
    joints = np.empty((len(q), model.njoints, 4, 4))
    for row, whole in zip(joints, whole_configurations(cell.robot, q), strict=True):
        pin.forwardKinematics(model, data, whole)
        row[:] = [placement.homogeneous for placement in data.oMi]
    return joints, joints[:, frame.parentJoint] @ frame.placement.homogeneous


def _moved(T: Array3, points: Matrix) -> Matrix:
    """Points (n, 3) out of the axes of some frames."""
    return np.asarray((T[:, :3, :3] @ points[..., None])[..., 0] + T[:, :3, 3])


def _seen_from(T: Array3, points: Matrix) -> Matrix:
    """Points (n, 3) in the axes of some frames."""
    return np.asarray((T[:, :3, :3].transpose(0, 2, 1) @ (points - T[:, :3, 3])[..., None])[..., 0])


def _near(form: Any, ends: Array3) -> Mask:
    """Which lines come near a shape's bounding sphere, (n,); all of them where it has no end."""
    form.computeLocalAABB()
    radius = float(form.aabb_radius)
    if not radius < np.inf:
        return np.ones(len(ends), dtype=bool)
    begin, way = ends[:, 0] - form.aabb_center, ends[:, 1] - ends[:, 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.clip(np.nan_to_num(-np.sum(begin * way, axis=1) / np.sum(way**2, axis=1)), 0.0, 1.0)
        return np.asarray(np.linalg.norm(begin + share[:, None] * way, axis=1) <= radius + _THICK)


def _crosses(hull: Any, form: Any, begin: Vector, end: Vector) -> bool:
    """Whether a line in a shape's own axes goes through it, and neither end is in it."""
    way = end - begin
    length = float(np.linalg.norm(way))
    if length - 2 * _LEFT_OUT < _SHORT:
        return False
    line = coal.Capsule(_THICK, length - 2 * _LEFT_OUT)
    at = coal.Transform3s(pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), way / length).toRotationMatrix(), (begin + end) / 2)
    if not _touch(hull, line, at) or (form is not hull and not _touch(form, line, at)):
        return False
    return not any(_inside(hull, point) for point in (begin, end))


def _touch(form: Any, line: Any, at: Any) -> bool:
    return bool(coal.collide(form, coal.Transform3s.Identity(), line, at, coal.CollisionRequest(), coal.CollisionResult()))


def _inside(hull: Any, point: Vector) -> bool:
    """Whether a point is well inside a solid; of a surface alone none is."""
    if isinstance(hull, coal.BVHModelBase):
        return False
    at, result = coal.Transform3s(np.eye(3), point), coal.DistanceResult()
    return bool(coal.distance(hull, coal.Transform3s.Identity(), coal.Sphere(_POINT), at, coal.DistanceRequest(), result) < -_INSIDE)
