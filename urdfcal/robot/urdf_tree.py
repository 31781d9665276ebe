"""The links and joints that a URDF declares, with the lines they stand on, checked before Pinocchio sees them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from lxml import etree

from urdfcal.base.errors import RobotError, no_such
from urdfcal.base.geometry import SE3, pose
from urdfcal.robot.description import Description
from urdfcal.robot.urdf_xml import FARTHEST, finite_number, in_few_lines, number_fault, read_xml

MOVING = ("revolute", "continuous", "prismatic")
_KINEMATIC = {"robot", "link", "joint", "origin", "parent", "child", "axis", "limit", "mimic"}
_TYPES = (*MOVING, "fixed", "floating", "planar")
_OF_THE_RIG = re.compile(r"slm|screen|laser_\d+")


@dataclass(frozen=True)
class Mimic:
    """This joint moves as `multiplier * (joint's position) + offset`."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class UrdfJoint:
    """One `<joint>`; lengths in metres, angles in radians.

    Attributes:
        lower, upper: Limits; a continuous joint has -inf and inf.
        line: Where the joint stands in the text.
    """

    name: str
    type: str
    parent: str
    child: str
    xyz: tuple[float, ...]
    rpy: tuple[float, ...]
    axis: tuple[float, ...]
    lower: float
    upper: float
    mimic: Mimic | None
    line: int

    @property
    def moves(self) -> bool:
        """Whether the joint has a degree of freedom that urdfcal can handle."""
        return self.type in MOVING

    @property
    def rigid(self) -> bool:
        """Whether the joint holds its child fast; one that floats neither does so nor counts as moving."""
        return self.type == "fixed"

    @property
    def prismatic(self) -> bool:
        """Whether the joint slides."""
        return self.type == "prismatic"

    @cached_property
    def origin(self) -> SE3:
        """Placement of the joint's frame in its parent link."""
        return pose(np.array(self.xyz), np.array(self.rpy))


@dataclass(frozen=True)
class UrdfTree:
    """Links and joints of a robot, known to be one tree.

    Attributes:
        label: The file, for messages.
        links: Names, in the file's order.
        joints: By name, in the file's order.
        warnings: What links weigh and look like that is left out, since its numbers are none.
    """

    label: str
    links: tuple[str, ...]
    joints: dict[str, UrdfJoint]
    warnings: tuple[str, ...] = ()

    @cached_property
    def by_child(self) -> dict[str, UrdfJoint]:
        """The joint that carries each link; the root has none."""
        return {joint.child: joint for joint in self.joints.values()}

    @cached_property
    def root(self) -> str:
        """The link that no joint carries."""
        return next(link for link in self.links if link not in self.by_child)

    @cached_property
    def last_link(self) -> str:
        """The link that most joints move, and of those the one at the end of the longest way: what a tool or a target is probably on."""
        ways = {name: self.path_from_root(name) for name in self.links}
        return max(ways, key=lambda name: (sum(joint.moves for joint in ways[name]), len(ways[name])))

    def require_link(self, name: str) -> str:
        """The name back, if there is such a link.

        Raises:
            RobotError: there is none; names the nearest.
        """
        if name not in self.links:
            raise RobotError(no_such("link", name, self.links), self.label)
        return name

    def path_from_root(self, link: str) -> list[UrdfJoint]:
        """The joints between the root and a link, root first."""
        path: list[UrdfJoint] = []
        while link in self.by_child:
            path.append(self.by_child[link])
            link = path[-1].parent
        return path[::-1]

    def moving_link(self, link: str) -> str:
        """The link nearest to the root that is rigidly joined to this one."""
        while link in self.by_child and self.by_child[link].rigid:
            link = self.by_child[link].parent
        return link


def _line(element: etree._Element) -> int | None:
    """The line that an element stands on."""
    line: Any = element.sourceline  # its type stub knows nothing of numbers
    return None if line is None else int(line)


def read_tree(description: Description) -> UrdfTree:
    """Read and check the kinematic part of a URDF.

    Raises:
        RobotError: with the line and joint or link, what was found and what was expected.
    """
    reader = _Reader(description.label)
    root = reader.parse(description.text)
    links = reader.names(root, "link")
    if not links:
        raise RobotError("there is no <link> under <robot>", description.label)
    reader.names(root, "joint")
    joints = {joint.name: joint for joint in map(reader.joint, root.findall("joint"))}
    reader.check_tree(links, joints)
    return UrdfTree(description.label, links, joints, in_few_lines(root))


