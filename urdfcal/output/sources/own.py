"""Numbers that have no place of their own: an origin that does not state them, or one that several calls of a macro share.

In a shared origin the number gets `+ NAME` behind it; NAME becomes a parameter of the macro, 0 by default, and is given at the call that
makes the joint; where that call itself is made several times, it hands the parameter on, and so forth up to calls that differ.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from urdfcal.base.errors import RobotError
from urdfcal.output.sources.numbers import Wanted
from urdfcal.output.sources.slots import EXPRESSION, LITERAL, Edit, Slot, decimal, words
from urdfcal.output.sources.tree import SourceTree
from urdfcal.output.sources.xml_slots import Element, XmlSource
from urdfcal.robot.urdf_writer import tag_end
from urdfcal.robot.xacro_probe import TO

_BLANK = re.compile(rb"[ \t\r\n]*")
_PLAIN = re.compile(r"\$[{(][^})]*[})]")
_AXES = {"xyz": ("dx", "dy", "dz"), "rpy": ("droll", "dpitch", "dyaw")}


@dataclass
class OwnPlaces:
    """Edits that give numbers places of their own.

    Attributes:
        tree: The sources.
        by: What each number is to change by, [m] or [rad].
        text: Whether expressions that are added to may give numbers as text.
    """

    tree: SourceTree
    by: Mapping[Wanted, float]
    text: bool = False
    _attributes: dict[tuple[int, int], dict[str, str]] = field(default_factory=dict)  # of calls, by source and start
    _parameters: dict[tuple[int, int], list[str]] = field(default_factory=dict)  # of macros
    _names: dict[tuple[str, str, int], str] = field(default_factory=dict)
    _outer: dict[tuple[str, str], tuple[str, str]] = field(default_factory=dict)  # of a call and a name: the macro around it, and its name

    def shared(self, joint: str) -> bool:
        """Whether the origin that a joint has, or would be given, is one of other joints, too."""
        return len(self._joints_of(joint)) > 1

    def literals(self) -> dict[Wanted, Slot]:
        """Numbers that are written in an origin which is one joint's alone: there is nothing to trace."""
        found: dict[Wanted, Slot] = {}
        for wanted in self.by:
            mark = self.tree.marked.marks[wanted.joint].origin
            if not mark or self.shared(wanted.joint):
                continue
            source, element = self.tree.element(mark)
            its = source.attributes(element).get(wanted.name.encode())
            spans = words(source.text, *its[:2]) if its else []
            slot = self._by_place.get((source.file, *spans[wanted.axis])) if len(spans) == 3 else None
            if slot is not None and slot.kind == LITERAL:
                found[wanted] = slot
        return found

    def edits(self) -> list[Edit]:
        """All of them.

        Raises:
            RobotError: a number stands in no word of its own, or nothing tells its joint from another.
        """
        places: dict[tuple[str, str], dict[int, str]] = {}
        for wanted, by in self.by.items():
            value = decimal(by)
            if value == "0.0":  # what another number's correction has brought about
                continue
            if self.shared(wanted.joint):
                name = self._name(wanted)
                self._give(wanted, name, value)
                value = f"${{{name}}}"
            places.setdefault((self._mark(wanted.joint), wanted.name), {})[wanted.axis] = value
        found: list[Edit] = []
        missing: dict[str, dict[str, list[str]]] = {}
        for (mark, name), values in places.items():
            source, element = self.tree.element(mark)
            if name.encode() in source.attributes(element):
                found += self._added(source, element, name, values)
            else:
                missing.setdefault(mark, {})[name] = [values.get(axis, "0") for axis in range(3)]
        for mark, its in missing.items():
            found.append(_stated(*self.tree.element(mark), its))
        return [*found, *self._at_calls(), *self._at_macros()]

    def _mark(self, joint: str) -> str:
        place = self.tree.marked.marks[joint].place
        if not place:
            raise RobotError(f"joint '{joint}' is no <joint> in any source, and cannot be calibrated there", self.tree.description.path)
        return place

    def _joints_of(self, joint: str) -> list[str]:
        return self._by_mark[self._mark(joint)]

    @cached_property
    def _by_mark(self) -> dict[str, list[str]]:
        found: dict[str, list[str]] = {}
        for joint, marks in self.tree.marked.marks.items():
            found.setdefault(marks.place, []).append(joint)
        return found

    def _calls(self, joint: str) -> list[tuple[str, str]]:
        """The calls that an origin comes out of, outermost first, up to the macro that it is written in: place of call and of macro."""
        its = self.tree.marked.marks[joint]
        source, element = self.tree.element(its.place)
        found = [(call, macro) for call, _, macro in (each.partition(TO) for each in its.calls.split())]
        while found and found[-1][1] != f"{source.number}.{element.macro}":
            found.pop()  # a block that was handed to a macro is written where that is called
        return found

    def _name(self, wanted: Wanted) -> str:
        """What the parameter of a number is called in the macro that its origin is written in."""
        key = (self._mark(wanted.joint), wanted.name, wanted.axis)
        if key not in self._names:
            written_as = {self.tree.marked.marks[joint].joint for joint in self._joints_of(wanted.joint)}
            stem = self._stem(wanted.joint) if len(written_as) == 1 else "origin"
            self._names[key] = self._unused(f"{stem}_{_AXES[wanted.name][wanted.axis]}", self._names.values())
        return self._names[key]

    def _unused(self, wanted: str, taken: Iterable[str]) -> str:
        """A name that no source mentions."""
        name, more, gone = wanted, 1, set(taken)
        while name in gone or any(name.encode() in text for text in self.tree.files.values()):
            more += 1
            name = f"{wanted}_{more}"
        return name

    def _stem(self, joint: str) -> str:
        """A joint's name as its source has it, without what is filled in."""
        source, element = self.tree.element(self.tree.marked.marks[joint].joint)
        its = source.attributes(element).get(b"name")
        stated = source.text[its[0] : its[1]].decode(errors="replace") if its else ""
        stem = re.sub(r"\W+", "_", _PLAIN.sub("", stated), flags=re.ASCII).strip("_")
        return stem if stem and not stem[0].isdigit() else f"joint_{stem}".rstrip("_")

    def _give(self, wanted: Wanted, name: str, value: str) -> None:
        """Hand a value down from the first call that is this joint's alone."""
        alike = self._joints_of(wanted.joint)
        calls = self._calls(wanted.joint)
        for level in range(len(calls) - 1, -1, -1):
            call, macro = calls[level]
            parameters = self._parameters.setdefault(_place(macro), [])
            if name not in parameters:
                parameters.append(name)
            alike = [joint for joint in alike if call in [its for its, _ in self._calls(joint)]]
            own = alike == [wanted.joint]
            outer = "" if own else self._handed_on(call, calls[level - 1][1] if level else "", name, wanted)
            self._attributes.setdefault(_place(call), {})[name] = value if own else f"${{{outer}}}"
            if own:
                return
            name = outer
        others = ", ".join(joint for joint in self._joints_of(wanted.joint) if joint != wanted.joint)
        raise RobotError(
            f"joint '{wanted.joint}' and {others} come out of one origin by the same calls, so that no parameter can tell them apart; "
            "write out what a loop or a block makes of it",
            self.tree.description.path,
        )

    def _handed_on(self, call: str, macro: str, name: str, wanted: Wanted) -> str:
        """What the macro that makes a call names the parameter that it hands on; another for each of its calls."""
        if (call, name) not in self._outer:
            taken = [its for of, its in self._outer.values() if of == macro]
            taken += self._parameters.get(_place(macro), []) if macro else []
            outer = self._unused(f"{self._stem(wanted.joint)}_{_AXES[wanted.name][wanted.axis]}", taken)
            self._outer[call, name] = (macro, outer)
        return self._outer[call, name][1]

    def _added(self, source: XmlSource, element: Element, name: str, values: Mapping[int, str]) -> list[Edit]:
        start, end, _ = source.attributes(element)[name.encode()]
        spans = words(source.text, start, end)
        slots = [self._by_place.get((source.file, *span)) for span in spans]
        behind = {axis: f" + {value.removeprefix('${').removesuffix('}')}".encode() for axis, value in values.items()}
        if len(slots) == 1 and slots[0] is not None and slots[0].kind == EXPRESSION:
            return slots[0].taken_apart(behind)
        edits: list[Edit] = []
        for axis, added in behind.items():
            slot = slots[axis] if len(slots) == 3 else None
            if slot is None:
                stated = source.text[start:end].decode(errors="replace")
                raise RobotError(
                    f'{name}="{stated}": its numbers do not stand there one by one; write it as three words', source.file, element.line
                )
            edits += slot.added(added, text=self.text)
        return edits

    @cached_property
    def _by_place(self) -> dict[tuple[Path, int, int], Slot]:
        its = (slot for slot in self.tree.slots if slot.kind in (LITERAL, EXPRESSION) and slot.rank == 0)
        return {(slot.file, slot.start, slot.end): slot for slot in its}

    def _at_calls(self) -> Iterator[Edit]:
        for place, its in self._attributes.items():
            source, element = self._element(place)
            yield _attributes(source, element, "".join(f' {name}="{value}"' for name, value in its.items()))

    def _at_macros(self) -> Iterator[Edit]:
        for place, names in self._parameters.items():
            source, element = self._element(place)
            defaults = " ".join(f"{name}:=0" for name in names)
            its = source.attributes(element).get(b"params")
            if its is None:
                yield _attributes(source, element, f' params="{defaults}"')
            else:
                blank = " " if source.text[its[0] : its[1]].strip() else ""
                yield Edit(source.file, its[0], its[0], f"{defaults}{blank}".encode())

    def _element(self, place: tuple[int, int]) -> tuple[XmlSource, Element]:
        return self.tree.element(f"{place[0]}.{place[1]}")


def _place(mark: str) -> tuple[int, int]:
    number, start = map(int, mark.split("."))
    return number, start


def _attributes(source: XmlSource, element: Element, added: str) -> Edit:
    """Attributes behind the last of an element."""
    end = tag_end(source.text, element.start)
    place = end - (2 if source.text[end - 2 : end] == b"/>" else 1)
    place = element.start + len(source.text[element.start : place].rstrip())
    return Edit(source.file, place, place, added.encode())


def _stated(source: XmlSource, element: Element, its: Mapping[str, list[str]]) -> Edit:
    """What an origin does not state yet; in a joint without one, the origin."""
    added = "".join(f' {name}="{" ".join(its[name])}"' for name in ("xyz", "rpy") if name in its)
    if element.tag == "origin":
        return _attributes(source, element, added)
    end = tag_end(source.text, element.start)
    blank = _BLANK.match(source.text, end)
    return Edit(source.file, end, end, (blank[0] if blank else b"") + f"<origin{added}/>".encode())
