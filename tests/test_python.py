"""What people who work in Python have of a result: DataFrames, figures, tables, a line and a card for everything."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import urdfcal
from tests.support.paths import ROBOTS_DIR
from urdfcal.base.errors import UsageError
from urdfcal.base.notebook import Listing, card
from urdfcal.output.latex import latex_text
from urdfcal.robot.robot import Robot


@pytest.fixture(scope="module")
def calibration(robots: dict[str, Robot]) -> urdfcal.Calibration:
    """arm7's."""
    data = urdfcal.read_measurements(ROBOTS_DIR / "arm7" / "measurements.csv", robots["arm7"])
    return urdfcal.fit(robots["arm7"], data)


@pytest.fixture(scope="module")
def simulation(robots: dict[str, Robot]) -> urdfcal.Simulation:
    """Poses of a UR5's tool."""
    return urdfcal.simulate(robots["ur5"], 12, sensors=["pose:tool0"], test_poses=3, seed=4)


@pytest.fixture(scope="module")
def shown(calibration: urdfcal.Calibration, simulation: urdfcal.Simulation, robots: dict[str, Robot]) -> list[Any]:
    """One of each thing that a notebook may show."""
    online = urdfcal.OnlineCalibrator(robots["ur5"])
    state = online.update(simulation.measurements.subset(np.arange(5)))
    check = urdfcal.check(robots["ur5"], simulation.measurements)
    plan = urdfcal.plan(robots["ur5"], candidates=40, n=3, sensors=["pose:tool0"])
    apart = urdfcal.compare(robots["arm7"], calibration)
    fitted = [robots["arm7"], simulation.nominal, calibration.data, calibration, calibration.verdict, simulation]
    return [*fitted, check, plan, online, state, apart]


def test_only_public_names_are_listed() -> None:
    """`dir(urdfcal)` is what is public, all of it is there, and `plan` is `plan_poses`."""
    assert dir(urdfcal) == sorted(urdfcal.__all__)
    assert all(hasattr(urdfcal, name) for name in dir(urdfcal))
    assert urdfcal.plan is urdfcal.plan_poses


def test_everything_says_in_a_line_what_it_is(shown: list[Any]) -> None:
    """No repr of a public thing is longer than a line that can be read."""
    for each in shown:
        assert repr(each).startswith(f"<{type(each).__name__}")
        assert len(repr(each)) < 160
        assert "\n" not in repr(each)


class Tags(HTMLParser):
    """The elements of a page, and whether they are closed in order."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: set[str] = set()

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self.open.append(tag)
        self.seen.add(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_notebooks_show_whole_elements(shown: list[Any]) -> None:
    """Every card is well formed, and asks for nothing but elements that notebooks show."""
    for each in [own for own in shown if hasattr(own, "_repr_html_")]:
        tags = Tags()
        tags.feed(each._repr_html_())
        assert tags.open == []
        assert tags.seen <= {"div", "span", "table", "thead", "tbody", "tr", "th", "td", "details", "summary"}
    assert sum(hasattr(own, "_repr_html_") for own in shown) >= 8


def test_foreign_text_is_text(calibration: urdfcal.Calibration) -> None:
    """What a file is called, and what stands in cells, becomes neither an element nor a control character."""
    data = dataclasses.replace(calibration.data, source="<script>alert(1)</script>\x1b[31m")
    page = data._repr_html_() + card("<b>", ["&"], [Listing(("<i>",), [("<img src=x>",)], title="<u>")])
    assert not any(element in page for element in ("<script", "<b>", "<i>", "<img", "<u>", "\x1b"))
    assert "\x1b" not in repr(data)


def test_parameters_are_a_frame(calibration: urdfcal.Calibration) -> None:
    """One row a parameter, in SI, with what the estimate says of it."""
    pytest.importorskip("pandas")
    frame = calibration.parameters
    assert list(frame.index) == list(calibration.errors.names)
    np.testing.assert_array_equal(frame["value"], calibration.x)
    np.testing.assert_array_equal(frame["sigma"], calibration.sigma)
    assert set(frame["unit"]) == {"m", "rad"}


def test_residuals_are_a_frame(calibration: urdfcal.Calibration) -> None:
    """One row a number that was read, in SI: before and after have the mean distances of the tables."""
    pytest.importorskip("pandas")
    frame = calibration.residuals()
    assert len(frame) == 2 * 2 * 90
    fitted = frame[frame["set"] == "fit"]
    for column, table in (("before", calibration.before), ("after", calibration.after)):
        for laser, own in table.items():
            pairs = fitted[fitted["reading"] == laser][column].to_numpy().reshape(-1, 2)
            assert np.linalg.norm(pairs, axis=1).mean() * 1e3 == pytest.approx(own.mean)


def test_without_pandas_its_extra_is_named(calibration: urdfcal.Calibration, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where pandas is not installed one line says how it is, and the same is there as arrays."""
    monkeypatch.setitem(sys.modules, "pandas", None)
    for ask in (lambda: calibration.parameters, calibration.residuals):
        with pytest.raises(UsageError, match=r"is a DataFrame, and pandas is not installed: pip install 'urdfcal\[pandas\]'$"):
            ask()
    assert len(calibration.x) == len(calibration.errors.names)