@dataclass(frozen=True)
class _Reader:
    """Parses elements; knows only the file's name, for messages."""

    label: str

    def fail(self, message: str, line: int | None) -> RobotError:
        return RobotError(message, self.label, line)

    def parse(self, text: bytes) -> etree._Element:
        try:
            root = read_xml(text)
        except etree.XMLSyntaxError as error:
            raise self.fail(f"not well-formed XML: {error.msg}", error.lineno) from None
        self.refuse_namespace(root)
        if root.tag != "robot":
            raise self.fail(f"the document is a <{root.tag}>, expected a URDF with <robot>", _line(root))
        if not root.get("name"):
            raise self.fail('<robot> has no name; expected <robot name="...">', _line(root))
        return root

    def refuse_namespace(self, root: etree._Element) -> None:
        """Readers of URDF disagree on what an element in a default namespace is."""
        for element in (root, *root, *root.iterfind("joint/*")):
            if not isinstance(element.tag, str) or not element.tag.startswith("{") or element.prefix is not None:
                continue
            name = etree.QName(element)
            if name.localname in _KINEMATIC:
                raise self.fail(
                    f"<{name.localname}> is in the default namespace '{name.namespace}', expected none; remove xmlns=\"...\"",
                    _line(element),
                )

    def names(self, root: etree._Element, tag: str) -> tuple[str, ...]:
        seen: dict[str, int | None] = {}
        for element in root.findall(tag):
            name = self.attribute(element, "name", f"<{tag}>")
            if name in seen:
                way_out = (
                    "; the macros of robots/slm.urdf.xacro take other names, or a prefix"
                    if tag == "link" and _OF_THE_RIG.fullmatch(name)
                    else ""
                )
                raise self.fail(f"{tag} '{name}' is declared twice, first on line {seen[name]}{way_out}", _line(element))
            seen[name] = _line(element)
        return tuple(seen)

    def attribute(self, element: etree._Element, name: str, who: str) -> str:
        value = element.get(name)
        if not value:
            raise self.fail(f"{who} has no {name}", _line(element))
        return value

    def joint(self, element: etree._Element) -> UrdfJoint:
        name = element.get("name", "")
        who, line = f"joint '{name}'", _line(element) or 0
        kind = self.attribute(element, "type", who)
        if kind not in _TYPES:
            raise self.fail(f"{who}: type '{kind}' is not one of {', '.join(_TYPES)}", line)
        origin, axis = self.one(element, "origin", who), self.one(element, "axis", who)
        lower, upper = self.limits(element, kind, who)
        return UrdfJoint(
            name=name,
            type=kind,
            parent=self.link_of(element, "parent", who),
            child=self.link_of(element, "child", who),
            xyz=self.triple(origin, "xyz", who, (0.0, 0.0, 0.0)),
            rpy=self.triple(origin, "rpy", who, (0.0, 0.0, 0.0)),
            axis=self.direction(axis, who) if kind in MOVING else (1.0, 0.0, 0.0),
            lower=lower,
            upper=upper,
            mimic=self.mimic(element, who),
            line=line,
        )

    def one(self, element: etree._Element, tag: str, who: str) -> etree._Element | None:
        found = element.findall(tag)
        if len(found) > 1:
            raise self.fail(f"{who} has {len(found)} <{tag}>, expected one", _line(found[1]))
        return found[0] if found else None

    def link_of(self, element: etree._Element, tag: str, who: str) -> str:
        found = self.one(element, tag, who)
        if found is None:
            raise self.fail(f"{who} has no <{tag} link=...>", _line(element))
        return self.attribute(found, "link", f"{who}: <{tag}>")

    def triple(self, element: etree._Element | None, name: str, who: str, default: tuple[float, ...]) -> tuple[float, ...]:
        text = None if element is None else element.get(name)
        if element is None or text is None:
            return default
        words = text.split()
        if len(words) != 3:
            raise self.fail(f'{who}: {name}="{text}" has {len(words)} numbers, expected 3', _line(element))
        return tuple(self.near(word, f'{who}: {name}="{text}"', _line(element)) for word in words)

    def number(self, word: str, who: str, line: int | None) -> float:
        value = finite_number(word)
        if value is None:
            raise self.fail(f"{who}: '{word}' is not a finite number", line)
        return value

    def near(self, word: str, who: str, line: int | None) -> float:
        if fault := number_fault(word):
            raise self.fail(f"{who}: {fault}; expected metres and radians" if finite_number(word) else f"{who}: {fault}", line)
        return float(word)

    def direction(self, element: etree._Element | None, who: str) -> tuple[float, ...]:
        axis = self.triple(element, "xyz", who, (1.0, 0.0, 0.0))
        length = math.hypot(*axis)
        if not length > 1e-6:
            raise self.fail(
                f"{who}: the axis has no length, expected a direction such as 0 0 1", None if element is None else _line(element)
            )
        return tuple(component / length for component in axis)

    def limits(self, element: etree._Element, kind: str, who: str) -> tuple[float, float]:
        found = self.one(element, "limit", who)
        if kind not in ("revolute", "prismatic"):
            return -math.inf, math.inf
        if found is None:
            way_out = ", or make it continuous" if kind == "revolute" else ""
            raise self.fail(f"{who} is {kind} and has no <limit>; add lower, upper, effort and velocity{way_out}", _line(element))
        lower, upper = (self.number(found.get(name, "0"), f"{who}: <limit> {name}", _line(found)) for name in ("lower", "upper"))
        if lower > upper:
            raise self.fail(f"{who}: its lower limit {lower:g} is above its upper limit {upper:g}", _line(found))
        return max(lower, -FARTHEST), min(upper, FARTHEST)

    def mimic(self, element: etree._Element, who: str) -> Mimic | None:
        found = self.one(element, "mimic", who)
        if found is None:
            return None
        values = [
            self.near(found.get(name, default), f"{who}: <mimic> {name}", _line(found))
            for name, default in (("multiplier", "1"), ("offset", "0"))
        ]
        return Mimic(self.attribute(found, "joint", f"{who}: <mimic>"), *values)

    def check_tree(self, links: tuple[str, ...], joints: dict[str, UrdfJoint]) -> None:
        carried_by: dict[str, UrdfJoint] = {}
        for joint in joints.values():
            for end in (joint.parent, joint.child):
                if end not in links:
                    raise self.fail(f"joint '{joint.name}': {no_such('link', end, links)}", joint.line)
            if joint.child in carried_by:
                raise self.fail(
                    f"link '{joint.child}' is the child of two joints, '{carried_by[joint.child].name}' and '{joint.name}'", joint.line
                )
            carried_by[joint.child] = joint
            self.check_mimic(joint, joints)
        roots = [link for link in links if link not in carried_by]
        if len(roots) > 1:
            raise self.fail(f"{len(roots)} links have no parent joint ({', '.join(roots[:5])}), expected one root", None)
        self.check_no_loop(links, carried_by)

    def check_mimic(self, joint: UrdfJoint, joints: dict[str, UrdfJoint]) -> None:
        for leader in self.leaders(joint, joints):
            if leader == joint.name:
                raise self.fail(f"joint '{joint.name}' mimics itself", joint.line)
            if joint.moves and not joints[leader].moves:
                raise self.fail(f"joint '{joint.name}' mimics '{leader}', which is {joints[leader].type} and has no position", joint.line)

    def leaders(self, joint: UrdfJoint, joints: dict[str, UrdfJoint]) -> Iterator[str]:
        seen: set[str] = set()
        while joint.mimic is not None and joint.name not in seen:
            seen.add(joint.name)
            if joint.mimic.joint not in joints:
                raise self.fail(f"joint '{joint.name}' mimics: {no_such('joint', joint.mimic.joint, joints)}", joint.line)
            joint = joints[joint.mimic.joint]
            yield joint.name

    def check_no_loop(self, links: tuple[str, ...], carried_by: dict[str, UrdfJoint]) -> None:
        grounded: set[str] = {link for link in links if link not in carried_by}
        for link in links:
            trail: list[str] = []
            while link not in grounded:
                if link in trail:
                    raise self.fail(f"joint '{carried_by[link].name}' closes a loop; expected a tree", carried_by[link].line)
                trail.append(link)
                link = carried_by[link].parent
            grounded.update(trail)
