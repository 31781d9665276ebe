"""Reports as a page, as Markdown and for machines."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from tests.support.paths import ROBOTS_DIR
from tests.support.small_robot import URDF, robot_of
from urdfcal.api import Calibration, fit
from urdfcal.base.errors import UsageError
from urdfcal.calibration.analysis.prediction import SpotAccuracy
from urdfcal.calibration.reach import draw_poses
from urdfcal.calibration.result import FitResult
from urdfcal.output.report.content import report_of
from urdfcal.output.report.files import report_bytes, write_report
from urdfcal.output.report.residuals import residuals_of
from urdfcal.output.report.suspects import spreads, suspects
from urdfcal.output.report.verdict import opening_of
from urdfcal.output.text.headline import headline
from urdfcal.output.text.result import text_report
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import spots_measured
from urdfcal.sensors.measurements_csv import read_measurements
from urdfcal.simulation.readings import SimulatedNoise, simulate
from urdfcal.simulation.truth import random_truth

COMMAND = ["/somewhere/urdfcal", "fit", "robot.urdf", "two words.csv"]
Written = Callable[[FitResult, str], str]

VOID = {"meta", "br", "wbr"}
SPOT_SIGMA = 1e-3


class Outline(HTMLParser):
    """What an HTML document holds, and whether its elements are closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.words: list[str] = []
        self.attributes: list[tuple[str, str, str]] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes += [(tag, name, value or "") for name, value in attrs]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes += [(tag, name, value or "") for name, value in attrs]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join("".join(self.words).split())


def simulated(robot: Robot, fitted: int = 40, tested: int = 0, shift: tuple[int, float] | None = None, **options: object) -> Calibration:
    """A fit of simulated spots with SPOT_SIGMA of noise; one spot may be shifted, [m]."""
    rng = np.random.default_rng(5)
    model, truth = random_truth(robot, rng, 2e-3, np.radians(0.2))
    q = draw_poses(robot, model, truth, fitted + tested, rng)
    data = simulate(robot, model, truth, q, rng, SimulatedNoise(SPOT_SIGMA))
    if shift:
        spots = data.spots.copy()
        spots[shift[0], 0] += shift[1]
        data = data.with_spots(spots)
    return fit(robot, replace(data, sets=np.array(["fit"] * fitted + ["test"] * tested)), **options)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def arm7(robots: dict[str, Robot]) -> Calibration:
    """The example that comes with urdfcal, with test poses."""
    folder = ROBOTS_DIR / "arm7"
    return fit(robots["arm7"], read_measurements(folder / "measurements.csv", robots["arm7"]))


@pytest.fixture(scope="module")
def page(arm7: Calibration, tmp_path_factory: pytest.TempPathFactory) -> str:
    """Its page."""
    path = tmp_path_factory.mktemp("page") / "report.html"
    write_report(path, arm7, COMMAND)
    return path.read_text("utf-8")


@pytest.fixture
def written(tmp_path: Path) -> Written:
    """Write a report into an empty folder and read it back."""

    def write(calibration: FitResult, ending: str) -> str:
        path = tmp_path / f"report{ending}"
        write_report(path, calibration, COMMAND)
        assert [each.name for each in tmp_path.iterdir()] == [path.name]
        text = path.read_text("utf-8")
        path.unlink()
        return text

    return write


def test_the_page_fetches_and_runs_nothing(page: str) -> None:
    """No element of the page refers to anything outside it, its style imports nothing, and there is no script."""
    outline = Outline(page)
    references = [value for _, name, value in outline.attributes if name in ("src", "href", "xlink:href", "action", "data", "srcset")]
    assert references
    assert {value[:1] for value in references} == {"#"}
    assert not re.search(r"<(script|link|iframe|object|embed)\b|@import|@font-face|\bon\w+=|url\((?!#)", page)
    assert set(re.findall(r"https?://[^\"' <]+", page)) <= {"http://www.w3.org/1999/xlink", "http://www.w3.org/2000/svg"}


