"""A report as one self-contained page: nothing is fetched, nothing runs. How it looks is in the folder `page`."""

from __future__ import annotations

import re
from collections import defaultdict
from typing import Any

from urdfcal.calibration.result import FitResult
from urdfcal.output.report.content import Report
from urdfcal.output.report.document import Block
from urdfcal.output.report.plots.maps import map_pictures
from urdfcal.output.report.plots.parameters import convergence_pictures, value_pictures
from urdfcal.output.report.plots.residuals import component_pictures, size_pictures
from urdfcal.output.report.plots.svg import Picture
from urdfcal.output.report.touches import consistency_pictures
from urdfcal.output.report.verdict import Level
from urdfcal.output.templates import filled_template

_MARKS: dict[Level, dict[str, str]] = {
    "good": {"sign": "✓", "meaning": "good"},
    "note": {"sign": "i", "meaning": "to be noted"},
    "warn": {"sign": "!", "meaning": "a reservation"},
    "bad": {"sign": "✕", "meaning": "bad"},
}


def page(report: Report, calibration: FitResult) -> str:
    """The report as an HTML document."""
    drawn = defaultdict(list)
    for picture in pictures(report, calibration):
        drawn[picture.gallery].append(picture)
    return filled_page("report.html.j2", report=report, pictures=drawn)


def filled_page(name: str, **content: Any) -> str:
    """A page from a template beside the report's own, with what its parts need."""
    known = {"marks": _MARKS, "kind": _kind, "parts": _parts, "pieces": _pieces, "percent": _percent}
    return filled_template("urdfcal.output.report", name, **known, **content)


def pictures(report: Report, calibration: FitResult) -> list[Picture]:
    """All pictures of a report."""
    return [
        *map_pictures(report.residuals, report.suspects),
        *size_pictures(report.residuals),
        *component_pictures(report.residuals),
        *consistency_pictures(report.residuals),
        *convergence_pictures(calibration),
        *value_pictures(calibration),
    ]


def _kind(block: Block) -> str:
    return "paragraph" if isinstance(block, str) else type(block).__name__.lower()


def _parts(text: str) -> list[str]:
    """Text and, at every other place, options such as `--estimate`, which are not to break at their hyphens."""
    return re.split(r"((?<!\S)--[\w-]+)", text)


def _pieces(name: str) -> list[str]:
    """A name cut where it may go on in another line: behind a full stop."""
    return re.split(r"(?<=\.)(?=.)", name)


def _percent(part: float) -> float:
    return 100 * min(max(part, 0.0), 1.0)
