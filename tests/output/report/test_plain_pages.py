"""Pages of `compare` and `correct`: self-contained, with the figures that the terminal prints, and replaced by the same alone."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path

import pytest

from tests.conftest import CliResult
from tests.support.good_files import TARGETS
from tests.support.small_robot import URDF

Run = Callable[..., CliResult]


@pytest.fixture
def cell(tmp_path: Path, run_cli: Run) -> Path:
    """A robot, the truth of two simulated ones, and targets with one out of reach of any solution."""
    (tmp_path / "small.urdf").write_text(URDF)
    (tmp_path / "targets.csv").write_text(TARGETS.replace("-0.3,0.1,50,b", "0.6,0.1,300,<b>"))
    for name in "ab":
        assert run_cli("simulate", "small.urdf", "-o", f"{name}.csv", "--poses", "3", "--seed", str(ord(name)), "-q").code == 0
    return tmp_path


class Page(HTMLParser):
    """What a page says, and what it would fetch."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.words: list[str] = []
        self.fetched: list[str] = []
        self.pictures = 0
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.pictures += tag == "figure"
        own = dict(attrs)
        self.fetched += [value for name in ("src", "href") if (value := own.get(name)) and not value.startswith("#")]
        assert tag != "script"

    def handle_data(self, data: str) -> None:
        self.words += data.split()


def test_a_comparison_is_a_page(cell: Path, run_cli: Run) -> None:
    """The page has each joint, the tool's figures as printed, pictures, and both files; it fetches nothing."""
    words = ("compare", "a_truth.yaml", "b_truth.yaml", "--tool", "tool", "--report", "c.html")
    done = run_cli(*words)
    assert (done.code, "wrote c.html" in done.out) == (0, True)
    page = Page((cell / "c.html").read_text())
    assert page.fetched == []
    assert page.pictures == 4
    row = re.search(r"distance, mm +([\d.]+) +([\d.]+) +([\d.]+)", done.out)
    assert row is not None
    assert {*row.groups(), "turn", "lift", "slide", "a_truth.yaml", "b_truth.yaml"} <= set(page.words)
    assert run_cli(*words).code == 0
    other = run_cli("compare", "a_truth.yaml", "small.urdf", "--tool", "tool", "--report", "c.html")
    assert (other.code, "is there already and is no page" in other.err) == (2, True)


def test_the_same_compared_is_a_page_without_pictures_of_nothing(cell: Path, run_cli: Run) -> None:
    """Two that are the same but for rounding are said to be; their page stands without histograms of zeros."""
    assert run_cli("compare", "a_truth.yaml", "a_truth.yaml", "--report", "c.html").code == 0
    assert "same but for rounding" in (cell / "c.html").read_text()


def test_corrected_targets_are_a_page(cell: Path, run_cli: Run) -> None:
    """Every target stands on the page with its figures before and after, reservations by line, and nothing is fetched."""
    words = ("correct", "small.urdf", "targets.csv", "--calibration", "a_truth.yaml", "--tool", "tool", "-o", "t.csv", "--report", "t.html")
    done = run_cli(*words, "--json")
    assert done.code == 0, done.err
    told = json.loads(done.out)
    page = Page((cell / "t.html").read_text())
    assert page.fetched == []
    assert page.pictures == 3
    assert {f"{target['before_mm']:.3f}" for target in told["targets"]} <= set(page.words)
    reserved = [target for target in told["targets"] if target["reservation"]]
    assert reserved
    assert f"targets.csv:{reserved[0]['line']}:" in page.words
    assert told["report"] == "t.html"


def test_a_page_is_refused_before_any_work(cell: Path, run_cli: Run) -> None:
    """A name that says another kind of file, or that of an input or of the other output, is refused and nothing is written."""
    correct = ("correct", "small.urdf", "targets.csv", "--calibration", "a_truth.yaml", "--tool", "tool", "-o")
    for words in (
        (*correct, "t.csv", "--report", "t.pdf"),
        (*correct, "t.html", "--report", "t.html"),
        ("compare", "a_truth.yaml", "b_truth.yaml", "--report", "a_truth.yaml"),
    ):
        done = run_cli(*words)
        assert (done.code, len(done.err.splitlines())) == (2, 1)
    assert not any((cell / name).exists() for name in ("t.csv", "t.html", "t.pdf"))
