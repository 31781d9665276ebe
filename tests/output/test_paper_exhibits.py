"""The paper's tables beside ours, as a page and for LaTeX, against figures that are worked out another way."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lxml import html

from tests.conftest import CliResult
from tests.support.paths import ROBOTS_DIR
from tests.support.small_robot import URDF
from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import DEG, MM
from urdfcal.base.terminal import as_text
from urdfcal.output.paper.chapters import chapter_of
from urdfcal.output.paper.exhibit import NONE, Exhibit
from urdfcal.output.paper.latex import latex_text, paper_latex
from urdfcal.output.paper.page import paper_page
from urdfcal.output.text.paper import paper_json, study_blocks
from urdfcal.robot.robot import Robot
from urdfcal.simulation import study
from urdfcal.simulation.paper import Repeated, repeat

SECTION_IV = ["table-I", "table-II", "table-III-mean-of-100-noise-free", "figure-4"]
SECTION_V = ["table-IV", "table-V", "table-VI", "table-VII-mean-of-2-measured"]


@pytest.fixture(scope="module")
def repeated(robots: dict[str, Robot]) -> list[Repeated]:
    """Both studies, one draw, few sweeps."""
    four, five = (replace(study.STUDIES[number], max_sweeps=60) for number in (4, 5))
    ticks: list[None] = []
    found = [repeat(robots["arm7"], four, 1, 2, lambda: ticks.append(None)), repeat(robots["arm4"], five, 2, 2, lambda: ticks.append(None))]
    assert len(ticks) == four.fits + 2 * five.fits
    return found


@pytest.fixture(scope="module")
def exhibits(repeated: list[Repeated]) -> dict[str, Exhibit]:
    """By their keys."""
    return {exhibit.key: exhibit for each in repeated for exhibit in chapter_of(each).exhibits}


def test_every_table_of_the_paper_is_there_once(repeated: list[Repeated], exhibits: dict[str, Exhibit]) -> None:
    """Tables I to VII and Fig. 4; no key stands for two; sections that are simulated for measured ones say so on every table of figures."""
    assert {*SECTION_IV, *SECTION_V} <= set(exhibits)
    assert len(exhibits) == sum(len(chapter_of(each).exhibits) for each in repeated)
    for key in ("table-V", "table-VI", "table-VII-mean-of-2-measured"):
        assert exhibits[key].note.startswith("Simulated here; published: measured on the real arm")


@pytest.mark.parametrize("key", ["table-I", "table-IV"])
def test_our_arms_are_the_published_ones(exhibits: dict[str, Exhibit], key: str) -> None:
    """Every difference of the nominal parameters and ranges is zero, and nothing says that it is another arm."""
    differences = [row[2:] for row in exhibits[key].table.rows if row[1] == "difference"]
    assert len(differences) == (8 if key == "table-I" else 5)
    assert {cell for row in differences for cell in row} == {"0.0"}
    assert exhibits[key].note == ""


@pytest.mark.parametrize(("key", "which"), [("table-II", 0), ("table-VI", 1)])
def test_distances_before_are_those_of_two_models(exhibits: dict[str, Exhibit], repeated: list[Repeated], key: str, which: int) -> None:
    """The ratio is ours over published, to its digits, and published digits are the paper's to the last."""
    for row in exhibits[key].table.rows:
        published, ours = float(row[3]), float(row[6])
        assert float(row[-1]) == pytest.approx(ours / published, abs=0.006 + 0.006 * ours / published)
    by_case = {(row[0], row[1], row[2]): row[3:6] for row in exhibits[key].table.rows}
    printed = {0: ("86.61", "15.05", "154.18"), 1: ("7.74", "2.66", "21.61")}
    assert by_case["3", "fit", "l1"] == printed[which]


