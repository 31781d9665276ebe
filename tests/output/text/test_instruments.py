"""Reports and checks of measurements that are not laser spots."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.support.paths import SHARED_DATA
from tests.support.sensor_cases import CASES, NOISE, setup_of
from urdfcal.api import Calibration, fit
from urdfcal.base.terminal import as_text
from urdfcal.calibration.analysis.check import check
from urdfcal.calibration.problem import Problem
from urdfcal.estimation.robust import mahalanobis_squared
from urdfcal.output.report.content import Report, report_of
from urdfcal.output.report.html import page
from urdfcal.output.report.markdown import markdown
from urdfcal.output.report.residuals import residuals_of
from urdfcal.output.report.suspects import suspects
from urdfcal.output.report.verdict import opening_of
from urdfcal.output.text.check import check_blocks, check_json
from urdfcal.output.text.instruments import length_entries, parameters_in_words, place_entries
from urdfcal.output.text.result import calibration_json, text_report
from urdfcal.robot.robot import Robot
from urdfcal.sensors.readings import known_lengths
from urdfcal.simulation.readings import simulate_readings

COMMAND = ["urdfcal", "fit", "robot.urdf", "poses.csv"]


def calibrated(name: str, robots: dict[str, Robot], fitted: int = 80, tested: int = 12, **options: object) -> Calibration:
    """A fit of simulated readings, with test poses."""
    rng = np.random.default_rng(7)
    setup = setup_of(CASES[name], robots, rng)
    data = simulate_readings(setup, fitted + tested, rng, NOISE)
    sets = np.where(rng.permutation(fitted + tested) < fitted, "fit", "test")
    lengths = [("1 - 2", float(np.linalg.norm(setup.place("socket:1") - setup.place("socket:2"))))] if name == "socket" else []
    data = replace(data, sets=sets, lengths=known_lengths(lengths, data.readings))
    return fit(setup.robot, data, evidence=False, **options)  # type: ignore[arg-type]


def sections_of(report: Report) -> set[str]:
    return {section.key for section in report.sections}


@pytest.fixture(scope="module", params=list(CASES))
def case(request: pytest.FixtureRequest, robots: dict[str, Robot]) -> Calibration:
    """A fit with every kind of sensor, in every arrangement."""
    return calibrated(request.param, robots)


def test_residuals_are_those_of_the_tables(case: Calibration) -> None:
    """Mean, number and unit of every reading's residuals are the before and after tables' own, of fitted and of test poses."""
    tables = {"fit": (case.before, case.after), "test": case.test or ({}, {})}
    sets = residuals_of(case)
    assert {(each.label, each.name) for each in sets} == {(label, name) for label, (_, after) in tables.items() for name in after}
    for each in sets:
        for table, sizes in zip(tables[each.label], (each.before_size, each.after_size), strict=True):
            assert (table[each.name].n, table[each.name].unit) == (len(sizes), each.unit)
            assert np.mean(sizes) == pytest.approx(table[each.name].mean, rel=1e-6, abs=1e-9)


def test_squared_lengths_are_the_gate_s(case: Calibration) -> None:
    """Squared lengths of fitted residuals are the squared distances that outliers are told by."""
    model = Problem(case.errors, case.data)
    d2 = mahalanobis_squared(model.linearise(case.x), case.estimate.noise)[: len(case.data)]
    columns = {block.name: d2[:, index] for index, block in enumerate(model.blocks)}
    for each in (each for each in residuals_of(case) if each.label == "fit"):
        assert each.lengths**2 == pytest.approx(columns[each.name][each.rows], rel=1e-9, abs=1e-12)


def test_every_arrangement_gives_a_whole_report(case: Calibration) -> None:
    """Markdown, JSON and text name every target, never call a reading a spot, and list no place as a parameter."""
    report = report_of(case, COMMAND)
    text, machine = markdown(report), json.dumps(calibration_json(case))
    for target in case.robot.rig.instruments.targets:
        assert all(target.name in each for each in (text, machine, text_report(case)))
    parameters = str(next(section for section in report.sections if section.key == "parameters"))
    assert not [name for name in case.errors.names if name.startswith(("socket:", "plane:")) and f"'{name}'" in parameters]
    assert ("frames" in sections_of(report)) == any(slot.frame is not None for slot in case.errors.slots)
    assert ("places" in sections_of(report)) == any(each.sensor in ("plane", "socket") for each in case.data.readings)
    assert case.data.lasers or not re.search(r"\bspots?\b|\bbeams?\b|\bscreen\b", text + text_report(case))
    assert not re.search(r"\bnan\b", text + machine)


@pytest.mark.parametrize("name", ["every kind", *(pytest.param(each, marks=pytest.mark.slow) for each in CASES)])
def test_pages_are_well_formed(name: str, robots: dict[str, Robot]) -> None:
    """No id stands twice, every picture says what it shows, and each kind of reading has a histogram before and after."""
    calibration = calibrated(name, robots, fitted=40)
    html = page(report_of(calibration, COMMAND), calibration)
    ids = re.findall(r'\bid="([^"]+)"', html)
    assert len(ids) == len(set(ids))
    drawings = re.findall(r"</h3>(<svg [^>]*>)", html)
    assert len(drawings) == html.count("<figure>")
    assert all(re.search(r'aria-label="[^"]{20,}"', drawing) for drawing in drawings)
    titles = re.findall(r"<figure><h3>(.*?)</h3>", html)
    assert len(titles) == len(set(titles))
    kinds = {each.noise for each in calibration.data.readings}
    assert len([title for title in titles if title.endswith(" before")]) >= len(kinds)


def test_every_arrangement_can_be_checked(case: Calibration) -> None:
    """What `check` says of readings names no spot and no parameter that is not the robot's own, and is whole for machines."""
    result = check(case.robot, case.data)
    text = as_text(check_blocks(result))
    assert case.data.summary in text
    assert case.data.lasers or not re.search(r"\bspots?\b|beam|screen", text)
    own = {each.name for each in result.errors.parameters if each.kind not in ("reference", "target", "place")}
    assert {name for suggestion in result.suggestions for name in suggestion.determines} <= own
    assert len(json.loads(json.dumps(check_json(result)))["parameters"]) == len(result.errors.names)


