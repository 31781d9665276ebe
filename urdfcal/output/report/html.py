"""A report as one self-contained page: nothing is fetched, nothing runs.

How the page looks: light and dark, desktop and phone.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from html import escape

from urdfcal.calibration.result import FitResult
from urdfcal.output.report.content import Report
from urdfcal.output.report.document import Block, Cell, Gallery, Points, Section, Share, Table
from urdfcal.output.report.parameter_plots import convergence_pictures, value_pictures
from urdfcal.output.report.reading_plots import component_pictures, consistency_pictures, place_pictures, size_pictures
from urdfcal.output.report.residual_plots import histogram_pictures, screen_pictures
from urdfcal.output.report.svg import Picture, house_style
from urdfcal.output.report.verdict import Finding, Level
from urdfcal.output.text.instruments import measuring_frame

_MARKS: dict[Level, tuple[str, str]] = {"good": ("✓", "good"), "warn": ("!", "to be noted"), "bad": ("✕", "bad")}

STYLE = """
:root {
  color-scheme: light dark;
  --paper: #fff; --ink: #1b2026; --soft: #59636e; --line: #d5dade; --band: #eef1f4; --link: #0b5cad;
  --good: #00694c; --good-paper: #e8f5f0; --warn: #8a5300; --warn-paper: #fdf3e1; --bad: #a8201a; --bad-paper: #fcebea;
  --c0: #0067a8; --c1: #c84e00; --c2: #007f5b; --c3: #a4418c; --c4: #3d9ad6; --c5: #a87900; --c6: #6247b5; --c7: #5b6168;
}
@media (prefers-color-scheme: dark) {
  :root {
    --paper: #14181c; --ink: #e6e9ec; --soft: #a2acb6; --line: #3a424a; --band: #22282e; --link: #7cbcf5;
    --good: #58d3a6; --good-paper: #12291f; --warn: #f1b650; --warn-paper: #2e2410; --bad: #ff8f86; --bad-paper: #371a18;
    --c0: #58aef0; --c1: #ff8d4f; --c2: #3fcf9f; --c3: #e58fcb; --c4: #a5d8ff; --c5: #ecc34f; --c6: #b6a2ff; --c7: #b4bcc4;
  }
}
* { box-sizing: border-box; }
html { -webkit-text-size-adjust: 100%; scroll-behavior: smooth; }
@media (prefers-reduced-motion: reduce) { html { scroll-behavior: auto; } }
body {
  margin: 0 auto; max-width: 68rem; padding: 2rem 1.25rem 4rem; background: var(--paper); color: var(--ink);
  font: 1rem/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", "Noto Sans", "Liberation Sans", Arial, sans-serif;
  overflow-wrap: anywhere;
}
h1 { margin: 0; font-size: 1.75rem; line-height: 1.2; letter-spacing: -0.01em; }
h2 { margin: 0 0 .5rem; font-size: 1.25rem; line-height: 1.3; }
h3 { margin: 0 0 .25rem; font-size: .95rem; font-weight: 600; }
header p { margin: .35rem 0 1.5rem; color: var(--soft); }
section { margin: 2.75rem 0 0; }
section > p { max-width: 46rem; margin: .5rem 0 .75rem; }
ul { margin: .5rem 0; padding-left: 1.25rem; }
li { margin: .25rem 0; max-width: 52rem; }
a { color: var(--link); }
nav { display: flex; flex-wrap: wrap; gap: .25rem 1.1rem; margin: 1.25rem 0 0; font-size: .9rem; }
nav a { padding: .15rem 0; }
.verdict {
  margin: 0; padding: 1.1rem 1.25rem;
  border-left: .35rem solid var(--tone); border-radius: .25rem; background: var(--tone-paper);
}
.good { --tone: var(--good); --tone-paper: var(--good-paper); }
.warn { --tone: var(--warn); --tone-paper: var(--warn-paper); }
.bad { --tone: var(--bad); --tone-paper: var(--bad-paper); }
.verdict h2 { display: flex; align-items: center; gap: .6rem; color: var(--tone); }
.headline { max-width: none; margin: .25rem 0 .75rem; font-size: 1.15rem; }
.findings { list-style: none; padding: 0; margin: 0; }
.findings li { max-width: none; display: flex; gap: .6rem; align-items: baseline; }
.mark {
  flex: none; display: inline-grid; place-items: center; width: 1.35em; height: 1.35em; border-radius: 50%;
  background: var(--tone); color: var(--paper); font-weight: 700; font-size: .8em; line-height: 1;
}
.scroll { overflow-x: auto; margin: .75rem 0 1.25rem; }
table { border-collapse: collapse; overflow-wrap: normal; font-size: .9rem; font-variant-numeric: tabular-nums; }
th, td {
  padding: .3rem .75rem .3rem 0; text-align: left;
  font-weight: 400; border-bottom: 1px solid var(--line); vertical-align: baseline;
}
thead th { color: var(--soft); font-size: .8rem; white-space: nowrap; }
thead .groups th, thead .groups td { border: 0; padding-bottom: 0; }
thead .groups th { color: var(--ink); font-weight: 600; text-align: right; }
.option { white-space: nowrap; }
.figure { text-align: right; white-space: nowrap; padding-left: .5rem; }
#provenance td { max-width: 44rem; overflow-wrap: anywhere; }
#outliers td { min-width: 6rem; }
#outliers tbody th { white-space: normal; overflow-wrap: anywhere; min-width: 7rem; }
th { white-space: nowrap; }
td { min-width: 3rem; }
#combinations tbody th { white-space: normal; min-width: 11rem; }
.share { white-space: nowrap; padding-left: .75rem; }
.bar {
  position: relative; display: inline-block; width: 5.5rem;
  height: .6rem; margin-right: .5rem; background: var(--band); border-radius: .15rem;
}
.bar i { position: absolute; inset: 0 auto 0 0; min-width: 1px; background: var(--c0); border-radius: .15rem; }
.bar b { position: absolute; top: -.15rem; bottom: -.15rem; width: 1px; background: var(--soft); }
.gallery {
  display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 20rem), 1fr));
  gap: 1.75rem 2rem; margin: 1.25rem 0; align-items: start;
}
.gallery.spots, .gallery.components, .gallery.consistency { grid-template-columns: repeat(auto-fit, minmax(min(100%, 25rem), 1fr)); }
figure { margin: 0; max-width: 32rem; }
figcaption { color: var(--soft); font-size: .85rem; line-height: 1.4; margin-top: .25rem; }
svg { display: block; width: 100%; height: auto; overflow: visible; }
svg text { font-family: inherit !important; }
@media (max-width: 40rem) {
  body { padding: 1.25rem 1rem 3rem; }
  h1 { font-size: 1.4rem; }
  section { margin-top: 2.25rem; }
  .verdict { margin: 0 -.25rem; padding: .9rem 1rem; }
  .headline { font-size: 1.05rem; }
}
@media print { nav { display: none; } figure, tr { break-inside: avoid; } body { max-width: none; } }
"""


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
