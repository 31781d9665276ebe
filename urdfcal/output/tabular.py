"""What all tables in LaTeX have in common: text in which nothing is a command, and rows of cells."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from urdfcal.output.report.document import Table

COMMANDS = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"} | {sign: rf"\{sign}" for sign in "&%$#_{}"}


def spelt(text: str, signs: Mapping[str, str]) -> str:
    """A text on one line, each of these signs as LaTeX has it."""
    return "".join(signs.get(letter, letter) for letter in " ".join(text.split()))


def row(cells: Iterable[str]) -> str:
    """A line of a `tabular`."""
    return rf"{' & '.join(cells)} \\"


def sides(table: Table) -> str:
    """How the columns of a table are set: words to the left, figures to the right."""
    return "l" * table.words + "r" * (len(table.columns) - table.words)
