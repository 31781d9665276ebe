"""Spots beyond the edge of the screen that the URDF draws."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.support.small_robot import CSV, URDF, robot_of
from tests.support.vision_scenes import random_camera
from urdfcal.robot.robot import Robot
from urdfcal.robot.sheet import ScreenArea, stated_sheet
from urdfcal.sensors.measurements import Measurements, spots_measured
from urdfcal.sensors.measurements_csv import read_measurements
from urdfcal.sensors.off_screen import beyond_the_screen
from urdfcal.sensors.readings import Readings


def with_screen(*drawn: str) -> Robot:
    """The small robot whose screen looks like this."""
    return robot_of(URDF.replace('<link name="screen"/>', f'<link name="screen">{"".join(drawn)}</link>'))


def box(size: str, origin: str = "", tag: str = "visual") -> str:
    return f'<{tag}>{origin}<geometry><box size="{size}"/></geometry></{tag}>'


SHEETS = {
    "as the macro draws it": (box("0.005 2 1.5", '<origin xyz="0.0025 0 0"/>'), ScreenArea((2.0, 1.5))),
    "beside its origin": (box("0.005 2 1.5", '<origin xyz="0 1 -0.75" rpy="0 0 0"/>'), ScreenArea((2.0, 1.5), (1.0, -0.75))),
    "turned": (box("2 0.01 1.5", '<origin rpy="0 0 1.5707963267948966"/>'), ScreenArea((2.0, 1.5))),
    "a collision shape": (box("0.01 2 1.5", tag="collision"), ScreenArea((2.0, 1.5))),
    "the larger of two": (box("0.01 0.1 0.2") + box("0.01 2 1.5"), ScreenArea((2.0, 1.5))),
    "a face": (box("0.1 0.1 0.1"), None),
    "askew": (box("0.01 2 1.5", '<origin rpy="0.3 0 0"/>'), None),
    "no box": ('<visual><geometry><sphere radius="1"/></geometry></visual>', None),
    "no number": (box("0.01 a 1"), None),
    "too few numbers": (box("0.01 1"), None),
    "nothing": ("", None),
}


@pytest.mark.parametrize("name", SHEETS)
def test_a_screen_is_as_large_as_it_is_drawn(name: str) -> None:
    """A flat box in the plane of the screen tells its size; anything else tells none."""
    drawn, expected = SHEETS[name]
    found = stated_sheet(with_screen(drawn))
    if expected is None:
        assert found is None
    else:
        assert found is not None
        np.testing.assert_allclose([*found.size, *found.centre], [*expected.size, *expected.centre], atol=1e-12)  # type: ignore[misc]


def data_of(robot: Robot, spots: np.ndarray) -> Measurements:
    return spots_measured(robot, np.zeros((len(spots), 3)), spots, poses=[f"p{number}" for number in range(len(spots))])


def test_spots_beyond_the_edge_are_counted_and_the_farthest_named() -> None:
    """As of 3 m of spots on a 2 m screen; a centimetre over the edge, an unseen beam and a screen of no size are nothing to speak of."""
    robot = with_screen(box("0.005 2 2"))
    spots = np.array([[[0.1, 0.2], [1.005, -1.0]], [[np.nan, np.nan], [1.4, 0.3]], [[-0.2, -1.5], [0.0, 1.011]]])
    (warning,) = beyond_the_screen(robot, data_of(robot, spots))
    assert warning.startswith(
        "3 of 5 spots lie beyond the edge of 'screen', which the URDF has as 2 x 2 m; the farthest is laser_1 in pose p2,"
    )
    assert "at y -0.200 m, z -1.500 m: check the unit" in warning
    assert beyond_the_screen(robot, data_of(robot, spots[:1])) == ()
    assert beyond_the_screen(with_screen(), data_of(robot, spots)) == ()


def test_pixels_of_spots_are_looked_up_on_the_screen() -> None:
    """A camera's pixels lie beyond the edge where the spots do that it saw."""
    robot, camera = with_screen(box("0.005 1 1")), random_camera(np.random.default_rng(3))
    spots = np.array([[0.2, 0.1], [0.7, 0.0], [-0.1, 0.4]])
    pixels = Readings("spot_pixel", "laser_1", "laser_1", camera.pixels_of_spots(spots), np.full(3, ""), np.full(3, np.nan))
    data = replace(data_of(robot, np.full((3, 2, 2), np.nan)), readings=(pixels,), camera=camera)
    (warning,) = beyond_the_screen(robot, data)
    assert warning.startswith("1 of 3 spots")
    assert "laser_1 in pose p1, at y 0.700 m, z 0.000 m" in warning or "z -0.000 m" in warning


def test_whoever_reads_a_file_is_warned(tmp_path: Path) -> None:
    """With the file's line; spots in millimetres under a header in metres are the usual cause."""
    path = tmp_path / "m.csv"
    path.write_text(CSV)
    robot = with_screen(box("0.005 2 2"))
    assert read_measurements(path, robot).warnings == ()
    path.write_text(CSV.replace("0.07,0.08", "7,8"))
    (warning,) = read_measurements(path, robot).warnings
    assert "1 of 4 spots lie beyond" in warning
    assert "laser_2 in" in warning
    assert "m.csv:3, at y 7.000 m" in warning