@pytest.mark.parametrize("draw", [urdfcal.Calibration.plot_spots, urdfcal.Calibration.plot_residuals, urdfcal.Calibration.plot_convergence])
def test_figures_are_nobody_elses(calibration: urdfcal.Calibration, draw: Callable[[Any], Any]) -> None:
    """A figure is drawn in colours of the page and not in their stand-ins, and pyplot knows nothing of it."""
    from matplotlib.colors import to_hex

    figure = draw(calibration)
    lines = [to_hex(line.get_color()) for axes in figure.findobj(lambda own: hasattr(own, "tick_params")) for line in axes.get_lines()]
    assert lines
    assert not any(colour.startswith("#000") for colour in lines)
    pyplot = sys.modules.get("matplotlib.pyplot")
    assert pyplot is None or pyplot.get_fignums() == []


def test_a_notebook_shows_a_figure(calibration: urdfcal.Calibration) -> None:
    """Without pyplot a notebook has no picture of a figure but the figure's own."""
    figure = calibration.plot_spots()
    figure.set_dpi(20)
    assert figure._repr_png_().startswith(b"\x89PNG")  # type: ignore[attr-defined]


def test_reports_and_tables_are_written(calibration: urdfcal.Calibration, tmp_path: Path) -> None:
    """A report by its ending; tables whose figures are the report's, with as many cells a row as columns."""
    calibration.write_report(tmp_path / "report.md", ["urdfcal"])
    assert "# Calibration of arm7" in (tmp_path / "report.md").read_text("utf-8")
    with pytest.raises(UsageError, match="a report ends in"):
        calibration.write_report(tmp_path / "report.pdf")
    text = calibration.to_latex()
    assert text.count("\\begin{table}") == text.count("\\end{tabular}") >= 2
    assert f"{calibration.after['laser_1'].mean:.3f}" in text
    rows = [line for line in text.partition("\\end{table}")[0].splitlines() if line.startswith(("fit", "test", "poses"))]
    assert {line.count(" & ") for line in rows} == {8}


def test_latex_sets_text_as_it_stands() -> None:
    """Signs of LaTeX's own are escaped once, and minus signs are minus signs."""
    assert latex_text("a_b {50%} \\x ~ ±") == r"a\_b \{50\%\} \textbackslash{}x \textasciitilde{} $\pm$"
    assert latex_text("-1.5 ± 0.2, laser-1, 3-4") == r"$-$1.5 $\pm$ 0.2, laser-1, 3-4"


