"""Corrected origins, and new links, put into a URDF's own bytes: nothing but the numbers of xyz and rpy changes, or is added."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from xml.parsers import expat

import numpy as np

from urdfcal.base.errors import RobotError
from urdfcal.base.geometry import SE3, Vector, pose, xyz_rpy
from urdfcal.robot.description import Description
from urdfcal.robot.urdf_xml import quoted

_SAME = 1e-15  # a rotation or translation this close to the text's own keeps the text
_DUST = 1e-16
_BLANK = re.compile(rb"[ \t\r\n]*")
_ENCODING = re.compile(rb"""<\?xml[^>]*?encoding\s*=\s*["']([\w.-]+)["']""")
_INDENT = re.compile(rb"\n([ \t]+)<(?:link|joint)\b")
ATTRIBUTE = re.compile(rb"""\s([^\s=]+)\s*=\s*("[^"]*"|'[^']*')""")


@dataclass
class _JointSpan:
    """Where a joint's start tag and its origin's start tag stand in the bytes, and what the origin says."""

    tag: int
    origin: int | None = None
    stated: dict[str, str] = field(default_factory=dict)


def with_origins(description: Description, origins: Mapping[str, SE3]) -> bytes:
    """The description's text with new origins; everything else stays byte for byte.

    Args:
        description: URDF text.
        origins: New placement by joint name; an `<origin>` is created where there is none.

    Raises:
        RobotError: a joint is not in the text.
    """
    text = description.text
    spans = _joint_spans(text)
    edits: list[tuple[int, int, bytes]] = []
    for name, origin in origins.items():
        if name not in spans:
            raise RobotError(f"there is no joint '{name}' in the text", description.label)
        edits += _edits(text, spans[name], origin)
    for start, end, new in sorted(edits, reverse=True):
        text = text[:start] + new + text[end:]
    return text


def numbers(values: Vector) -> str:
    """Three numbers as a URDF has them, each with as many digits as bring the double back; rounding dust is written as 0."""
    return " ".join("0" if abs(value) < _DUST else repr(float(value)).removesuffix(".0") for value in values)


def with_elements(description: Description, elements: str, note: str, names: Mapping[str, str]) -> bytes:
    """The description's text with further links and joints before its end; everything else stays byte for byte.

    Args:
        description: URDF text.
        elements: What is added, as it stands right under <robot>, in lines, two blanks deeper each level.
        note: A comment that stands before it.
        names: Links that are named otherwise in the elements, as they are called there.
    """
    text = description.text
    for meanwhile, name in names.items():
        elements = elements.replace(f'link="{meanwhile}"', f"link={quoted(name)}")
    lines = [f"  <!-- {note} -->", *elements.splitlines()]
    indent, end = _INDENT.search(text), "\r\n" if b"\r\n" in text else "\n"
    step = indent[1].decode() if indent else "  "
    depths = [(len(line) - len(line.lstrip())) // 2 for line in lines]
    added = "".join(f"{step * depth}{line.lstrip()}{end}" for depth, line in zip(depths, lines, strict=True))
    encoding = _ENCODING.match(text.removeprefix(b"\xef\xbb\xbf"))
    place = _robot_end(text)
    begun = len(text[:place].rstrip(b" \t"))
    alone = text[begun - 1 : begun] == b"\n"
    place = begun if alone else place
    content = ("" if alone else end) + added
    return text[:place] + content.encode(encoding[1].decode() if encoding else "utf-8", "xmlcharrefreplace") + text[place:]


def _robot_end(text: bytes) -> int:
    """Where </robot> begins."""
    parser = expat.ParserCreate()
    found: list[int] = []

    def end(_: str) -> None:
        found[:] = [parser.CurrentByteIndex]

    parser.EndElementHandler = end
    parser.Parse(text, True)
    return found[0]


def _edits(text: bytes, span: _JointSpan, origin: SE3) -> list[tuple[int, int, bytes]]:
    xyz, rpy = xyz_rpy(origin)
    if span.origin is None:
        return [_new_origin(text, span.tag, xyz, rpy)]
    end = tag_end(text, span.origin)
    values_at = {match[1]: match.span(2) for match in ATTRIBUTE.finditer(text, span.origin, end)}
    old = pose(*(np.array([float(word) for word in span.stated.get(name, "0 0 0").split()]) for name in ("xyz", "rpy")))
    same = {
        "xyz": np.abs(old.translation - origin.translation).max() <= _SAME,
        "rpy": np.abs(old.rotation - origin.rotation).max() <= _SAME,
    }
    place = end - (2 if text[end - 2 : end] == b"/>" else 1)
    place -= len(text[span.origin : place]) - len(text[span.origin : place].rstrip())
    edits, added = [], ""
    for name, values in (("xyz", xyz), ("rpy", rpy)):
        if same[name]:
            continue
        if name.encode() in values_at:
            start, stop = values_at[name.encode()]
            edits.append((start + 1, stop - 1, numbers(values).encode()))
        else:
            added += f' {name}="{numbers(values)}"'
    return [*edits, (place, place, added.encode())]


def _new_origin(text: bytes, tag: int, xyz: Vector, rpy: Vector) -> tuple[int, int, bytes]:
    end = tag_end(text, tag)
    blank = _BLANK.match(text, end)
    indent = blank[0] if blank else b""
    return end, end, indent + f'<origin xyz="{numbers(xyz)}" rpy="{numbers(rpy)}"/>'.encode()


def tag_end(text: bytes, start: int) -> int:
    """Behind the `>` of the tag that starts here; a `>` inside quotes does not count."""
    quote = 0
    for index in range(start, len(text)):
        letter = text[index]
        if quote:
            quote = 0 if letter == quote else quote
        elif letter in b"\"'":
            quote = letter
        elif letter == ord(">"):
            return index + 1
    raise AssertionError("expat let an unfinished tag pass")


def _joint_spans(text: bytes) -> dict[str, _JointSpan]:
    """The joints right under <robot>, and the origins right under them."""
    parser = expat.ParserCreate()
    spans: dict[str, _JointSpan] = {}
    path: list[str] = []
    current: list[_JointSpan] = []

    def start(tag: str, attributes: dict[str, str]) -> None:
        path.append(tag)
        if path == ["robot", "joint"]:
            current[:] = [_JointSpan(parser.CurrentByteIndex)]
            spans[attributes.get("name", "")] = current[0]
        elif path == ["robot", "joint", "origin"] and current[0].origin is None:
            current[0].origin, current[0].stated = parser.CurrentByteIndex, attributes

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: path.pop()
    parser.Parse(text, True)
    return spans
