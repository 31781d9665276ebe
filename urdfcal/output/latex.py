r"""A report's tables in LaTeX, for a paper: `tabular`s with booktabs, each in a `table` of its own."""

from __future__ import annotations

import re
from collections.abc import Iterator

from urdfcal.base.foreign_text import shown
from urdfcal.calibration.result import FitResult
from urdfcal.output.report.content import report_of
from urdfcal.output.report.document import Section, Table
from urdfcal.output.tabular import COMMANDS, row, sides, spelt

_SIGNS = COMMANDS | {
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "±": r"$\pm$",
    "–": "--",
}
_MINUS = re.compile(r"(?<![\w.-])-(?=\d)")


def calibration_latex(calibration: FitResult) -> str:
    """What a calibration found: distances before and after it, parameters with their sigmas, and sums that are known alone."""
    sections = [section for section in report_of(calibration, ()).sections if section.key in ("spots", "parameters", "combinations")]
    tables = [table for section in sections for table in _tables(section)]
    return "\n".join(["% needs \\usepackage{booktabs}", *tables])


def _tables(section: Section) -> Iterator[str]:
    """The tables of a section, each under the first sentence of what stands before it."""
    caption, count = section.title, 0
    for block in section.blocks:
        if isinstance(block, str):
            caption = block.partition(". ")[0].rstrip(".:")
        if isinstance(block, Table):
            count += 1
            yield latex(block, caption, f"tab:{section.key}{f'-{count}' if count > 1 else ''}")


def latex(table: Table, caption: str, label: str) -> str:
    """A table as a LaTeX `table`."""
    rows = [*_heads(table), r"\midrule", *(row(latex_text(str(cell)) for cell in cells) for cells in table.rows)]
    body = "\n".join(["\\toprule", *rows, "\\bottomrule"])
    return (
        f"\\begin{{table}}[htb]\n\\centering\n\\caption{{{latex_text(caption)}}}\n\\label{{{label}}}\n"
        f"\\begin{{tabular}}{{{sides(table)}}}\n{body}\n\\end{{tabular}}\n\\end{{table}}\n"
    )


def _heads(table: Table) -> Iterator[str]:
    if table.groups:
        yield row(f"\\multicolumn{{{count}}}{{c}}{{{latex_text(heading)}}}" for heading, count in table.groups)
    yield row(map(latex_text, table.columns))


def latex_text(text: str) -> str:
    """Text that LaTeX sets as it stands, on one line; minus signs before figures are minus signs."""
    return _MINUS.sub("$-$", spelt(shown(" ".join(text.split())), _SIGNS))
