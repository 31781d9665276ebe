"""A xacro with all files that it is read from, and what it expands to with edits of them."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby
from pathlib import Path

import numpy as np

from urdfcal.base.errors import RobotError
from urdfcal.base.reading import DESCRIPTION, content_of
from urdfcal.output.sources.numbers import Expansion, read_expansion
from urdfcal.output.sources.slots import Edit, Slot, edited
from urdfcal.output.sources.tracing import Traced, trace
from urdfcal.output.sources.xml_slots import Element, XmlSource
from urdfcal.output.sources.yaml_slots import yaml_slots
from urdfcal.robot.description import Description
from urdfcal.robot.entities import refuse_entities
from urdfcal.robot.xacro_child import Variant, XacroLimit, variants

_SEED = 0  # of the steps of tracing
_LONGER, _LEAST = 10.0, 2.0  # times as long as unchanged, and [s] more
_WIDE = (b"\xff\xfe", b"\xfe\xff")


@dataclass(frozen=True)
class SourceTree:
    """The sources of a description.

    Attributes:
        description: What they expand to.
        files: Their bytes, by real path; xacro files first, in the order in which they are read.
        xml: Those that are xacro.
        limit: What an expansion with changed sources may take: little more than one of them as they are.
        traces: What was found of places, by the kinds that were looked at and the places that were left out.
    """

    description: Description
    files: dict[Path, bytes]
    xml: dict[Path, XmlSource]
    limit: XacroLimit
    traces: dict[tuple[tuple[int, ...], frozenset[Slot]], Traced] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def of(cls, description: Description) -> SourceTree:
        """The sources as they are now.

        Raises:
            RobotError: it is no xacro, or its sources have changed since it was read.
        """
        if not description.expanded:
            raise RobotError(
                "is a plain URDF, which --format urdf patches; --format xacro is for sources that xacro expands", description.path
            )
        began = time.monotonic()
        (found,) = _expanded(description, [{}], description.xacro_limit)
        seconds = min(description.xacro_limit.seconds, _LONGER * (time.monotonic() - began) + _LEAST)
        if found.text != description.text:
            raise RobotError("does not expand any more to what was calibrated: its sources have changed since", description.path)
        places = dict.fromkeys(Path(os.path.realpath(file)) for file in found.files)
        files = {place: content_of(place, DESCRIPTION, RobotError) for place in places}
        for place, text in files.items():
            if text[:2] in _WIDE or b"\x00" in text[:64]:
                raise RobotError("is in UTF-16 or UTF-32, whose bytes cannot be kept; save it as UTF-8", place)
        xml = {place: XmlSource(place, text, number) for number, (place, text) in enumerate(files.items()) if _is_xml(text, place)}
        return cls(description, files, xml, replace(description.xacro_limit, seconds=seconds))

    def require_unchanged(self) -> None:
        """Refuse sources that are others by now.

        Raises:
            RobotError: names the first.
        """
        for place, text in self.files.items():
            if content_of(place, DESCRIPTION, RobotError) != text:
                raise RobotError("does not expand any more to what was calibrated: its sources have changed since", place)

    def traced(self, kinds: tuple[int, ...], barred: frozenset[Slot], wanted: Iterable[int]) -> Traced | None:
        """What places of some kinds feed; None where there are no such places.

        Args:
            kinds: LITERAL, EXPRESSION, PART.
            barred: Places to leave out.
            wanted: The numbers whose places must be found.
        """
        slots = [slot for slot in self.slots if slot.kind in kinds and slot not in barred]
        if not slots:
            return None
        needed, known = set(wanted), self.traces.get((kinds, barred))
        if known is None or needed & known.unresolved:
            known = trace(slots, self.base, needed, self.expand, np.random.default_rng(_SEED))
            self.traces[kinds, barred] = known
        return known

    @cached_property
    def base(self) -> Expansion:
        """What they expand to, unchanged."""
        return read_expansion(self.description.text)

    @cached_property
    def marked(self) -> Expansion:
        """The same, with marks that tell where its joints come from.

        Raises:
            RobotError: the marks change what it expands to.
        """
        (found,) = self.expand([[edit for source in self.xml.values() for edit in source.marks()]])
        if found is None or not found.alike(self.base):
            raise RobotError("its sources look at attributes of their own elements, and cannot be traced", self.description.path)
        return found

    @cached_property
    def slots(self) -> tuple[Slot, ...]:
        """All places in them that may feed an origin."""
        of_xml = [slot for source in self.xml.values() for slot in source.slots()]
        return (*of_xml, *(slot for place, text in self.files.items() if place not in self.xml for slot in yaml_slots(place, text)))

    def contents(self, edits: Sequence[Edit]) -> dict[Path, bytes]:
        """The files that edits change, as they are with them."""
        by_file = sorted(edits, key=lambda edit: str(edit.file))
        return {file: edited(self.files[file], its) for file, its in groupby(by_file, key=lambda edit: edit.file)}

    def expand(self, several: Sequence[Sequence[Edit]]) -> list[Expansion | None]:
        """What they expand to with edits, for each of several sets of them; None where it cannot be expanded."""
        overlays = [{str(file): text for file, text in self.contents(edits).items()} for edits in several]
        return [None if each.text is None else read_expansion(each.text) for each in _expanded(self.description, overlays, self.limit)]

    def element(self, mark: str) -> tuple[XmlSource, Element]:
        """What a mark says."""
        number, start = map(int, mark.split("."))
        source = next(each for each in self.xml.values() if each.number == number)
        return source, source.elements[start]

    def where(self, slot: Slot) -> str:
        """File and line of a place."""
        line = self.files[slot.file].count(b"\n", 0, slot.start) + 1
        return f"{slot.file}:{line}"


def _expanded(description: Description, overlays: Sequence[dict[str, bytes]], limit: XacroLimit) -> list[Variant]:
    if not overlays:
        return []
    return variants(description.path, description.xacro_args, description.package_dirs, limit, overlays)


def _is_xml(text: bytes, place: Path) -> bool:
    if not text.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<"):
        return False
    refuse_entities(text, place)
    return True
