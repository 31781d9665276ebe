"""Pictures of parameters."""

from __future__ import annotations

import re

import pytest

from tests.support.paths import ROBOTS_DIR
from urdfcal.api import Calibration, fit
from urdfcal.output.report.plots.parameters import convergence_pictures, value_pictures
from urdfcal.output.report.plots.svg import Picture
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements_csv import read_measurements


@pytest.fixture(scope="module")
def calibration(robots: dict[str, Robot]) -> Calibration:
    """The example that comes with urdfcal."""
    return fit(robots["arm7"], read_measurements(ROBOTS_DIR / "arm7" / "measurements.csv", robots["arm7"]))


def colours(picture: Picture) -> dict[str, str]:
    """Colour by label in a legend."""
    return {key.label: re.findall(r'class="(\w+)"', key.svg)[0] for key in picture.keys}


def test_a_joint_has_one_colour_throughout(calibration: Calibration) -> None:
    """In every panel and picture, whichever of its parameters are shown; no two of the seven joints and the mount share one."""
    found: dict[str, set[str]] = {}
    for picture in convergence_pictures(calibration):
        for label, colour in colours(picture).items():
            found.setdefault(re.split(r"[. ]", label)[0], set()).add(colour)
    assert set(found) == {*(f"joint{number}" for number in range(1, 8)), "slm"}
    assert all(len(own) == 1 for own in found.values())
    assert len(set.union(*found.values())) == 8
    for picture in value_pictures(calibration):
        rows = re.findall(r'text-anchor="end">(\w+)\.', picture.svg)
        drawn = re.findall(r'<g class="(c\d)"><path d="[^"]*" stroke="none"', picture.svg)
        assert [{colour} for colour in drawn] == [found[name] for name in rows]


def test_legends_are_in_reading_order(calibration: Calibration) -> None:
    """Joints follow each other as on the robot; the paper's panels come first, in its order."""
    pictures = convergence_pictures(calibration)
    assert [picture.title[:3] for picture in pictures[:4]] == ["(a)", "(b)", "(c)", "(d)"]
    assert [key.label for key in pictures[0].keys] == [f"joint{number}" for number in range(1, 8)]