def test_the_experiments_truth_is_table_v(exhibits: dict[str, Exhibit], repeated: list[Repeated]) -> None:
    """Section V is simulated with the published errors of case 3; what no spot tells singly is left open, and its sums are told."""
    experiment = repeated[1]
    rows = {str(row[0]): row for row in exhibits["table-V"].table.rows}
    sizes = [MM if unit == "m" else DEG for unit in experiment.errors.units]
    published = [float(row[7]) for row in list(rows.values())[: len(sizes)]]
    np.testing.assert_allclose(experiment.truth / sizes, published, atol=1e-12)
    hidden = [name for name, row in rows.items() if row[2] == NONE]
    assert hidden == ["Δd₁ (mm) *", "Δd₂ (mm) *", "Δd₄ (mm) *", "Trans(z, SLM) (mm) *"]
    column = experiment.errors.names.index("joint1.d_d"), experiment.errors.names.index("joint2.d_d")
    own = experiment.estimates["one reading", "EKF", 3].mean(axis=0)
    assert float(rows["Δd₁ + Δd₂ (mm)"][8]) == pytest.approx(own[list(column)].sum() / MM, abs=1e-4)


def test_the_page_stands_alone_and_has_every_table_and_four_panels(repeated: list[Repeated], exhibits: dict[str, Exhibit]) -> None:
    """Its policy lets nothing in, its links lead to its tables, cells are the exhibits' own, Fig. 4 has the paper's panels."""
    page = html.fromstring(paper_page(repeated))
    assert "default-src 'none'" in page.xpath("//meta[@http-equiv='Content-Security-Policy']/@content")[0]
    assert page.xpath("//script | //link | //img | //iframe") == []
    assert {link.removeprefix("#") for link in page.xpath("//nav/a/@href")} == set(exhibits)
    for key, exhibit in exhibits.items():
        (section,) = page.xpath(f"//section[@id='{key}']")
        assert len(section.xpath(".//tbody/tr")) == len(exhibit.table.rows)
    titles = [title.text_content() for title in page.xpath("//section[@id='figure-4']//figure/h3")]
    assert [title[:3] for title in titles] == ["(a)", "(b)", "(c)", "(d)"]


def test_latex_is_whole(repeated: list[Repeated], exhibits: dict[str, Exhibit]) -> None:
    """A float with caption, label and booktabs' rules for each; as many cells in every row as there are columns; nothing but ASCII."""
    text = paper_latex(repeated)
    assert text.isascii()
    floats = re.findall(r"\\begin\{table\}.*?\\end\{table\}", text, re.DOTALL)
    assert [re.search(r"\\label\{tab:paper-(.*?)\}", each)[1] for each in floats] == list(exhibits)  # type: ignore[index]
    for each, exhibit in zip(floats, exhibits.values(), strict=True):
        assert [each.count(rule) for rule in (r"\toprule", r"\midrule", r"\bottomrule", r"\caption{")] == [1] * 4
        body = each.split(r"\midrule")[1].split(r"\bottomrule")[0]
        rows = [line for line in body.splitlines() if line.endswith(r"\\")]
        assert [line.count(" & ") + 1 for line in rows] == [len(exhibit.table.columns)] * len(exhibit.table.rows)