def test_the_page_is_well_formed_and_its_ids_are_unique(page: str) -> None:
    """Elements close in order, no id stands twice, and every reference inside the page has its target."""
    outline = Outline(page)
    assert outline.open == []
    ids = [value for _, name, value in outline.attributes if name == "id"]
    assert len(ids) == len(set(ids))
    targets = {value[1:] for _, name, value in outline.attributes if name in ("href", "xlink:href")}
    assert targets <= set(ids)


def test_pictures_take_their_colours_from_the_page_and_say_what_they_show(page: str) -> None:
    """Every picture has a text for those who do not see it and no colour of its own, so that it follows light and dark."""
    drawings = re.findall(r"</h3>(<svg .*?)</figure>", page, re.DOTALL)
    assert len(drawings) >= 12
    assert [drawing for drawing in drawings if not re.match(r'<svg [^>]*role="img" aria-label="[^"]{20,}"', drawing)] == []
    assert set(re.findall(r"#[0-9a-f]{6}\b", " ".join(drawings))) == set()
    assert {"c0", "c1", "grid"} <= set(re.findall(r'class="(\w+)"', drawings[0])) <= set(re.findall(r"\.(\w+) \{", page))
    variables = set(re.findall(r"var\((--\w+)\)", page))
    assert variables <= set(re.findall(r"(--\w[\w-]*):", page))


@pytest.mark.parametrize("ending", [".html", ".md"])
def test_lasers_parameters_and_provenance_are_named(arm7: Calibration, page: str, written: Written, ending: str) -> None:
    """Both writings name every laser, parameter and carried parameter, the command line and the hash of the measurements."""
    text = Outline(page).text if ending == ".html" else written(arm7, ending)
    for name in (*arm7.data.lasers, *arm7.errors.names, *arm7.errors.carried, "urdfcal fit robot.urdf 'two words.csv'", arm7.data.sha256):
        assert name in text
    assert "The spots lay 99 mm off on average; after calibration 1.3 mm (1.6 mm on test poses" in text


def test_what_is_predicted_of_the_workspace_is_in_page_and_markdown(arm7: Calibration) -> None:
    """Where it is known how far off each laser's spots will be, both say it in their first table, with the terminal's figures."""
    spots = SpotAccuracy(("laser_1", "laser_2"), (9, 9), *(np.array([1.0, 2.0]) * 1e-3 * times for times in (1, 3, 40)))
    for ending in (".html", ".md"):
        text = report_bytes(Path(f"report{ending}"), arm7, COMMAND, spots=spots).decode()
        first = (Outline(text).text if ending == ".html" else text.replace("|", "").replace("  ", " ")).partition("Parameters")[0]
        assert re.search(r"spots of laser_2 over the workspace ?– ?– ?– ?2\.0 ?6\.0 ?80", first), first


def test_the_verdict_stands_first_and_is_the_terminals(arm7: Calibration, page: str, written: Written) -> None:
    """Page, Markdown and terminal begin with the same verdict and say in the same sentence how far off the spots were."""
    spoken = text_report(arm7).splitlines()
    words = headline(arm7)
    assert spoken[:2] == ["Verdict: can be used", words]
    assert Outline(page).text.partition(spoken[0])[2].startswith(f" {words}")
    assert f"**{spoken[0]}.** {words}" in written(arm7, ".md")
    assert json.loads(written(arm7, ".json"))["headline"] == words


def test_figures_have_a_true_minus_and_what_is_copied_a_hyphen(arm7: Calibration, page: str, written: Written) -> None:
    """No negative figure in tables, terminal and pictures begins with a hyphen; the command line keeps its own."""
    rows = [line for line in written(arm7, ".md").splitlines() if line.startswith("| ") and "sha256" not in line and "created" not in line]
    tables = "\n".join(row for row in rows if not row.startswith("| command"))
    ticks = " ".join(re.findall(r"<text [^>]*>([^<]*)</text>", page))
    for text in (tables, text_report(arm7), ticks):
        assert "\u2212" in text
        assert not re.search(r"(?<![\w.-])-\d", text)
    assert "--spot -1" in report_bytes(Path("report.md"), arm7, [*COMMAND, "--spot", "-1"]).decode()


