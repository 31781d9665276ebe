"""Robot programs as words and numbers: what all languages have in common.

A program is read as tokens, each with its place in the text, so that a number can be exchanged and every other byte stays. Comments,
strings and line ends are passed over; a sign belongs to a number where no other number or name stands before it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from urdfcal.base.errors import InputError
from urdfcal.base.geometry import Matrix
from urdfcal.deploy.targets import Number

_TOKEN = re.compile(
    r"""(?P<blank>\s+)
    |(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?(?:(?![\w.])|(?=(?:mm|deg)\b)))
    |(?P<name>[A-Za-z_$&][\w$]*(?:\.[A-Za-z_]\w*)*)
    |(?P<sign>[+-])
    |(?P<mark>:=|==|<>|.)""",
    re.VERBOSE | re.DOTALL,
)


@dataclass(frozen=True)
class Token:
    """A word of a program.

    Attributes:
        kind: `number`, `name`, `string` or `mark`.
        text: As it stands.
        start, end: Where.
    """

    kind: str
    text: str
    start: int
    end: int


def tokens_of(text: str, comment: str, quotes: str) -> list[Token]:
    """The tokens of a program.

    Args:
        text: The program.
        comment: Pattern of what begins a comment, to the end of the line.
        quotes: Characters that strings stand between.
    """
    passed = re.compile(rf"(?P<comment>(?:{comment})[^\r\n]*)|(?P<string>([{quotes}]).*?(?:\3|$))", re.MULTILINE)
    found: list[Token] = []
    at = 0
    while at < len(text):
        match = passed.match(text, at) or _TOKEN.match(text, at)
        assert match is not None
        kind, at = str(match.lastgroup if match.re is _TOKEN else ("comment" if match["comment"] else "string")), match.end()
        if kind == "number" and not math.isfinite(float(match.group())):
            kind = "name"  # 1e999 is no number of any robot's
        if kind not in ("blank", "comment"):
            found.append(Token(kind, match.group(), match.start(), match.end()))
    return list(_signed(found))


def _signed(found: Sequence[Token]) -> Iterator[Token]:
    """Signs taken to the numbers behind them, where they are no operators."""
    pending: Token | None = None
    before: Token | None = None
    for token in found:
        if token.kind == "sign" and (before is None or (before.kind == "mark" and before.text not in ")]}") or before.kind == "name"):
            if pending is not None:
                yield pending
            pending = token
            continue
        if pending is not None and token.kind == "number":
            token = Token("number", f"{pending.text}{token.text}", pending.start, token.end)
        elif pending is not None:
            yield Token("mark", pending.text, pending.start, pending.end)
        pending = None
        before = token
        yield token if token.kind != "sign" else Token("mark", token.text, token.start, token.end)


@dataclass(frozen=True, eq=False)
class Program:
    """A program that is being read.

    Attributes:
        path: The file.
        text: Its text.
        encoding: Of its bytes.
        tokens: Its words.
        joints: How many positions a joint target has.
        frames: Frames that its user states, by name, in its own convention, (4, 4), [m].
    """

    path: Path
    text: str
    encoding: str
    tokens: Sequence[Token]
    joints: int
    frames: Mapping[str, Matrix]

    def line(self, at: int) -> int:
        """The line of a place in the text."""
        return len(re.findall(r"\r\n|\n|\r", self.text[:at])) + 1

    def fail(self, token: Token, message: str) -> InputError:
        """An error that names the file and the line."""
        return InputError(message, self.path, self.line(token.start))

    def closing(self, index: int) -> int:
        """Index of the bracket that closes the one at `index`."""
        depth = 0
        for at in range(index, len(self.tokens)):
            text = self.tokens[at].text if self.tokens[at].kind == "mark" else ""
            depth += (text in "([{" and text != "") - (text in ")]}" and text != "")
            if depth == 0:
                return at
        raise self.fail(self.tokens[index], f"'{self.tokens[index].text}' is not closed")

    def parts(self, index: int) -> list[tuple[int, int]]:
        """Where the parts between commas stand in the bracket at `index`: from the first token of each to behind its last."""
        end, found, begun, at = self.closing(index), [], index + 1, index + 1
        while at < end:
            token = self.tokens[at]
            if token.kind == "mark" and token.text in "([{":
                at = self.closing(at) + 1
                continue
            if token.kind == "mark" and token.text == ",":
                found.append((begun, at))
                begun = at + 1
            at += 1
        return [*found, (begun, end)] if end > begun else found

    def list_of(self, index: int, units: Sequence[float]) -> tuple[Number, ...] | None:
        """The numbers of a flat list in brackets, in SI; None where it is none, or has another count."""
        parts = self.parts(index)
        if len(parts) != len(units) or any(end - start != 1 or self.tokens[start].kind != "number" for start, end in parts):
            return None
        return tuple(number(self.tokens[start], unit) for (start, _), unit in zip(parts, units, strict=True))


def number(token: Token, unit: float) -> Number:
    """A token as a number."""
    return Number(token.start, token.end, unit, float(token.text) * unit)
