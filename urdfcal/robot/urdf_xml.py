"""A URDF as XML: read whatever prefixes it leaves undeclared, and pared down to what Pinocchio's reader needs and can take.

One rule for numbers: each is finite, and none is beyond `FARTHEST`. Where the kinematics hang on it (a joint), the file is refused; what
a link weighs or looks like is kept out as a whole where one of its numbers is no such number, and that is said.
"""

from __future__ import annotations

import math
import re
import sys
from copy import deepcopy

from lxml import etree

_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
FARTHEST = 1e6  # [m], [rad] and [kg]: a number beyond this belongs to no robot, and overflows further on
_NAMED = 3  # links in a warning
_BESIDE = ("inertial", "visual", "collision")  # under <link>
_MEASURES = ("xyz", "rpy", "value", "size", "radius", "length", "scale", "ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_LIMITED = ("revolute", "prismatic")
_NO_LIMIT = repr(sys.float_info.max)  # the reader takes no infinity
_READ = ("link", "joint", "material")  # under <robot>
_IN_ATTRIBUTES = str.maketrans({"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;", "\n": "&#10;", "\r": "&#13;", "\t": "&#9;"})
_UNUSED = ("safety_controller", "calibration")  # under <joint>; the reader refuses the whole robot where they are not whole


def read_xml(text: bytes) -> etree._Element:
    """The root of an XML document without its comments; an undeclared prefix is a part of the name, as it is to urdfdom.

    Raises:
        etree.XMLSyntaxError: it is not well-formed.
    """
    try:
        return etree.fromstring(text, _parser(recover=False))
    except etree.XMLSyntaxError:
        parser = _parser(recover=True)
        root: etree._Element | None = etree.fromstring(text, parser)
        faults = parser.error_log.filter_from_errors()
        if root is None or any(fault.domain != etree.ErrorDomains.NAMESPACE for fault in faults):
            raise
        return root


def _parser(*, recover: bool) -> etree.XMLParser:
    return etree.XMLParser(resolve_entities=False, no_network=True, remove_comments=True, recover=recover)


def finite_number(text: str | None) -> float | None:
    """A number as a URDF writes it; None for anything else."""
    if text is None or not _NUMBER.fullmatch(text) or not math.isfinite(float(text)):
        return None
    return float(text)


def number_fault(word: str) -> str | None:
    """What keeps a word from being a number of a robot; None for one that is."""
    value = finite_number(word)
    if value is None:
        return f"'{word}' is not a finite number"
    return f"'{word}' is beyond {FARTHEST:g}" if abs(value) > FARTHEST else None


def quoted(text: str) -> str:
    """Text as the value of an attribute; `saxutils` does the same, and brings all of `urllib` with it."""
    return f'"{text.translate(_IN_ATTRIBUTES)}"'


def left_out(root: etree._Element) -> dict[etree._Element, str]:
    """What links weigh and look like, where a number of it is none: the `<inertial>`, `<visual>` or `<collision>`, and why."""
    beside = [(link, element) for link in root.iterfind("link") for tag in _BESIDE for element in link.findall(tag)]
    faults = {element: (link, fault) for link, element in beside if (fault := _first_fault(element))}
    return {
        element: f"link '{link.get('name')}': the <{element.tag}> on line {element.sourceline} is left out: {fault}"
        for element, (link, fault) in faults.items()
    }


def in_few_lines(root: etree._Element) -> tuple[str, ...]:
    """What `left_out` says, a line for each fault: of one link as it is, of several how many and the first of them."""
    found: dict[tuple[str, str], list[tuple[etree._Element, str]]] = {}
    for element, line in left_out(root).items():
        found.setdefault((element.tag, line.partition(" is left out: ")[2]), []).append((element, line))
    return tuple(own[0][1] if len(own) == 1 else _summed(*what, [element for element, _ in own]) for what, own in found.items())


def _summed(tag: str, fault: str, elements: list[etree._Element]) -> str:
    parents = [element.getparent() for element in elements]
    links = list(dict.fromkeys(f"'{link.get('name')}'" for link in parents if link is not None))
    more = f" and {len(links) - _NAMED} more" if len(links) > _NAMED else ""
    whose = f"link{'s' if len(links) > 1 else ''} {', '.join(links[:_NAMED])}{more}"
    return f"{len(elements)} <{tag}>, the first on line {elements[0].sourceline}, of {whose} are left out: {fault}"


def _first_fault(element: etree._Element) -> str | None:
    for part in element.iter(etree.Element):
        for name in _MEASURES:
            for word in part.get(name, "").split():
                if fault := number_fault(word):
                    return f"{name}: {fault}"
    return None


def for_pinocchio(root: etree._Element, *, shapes: bool) -> str:
    """A URDF for Pinocchio's reader: the same links, joints and masses, without what it would refuse and nobody here asks it for.

    Efforts and velocities that are none, or below zero as in many descriptions without a limit, become no limit.

    Args:
        root: The whole URDF; left unchanged.
        shapes: Whether visual and collision shapes are wanted.
    """
    pared = deepcopy(root)
    for element in left_out(pared):
        if (above := element.getparent()) is not None:
            above.remove(element)
    for name in set(pared.attrib) - {"name"}:  # a version, say
        del pared.attrib[name]
    for element in list(pared):
        if element.tag not in _READ:
            pared.remove(element)
    for joint in pared.iterfind("joint"):
        _pare_joint(joint)
    for link in () if shapes else pared.iterfind("link"):
        _remove(link, "visual", "collision")
    return etree.tostring(pared, encoding="unicode", with_tail=False)  # without the declaration of an encoding


def _pare_joint(joint: etree._Element) -> None:
    _remove(joint, *_UNUSED)
    for limit in joint.findall("limit"):
        for name in ("effort", "velocity"):
            limit.set(name, _magnitude(limit.get(name)) or _NO_LIMIT)
        for name in () if joint.get("type") in _LIMITED else ("lower", "upper"):
            limit.attrib.pop(name, "")
    for dynamics in joint.findall("dynamics"):
        stated = {name: text for name in ("damping", "friction") if (text := _magnitude(dynamics.get(name)))}
        dynamics.attrib.clear()
        for name, text in stated.items():
            dynamics.set(name, text)
        if not stated:
            joint.remove(dynamics)


def _magnitude(text: str | None) -> str | None:
    """A finite number that is not below zero, as its text; None for anything else."""
    stripped = (text or "").strip()
    number = finite_number(stripped)
    return None if number is None or number < 0 else stripped


def _remove(element: etree._Element, *tags: str) -> None:
    for tag in tags:
        for child in element.findall(tag):
            element.remove(child)