def test_before_and_after_stand_over_their_three_columns(page: str) -> None:
    """Each of the two headings spans three columns, and in a narrow window a row's names stand in a line above all six."""
    assert re.search(r'colspan="3" scope="colgroup"><span>before</span></th>\s*<th [^>]*colspan="3" scope="colgroup"><span>after', page)
    table = page[page.index('id="spots"') :].partition("</table>")[0]
    for row in re.findall(r'<tr role="row"><th.*?</tr>', table):
        assert len(re.findall(r' lead"', row)) == 3
        assert len(re.findall(r'class="figure"', row)) == 6


def test_markdown_tables_are_regular(arm7: Calibration, written: Written) -> None:
    """Each table has as many cells in every row as in its head."""
    for table in re.findall(r"(?:^\|.*\n)+", written(arm7, ".md"), re.MULTILINE):
        widths = {len(re.findall(r"(?<!\\)\|", row)) for row in table.splitlines()}
        assert len(widths) == 1


def test_json_is_what_the_command_line_prints(arm7: Calibration, written: Written) -> None:
    """The machine-readable report holds at least the entries that the contract promises."""
    found = json.loads(written(arm7, ".json"))
    assert {"converged", "iterations", "rank", "parameters", "combinations", "before", "after", "test"} <= set(found)
    assert [each["name"] for each in found["parameters"]] == list(arm7.errors.names)


