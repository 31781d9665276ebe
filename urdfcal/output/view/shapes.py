"""What a robot looks like: its visual meshes, found without ROS, and simple shapes where there are none.

A link whose mesh cannot be found, and every link of a robot that has no visual shapes at all, is drawn by a cylinder about each
of its joints and a capsule towards each joint that it carries. The sheet of the screen is left out: the viewer draws its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from lxml import etree

from urdfcal.base.errors import RobotError
from urdfcal.base.geometry import SE3, Matrix, Vector
from urdfcal.base.native import native_stderr
from urdfcal.robot.description import Description
from urdfcal.robot.packages import resolve_uri
from urdfcal.robot.pinocchio_model import without_its_source
from urdfcal.robot.rig import lasers_by_name
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_xml import for_pinocchio, read_xml

_READABLE = (".dae", ".obj", ".stl")  # what meshcat can show
_BODY, _MODULE, _LASER = (0.62, 0.67, 0.73, 1.0), (0.25, 0.25, 0.28, 1.0), (0.8, 0.1, 0.1, 1.0)
_LONGEST_RAIL = 5.0  # [m]; a prismatic joint that goes farther has no limits worth drawing
_SLENDER = 0.03  # radius of a simple shape over the reach of the arm
_THINNEST, _THICKEST = 0.006, 0.05  # [m]


@dataclass(frozen=True)
class Shapes:
    """The shapes of a robot.

    Attributes:
        model: Pinocchio geometry model on the robot's own model.
        links: The link that each shape belongs to.
        T_link_shape: Its placement in that link.
        simple: Links that are drawn by simple shapes.
        warnings: Meshes that were not found.
    """

    model: Any
    links: tuple[str, ...]
    T_link_shape: tuple[SE3, ...]
    simple: tuple[str, ...]
    warnings: tuple[str, ...]

    def on(self, robot: Robot) -> Any:
        """The same shapes on another robot with these links: each stands in its link's frame as before."""
        model = self.model.copy()
        for shape, link, T_link_shape in zip(model.geometryObjects, self.links, self.T_link_shape, strict=True):
            frame = robot.model.frames[robot.model.getFrameId(link, pin.FrameType.BODY)]
            shape.parentJoint, shape.placement = frame.parentJoint, frame.placement * T_link_shape
        return model

    def corners(self, robot: Robot, q: Vector) -> Matrix:
        """The corners of the boxes around all shapes at one configuration, (8 shapes, 3), [m], in the root's axes."""
        data, placed = robot.model.createData(), self.model.createData()
        pin.forwardKinematics(robot.model, data, q)
        pin.updateGeometryPlacements(robot.model, data, self.model, placed)
        found = []
        for shape, placement in zip(self.model.geometryObjects, placed.oMg, strict=True):
            shape.geometry.computeLocalAABB()
            box = shape.geometry.aabb_local
            sides = np.stack([box.min_, box.max_])  # coal has applied the mesh's scale already
            corners = np.stack(np.meshgrid(*sides.T), axis=-1).reshape(-1, 3)
            found.append(corners @ placement.rotation.T + placement.translation)
        return np.concatenate(found) if found else np.zeros((1, 3))


def robot_shapes(robot: Robot) -> Shapes:
    """The visual shapes of a robot.

    Meshes are looked for as `$(find pkg)` is, or beside the description; one that is missing is warned of and replaced.
    """
    root = read_xml(robot.description.text)
    bare, missing = _resolve_meshes(root, robot)
    warnings = [f"{len(missing)} meshes are drawn as simple shapes, the first because {missing[0]}"] if missing else []
    try:
        model = _from_urdf(robot, root)
    except (ValueError, RuntimeError) as error:
        model, bare = pin.GeometryModel(), set(robot.tree.links)
        warnings = [f"the robot is drawn by simple shapes, since its meshes cannot be read: {without_its_source(str(error))}"]
    rig = {robot.rig.base, robot.rig.tip, *robot.rig.lasers} if robot.rig.lasers else set()
    drawn = {robot.model.frames[shape.parentFrame].name for shape in model.geometryObjects}
    simple = bare if drawn - rig else set(robot.tree.links)
    _add_simple(robot, model, simple - rig, set(rig) - drawn)
    frames = [robot.model.frames[shape.parentFrame] for shape in model.geometryObjects]
    own = tuple(frame.placement.actInv(shape.placement) for frame, shape in zip(frames, model.geometryObjects, strict=True))
    return Shapes(model, tuple(frame.name for frame in frames), own, tuple(sorted(simple)), tuple(warnings))


