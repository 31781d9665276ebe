"""The places in a YAML file that a macro loads."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from urdfcal.output.sources.slots import EXPRESSION, LITERAL, NUMBER, Slot

_UNITS = ("radians", "degrees", "meters", "millimeters", "foot", "inches")
_NUMBERS = re.compile(rb"\s*[+-]?" + NUMBER + rb"(?:\s+[+-]?" + NUMBER + rb")*\s*")
_WORD = re.compile(rb"\S+")


def yaml_slots(file: Path, text: bytes) -> Iterator[Slot]:
    """The scalars that are numbers, rows of them, or, with a unit's tag, expressions; names of entries are none."""
    import yaml

    try:
        content = text.decode()
        tokens = list(yaml.scan(content))
    except (UnicodeDecodeError, yaml.YAMLError):  # xacro, which has read it, knows more of it than can be patched
        return
    places = _Places(content)
    key, tag = False, ""
    for token in tokens:
        if isinstance(token, yaml.TagToken):
            tag = token.value[1]
            continue
        if isinstance(token, yaml.ScalarToken):
            if not key and not (tag and tag not in _UNITS):
                yield from _slots_of_scalar(file, token, text, places, bool(tag))
        tag = ""
        key = isinstance(token, yaml.KeyToken)


class _Places:
    """Where letters of a text stand in its bytes."""

    def __init__(self, content: str) -> None:
        self._content, self._plain = content, content.isascii()

    def byte(self, index: int) -> int:
        return index if self._plain else len(self._content[:index].encode())


def _slots_of_scalar(file: Path, token: Any, text: bytes, places: _Places, tagged: bool) -> Iterator[Slot]:
    start, end = places.byte(token.start_mark.index), places.byte(token.end_mark.index)
    if token.style in ("'", '"'):
        start, end = start + 1, end - 1
    elif token.style:  # a block
        return
    its = text[start:end]
    if _NUMBERS.fullmatch(its):
        for word in _WORD.finditer(text, start, end):
            yield Slot(file, *word.span(), word[0], LITERAL)
    elif tagged and token.style is None:
        yield Slot(file, start, end, its, EXPRESSION, (start, end), tagged=True)