@pytest.mark.parametrize("name", ["report.pdf", "report", "report.html.txt", ".html"])
def test_other_endings_are_refused(arm7: Calibration, tmp_path: Path, name: str) -> None:
    """Any other ending is refused in one line that names the three there are, and nothing is written."""
    with pytest.raises(UsageError, match=r"\.html, \.md or \.json") as refused:
        write_report(tmp_path / name, arm7, COMMAND)
    assert "\n" not in str(refused.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("ending", [".html", ".md"])
def test_names_from_files_are_escaped(written: Written, ending: str) -> None:
    """Names of joints, lasers and poses are text, whatever they are made of, also in pictures and where the font lacks their letters."""
    nasty = "&lt;script&gt;alert(1)&lt;/script&gt;&amp;|`$x$`_關節"
    robot = robot_of(URDF.replace('"turn"', f'"{nasty}"').replace('name="small"', 'name="&lt;b&gt;"'))
    calibration = simulated(robot, fitted=12, tested=2, error_model="offset")
    assert "<script>alert(1)</script>&|`$x$`_關節.d_theta" in calibration.errors.names
    text = written(calibration, ending)
    assert "<script" not in text
    assert "<b>" not in text.removeprefix("<b ").replace("<b style", "")
    if ending == ".html":
        assert "<script>alert(1)</script>&|`$x$`_關節.d_theta" in Outline(text).text


@pytest.mark.parametrize("ending", [".html", ".md", ".json"])
def test_a_fit_that_did_not_converge_is_reported_as_bad(robots: dict[str, Robot], written: Written, ending: str) -> None:
    """After a single sweep the report is written all the same, and its verdict is not to use the result."""
    calibration = simulated(robots["arm4"], max_sweeps=1, gated=False)
    assert not calibration.converged
    assert opening_of(calibration, []).level == "bad"
    assert "did not converge" in written(calibration, ending)


def test_numbers_that_are_none_do_not_break_the_page(arm7: Calibration, written: Written) -> None:
    """A fit that ran away, with infinite estimates and covariance, still gives a page."""
    belief = replace(arm7.estimate.belief, x=np.full_like(arm7.x, 1e9), P=np.full_like(arm7.covariance, np.inf))
    broken = replace(arm7, estimate=replace(arm7.estimate, belief=belief, stop="not_finite"), chi_squared=np.nan)
    with np.errstate(all="ignore"):
        assert "Verdict: do not use" in written(broken, ".html")


def test_noise_that_is_stated_too_small_is_bad_and_no_single_spot_is_blamed(robots: dict[str, Robot]) -> None:
    """With a tenth of the noise stated the fit is rejected, while residuals are still judged against each other."""
    calibration = simulated(robots["arm4"], spot_sigma=SPOT_SIGMA / 10, gated=False)
    sets = residuals_of(calibration)
    assert spreads(calibration, sets)["spot"] == pytest.approx(10, rel=0.2)
    assert suspects(calibration, sets) == []
    assert opening_of(calibration, []).level == "bad"


@pytest.mark.parametrize("gated", [True, False])
def test_a_wild_spot_is_named(robots: dict[str, Robot], gated: bool) -> None:
    """A spot that is 5 cm off is named by pose and laser, whether the fit left it out or had to live with it."""
    calibration = simulated(robots["arm4"], shift=(7, 0.05), gated=gated)
    report = report_of(calibration, COMMAND)
    outliers = str(next(section for section in report.sections if section.key == "outliers"))
    assert re.search(rf"'(pose )?{calibration.data.poses[7]}', 'laser_1'", outliers)
    assert any(each.distance_mm > 40 for each in calibration.outliers) == gated
    assert any(each.distance > 40 for each in report.suspects) != gated


def test_lengths_of_residuals_have_their_distribution(robots: dict[str, Robot]) -> None:
    """Squared lengths of residuals of fitted and test poses average to two, the size of a spot, with joint noise too."""
    robot, rng = robots["ur5"], np.random.default_rng(8)
    model, truth = random_truth(robot, rng, 1e-3, np.radians(0.1))
    q = draw_poses(robot, model, truth, 400, rng)
    data = simulate(robot, model, truth, q, rng, SimulatedNoise(SPOT_SIGMA, np.radians(0.05)))
    data = replace(data, sets=np.array(["fit"] * 300 + ["test"] * 100))
    sets = residuals_of(fit(robot, data, spot_sigma=SPOT_SIGMA, joint_sigma=np.radians(0.05), gated=False))
    fitted, tested = (np.concatenate([each.lengths for each in sets if each.label == label]) for label in ("fit", "test"))
    used = 34 / 1200
    assert np.mean(fitted**2) == pytest.approx(2 * (1 - used), rel=0.15)
    assert np.mean(tested**2) == pytest.approx(2, rel=0.25)


def test_healthy_data_raise_no_suspicion(robots: dict[str, Robot]) -> None:
    """Over ten clean data sets of 80 spots at most one spot is suspected."""
    robot, found = robots["arm4"], 0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        model, truth = random_truth(robot, rng, 2e-3, np.radians(0.2))
        data = simulate(robot, model, truth, draw_poses(robot, model, truth, 40, rng), rng, SimulatedNoise(SPOT_SIGMA))
        calibration = fit(robot, data, error_model="placement")
        found += len(suspects(calibration, residuals_of(calibration)))
    assert found <= 1


def test_undetermined_parameters_are_told_and_no_reservation(robots: dict[str, Robot], written: Written) -> None:
    """Under dh the paper's four-joint arm shows only joint1.d_d + joint2.d_d; table and verdict say so, and it can be used all the same."""
    calibration = simulated(robots["arm4"], tested=20, error_model="dh")
    opening = opening_of(calibration, [])
    assert opening.level == "good"
    assert any("joint1.d_d" in finding.text for finding in opening.findings if finding.level == "note")
    text = written(calibration, ".md")
    assert "| joint1.d\\_d | not determined |" in text.replace("joint1.d_d", "joint1.d\\_d")
    assert "joint1.d_d + joint2.d_d" in text


def test_many_poses_stay_small(robots: dict[str, Robot], written: Written) -> None:
    """A page of 1000 poses has at most 1.5 MB."""
    assert len(written(simulated(robots["ur5"], fitted=800, tested=200), ".html")) < 1.5e6


def test_measurements_without_labels_or_a_beam_or_test_poses(robots: dict[str, Robot], written: Written) -> None:
    """Data from arrays, with a beam that is never seen, give a page too; without test poses it has no pictures of them, and says so."""
    robot = robots["ur5"]
    calibration = simulated(robot, fitted=60)
    spots = calibration.data.spots.copy()
    spots[:, 1] = np.nan
    page = written(fit(robot, spots_measured(robot, calibration.data.q, spots)), ".html")
    assert "laser_1" in Outline(page).text
    assert "No test poses" in page
    assert "Test poses after calibration" not in page
