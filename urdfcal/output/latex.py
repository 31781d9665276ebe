r"""A report's tables in LaTeX, for a paper: `tabular`s with booktabs, each in a `table` of its own."""

from __future__ import annotations

import re
from collections.abc import Iterator

from urdfcal.base.foreign_text import shown
from urdfcal.calibration.result import FitResult
from urdfcal.output.report.content import report_of
from urdfcal.output.report.document import Section, Table

_SIGNS = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "±": r"$\pm$",
    "–": "--",
    **{sign: f"\\{sign}" for sign in "&%$#_{}"},
}
_SIGN = re.compile("|".join(map(re.escape, _SIGNS)))
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
    columns = "l" * table.words + "r" * (len(table.columns) - table.words)
    rows = [*_heads(table), r"\midrule", *(_row([str(cell) for cell in row]) for row in table.rows)]
    body = "\n".join(["\\toprule", *rows, "\\bottomrule"])
    return (
        f"\\begin{{table}}[htb]\n\\centering\n\\caption{{{latex_text(caption)}}}\n\\label{{{label}}}\n"
        f"\\begin{{tabular}}{{{columns}}}\n{body}\n\\end{{tabular}}\n\\end{{table}}\n"
    )


def _heads(table: Table) -> Iterator[str]:
    if table.groups:
        cells = [f"\\multicolumn{{{count}}}{{c}}{{{latex_text(heading)}}}" for heading, count in table.groups]
        yield f"{' & '.join(cells)} \\\\"
    yield _row(list(table.columns))


def _row(cells: list[str]) -> str:
    return f"{' & '.join(latex_text(cell) for cell in cells)} \\\\"


def latex_text(text: str) -> str:
    """Text that LaTeX sets as it stands, on one line; minus signs before figures are minus signs."""
    escaped = _SIGN.sub(lambda found: _SIGNS[found[0]], shown(" ".join(text.split())))
    return _MINUS.sub("$-$", escaped)
