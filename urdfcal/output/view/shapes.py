"""What a robot looks like: its visual meshes, found without ROS, and simple shapes where there are none.

A link whose mesh cannot be found or is not to be shown, and every link of a robot that has no visual shapes at all, is drawn by a
cylinder about each of its joints and a capsule towards each joint that it carries. The sheet of the screen is left out: the viewer
draws its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from lxml import etree

from urdfcal.base.errors import RobotError
from urdfcal.base.geometry import SE3, Matrix, Vector
from urdfcal.base.native import native_stderr
from urdfcal.output.view.light_meshes import light_meshes
from urdfcal.output.view.mesh_child import faults
from urdfcal.output.view.mesh_files import MeshFiles, Textures
from urdfcal.output.view.shape_sizes import LARGEST, grey_where_no_colour, pass_over_textures, size_fault
from urdfcal.robot.pinocchio_model import without_its_source
from urdfcal.robot.rig import lasers_by_name
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_xml import for_pinocchio, read_xml

_Reasons = dict[str, list[str]]  # why something is not shown, by what is said of its kind
_BODY, _RAIL, _MODULE, _LASER = (0.62, 0.67, 0.73, 1.0), (0.42, 0.46, 0.52, 1.0), (0.25, 0.25, 0.28, 1.0), (0.8, 0.1, 0.1, 1.0)
_LONGEST_RAIL = 12.0  # [m]; a prismatic joint that goes farther has no limits worth drawing
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
        warnings: What is not shown as the description has it, one for each kind.
        textures: The pictures of each Collada file, by its path; None where it is drawn without colours.
        lighter: The files that are shown with fewer triangles, by a path that may be no more.
    """

    model: Any
    links: tuple[str, ...]
    T_link_shape: tuple[SE3, ...]
    simple: tuple[str, ...]
    warnings: tuple[str, ...]
    textures: Mapping[str, Textures | None]
    lighter: Mapping[str, bytes] = field(default_factory=dict)

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
    root, files = read_xml(robot.description.text), MeshFiles(robot.description)
    _remove_sheet(root, robot)
    pass_over_textures(root)
    grey = grey_where_no_colour(root)
    bare, reasons = _only_drawable(root, files)
    unreadable, named = "", _named(root)
    with light_meshes(root, files.triangles) as lighter:
        textures = {new: files.textures.get(old) for old, new in zip(named, _named(root), strict=True)}
        bare |= _remove_unreadable(root, reasons)
        try:
            model = _from_urdf(robot, root)
            bare |= _without_endless(robot, model, reasons)
        except (ValueError, RuntimeError) as error:
            model, bare = pin.GeometryModel(), set(robot.tree.links)
            unreadable = f"the robot is drawn by simple shapes, since its meshes cannot be read: {without_its_source(str(error))}"
    rig = {robot.rig.base, robot.rig.tip, *robot.rig.lasers} if robot.rig.lasers else set()
    drawn = {robot.model.frames[shape.parentFrame].name for shape in model.geometryObjects}
    simple = bare if drawn - rig else set(robot.tree.links)
    add_simple(robot, model, simple - rig, set(rig) - drawn)
    _add_rails(robot, model, set(robot.tree.links) - drawn)
    frames = [robot.model.frames[shape.parentFrame] for shape in model.geometryObjects]
    own = tuple(frame.placement.actInv(shape.placement) for frame, shape in zip(frames, model.geometryObjects, strict=True))
    reasons = {**reasons, "meshes are drawn without colours": files.refused_textures}
    warnings = (unreadable,) if unreadable else _said(reasons, grey)
    return Shapes(model, tuple(frame.name for frame in frames), own, tuple(sorted(simple)), warnings, textures, lighter)


def _named(root: etree._Element) -> list[str]:
    """The files of all meshes."""
    return [mesh.get("filename", "") for mesh in root.iterfind("link/visual/geometry/mesh")]


def _said(reasons: _Reasons, grey: int) -> tuple[str, ...]:
    """One line for each kind of what is not shown."""
    lines = [f"{len(all_of_it)} {kind}, the first because {all_of_it[0]}" for kind, all_of_it in reasons.items() if all_of_it]
    return (*lines, *([f"{grey} colours are drawn grey: an rgba is four numbers from 0 to 1"] if grey else []))


def _remove_sheet(root: etree._Element, robot: Robot) -> None:
    for link in root.findall("link"):
        for visual in link.findall("visual") if link.get("name") == _sheet(robot) else ():
            link.remove(visual)


