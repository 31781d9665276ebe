"""A report as one self-contained page: nothing is fetched, nothing runs."""

from __future__ import annotations

import re
from collections.abc import Sequence
from html import escape

from urdfcal.fit_result import FitResult
from urdfcal.instrument_report import measuring_frame
from urdfcal.reporting.document import Block, Cell, Gallery, Points, Section, Share, Table
from urdfcal.reporting.page_style import STYLE
from urdfcal.reporting.parameter_plots import convergence_pictures, value_pictures
from urdfcal.reporting.reading_plots import component_pictures, consistency_pictures, place_pictures, size_pictures
from urdfcal.reporting.report_content import Report
from urdfcal.reporting.spot_plots import histogram_pictures, screen_pictures
from urdfcal.reporting.svg_plots import Picture, house_style
from urdfcal.reporting.verdict import Finding, Level

_MARKS: dict[Level, tuple[str, str]] = {"good": ("✓", "good"), "warn": ("!", "to be noted"), "bad": ("✕", "bad")}


def page(report: Report, calibration: FitResult) -> str:
    """The report as an HTML document."""
    drawn = pictures(report, calibration)
    sections = "\n".join(
        f'<section id="{section.key}"><h2>{escape(section.title)}</h2>\n{_blocks(section, drawn)}</section>' for section in report.sections
    )
    links = "".join(f'<a href="#{section.key}">{escape(section.title)}</a>' for section in report.sections)
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n<meta name="color-scheme" content="light dark">\n'
        f"<title>{escape(report.title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        f"<header><h1>{escape(report.title)}</h1><p>{escape(report.subtitle)}</p></header>\n"
        f'<main>\n{_verdict(report)}\n<nav aria-label="Sections">{links}</nav>\n{sections}\n</main>\n</body>\n</html>\n'
    )


def pictures(report: Report, calibration: FitResult) -> list[Picture]:
    """All pictures of a report."""
    with house_style():
        return [
            *screen_pictures(report.residuals, report.suspects),
            *histogram_pictures(report.residuals),
            *place_pictures(report.readings, report.suspects, measuring_frame(calibration)),
            *size_pictures(report.readings),
            *component_pictures(report.readings),
            *consistency_pictures(report.readings),
            *convergence_pictures(calibration),
            *value_pictures(calibration),
        ]


def _verdict(report: Report) -> str:
    verdict = report.verdict
    findings = "".join(_finding(finding) for finding in verdict.findings)
    return (
        f'<section class="verdict {verdict.level}" aria-label="Verdict"><h2>{_mark(verdict.level)}{escape(verdict.summary)}</h2>'
        f'<p class="headline">{escape(verdict.headline)}</p><ul class="findings">{findings}</ul></section>'
    )


def _finding(finding: Finding) -> str:
    return f'<li class="{finding.level}">{_mark(finding.level)}<span>{_words(finding.text)}</span></li>'


def _mark(level: Level) -> str:
    sign, meaning = _MARKS[level]
    return f'<span class="mark" role="img" aria-label="{meaning}">{sign}</span>'


def _blocks(section: Section, drawn: Sequence[Picture]) -> str:
    return "".join(_block(block, drawn) for block in section.blocks)


def _block(block: Block, drawn: Sequence[Picture]) -> str:
    if isinstance(block, Table):
        return _table(block)
    if isinstance(block, Points):
        return f"<ul>{''.join(f'<li>{_words(line)}</li>' for line in block.lines)}</ul>\n"
    if isinstance(block, Gallery):
        own = "".join(_picture(each) for each in drawn if each.gallery == block.key)
        return f'<div class="gallery {block.key}">{own}</div>\n' if own else ""
    return f"<p>{_words(block)}</p>\n"


def _words(text: str) -> str:
    """Escaped text in which options such as `--estimate` do not break at their hyphens."""
    return re.sub(r"(?<!\S)--[\w-]+", r'<span class="option">\g<0></span>', escape(text))


def _picture(picture: Picture) -> str:
    return f"<figure><h3>{escape(picture.title)}</h3>{picture.svg}<figcaption>{escape(picture.caption)}</figcaption></figure>\n"


def _table(table: Table) -> str:
    heads = "".join(f'<th scope="col"{_kind(column, table)}>{escape(name)}</th>' for column, name in enumerate(table.columns))
    rows = "\n".join(_row(row, table) for row in table.rows)
    opening = f'<div class="scroll" tabindex="0" role="region" aria-label="Table: {escape(", ".join(table.columns))}"><table>'
    return f"{opening}<thead>{_groups(table)}<tr>{heads}</tr></thead>\n<tbody>{rows}</tbody></table></div>\n"


def _groups(table: Table) -> str:
    cells = "".join(_group(heading, count) for heading, count in table.groups)
    return f'<tr class="groups">{cells}</tr>' if cells else ""


def _group(heading: str, count: int) -> str:
    return f'<th colspan="{count}" scope="colgroup">{escape(heading)}</th>' if heading else f'<td colspan="{count}"></td>'


def _row(row: Sequence[Cell], table: Table) -> str:
    cells = (_cell(cell, column, table) for column, cell in enumerate(row))
    return f"<tr>{''.join(cells)}</tr>"


def _cell(cell: Cell, column: int, table: Table) -> str:
    if column == 0:
        return f'<th scope="row">{escape(str(cell))}</th>'
    if isinstance(cell, Share):
        width, mark = (100 * min(max(part, 0.0), 1.0) for part in (cell.value, cell.mark))
        bar = f'<span class="bar" aria-hidden="true"><i style="width:{width:.1f}%"></i><b style="left:{mark:.0f}%"></b></span>'
        return f'<td class="share">{bar}<span>{cell}</span></td>'
    return f"<td{_kind(column, table)}>{escape(cell)}</td>"


def _kind(column: int, table: Table) -> str:
    return "" if column < table.words else ' class="figure"'
