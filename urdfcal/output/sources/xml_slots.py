"""The places in a xacro file: its elements by their bytes, and what of them can feed an origin."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from xml.parsers import expat

from urdfcal.output.sources.slots import Edit, Slot, word_slots
from urdfcal.robot.urdf_writer import ATTRIBUTE, tag_end
from urdfcal.robot.xacro_probe import MARK

_SHAPES = {"visual", "collision", "inertial"}
_NOT_CALLS = {"if", "unless", "include", "insert_block", "element", "property", "arg", "attribute", "macro"}
_STATED = {"property": (b"value", b"default"), "arg": (b"default",), "attribute": (b"value",)}
_DEFAULT = re.compile(rb"""([^\s:=]+?)\s*:?=\s*(?:\^\|?)?(\$\{.*?\}|\$\(.*?\)|'[^']*'|"[^"]*"|[^\s'"]+)""", re.DOTALL)
_MARKED = ("joint", "origin")


@dataclass(frozen=True)
class Element:
    """A start tag in a source.

    Attributes:
        tag: Its name.
        start: Its first byte.
        above: The tags that it stands in, outermost first.
        line: Its line, from 1.
        macro: Where the macro starts that it is written in; None where it is in none.
    """

    tag: str
    start: int
    above: tuple[str, ...]
    line: int
    macro: int | None

    @property
    def xacro(self) -> str:
        """Its name among xacro's own, or as a macro's call; the empty string for others."""
        return self.tag.removeprefix("xacro:") if self.tag.startswith("xacro:") else ""

    @property
    def is_call(self) -> bool:
        """Whether it calls a macro."""
        return bool(self.xacro) and self.xacro not in _NOT_CALLS


@dataclass(frozen=True)
class XmlSource:
    """A xacro file.

    Attributes:
        file: Its real path.
        text: Its bytes.
        number: Which of the sources it is, for marks.
    """

    file: Path
    text: bytes
    number: int

    @cached_property
    def elements(self) -> dict[int, Element]:
        """Its start tags, by where they stand."""
        parser, found = expat.ParserCreate(), dict[int, Element]()
        above: list[Element] = []

        def start(tag: str, _: object) -> None:
            macro = next((each.start for each in reversed(above) if each.xacro == "macro"), None)
            tags = tuple(each.tag for each in above)
            above.append(Element(tag, parser.CurrentByteIndex, tags, parser.CurrentLineNumber, macro))
            found[parser.CurrentByteIndex] = above[-1]

        parser.StartElementHandler, parser.EndElementHandler = start, lambda _: above.pop()
        parser.Parse(self.text, True)
        return found

    def attributes(self, element: Element) -> dict[bytes, tuple[int, int, bytes]]:
        """Where the values of its attributes stand, without their quotes, and the quotes."""
        end = tag_end(self.text, element.start)
        return {
            match[1]: (match.start(2) + 1, match.end(2) - 1, match[2][:1]) for match in ATTRIBUTE.finditer(self.text, element.start, end)
        }

    def slots(self) -> Iterator[Slot]:
        """All places that may feed an origin."""
        for element in self.elements.values():
            rank = 0 if element.tag == "origin" else 1 if element.is_call else 2
            for start, end, quote in self._values(element):
                yield from (replace(slot, rank=rank) for slot in word_slots(self.file, self.text, start, end, quote))

    def _values(self, element: Element) -> Iterator[tuple[int, int, bytes]]:
        its = self.attributes(element)
        if element.tag == "origin" and not _SHAPES & set(element.above):
            yield from (its[name] for name in (b"xyz", b"rpy") if name in its)
        elif element.xacro == "macro":
            yield from self._defaults(its)
        elif element.is_call:
            yield from (value for name, value in its.items() if not name.startswith(b"xmlns") and name != b"macro")
        elif element.xacro:
            yield from (its[name] for name in _STATED.get(element.xacro, ()) if name in its)

    def _defaults(self, its: dict[bytes, tuple[int, int, bytes]]) -> Iterator[tuple[int, int, bytes]]:
        if b"params" not in its:
            return
        start, end, quote = its[b"params"]
        for match in _DEFAULT.finditer(self.text, start, end):
            first, last = match.span(2)
            quoted = match[2][:1] in (b"'", b'"')
            yield first + quoted, last - quoted, quote

    def marks(self) -> Iterator[Edit]:
        """Edits that tell each joint and origin, macro and call where it stands."""
        for element in self.elements.values():
            if element.tag in _MARKED or element.xacro == "macro" or element.is_call:
                place = element.start + 1 + len(element.tag.encode())
                yield Edit(self.file, place, place, f' {MARK}="{self.number}.{element.start}"'.encode())
