"""A table of the paper, published beside repeated, before it is text, HTML or LaTeX."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from urdfcal.base.terminal import decimals
from urdfcal.output.report.document import Table

PUBLISHED, HERE, DIFFERENCE, RATIO = "published", "here", "difference", "ratio"
NONE = "–"  # where the paper, or this robot, has no such figure


@dataclass(frozen=True)
class Exhibit:
    """One table and what is said of it.

    Attributes:
        key: Its anchor, and its label in LaTeX.
        title: `Table III: ...`.
        caption: What its figures are.
        table: Published figures, ours, and the ratio or difference.
        note: What is to be known before it is believed; may be empty.
        picture: Key of the pictures that stand beside it; may be empty.
        lines: How many rows of the table belong together.
    """

    key: str
    title: str
    caption: str
    table: Table
    note: str = ""
    picture: str = ""
    lines: int = 1


@dataclass(frozen=True)
class Chapter:
    """What belongs to one section of the paper.

    Attributes:
        key: Its anchor.
        title: `Section V: ...`.
        opening: What was done, and what is simulated.
        exhibits: In the paper's order.
    """

    key: str
    title: str
    opening: tuple[str, ...]
    exhibits: tuple[Exhibit, ...]


def draws(runs: int) -> str:
    """`one draw`, `5 draws`."""
    return "one draw" if runs == 1 else f"{runs} draws"


def ratio(ours: float, published: float) -> str:
    """How many times the published figure ours is."""
    times = ours / published
    return f"{times:.2f}" if times < 10 else f"{times:.0f}"


def three_lines(name: str, published: Sequence[float] | None, here: Sequence[float] | None, digits: int) -> list[tuple[str, ...]]:
    """Published, ours and the difference one below the other; of what only one side has, the others are left open."""
    width = len(published or here or ())

    def line(label: str, what: str, values: Sequence[float] | None) -> tuple[str, ...]:
        return (label, what, *((NONE,) * width if values is None else (decimals(value, digits) for value in values)))

    apart = None if published is None or here is None else [own - theirs for own, theirs in zip(here, published, strict=True)]
    return [line(name, PUBLISHED, published), line("", HERE, here), line("", DIFFERENCE, apart)]
