"""An XML document with the place of each element in its bytes, and edits of attributes and text that leave all other bytes."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

import numpy as np

from urdfcal.base.errors import InputError, RobotError
from urdfcal.base.geometry import Vector
from urdfcal.base.reading import DESCRIPTION, content_of
from urdfcal.robot.entities import refuse_entities
from urdfcal.robot.urdf_writer import ATTRIBUTE, numbers, tag_end
from urdfcal.robot.urdf_xml import number_fault

_BLANK = re.compile(rb"[ \t\r\n]*")


@dataclass(eq=False)
class Element:
    """One element of a document.

    Attributes:
        path: The file that it stands in.
        start, end: Of its start tag in the bytes; `end` is behind the `>`.
        close: Where its end tag begins; `end` where it has none of its own.
        text: What it says before its first child, entities resolved.
    """

    path: Path
    tag: str
    attributes: dict[str, str]
    above: Element | None
    line: int
    start: int
    end: int = 0
    close: int = 0
    text: str = ""
    children: list[Element] = field(default_factory=list)

    @property
    def name(self) -> str:
        """Its name; empty without one."""
        return self.attributes.get("name", "")

    def find(self, tag: str) -> Element | None:
        """The first child of this tag."""
        return next(self.all(tag), None)

    def all(self, *tags: str) -> Iterator[Element]:
        """The children of these tags."""
        return (child for child in self.children if child.tag in tags)

    def walk(self) -> Iterator[Element]:
        """Itself and all below, in the document's order."""
        yield self
        for child in self.children:
            yield from child.walk()

    def fail(self, message: str) -> RobotError:
        """An error that names file and line."""
        return RobotError(message, self.path, self.line)

    def numbers(self, words: str, counts: Sequence[int], what: str) -> Vector:
        """Numbers with blanks between them.

        Raises:
            RobotError: one is none, or there are more or fewer than expected.
        """
        found = words.split()
        fault = next(filter(None, map(number_fault, found)), None)
        if fault is None and len(found) not in counts:
            fault = f"found {len(found)} numbers, expected {' or '.join(map(str, counts))}"
        if fault is not None:
            raise self.fail(f"<{self.tag}{f' {self.name}' if self.name else ''}>: {what}: {fault}")
        return np.array([float(word) for word in found])


@dataclass(frozen=True)
class Edit:
    """Bytes from `start` to `end` of a file give way to `new`."""

    path: Path
    start: int
    end: int
    new: bytes


@dataclass(frozen=True)
class Document:
    """A document and its bytes."""

    path: Path
    text: bytes
    root: Element

    def with_attributes(self, element: Element, values: dict[str, Vector], gone: Iterable[str] = ()) -> list[Edit]:
        """Edits that give an element's attributes numbers, and take some of its attributes away."""
        tag = self.text[element.start : element.end]
        spans = {match[1].decode(): match.span(2) for match in ATTRIBUTE.finditer(tag)}
        whole = {match[1].decode(): match.span() for match in ATTRIBUTE.finditer(tag)}
        edits = [self._edit(element, *whole[name], b"") for name in gone if name in whole]
        edits += [self._edit(element, spans[name][0] + 1, spans[name][1] - 1, _ascii(own)) for name, own in values.items() if name in spans]
        new = b"".join(b' %s="%s"' % (name.encode(), _ascii(own)) for name, own in values.items() if name not in spans)
        behind = len(tag[: -2 if tag.endswith(b"/>") else -1].rstrip())
        return edits + ([self._edit(element, behind, behind, new)] if new else [])

    def with_text(self, element: Element, values: Vector) -> list[Edit]:
        """Edits that give an element's text numbers, the blanks about it kept.

        Raises:
            RobotError: something else than numbers stands between them.
        """
        said = self.text[element.end : element.close]
        if element.close == element.end and self.text[: element.end].endswith(b"/>"):
            start = element.end - len(self.text[: element.end]) + len(self.text[: element.end - 2].rstrip())
            return [Edit(self.path, start, element.end, b">%s</%s>" % (_ascii(values), element.tag.encode()))]
        if b"<" in said or b"&" in said:
            raise element.fail(f"<{element.tag}>: a comment or entity stands between its numbers; take it out")
        start = element.end + len(said) - len(said.lstrip())
        return [Edit(self.path, start, max(start, element.end + len(said.rstrip())), _ascii(values))]

    def with_child(self, element: Element, tag: str, values: Vector) -> list[Edit]:
        """Edits that put a new element with numbers before all others of an element."""
        return self.with_new(element, f"<{tag}>{_ascii(values).decode()}</{tag}>")

    def with_new(self, element: Element, new: str) -> list[Edit]:
        """Edits that put something new before all others of an element, on a line of its own where these stand on theirs."""
        blank = _BLANK.match(self.text, element.end)
        return [Edit(self.path, element.end, element.end, (blank[0] if blank else b"") + new.encode())]

    def _edit(self, element: Element, start: int, end: int, new: bytes) -> Edit:
        return Edit(self.path, element.start + start, element.start + end, new)


def edited(text: bytes, edits: Iterable[Edit]) -> bytes:
    """The bytes with edits that do not overlap."""
    for edit in sorted(edits, key=lambda own: (own.start, own.end), reverse=True):
        text = text[: edit.start] + edit.new + text[edit.end :]
    return text


def read_document(path: Path, text: bytes | None = None) -> Document:
    """Read a document.

    Args:
        path: The file, for messages where there is a text.
        text: What it is to hold; None reads the file.

    Raises:
        RobotError: it cannot be read, is not well-formed, or declares entities.
    """
    text = content_of(path, DESCRIPTION, RobotError) if text is None else text
    if text[:2] in (b"\xff\xfe", b"\xfe\xff") or b"\x00" in text[:64]:
        raise RobotError("is in UTF-16 or UTF-32, whose bytes cannot be kept; save it as UTF-8", path)
    refuse_entities(text, path)
    root = _parsed(path, text)
    return Document(path, text, root)


def _parsed(path: Path, text: bytes) -> Element:
    parser = expat.ParserCreate()
    parser.buffer_text = True
    open_ones: list[Element] = []
    roots: list[Element] = []

    def start(tag: str, attributes: dict[str, str]) -> None:
        place = parser.CurrentByteIndex
        above = open_ones[-1] if open_ones else None
        own = Element(path, tag, attributes, above, parser.CurrentLineNumber, place, tag_end(text, place))
        (above.children if above else roots).append(own)
        open_ones.append(own)

    def end(_: str) -> None:
        own = open_ones.pop()
        own.close = max(own.end, parser.CurrentByteIndex)

    def said(words: str) -> None:
        if open_ones and not open_ones[-1].children:
            open_ones[-1].text += words

    parser.StartElementHandler, parser.EndElementHandler, parser.CharacterDataHandler = start, end, said
    parser.Parse(text, True)
    if not roots:
        raise InputError("holds no XML element", path)
    return roots[0]


def _ascii(values: Vector) -> bytes:
    return numbers(values).encode()
