"""Pages of commands that fit nothing, in the style of reports: what was found, first in words, then in tables and pictures."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from urdfcal.base.files import sha256
from urdfcal.base.version import __version__
from urdfcal.output.report.document import Section, Table
from urdfcal.output.report.html import filled_page
from urdfcal.output.report.plots.svg import Picture
from urdfcal.output.report.verdict import Opening


@dataclass(frozen=True)
class PlainReport:
    """A page's words and tables.

    Attributes:
        title, subtitle: Its heading.
        opening: What was found.
        sections: The rest.
    """

    title: str
    subtitle: str
    opening: Opening
    sections: tuple[Section, ...]


def page_mark(made_of: str) -> str:
    """By which an earlier page of the same inputs is known."""
    return f"<!-- of {made_of} -->"


def plain_page(report: PlainReport, pictures: Sequence[Picture], made_of: str) -> bytes:
    """The page, self-contained.

    Args:
        report: What it says.
        pictures: What stands in its galleries.
        made_of: Hash of its inputs.
    """
    drawn: Mapping[str, list[Picture]] = defaultdict(list)
    for picture in pictures:
        drawn[picture.gallery].append(picture)
    return f"{filled_page('report.html.j2', report=report, pictures=drawn)}{page_mark(made_of)}\n".encode()


def made_of_section(files: Iterable[tuple[str, Path | None]]) -> Section:
    """Which files it is made of, to be found again."""
    rows = tuple((what, str(path), sha256(path.read_bytes())[:16]) for what, path in files if path is not None)
    table = Table(("", "file", "SHA-256 begins"), rows, words=3)
    return Section("provenance", "What this is made of", (f"urdfcal {__version__}", table))
