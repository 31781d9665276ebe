"""At which poses a robot touches neither itself nor what stands around it, by coal through Pinocchio.

Not looked at are links that the measured joints do not move against each other, neighbours (over links without a shape, too), pairs that
an SRDF leaves out, and links that overlap as they are drawn: that touch in nearly every random pose, or in most and where all joints are
at zero. The robot's meshes are convex hulls, which are larger, and where these touch they are looked at themselves.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from lxml import etree

from urdfcal.base.errors import RobotError, UsageError
from urdfcal.base.geometry import MM, Mask, Matrix, Vector
from urdfcal.base.reading import DESCRIPTION, content_of
from urdfcal.cell.bodies import Bodies, bodies_of
from urdfcal.cell.scene import add_scene
from urdfcal.robot.chain import leader_of
from urdfcal.robot.configurations import WholeRobot, random_positions
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_xml import read_xml

CLEARANCE = 5 * MM
_SAMPLES = 200  # random poses by which it is told which pairs overlap as they are drawn
_MOST, _NEARLY_ALL = 0.5, 0.95  # of them
_NAMED = 4  # pairs in a warning
_Names = frozenset[str]


@dataclass(frozen=True)
class Cell:
    """A robot among what stands around it.

    Attributes:
        robot: As the sensors see it.
        model: A Pinocchio geometry model with the pairs that must not touch, meshes as their convex hulls.
        exact: The same with meshes as they are, which is asked where hulls touch.
        margins: How far those stay apart, [m].
        warnings: What was left out, and what is not as the description has it.
    """

    robot: Robot
    model: Any
    exact: Any
    margins: tuple[float, ...]
    warnings: tuple[str, ...] = ()

    def free(self, q: Matrix) -> Mask:
        """At which positions of the measured joints (n, inputs) nothing touches, (n,)."""
        return np.array([self._is_free(row) for row in _whole(self.robot, q)], dtype=bool)

    def _is_free(self, configuration: Vector) -> bool:
        """Whether no hulls touch, or where they do, not what is in them."""
        model, data, hulls, exact = self.robot.model, self._data, self._placed, self._placed_exactly
        if not pin.computeCollisions(model, data, self.model, hulls, configuration, False):
            return True
        pin.updateGeometryPlacements(model, data, self.exact, exact)
        near = (index for index, found in enumerate(hulls.collisionResults) if found.isCollision())
        return not any(pin.computeCollision(self.exact, exact, index) for index in near)

    @cached_property
    def _data(self) -> Any:
        return self.robot.model.createData()

    def most_in_the_way(self, q: Matrix) -> str:
        """Which two touch at most of these positions (n, inputs), in words; the empty string where none do."""
        counts = _touching(self.robot, self.exact, self._placed_exactly, _whole(self.robot, q)).sum(axis=0)
        if not counts.any():
            return ""
        return " and ".join(self._pair(int(np.argmax(counts))))

    def _pair(self, index: int) -> tuple[str, str]:
        pair, shapes = self.model.collisionPairs[index], self.model.geometryObjects
        one, other = sorted((_owner(self.robot, shapes[pair.first]), _owner(self.robot, shapes[pair.second])))
        return one, other

    @cached_property
    def _placed(self) -> Any:
        return _placed(self.model, self.margins)

    @cached_property
    def _placed_exactly(self) -> Any:
        return _placed(self.exact, self.margins)


def cell_of(
    robot: Robot,
    *,
    scene: str | Path | None = None,
    srdf: str | Path | None = None,
    clearance: float = CLEARANCE,
    seed: int = 0,
) -> Cell:
    """A robot's cell.

    Args:
        robot: As the sensors see it.
        scene: A scene.yaml, what stands around it.
        srdf: Says of which pairs of links nobody need ask; by default the file of the description's name beside it.
        clearance: How far all stay apart, [m].
        seed: Of the random poses by which it is told which pairs overlap as they are drawn.

    Raises:
        RobotError: the shapes, or the SRDF, cannot be read.
        RigError: the scene cannot be read.
        UsageError: the clearance is none.
    """
    if not 0 <= clearance < 1:
        raise UsageError(f"a clearance of {clearance / MM:g} mm: expected a number from 0 to 1000 mm")
    bodies = bodies_of(robot)
    if scene is not None:
        add_scene(scene, robot, bodies)
    beside = robot.description.path.with_suffix(".srdf")
    srdf = srdf or (beside if beside.is_file() else None)
    left_out = {*_neighbours(robot, bodies), *(_disabled(Path(srdf)) if srdf else ())}
    model = bodies.model
    for first, second in _pairs(robot, bodies, left_out):
        model.addCollisionPair(pin.CollisionPair(first, second))
    exact = _as_they_are(bodies)
    poses = _whole(robot, random_positions(robot, _SAMPLES, np.random.default_rng(seed)))
    overlapping = _without_overlapping(robot, bodies, exact, poses)
    near = _touching(robot, exact, _placed(exact, repeat(clearance, len(exact.collisionPairs))), poses).mean(axis=0) >= _MOST
    warnings = list(bodies.warnings)
    if overlapping:
        more = f"; and {len(overlapping) - _NAMED} more pairs" if len(overlapping) > _NAMED else ""
        named = "; ".join(overlapping[:_NAMED]) + more
        warnings.append(f"not looked at are {named}, which overlap as they are drawn, at zero or at nearly all positions")
    return Cell(robot, model, exact, tuple(np.where(near, 0.0, clearance).tolist()), tuple(warnings))


def _whole(robot: Robot, q: Matrix) -> Matrix:
    return WholeRobot(robot, robot.chain.input_names).configurations(q)


def _owner(robot: Robot, shape: Any) -> str:
    """The link that a shape is of, or the name that it has in the scene."""
    return shape.name.partition(".")[2] if is_scenery(shape.name) else str(robot.model.frames[shape.parentFrame].name)


def is_scenery(name: str) -> bool:
    """Whether a shape of this name is of the scene, and not of the robot."""
    return name.partition(".")[0] in ("boxes", "cylinders", "planes", "meshes")


def _pairs(robot: Robot, bodies: Bodies, left_out: set[_Names]) -> Iterable[tuple[int, int]]:
    """Shapes that the measured joints move against each other; the others stay as they are."""
    shapes, links = bodies.model.geometryObjects, bodies.links
    moving = _moving(robot)
    moved = [moving.intersection(robot.model.supports[shape.parentJoint]) for shape in shapes]
    for second in range(len(shapes)):
        for first in range(second):
            names = frozenset(filter(None, (links.get(shapes[first].name), links.get(shapes[second].name))))
            if moved[first] != moved[second] and names not in left_out:
                yield first, second


def _moving(robot: Robot) -> set[int]:
    """Joints of the model that the measured ones move: they themselves, and those that follow them."""
    inputs, joints = set(robot.chain.input_names), robot.tree.joints
    driven = {name for name, joint in joints.items() if leader_of(robot.tree, joint)[0].name in inputs}
    return {index for index, name in enumerate(robot.model.names) if name in driven}


def _neighbours(robot: Robot, bodies: Bodies) -> Iterable[_Names]:
    """Links with a shape and the next ones with a shape towards the root."""
    shaped = set(bodies.links.values())
    for link in shaped:
        above = robot.tree.by_child.get(link)
        while above is not None and above.parent not in shaped:
            above = robot.tree.by_child.get(above.parent)
        if above is not None:
            yield frozenset((link, above.parent))


def _disabled(path: Path) -> Iterable[_Names]:
    """Pairs that an SRDF leaves out.

    Raises:
        RobotError: it is no XML.
    """
    try:
        root = read_xml(content_of(path, DESCRIPTION, RobotError))
    except etree.XMLSyntaxError as error:
        raise RobotError(f"is no SRDF: {error}", path) from None
    for pair in root.iter("disable_collisions"):
        yield frozenset((pair.get("link1", ""), pair.get("link2", "")))


def _placed(model: Any, margins: Iterable[float]) -> Any:
    """Data of a geometry model whose pairs are to stay so far apart, [m]."""
    placed = model.createData()
    for request, margin in zip(placed.collisionRequests, margins, strict=True):
        request.security_margin = margin
    return placed


def _touching(robot: Robot, model: Any, placed: Any, poses: Matrix) -> Mask:
    """Which pairs touch at configurations of the whole model, (n, pairs)."""
    data, pairs = robot.model.createData(), range(len(model.collisionPairs))
    found = np.zeros((len(poses), len(model.collisionPairs)), dtype=bool)
    for row, pose in enumerate(poses):
        pin.computeCollisions(robot.model, data, model, placed, pose, False)
        found[row] = [placed.collisionResults[index].isCollision() for index in pairs]
    return found


def _as_they_are(bodies: Bodies) -> Any:
    """The same shapes and pairs, the robot's meshes in place of their hulls; those of the scene stay solid, as their surfaces are not."""
    exact = pin.GeometryModel()
    for shape in bodies.model.geometryObjects:
        form = bodies.exact.get(shape.name, shape.geometry) if shape.name in bodies.links else shape.geometry
        exact.addGeometryObject(pin.GeometryObject(shape.name, shape.parentJoint, shape.parentFrame, shape.placement, form))
    for pair in bodies.model.collisionPairs:
        exact.addCollisionPair(pin.CollisionPair(pair.first, pair.second))
    return exact


def _without_overlapping(robot: Robot, bodies: Bodies, exact: Any, poses: Matrix) -> list[str]:
    """Leave out pairs of the robot's own links that overlap as they are drawn; their names. What stands around is never left out."""
    placed = exact.createData()
    share = _touching(robot, exact, placed, poses).mean(axis=0)
    at_zero = _touching(robot, exact, placed, pin.neutral(robot.model)[None])[0]
    found = np.flatnonzero((share >= _NEARLY_ALL) | at_zero & (share >= _MOST)).tolist()
    shapes, names = exact.geometryObjects, []
    pairs = [exact.collisionPairs[index] for index in found]
    for first, second in [(pair.first, pair.second) for pair in pairs]:
        if {shapes[first].name, shapes[second].name} <= bodies.links.keys():
            for model in (bodies.model, exact):
                model.removeCollisionPair(pin.CollisionPair(first, second))
            names.append(" and ".join(sorted(_owner(robot, shapes[index]) for index in (first, second))))
    return list(dict.fromkeys(names))
