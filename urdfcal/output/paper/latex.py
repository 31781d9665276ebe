r"""The paper's tables beside ours for LaTeX: one file to `\input`, which needs booktabs and nothing else."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from urdfcal.base.foreign_text import shown
from urdfcal.output.paper.chapters import chapter_of
from urdfcal.output.paper.exhibit import Exhibit
from urdfcal.output.report.document import Table
from urdfcal.output.tabular import COMMANDS, row, sides, spelt
from urdfcal.simulation.paper import Repeated

LATEX_MARK = "% Written by urdfcal paper"  # by which an earlier file is known
_SIGNS = {
    "Δ": r"\Delta",
    "α": r"\alpha",
    "β": r"\beta",
    "θ": r"\theta",
    "°": r"{}^\circ",
    "±": r"\pm",
    "≤": r"\leq",
    "−": "-",
    "<": "<",
    ">": ">",
}
_MATHS = {sign: f"${command}$" for sign, command in _SIGNS.items()} | {"–": "--"}
_SUBSCRIPTS = {chr(ord("₀") + digit): f"$_{{{digit}}}$" for digit in range(10)}
_LETTERS = COMMANDS | _MATHS | _SUBSCRIPTS


def paper_latex(studies: Sequence[Repeated], made_of: str = "") -> str:
    """All tables with their captions, floats of their own each.

    Args:
        studies: What was repeated.
        made_of: Hash of the robots' files, by which a later run knows it.
    """
    lines = [
        f"{LATEX_MARK} of robots {made_of}".strip(),
        r"% In the preamble: \usepackage{booktabs}",
        r"% Where the tables are to stand: \input{this file}",
    ]
    for repeated in studies:
        chapter = chapter_of(repeated)
        lines += ["", f"% {chapter.title}", *(f"% {latex_text(line)}" for line in chapter.opening)]
        for exhibit in chapter.exhibits:
            lines += ["", *_float(exhibit)]
    return "\n".join(shown(line) for line in lines) + "\n"


def latex_text(text: str) -> str:
    """Text that LaTeX sets as it stands."""
    return spelt(text, _LETTERS)


def _float(exhibit: Exhibit) -> Iterator[str]:
    title = re.sub(r"^(Table [IVX]+|Fig\. \d)", r"\1 of the paper", exhibit.title)
    said = " ".join(f"{part.rstrip('.')}." for part in (title, exhibit.caption, exhibit.note) if part)
    yield r"\begin{table}[htbp]"
    yield r"\centering\footnotesize\setlength{\tabcolsep}{3.5pt}"
    yield rf"\caption{{{latex_text(said)}}}"
    yield rf"\label{{tab:paper-{exhibit.key}}}"
    yield r"\smallskip"
    yield from _tabular(exhibit.table, exhibit.lines)
    yield r"\end{table}"


def _tabular(table: Table, together: int) -> Iterator[str]:
    yield rf"\begin{{tabular}}{{@{{}}{sides(table)}@{{}}}}"
    yield r"\toprule"
    if table.groups:
        yield from _groups(table.groups)
    yield row(map(latex_text, table.columns))
    yield r"\midrule"
    for number, cells in enumerate(table.shown):
        if number and together > 1 and number % together == 0:
            yield r"\addlinespace[2pt]"
        yield row(latex_text(str(cell)) for cell in cells)
    yield r"\bottomrule"
    yield r"\end{tabular}"


def _groups(groups: Sequence[tuple[str, int]]) -> Iterator[str]:
    heads, rules, first = [], [], 1
    for heading, count in groups:
        heads.append(rf"\multicolumn{{{count}}}{{c}}{{{latex_text(heading)}}}" if heading else " & " * (count - 1))
        rules += [rf"\cmidrule(lr){{{first}-{first + count - 1}}}"] if heading else []
        first += count
    yield row(heads)
    yield " ".join(rules)