def _without_endless(robot: Robot, model: Any, reasons: _Reasons) -> set[str]:
    """Take out meshes with corners that are no numbers or too far away, and give their links back."""
    import coal

    bare: set[str] = set()
    for shape in [each for each in model.geometryObjects if isinstance(each.geometry, coal.BVHModelBase)]:
        corners = shape.geometry.vertices()
        if not (np.abs(corners) < LARGEST).all():
            link = robot.model.frames[shape.parentFrame].name
            bare.add(link)
            reasons["shapes are left out"].append(f"link '{link}': its mesh has corners that are no numbers or beyond {LARGEST:g} m")
            model.removeGeometryObject(shape.name)
    return bare


def _sheet(robot: Robot) -> str:
    """The link of the screen, also where this robot is measured without it: then the sheet would only be in the way.

    The empty string for a robot without lasers: what is named `screen` there is its own.
    """
    default = "screen" if lasers_by_name(robot.tree) else ""
    return robot.rig.base if robot.rig.lasers else robot.screen or default


def _only_drawable(root: etree._Element, files: MeshFiles) -> tuple[set[str], _Reasons]:
    """Name every mesh by its file; visuals that cannot be shown go, and their links are given back, with the reasons by kind."""
    bare: set[str] = set()
    reasons: _Reasons = {"meshes are drawn as simple shapes": [], "shapes are left out": []}
    for link in root.findall("link"):
        name = link.get("name", "")
        for visual in link.findall("visual"):
            mesh = visual.find("geometry/mesh")
            try:
                if fault := size_fault(visual):
                    raise RobotError(f"link '{name}': {fault}")
                if mesh is not None:
                    mesh.set("filename", str(files.find(mesh.get("filename", ""))))
            except RobotError as error:
                link.remove(visual)
                bare.add(name)
                reasons["shapes are left out" if fault else "meshes are drawn as simple shapes"].append(str(error))
        for collision in link.findall("collision"):
            link.remove(collision)
    return bare, reasons


def _from_urdf(robot: Robot, root: etree._Element) -> Any:
    with native_stderr():  # of shapes that it passes over, and simple ones stand for
        return pin.buildGeomFromUrdfString(robot.model, for_pinocchio(root, shapes=True), pin.GeometryType.VISUAL)


def _remove_unreadable(root: etree._Element, reasons: _Reasons) -> set[str]:
    """Take out the meshes that Assimp cannot read, and give their links back."""
    meshes = [
        (link, visual, Path(mesh.get("filename", "")))
        for link in root.findall("link")
        for visual in link.findall("visual")
        for mesh in visual.findall("geometry/mesh")
    ]
    unreadable, bare = faults(path for _, _, path in meshes), set[str]()
    for link, visual, path in meshes:
        if path in unreadable:
            link.remove(visual)
            bare.add(link.get("name", ""))
            why = without_its_source(unreadable[path]).removesuffix("Hint: the mesh directory may be wrong.")
            reasons["meshes are drawn as simple shapes"].append(f"{path.name} cannot be read: {why.strip()}")
    return bare


def add_simple(robot: Robot, model: Any, links: set[str], rig: set[str]) -> None:
    """Cylinders about joints, capsules between joints, and a box and barrels for a module and lasers without shapes."""
    import coal

    radius = _radius(robot)
    for joint in robot.tree.joints.values():
        if joint.child in links and joint.moves:
            about = _z_to(np.array(joint.axis), np.zeros(3))
            _add(robot, model, joint.child, "joint", coal.Cylinder(1.3 * radius, 4 * radius), about, _BODY)
        reach = float(np.linalg.norm(joint.origin.translation))
        if joint.parent in links and reach > radius and joint.child != _sheet(robot):
            between = _z_to(joint.origin.translation, joint.origin.translation / 2)
            _add(robot, model, joint.parent, f"to_{joint.child}", coal.Capsule(radius, reach), between, _BODY)
    if robot.rig.tip in rig:
        _add(robot, model, robot.rig.tip, "box", coal.Box(0.03, 0.06, 0.02), pin.SE3(np.eye(3), np.array([0, 0, -0.01])), _MODULE)
    for laser in (laser for laser in robot.rig.lasers if laser in rig):
        _add(robot, model, laser, "barrel", coal.Cylinder(0.004, 0.04), pin.SE3(np.eye(3), np.array([0, 0, 0.02])), _LASER)


def _add_rails(robot: Robot, model: Any, links: set[str]) -> None:
    """A rail along each joint that slides on one of these links, which have no shape of their own, as far as its limits."""
    import coal

    for joint in robot.tree.joints.values():
        length = joint.upper - joint.lower
        if joint.parent not in links or not joint.prismatic or not 0 < length < _LONGEST_RAIL:
            continue
        axis = np.array(joint.axis)
        rail = joint.origin * _z_to(axis, (joint.lower + joint.upper) / 2 * axis)
        _add(robot, model, joint.parent, f"rail_{joint.child}", coal.Capsule(0.6 * _radius(robot), length), rail, _RAIL)


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
