"""Places in a source where a number of an origin can be corrected: numbers as they are written, and expressions that give one."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from urdfcal.robot.xacro_probe import MOVED, MOVED_TEXT

NUMBER = rb"(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
_WORD = re.compile(rb"(?:\$\{[^}]*\}|\$\([^)]*\)|[^\s])+")
_LITERAL = re.compile(rb"[+-]?" + NUMBER)
_EXPRESSION = re.compile(rb"([+-]?)\$\{([^}]*)\}")
_ARGUMENT = re.compile(rb"([+-]?)(\$\([^)]*\))")
_ALONE = re.compile(rb"\s*([+-]?" + NUMBER + rb")\s*")
_DEGREES = tuple(
    re.compile(pattern)
    for pattern in (
        rb"\s*(?:math\.)?radians\(\s*([+-]?" + NUMBER + rb")\s*\)\s*",
        rb"\s*([+-]?" + NUMBER + rb")\s*\*\s*(?:math\.)?pi\s*/\s*180(?:\.0*)?\s*",
        rb"\s*([+-]?" + NUMBER + rb")\s*/\s*180(?:\.0*)?\s*\*\s*(?:math\.)?pi\s*",
        rb"\s*(?:math\.)?pi\s*\*\s*([+-]?" + NUMBER + rb")\s*/\s*180(?:\.0*)?\s*",
    )
)
_INNER = re.compile(rb"(?<![\w.\]])" + NUMBER + rb"(?![\w.])")
_INDEX = re.compile(rb"[\w\])]\s*\[\s*$")  # before a number that is an index
_HOLDER = re.compile(rb"\[|dict\(|=|,")
STEP = 1e-6  # [m], [rad], or what the place is written in: of a trial, for numbers about one
_LEAST, _MOST = 1e-3, 1e4  # numbers below and above are moved as these
PLACES = 13  # decimals that are written: far under what any reader keeps of a placement

LITERAL, EXPRESSION, PART = 0, 1, 2  # in this order they are preferred


@dataclass(frozen=True)
class Edit:
    """Bytes that take the place of others; of equal places the first comes first."""

    file: Path
    start: int
    end: int
    new: bytes


@dataclass(frozen=True)
class Slot:
    """One place.

    Attributes:
        file: The source.
        start: First byte of the number, or of the whole expression.
        end: Behind its last.
        text: What stands there.
        kind: LITERAL, EXPRESSION, or PART of an expression that is no number as a whole, as in a list.
        inner: Of an expression: first byte and end of what is evaluated.
        quote: What its attribute is quoted with.
        tagged: Whether it is an expression of YAML, under a tag with a unit.
        rank: 0 in an origin, 1 at a call, 2 elsewhere; of expressions the first is preferred.
    """

    file: Path
    start: int
    end: int
    text: bytes
    kind: int
    inner: tuple[int, int] = (0, 0)
    quote: bytes = b'"'
    tagged: bool = False
    rank: int = 2

    @property
    def shown(self) -> str:
        """As messages quote it."""
        return self.text.decode(errors="replace")

    @property
    def step(self) -> float:
        """How far it is moved for a trial: in proportion to what is written; as a number about one where that is nought or unknown."""
        size = abs(float(self.text)) if self.kind != EXPRESSION else 0.0
        return STEP * min(max(size, _LEAST), _MOST) if size > 0 else STEP

    def moved(self, by: float) -> list[Edit]:
        """It, for a trial, a little further on; an expression that is no number stays what it is."""
        if self.kind != EXPRESSION:
            return [Edit(self.file, self.start, self.end, f"{float(self.text) + by:.17f}".encode())]
        if self.tagged:
            return self._wrapped(b"(", b") + (%.17e)" % by)
        sign = self._sign
        if self._is_argument:
            other = b"'" if self.quote == b'"' else b'"'
            return self._wrapped(b"${" + MOVED_TEXT.encode() + b"(" + other + sign, other + b", %.17e)}" % by)
        return self._wrapped(b"${" + MOVED.encode() + b"(" + sign + b"(", b"), %.17e)}" % by)

    def corrected(self, by: float) -> list[Edit]:
        """It, further on by what is in its own unit, as it is written for good."""
        if self.kind != EXPRESSION:
            return [Edit(self.file, self.start, self.end, self._number(float(self.text) + by))]
        size = decimal(abs(by)).encode()
        behind = (b" - " if by < 0 else b" + ") + size
        if self.tagged:
            return self._wrapped(b"(", b")" + behind)
        return self.added(behind)

    def added(self, behind: bytes, *, text: bool = False) -> list[Edit]:
        """It with something behind it in its expression; a number becomes an expression.

        Args:
            behind: What is added, with its sign.
            text: Whether what is there may be a number as text.
        """
        if self.kind == LITERAL:
            return [Edit(self.file, self.start, self.start, b"${"), Edit(self.file, self.end, self.end, behind + b"}")]
        opened, closed = (b"float(", b")") if text else (b"", b"") if self._is_argument or _bare(self._inside) else (b"(", b")")
        return self._wrapped(b"${" + self._sign + opened, closed + behind + b"}")

    def taken_apart(self, behind: Mapping[int, bytes]) -> list[Edit]:
        """An expression that is three numbers in a row, as three words, with something behind some of them."""
        its = [b"${float((%s).split()[%d])%s}" % (self._inside, axis, behind.get(axis, b"")) for axis in range(3)]
        return [Edit(self.file, self.start, self.end, b" ".join(its))]

    def _number(self, value: float) -> bytes:
        text = decimal(value).encode()
        return b"(" + text + b")" if self.kind == PART and value < 0 else text

    @property
    def _inside(self) -> bytes:
        return self.text[self.inner[0] - self.start : self.inner[1] - self.start]

    @property
    def _sign(self) -> bytes:
        return self.text[:1] if self.text[:1] in (b"+", b"-") and not self.tagged else b""

    @property
    def _is_argument(self) -> bool:
        return self._inside.startswith(b"$(")

    def _wrapped(self, before: bytes, behind: bytes) -> list[Edit]:
        first, last = self.inner
        return [Edit(self.file, self.start, first, before), Edit(self.file, last, self.end, behind)]


def _bare(text: bytes) -> bool:
    return re.fullmatch(rb"\s*[\w.\[\]'()]+\s*", text) is not None and text.count(b"(") == text.count(b")") and b") " not in text


def decimal(value: float, places: int = PLACES) -> str:
    """A number without an exponent, which YAML and URDF read alike, and without noughts at its end; less decimals from one on."""
    before = len(f"{abs(value):.0f}") if abs(value) >= 1 else 0
    text = f"{value:.{max(places - before, 0)}f}".rstrip("0")
    return "0.0" if text in ("-0.", "0.") else text + "0" if text.endswith(".") else text


def edited(text: bytes, edits: Iterable[Edit]) -> bytes:
    """A file's bytes with edits; all others stay."""
    ordered = sorted(enumerate(edits), key=lambda each: (each[1].start, each[1].end, each[0]), reverse=True)
    for _, edit in ordered:
        text = text[: edit.start] + edit.new + text[edit.end :]
    return text