def test_calibrations_are_compared_as_the_files_that_they_write(calibration: urdfcal.Calibration, tmp_path: Path) -> None:
    """A fit and its YAML differ by nothing; a fit of other poses by as much, and as probably, as its YAML does."""
    robot, half = calibration.robot, np.arange(0, len(calibration.data), 2)
    other = urdfcal.fit(robot, calibration.data.subset(half))
    for name, found in (("all.yaml", calibration), ("half.yaml", other)):
        (tmp_path / name).write_bytes(found.record())
    assert urdfcal.compare(calibration, tmp_path / "all.yaml").identical
    fits = urdfcal.compare(calibration, other)
    files = urdfcal.compare(tmp_path / "all.yaml", str(tmp_path / "half.yaml"), robot=robot)
    assert fits.same is True
    assert fits.by_chance == pytest.approx(files.by_chance, rel=1e-6)
    assert fits.at_tool.apart == pytest.approx(files.at_tool.apart, abs=1e-9)
    assert "are the same within what either knows" in fits.report()
    with pytest.raises(UsageError, match="compare: found a Model; expected calibrations, robots, or paths"):
        urdfcal.compare(calibration, robot.model)


def test_a_simulation_knows_its_truth(simulation: urdfcal.Simulation) -> None:
    """The true robot explains what was simulated to the noise, the nominal one does not, and test poses are marked."""
    assert int(np.count_nonzero(simulation.measurements.sets == "test")) == 3
    true, nominal = (urdfcal.evaluate(robot, simulation.measurements) for robot in (simulation.robot, simulation.nominal))
    assert true["tool0"].mean < 0.3
    assert nominal["tool0"].mean > 1.0
    assert len(simulation.truth) == len(simulation.x)


def test_stated_errors_are_the_truth(robots: dict[str, Robot]) -> None:
    """Errors by name are simulated as they are stated, and what is no error's name is refused."""
    made = urdfcal.simulate(robots["arm7"], 2, errors={"joint1.d_a": 0.01}, error_model="dh", spot_noise=0.0)
    assert made.truth["joint1.d_a"] == 0.01
    assert sum(map(abs, made.truth.values())) == 0.01
    with pytest.raises(UsageError, match=r"no parameter named 'joint1\.a'"):
        urdfcal.simulate(robots["arm7"], 2, errors={"joint1.a": 0.01}, error_model="dh")
    with pytest.raises(UsageError, match="one pose or more"):
        urdfcal.simulate(robots["arm7"], 0)


CALLS: dict[str, Callable[[Any, Any], Any]] = {
    "fit": urdfcal.fit,
    "check": urdfcal.check,
    "read_measurements": lambda robot, data: urdfcal.read_measurements(data, robot),
    "measurements_from": urdfcal.measurements_from,
    "simulate": lambda robot, data: urdfcal.simulate(robot),
    "plan_poses": lambda robot, data: urdfcal.plan_poses(robot),
    "OnlineCalibrator": lambda robot, data: urdfcal.OnlineCalibrator(robot),
}


@pytest.mark.parametrize("call", CALLS)
def test_a_path_in_place_of_a_robot_is_refused(call: str) -> None:
    """Every call that takes a robot says by its name that it does, before anything fails in it."""
    with pytest.raises(UsageError, match=f"^{call}: expected a Robot, as load_robot gives it, found str$"):
        CALLS[call]("arm7.urdf", "measurements.csv")


def test_one_sensor_needs_no_list(robots: dict[str, Robot], simulation: urdfcal.Simulation) -> None:
    """A single sensor by its words is the list of it."""
    alone = urdfcal.simulate(robots["ur5"], 12, sensors="pose:tool0", test_poses=3, seed=4)
    assert np.array_equal(alone.measurements.q, simulation.measurements.q)
    assert alone.measurements.summary == simulation.measurements.summary


@pytest.mark.parametrize("call", [urdfcal.fit, urdfcal.check])
def test_a_table_in_place_of_measurements_is_refused(robots: dict[str, Robot], call: Callable[[Any, Any], Any]) -> None:
    """What measurements_from takes is not yet measurements."""
    with pytest.raises(UsageError, match="expected Measurements, as read_measurements gives them, found dict"):
        call(robots["ur5"], {"tool0.x": [1.0]})
