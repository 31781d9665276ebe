"""What may collide: a robot's shapes, its meshes as convex hulls, by the link that each belongs to.

A link is as large as its <collision> shapes, or its <visual> ones where it has no others. Meshes come from strangers' files: each is
looked at and first read in a process of its own, as those of the view are, and what is refused there is not read here.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from lxml import etree

from urdfcal.base.errors import RobotError
from urdfcal.base.geometry import SE3
from urdfcal.base.native import native_stderr
from urdfcal.output.view.mesh_child import faults
from urdfcal.output.view.mesh_files import MeshFiles
from urdfcal.output.view.shape_sizes import LARGEST, size_fault
from urdfcal.output.view.shapes import add_simple
from urdfcal.robot.pinocchio_model import without_its_source
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_xml import for_pinocchio, read_xml


@dataclass
class Bodies:
    """Shapes on a robot's model.

    Attributes:
        model: A Pinocchio geometry model, without pairs.
        exact: Meshes that stand in it as their hulls, by the shape's name.
        links: Of the description, that the shapes belong to; what is not of the robot is not among them.
        warnings: What is not as the description has it.
    """

    model: Any
    exact: dict[str, Any] = field(default_factory=dict)
    links: dict[str, str] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)

    def add(self, robot: Robot, link: str, name: str, T_link_shape: SE3, form: Any) -> None:
        """Put one more shape on a link."""
        index = robot.model.getFrameId(link, pin.FrameType.BODY)
        frame = robot.model.frames[index]
        solid = hull(form)
        self.model.addGeometryObject(pin.GeometryObject(name, frame.parentJoint, index, frame.placement * T_link_shape, solid))
        if solid is not form:
            self.exact[name] = form


def bodies_of(robot: Robot) -> Bodies:
    """The shapes of a robot; links whose meshes are missing, and all where there are no shapes at all, are taken as simple shapes."""
    root = read_xml(robot.description.text)
    reasons = _only_usable(root, MeshFiles(robot.description))
    try:
        with native_stderr():
            drawn = pin.buildGeomFromUrdfString(robot.model, for_pinocchio(root, shapes=True), pin.GeometryType.COLLISION)
    except (ValueError, RuntimeError) as error:
        raise RobotError(f"its shapes cannot be read: {without_its_source(str(error))}", robot.description.label) from None
    bodies = Bodies(pin.GeometryModel())
    for shape in drawn.geometryObjects:
        frame = robot.model.frames[shape.parentFrame]
        if _endless(shape.geometry):
            reasons[frame.name].append("its mesh has no corners, or some that are no numbers or too far away")
            continue
        bodies.add(robot, frame.name, shape.name, frame.placement.actInv(shape.placement), shape.geometry)
        bodies.links[shape.name] = frame.name
    rig = {robot.rig.base, robot.rig.tip, *robot.rig.lasers} if robot.rig.lasers else set()
    bare = set(reasons) if set(bodies.links.values()) - rig else set(robot.tree.links)
    _stand_in(robot, bodies, bare - rig)
    if reasons:
        link, why = next(iter(reasons.items()))
        bodies.warnings.append(f"{len(reasons)} links collide as simple shapes, the first because {why[0]} (link '{link}')")
    elif bare - rig:
        bodies.warnings.append("the robot has no shapes: its links collide as simple ones between their joints")
    return bodies


def hull(form: Any) -> Any:
    """The convex hull of a mesh; what is no mesh, or so flat that it has none, is given back as it is."""
    if not isinstance(form, coal.BVHModelBase):
        return form
    try:
        form.buildConvexHull(True, "Qt")
    except (ValueError, RuntimeError):  # flat, or too few corners
        return form
    return form.convex


def mesh_from(path: Path, scale: Iterable[float]) -> Any:
    """A mesh whose file was looked at before, read.

    Raises:
        RobotError: it cannot be read, and why.
    """
    fault = faults([path]).get(path)
    if fault is None:
        with native_stderr():
            form = coal.MeshLoader().load(str(path), np.array(list(scale), dtype=float))
        fault = "it has no corners, or some that are no numbers or too far away" if _endless(form) else None
        if fault is None:
            return form
    raise RobotError(f"cannot be read: {without_its_source(fault)}")


def _endless(form: Any) -> bool:
    if not isinstance(form, coal.BVHModelBase):
        return False
    corners = form.vertices()
    return not (len(corners) and (np.abs(corners) < LARGEST).all())


def _only_usable(root: etree._Element, files: MeshFiles) -> dict[str, list[str]]:
    """Name meshes by their files, let visual shapes stand for collision ones that are not there; why shapes were taken out, by link."""
    reasons: dict[str, list[str]] = defaultdict(list)
    kept: list[tuple[str, etree._Element, Path]] = []
    for link in root.findall("link"):
        name = link.get("name", "")
        own = link.findall("collision") or link.findall("visual")
        for shape in [*link.findall("collision"), *link.findall("visual")]:
            link.remove(shape)
        for shape in own:
            shape.tag = "collision"
            mesh = shape.find("geometry/mesh")
            try:
                if fault := size_fault(shape):
                    raise RobotError(fault)
                if mesh is not None:
                    mesh.set("filename", str(files.find(mesh.get("filename", ""))))
                    kept.append((name, shape, Path(mesh.get("filename", ""))))
            except RobotError as error:
                reasons[name].append(str(error))
            else:
                link.append(shape)
    unreadable = faults(path for _, _, path in kept)
    for name, shape, path in kept:
        if path in unreadable:
            parent = shape.getparent()
            assert parent is not None  # a link
            parent.remove(shape)
            reasons[name].append(f"{path.name} cannot be read: {without_its_source(unreadable[path])}")
    return reasons


def _stand_in(robot: Robot, bodies: Bodies, links: set[str]) -> None:
    """Simple shapes for links that have lost theirs."""
    simple = pin.GeometryModel()
    add_simple(robot, simple, links, set())
    for shape in simple.geometryObjects:
        bodies.model.addGeometryObject(shape)
        bodies.links[shape.name] = robot.model.frames[shape.parentFrame].name
