"""A report as Markdown: the same words and tables as the page, without its pictures."""

from __future__ import annotations

import re

from urdfcal.output.report.content import Report
from urdfcal.output.report.document import Block, Gallery, Points, Table
from urdfcal.output.report.verdict import Level

_MARKS: dict[Level, str] = {"good": "OK", "note": "NOTE", "warn": "RESERVATION", "bad": "NO"}


def markdown(report: Report) -> str:
    """The report in GitHub's Markdown."""
    opening = report.opening
    parts = [f"# {_text(report.title)}", _text(report.subtitle), f"**{_text(opening.summary)}.** {_text(opening.headline)}"]
    parts += [_table(opening.predicted), _text(opening.constant)] if opening.predicted is not None else []
    parts.append("\n".join(f"- {_MARKS[finding.level]}: {_text(finding.text)}" for finding in opening.findings))
    for section in report.sections:
        parts += [f"## {_text(section.title)}", *(_block(block) for block in section.blocks if not isinstance(block, Gallery))]
    return "\n\n".join(parts) + "\n"


def _block(block: Block) -> str:
    if isinstance(block, Table):
        return _table(block)
    if isinstance(block, Points):
        return "\n".join(f"- {_text(line)}" for line in block.lines)
    return _text(str(block))


def _table(table: Table) -> str:
    groups = [heading for heading, count in table.groups for _ in range(count)] or [""] * len(table.columns)
    heads = [f"{column} {group}".strip() for column, group in zip(table.columns, groups, strict=True)]
    rules = [":--" if column < table.words else "--:" for column in range(len(table.columns))]
    rows = [[_text(str(cell)) for cell in row] for row in table.shown]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in [heads, rules, *rows])


def _text(text: str) -> str:
    """Text that Markdown leaves as it is, on one line."""
    text = re.sub(r"([\\`*\[\]|~])|(?<![A-Za-z0-9])_|_(?![A-Za-z0-9])", r"\\\g<0>", " ".join(text.split()))
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
