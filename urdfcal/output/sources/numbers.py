"""An expanded document as its numbers and all the rest of it, so that two can be compared; which numbers are joints' origins."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from lxml import etree

from urdfcal.base.geometry import Vector
from urdfcal.robot.urdf_xml import read_xml
from urdfcal.robot.xacro_probe import CALLS, MARK

SIX = tuple((name, axis) for name in ("xyz", "rpy") for axis in range(3))
_AXES = {"xyz": ("x", "y", "z"), "rpy": ("roll", "pitch", "yaw")}
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")


@dataclass(frozen=True)
class Wanted:
    """One number of a joint's origin: `xyz` or `rpy`, and which of the three."""

    joint: str
    name: str
    axis: int

    def __str__(self) -> str:
        """As messages have it."""
        return f"{_AXES[self.name][self.axis]} of joint '{self.joint}'"


class Marks(NamedTuple):
    """Where a joint and its origin stand in the sources, and the calls that each comes out of; empty where there is none."""

    joint: str
    joint_calls: str
    origin: str
    origin_calls: str

    @property
    def place(self) -> str:
        """Where its origin stands, else the joint itself."""
        return self.origin or self.joint

    @property
    def calls(self) -> str:
        """The calls that this comes out of."""
        return self.origin_calls if self.origin else self.joint_calls


@dataclass(frozen=True)
class Expansion:
    """An expanded document.

    Attributes:
        values: Its numbers, (n,), in its order; each joint begins with the six of its origin, 0 where one is not stated.
        rest: All that is no number, as names of places; equal in two documents of one structure.
        owners: What each number belongs to, in words.
        joints: By name, the index of the first of its six.
        stated: Which of `xyz` and `rpy` each joint's origin states as three numbers.
        marks: Of each joint and of its origin: where it stands in the sources, and the calls that it comes out of.
    """

    values: Vector
    rest: tuple[str, ...]
    owners: tuple[str, ...]
    joints: dict[str, int]
    stated: dict[str, frozenset[str]]
    marks: dict[str, Marks]

    def alike(self, other: Expansion) -> bool:
        """Whether all but the numbers are the same."""
        return self.rest == other.rest

    def index(self, wanted: Wanted) -> int:
        """Where a number of an origin stands among the values."""
        return self.joints[wanted.joint] + SIX.index((wanted.name, wanted.axis))

    def six(self, joint: str) -> Vector:
        """The numbers of a joint's origin, (6,), [m] and [rad]."""
        return self.values[self.joints[joint] : self.joints[joint] + 6]


def read_expansion(text: bytes) -> Expansion:
    """Take an expanded document apart."""
    reader, root = _Reader(), read_xml(text)
    reader.element(root, "robot")
    for top in root:
        reader.whole(top)
    return Expansion(np.array(reader.values), tuple(reader.rest), tuple(reader.owners), reader.joints, reader.stated, reader.marks)


class _Reader:
    def __init__(self) -> None:
        self.values: list[float] = []
        self.rest: list[str] = []
        self.owners: list[str] = []
        self.joints: dict[str, int] = {}
        self.stated: dict[str, frozenset[str]] = {}
        self.marks: dict[str, Marks] = {}

    def whole(self, top: Any) -> None:
        name, skipped = top.get("name", ""), None
        if top.tag == "joint":
            skipped = top.find("origin")
            self.joint(top, name, skipped)
        for element in top.iter(etree.Element):
            if element is not skipped:
                self.element(element, f"{top.tag} '{name}'" if element is top else f"{element.tag} of {top.tag} '{name}'")

    def joint(self, top: Any, name: str, origin: Any) -> None:
        """Its origin, and where it comes from."""
        its = {} if origin is None else dict(origin.attrib)
        self.marks[name] = Marks(top.get(MARK, ""), top.get(CALLS, ""), its.pop(MARK, ""), its.pop(CALLS, ""))
        self.joints[name] = len(self.values)
        stated = set()
        for which in ("xyz", "rpy"):
            words = its.pop(which, "").split()
            if len(words) == 3 and all(map(_is_number, words)):
                stated.add(which)
            elif words:
                self.rest += words
            self.values += map(float, words) if which in stated else (0.0, 0.0, 0.0)
        self.stated[name] = frozenset(stated)
        self.owners += [str(Wanted(name, *each)) for each in SIX]
        self.rest += [f"{key}={value}" for key, value in its.items()]

    def element(self, element: Any, owner: str) -> None:
        self.rest.append(str(element.tag))
        for name, value in element.attrib.items():
            if name not in (MARK, CALLS):
                self.words(f"@{name}", value, owner)
        self.words("text", element.text or "", owner)

    def words(self, name: str, value: str, owner: str) -> None:
        self.rest.append(name)
        for word in value.split():
            number = _is_number(word)
            if number:
                self.values.append(float(word))
                self.owners.append(owner)
            self.rest.append("#" if number else word)


def _is_number(word: str) -> bool:
    return _NUMBER.fullmatch(word) is not None and math.isfinite(float(word))
