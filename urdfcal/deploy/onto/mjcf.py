"""MuJoCo's MJCF: bodies and sites with joints inside them.

A body stands at P in the one above, and its joints move it one after the other, each about an axis that is told in the body's own frame
and displaced by q - ref:

    T_body(q) = T_above P M_1(q_1 - ref_1) ... M_k(q_k - ref_k) = exp(q_1 - ref_1) ... in base axes S_i, times T_above P

So with motions G of what each joint carries, S_i' = G_i S_i, and P follows from where the body has to be at zero:

    T_above' P' = exp(ref_1 S_1') ... exp(ref_k S_k') G_k T_body(0)

Shapes, inertias and all else under a body are told in its frame and go with it as they stand.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pinocchio as pin

from urdfcal.base.geometry import SE3, Vector, Z
from urdfcal.deploy.onto.mjcf_files import MjcfFiles
from urdfcal.deploy.onto.model import Called, MovingJoint, OtherModel, Placed, same_name
from urdfcal.deploy.onto.orientations import WAYS, read_rotation, written
from urdfcal.deploy.onto.text import Edit, Element
from urdfcal.deploy.onto.zero import Axis

_TAGS = ("body", "site", "frame")
_STAYS = 1e-13


@dataclass(frozen=True)
class _Joint:
    element: Element
    name: str  # as the URDF has it
    moves: bool
    ref: float
    axis: Axis  # in the model's base at zero


@dataclass(eq=False)
class _Node:
    """A body, site or frame, its placement in the one above, and where it stands at zero."""

    element: Element
    attributes: dict[str, str]
    above: _Node | None
    placement: SE3
    T_model_own: SE3
    joints: list[_Joint] = field(default_factory=list)

    @property
    def moved_by(self) -> tuple[str, ...]:
        own = tuple(joint.name if joint.moves else "" for joint in self.joints)
        return (*(self.above.moved_by if self.above else ()), *own)


class Mjcf(OtherModel):
    """An MJCF model that was read."""

    kind = "mjcf"

    def __init__(self, files: MjcfFiles, called: Called = same_name) -> None:
        self.files, self.called = files, called
        self.angles, self.defaults = files.angles(), files.defaults()
        if files.main.root.tag != "mujoco":
            raise files.main.root.fail(f"found <{files.main.root.tag}>, expected <mujoco>, as MJCF has it")
        self.nodes: list[_Node] = []
        for world in files.children(files.main.root, "worldbody"):
            self._read(world, None, world.attributes.get("childclass", ""))
        self.joints = {}
        for node in self.nodes:
            for index, joint in enumerate(node.joints):
                if joint.moves and joint.name:
                    count = len(node.moved_by) - len(node.joints) + index
                    self.joints[joint.name] = MovingJoint(joint.name, joint.axis, node.T_model_own, joint.element, node.moved_by[:count])

    def texts(self) -> Mapping[Path, bytes]:
        """The files that it consists of; the one that was named first."""
        return {path: document.text for path, document in self.files.documents.items()}

    def placed(self) -> Iterable[Placed]:
        """Bodies without a joint of their own, and sites."""
        for node in self.nodes:
            if node.element.tag != "frame" and not any(joint.moves for joint in node.joints):
                yield Placed(
                    node.element, (self.called(node.element.name), node.element.name), tuple(filter(None, node.moved_by)), node.T_model_own
                )

    def _read(self, element: Element, above: _Node | None, childclass: str) -> None:
        for child in self.files.children(element):
            if child.tag == "replicate":
                if named := next((own for own in child.walk() if own.tag == "joint" and own.name), None):
                    raise named.fail(f"joint '{named.name}' stands in a <replicate>, which makes several of it; write its body out")
            elif child.tag in _TAGS:
                self._read_node(child, above, childclass)

    def _read_node(self, element: Element, above: _Node | None, childclass: str) -> None:
        attributes = self.defaults.attributes(element, childclass) if element.tag == "site" else element.attributes
        position = element.numbers(attributes.get("pos", "0 0 0"), (3,), "pos")
        placement = pin.SE3(read_rotation(element, attributes, self.angles), position)
        T_model_own = above.T_model_own * placement if above else placement
        node = _Node(element, attributes, above, placement, T_model_own)
        self.nodes.append(node)
        childclass = element.attributes.get("childclass", childclass)
        if element.tag == "body":
            for child in self._inside(element, childclass):
                node.joints.append(self._joint(child[0], child[1], node))
        self._read(element, node, childclass)

    def _inside(self, element: Element, childclass: str) -> Iterator[tuple[Element, str]]:
        """Joints of a body, each with the class that holds for it."""
        for child in self.files.children(element, "joint", "freejoint", "frame"):
            if child.tag != "frame":
                yield child, childclass
            elif joint := next((own for own in child.all("joint", "freejoint")), None):
                raise joint.fail(f"joint '{joint.name}' stands in a <frame>; put it right under its body")

    def _joint(self, element: Element, childclass: str, node: _Node) -> _Joint:
        said = self.defaults.attributes(element, childclass)
        kind = "free" if element.tag == "freejoint" else said.get("type", "hinge")
        moves, slides = kind in ("hinge", "slide"), kind == "slide"
        direction = element.numbers(said.get("axis", "0 0 1"), (3,), "axis") if moves else Z
        length = float(np.linalg.norm(direction))
        if length < 1e-10:
            raise element.fail(f"joint '{element.name}': axis: has no length")
        point = element.numbers(said.get("pos", "0 0 0"), (3,), "pos")
        ref = float(element.numbers(said.get("ref", "0"), (1,), "ref")[0]) * (1.0 if slides else self.angles.unit) if moves else 0.0
        axis = Axis(point, direction / length, slides).moved(node.T_model_own)
        node.T_model_own = axis.motion(-ref) * node.T_model_own
        return _Joint(element, self.called(element.name), moves, ref, axis)

    def edits(self, follows: Mapping[str, SE3], named: Mapping[Element, SE3]) -> list[Edit]:
        """Numbers that move everything."""
        motions: dict[_Node | None, SE3] = {None: pin.SE3.Identity()}
        after: dict[_Node | None, SE3] = {None: pin.SE3.Identity()}
        edits: list[Edit] = []
        for node in self.nodes:
            carried = [joint.name for joint in node.joints if joint.name in follows]
            own = follows[carried[-1]] if carried else named.get(node.element)
            motions[node] = motions[node.above] if own is None else own
            after[node] = motions[node] * node.T_model_own
            axes = [joint.axis.moved(follows.get(joint.name, motions[node])) for joint in node.joints]
            start = after[node]
            for joint, axis in zip(reversed(node.joints), reversed(axes), strict=True):
                start = axis.motion(joint.ref) * start
            edits += self._place(node, after[node.above].actInv(start))
            edits += self._axes(node, axes, start)
        return edits

    def _axes(self, node: _Node, axes: list[Axis], T_model_start: SE3) -> Iterator[Edit]:
        """Axes that the body does not take along: those of its joints before the last, where a correction stands between two."""
        before = node.above.T_model_own * node.placement if node.above else node.placement
        for joint, axis in zip(node.joints, axes, strict=True):
            new, old = axis.moved(T_model_start.inverse()), joint.axis.moved(before.inverse())
            values = {}
            if np.abs(new.direction - old.direction).max() > _STAYS:
                values["axis"] = new.direction
            if np.abs(new.point - old.point).max() > _STAYS and not joint.axis.slides:
                values["pos"] = new.point
            if values and joint.moves:
                yield from self._of(joint.element, values)
            T_model_start = axis.motion(-joint.ref) * T_model_start
            before = joint.axis.motion(-joint.ref) * before

    def _place(self, node: _Node, placement: SE3) -> list[Edit]:
        difference = node.placement.actInv(placement)
        values: dict[str, Vector] = {}
        gone: list[str] = []
        if np.abs(placement.translation - node.placement.translation).max() > _STAYS:
            values["pos"] = np.array(placement.translation)
        if np.abs(difference.rotation - np.eye(3)).max() > _STAYS:
            stated = next((way for way in WAYS if way in node.attributes), "quat")
            way, numbers = written(stated, placement.rotation, self.angles)
            values[way] = numbers
            gone = [stated] if way != stated else []
        return self._of(node.element, values, gone) if values else []

    def _of(self, element: Element, values: dict[str, Vector], gone: Iterable[str] = ()) -> list[Edit]:
        return self.files.documents[element.path].with_attributes(element, values, gone)