def word_slots(file: Path, text: bytes, start: int, end: int, quote: bytes) -> Iterator[Slot]:
    """The places among the words of an attribute's value."""
    for word in _WORD.finditer(text, start, end):
        yield from _slots_of_word(file, word[0], word.start(), quote)


def words(text: bytes, start: int, end: int) -> list[tuple[int, int]]:
    """Where the words of an attribute's value stand; an expression is one word."""
    return [match.span() for match in _WORD.finditer(text, start, end)]


def _slots_of_word(file: Path, word: bytes, at: int, quote: bytes) -> Iterator[Slot]:
    if _LITERAL.fullmatch(word):
        yield Slot(file, at, at + len(word), word, LITERAL)
        return
    argument = _ARGUMENT.fullmatch(word)
    if argument:
        yield Slot(file, at, at + len(word), word, EXPRESSION, (at + argument.start(2), at + argument.end(2)), quote)
        return
    match = _EXPRESSION.fullmatch(word)
    if not match:
        return
    inside, first = match[2], at + match.start(2)
    yield Slot(file, at, at + len(word), word, EXPRESSION, (first, at + match.end(2)), quote)
    plain = _ALONE.fullmatch(inside) or next(filter(None, (each.fullmatch(inside) for each in _DEGREES)), None)
    if plain:
        yield Slot(file, first + plain.start(1), first + plain.end(1), plain[1], LITERAL)
    elif _HOLDER.search(inside):
        for part in _INNER.finditer(inside):
            if not _INDEX.search(inside, 0, part.start()):
                yield Slot(file, first + part.start(), first + part.end(), part[0], PART)