def test_latex_escapes_what_would_be_commands() -> None:
    """A robot's name is text, whatever is in it."""
    assert latex_text(r"a_b & 50% #1 {x} \input $y$ ~^") == (
        r"a\_b \& 50\% \#1 \{x\} \textbackslash{}input \$y\$ \textasciitilde{}\textasciicircum{}"
    )


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="no LaTeX here")
def test_latex_compiles(repeated: list[Repeated], tmp_path: Path) -> None:
    """An article takes the file in, without an overfull line."""
    (tmp_path / "tables.tex").write_text(paper_latex(repeated))
    wide = r"\documentclass{article}\usepackage{booktabs}\usepackage[margin=2cm]{geometry}\begin{document}\input{tables}\end{document}"
    (tmp_path / "main.tex").write_text(wide)
    done = subprocess.run(["pdflatex", "-interaction=nonstopmode", "main"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, "Overfull" in done.stdout) == (0, False)


def test_what_is_printed_fits_80_columns(repeated: list[Repeated]) -> None:
    """No row of a table is wider, and no case is broken in its middle."""
    for each in repeated:
        tables = [as_text([block]) for block in study_blocks(each) if not isinstance(block, str)]
        assert max(len(line) for text in tables for line in text.splitlines()) <= 80
        assert sum(line.startswith("1 test") for text in tables for line in text.splitlines()) >= 4


def test_json_tells_of_both_studies(repeated: list[Repeated]) -> None:
    """Each line says its section; each estimate its truth."""
    told = paper_json(repeated)
    assert [sum(line["section"] == number for line in told["lines"]) for number in (4, 5)] == [35, 15]
    last = next(each for each in told["estimates"] if each["section"] == 5)
    assert [parameter["truth"] for parameter in last["parameters"]] == repeated[1].truth.tolist()


REFUSED = {
    "ending": (("--report", "paper.pdf"), "--report paper.pdf: a page ends in .html or .htm, found '.pdf'"),
    "latex ending": (("--latex", "t.txt"), "--latex t.txt: a file for LaTeX ends in .tex, found '.txt'"),
    "foreign": (("--report", "mine.html"), "mine.html: is there already and is no result of urdfcal paper"),
    "input": (("arm.html", "--report", "arm.html"), "arm.html: is an input of this command"),
    "another arm": (
        (str(ROBOTS_DIR / "arm7" / "arm7.urdf.xacro"), "--section", "5"),
        "the true errors of section 5 are the 21 of",
    ),
    "section": (("--section", "6"), "'6' is not one of '4', '5'"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_before_anything_is_worked_out(case: str, run_cli: Callable[..., CliResult], tmp_path: Path) -> None:
    """One line that names what is wrong; what stood there stays."""
    for name in ("mine.html", "arm.html"):
        (tmp_path / name).write_text("mine")
    words, expected = REFUSED[case]
    done = run_cli("paper", *words)
    assert (done.code, done.out) == (2, "")
    assert expected in done.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["arm.html", "mine.html"]
    assert {path.read_text() for path in tmp_path.iterdir()} == {"mine"}


def test_files_are_written_together_and_give_way_to_the_next(
    repeated: list[Repeated], run_cli: Callable[..., CliResult], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Without ROBOT and --section both sections are in both files; a second run replaces them; --json lists them."""
    asked: list[int] = []

    def stub(robot: Robot, wanted: study.Study, runs: int, seed: int, progress: object) -> Repeated:
        asked.append(wanted.section)
        return repeated[wanted.section - 4]

    monkeypatch.setattr("urdfcal.simulation.paper.repeat", stub)
    for words in ((), ("--json",)):
        done = run_cli("paper", "--report", "p.html", "--latex", "t.tex", *words)
        assert (done.code, done.err) == (0, "")
    assert asked == [4, 5, 4, 5]
    other = run_cli("paper", "--report", "p.html", "--section", "4")
    assert (other.code, "p.html: is there already and is no result of urdfcal paper for the same arms" in other.err) == (2, True)
    assert '"files": [\n    "p.html",\n    "t.tex"\n  ]' in done.out
    assert 'id="table-VI"' in (tmp_path / "p.html").read_text("utf-8")
    assert "tab:paper-table-VI}" in (tmp_path / "t.tex").read_text("utf-8")


def test_a_rig_without_its_mount_is_refused_in_words(run_cli: Callable[..., CliResult], tmp_path: Path) -> None:
    """Whose beams never reach the screen is told so in one line, whatever numpy would have warned of."""
    (tmp_path / "small.urdf").write_text(URDF.replace('<origin xyz="0.05 0.04 0.02" rpy="0 1.5707963267948966 0"/>', ""))
    done = run_cli("paper", "small.urdf", "--runs", "1", "-q")
    assert (done.code, done.out) == (2, "")
    assert "'small': with every joint at 0 a beam runs along the screen" in done.err
    assert len(done.err.splitlines()) == 1


def test_spots_that_an_estimate_loses_are_refused_in_words(robots: dict[str, Robot], monkeypatch: pytest.MonkeyPatch) -> None:
    """An estimate that is no number has no distances: estimator, case and count are told, and no mean of nothing is taken."""
    arm = robots["arm7"]

    class Away:
        """An estimate with the module nowhere."""

        x = np.zeros(33)

    Away.x[-5] = np.nan
    monkeypatch.setattr("urdfcal.simulation.paper._fitted", lambda *given: Away)
    small = replace(study.SECTION_4, half=4, protocols={"one reading": 1})
    with pytest.raises(UsageError, match=r"'arm7': the model that LSE finds in case 1 has \d+ of 8 spots nowhere on the screen's plane"):
        repeat(arm, small, 1, 0)