def _sheet(robot: Robot) -> str:
    """The link of the screen, also where this robot is measured without it: then the sheet would only be in the way.

    The empty string for a robot without lasers: what is named `screen` there is its own.
    """
    default = "screen" if lasers_by_name(robot.tree) else ""
    return robot.rig.base if robot.rig.lasers else robot.screen or default


def _resolve_meshes(root: etree._Element, robot: Robot) -> tuple[set[str], list[str]]:
    """Name every mesh by its file; visuals whose mesh cannot be shown go, and their links are given back, with the reasons."""
    bare: set[str] = set()
    missing: list[str] = []
    for link in root.findall("link"):
        name = link.get("name", "")
        for visual in link.findall("visual"):
            mesh = visual.find("geometry/mesh")
            if name == _sheet(robot):
                link.remove(visual)
            elif mesh is not None:
                try:
                    mesh.set("filename", str(_mesh_file(mesh.get("filename", ""), robot.description)))
                except RobotError as error:
                    link.remove(visual)
                    bare.add(name)
                    missing.append(str(error))
        for collision in link.findall("collision"):
            link.remove(collision)
    return bare, missing


def _mesh_file(uri: str, description: Description) -> Path:
    if not uri:
        raise RobotError("a <mesh> has no filename")
    path = Path(resolve_uri(uri, description.package_dirs).removeprefix("file://"))
    path = path if path.is_absolute() else description.path.parent / path
    if not path.is_file():
        raise RobotError(f"{uri} was not found; name the folder that holds its package with --package-dir")
    if path.suffix.lower() not in _READABLE:
        raise RobotError(f"{uri} is none of {', '.join(_READABLE)}")
    return path.resolve()


def _from_urdf(robot: Robot, root: etree._Element) -> Any:
    with native_stderr():  # of shapes that it passes over, and simple ones stand for
        return pin.buildGeomFromUrdfString(robot.model, for_pinocchio(root, shapes=True), pin.GeometryType.VISUAL)


def _add_simple(robot: Robot, model: Any, links: set[str], rig: set[str]) -> None:
    """Cylinders about joints, capsules between joints, and a box and barrels for a module and lasers without shapes."""
    import coal

    radius = _radius(robot)
    for joint in robot.tree.joints.values():
        if joint.child in links and joint.moves:
            about = _z_to(np.array(joint.axis), np.zeros(3))
            _add(robot, model, joint.child, "joint", coal.Cylinder(1.3 * radius, 4 * radius), about, _BODY)
        if joint.parent in links and joint.prismatic and 0 < joint.upper < _LONGEST_RAIL:
            rail = joint.origin * _z_to(np.array(joint.axis), joint.upper / 2 * np.array(joint.axis))
            _add(robot, model, joint.parent, f"rail_{joint.child}", coal.Capsule(0.6 * radius, joint.upper), rail, _BODY)
        reach = float(np.linalg.norm(joint.origin.translation))
        if joint.parent in links and reach > radius and joint.child != _sheet(robot):
            between = _z_to(joint.origin.translation, joint.origin.translation / 2)
            _add(robot, model, joint.parent, f"to_{joint.child}", coal.Capsule(radius, reach), between, _BODY)
    if robot.rig.tip in rig:
        _add(robot, model, robot.rig.tip, "box", coal.Box(0.03, 0.06, 0.02), pin.SE3(np.eye(3), np.array([0, 0, -0.01])), _MODULE)
    for laser in (laser for laser in robot.rig.lasers if laser in rig):
        _add(robot, model, laser, "barrel", coal.Cylinder(0.004, 0.04), pin.SE3(np.eye(3), np.array([0, 0, 0.02])), _LASER)


def _add(robot: Robot, model: Any, link: str, part: str, shape: Any, T_link_shape: SE3, colour: tuple[float, ...]) -> None:
    frame = robot.model.frames[robot.model.getFrameId(link, pin.FrameType.BODY)]
    index = robot.model.getFrameId(link, pin.FrameType.BODY)
    geometry = pin.GeometryObject(f"{link}_{part}", frame.parentJoint, index, frame.placement * T_link_shape, shape)
    geometry.meshColor = np.array(colour)
    model.addGeometryObject(geometry)


def _radius(robot: Robot) -> float:
    moving = [float(np.linalg.norm(step.joint.origin.translation)) for step in robot.chain.moving[1:]]
    return float(np.clip(_SLENDER * sum(moving), _THINNEST, _THICKEST))


def _z_to(direction: Vector, point: Vector) -> SE3:
    """A placement at a point whose z runs along a direction."""
    unit = np.asarray(direction, dtype=float) / np.linalg.norm(direction)
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), unit)
    return pin.SE3(turn.toRotationMatrix(), np.asarray(point, dtype=float))