def test_a_wild_reading_is_named_and_healthy_ones_are_not(robots: dict[str, Robot]) -> None:
    """A point that is 20 mm off is the one suspect, and the report's opening names its pose, when the fit has to live with it."""
    rng = np.random.default_rng(3)
    setup = setup_of(CASES["pose"], robots, rng)
    data = simulate_readings(setup, 60, rng, NOISE)
    healthy = fit(setup.robot, data, gated=False, evidence=False)
    assert suspects(healthy, residuals_of(healthy)) == []
    data.readings[0].values[11, 1] += 0.02
    calibration = fit(setup.robot, data, gated=False, evidence=False)
    report = report_of(calibration, COMMAND)
    assert report.suspects[0].pose == data.poses[11]
    assert report.suspects[0].distance > 10
    told = [finding.text for finding in report.opening.findings if finding.level == "note"]
    assert any("measurement" in text and f"pose {data.poses[11]}" in text for text in told)


def test_places_and_known_lengths_are_told(robots: dict[str, Robot]) -> None:
    """Every socket has its position within five sigmas of the truth's distances, and the known length is found."""
    calibration = calibrated("socket", robots, fitted=60, tested=0)
    places = place_entries(calibration)
    assert [place["name"] for place in places] == ["socket:1", "socket:2", "socket:3", "socket:4"]
    assert all(len(place["xyz"]) == 3 and place["sigma"] > 0 for place in places)
    known = length_entries(calibration)[0]
    assert known["found"] == pytest.approx(known["known"], abs=5 * known["sigma"])
    apart = np.linalg.norm(np.subtract(places[0]["xyz"], places[1]["xyz"]))
    assert known["found"] == pytest.approx(float(apart), abs=1e-12)
    assert "3 of targets, 12 of places" in parameters_in_words(calibration.errors)


def test_orientation_is_told_in_degrees(robots: dict[str, Robot]) -> None:
    """Headline and table give points in mm and orientations in deg."""
    calibration = calibrated("pose", robots)
    headline = opening_of(calibration, []).headline
    assert re.search(r"lay [\d.]+ mm and [\d.]+ deg off on average; after calibration [\d.]+ mm and [\d.]+ deg \(", headline)
    assert "in mm and deg" in text_report(calibration)


def test_more_range_of_a_stiff_joint_is_suggested(robots: dict[str, Robot]) -> None:
    """Where one joint hardly moves, `check` says so first among ranges, and with points alone it asks for the orientation too."""
    rng = np.random.default_rng(5)
    setup = setup_of(CASES["point"], robots, rng)
    data = simulate_readings(setup, 60, rng, NOISE)
    stiff = data.q.copy()
    stiff[:, 2] = 0.3 + 0.01 * rng.normal(size=len(stiff))
    words = [suggestion.words for suggestion in check(setup.robot, replace(data, q=stiff)).suggestions]
    ranges = [each for each in words if each.startswith("more range of ")]
    assert ranges[0].startswith(f"more range of {data.joints[2]}:")
    assert any(each.startswith("the orientation of tool0 too") for each in words)


def test_real_measurements_of_sockets_are_summarised(example_robots: Path) -> None:
    """The report of 387 touches of 12 sockets lists 12 places and 6 known lengths, and its JSON holds them all."""
    from urdfcal.robot.robot import load_robot
    from urdfcal.sensors.measurements_csv import read_measurements

    folder = SHARED_DATA / "panda_sockets"
    if not folder.exists():
        pytest.skip("the measurements of real robots are not here: ../shared/data/panda_sockets")
    robot = load_robot(example_robots / "panda_description" / "urdf" / "panda.urdf")
    data = read_measurements(folder / "measurements.csv", robot)
    calibration = fit(robot, replace(data, lengths=known_lengths([("*/0 - */1", 0.05)], data.readings)), evidence=False)
    places = next(section for section in report_of(calibration, COMMAND).sections if section.key == "places")
    tables = [block for block in places.blocks if hasattr(block, "rows")]
    assert [len(table.rows) for table in tables] == [12, 6]
    machine = calibration_json(calibration)
    assert (len(machine["places"]), len(machine["lengths"])) == (12, 6)
    assert all(length["found"] == pytest.approx(0.05, abs=1e-4) for length in machine["lengths"])
