"""Several instruments in the view: each stands where it was found, cameras and sheets with it, marks where targets were in the room."""

from __future__ import annotations

import numpy as np
import pytest

from tests.calibration.test_lasers_of_arms import CELL
from tests.simulation.test_pictures import CAMERA, GRID
from tests.support.small_robot import robot_of
from urdfcal.output.view.legend import layers
from urdfcal.output.view.placed import frame_placements, link_placements
from urdfcal.output.view.scene import Scene
from urdfcal.robot.configurations import whole_configurations
from urdfcal.robot.robot import Robot
from urdfcal.sensors.columns import Stations
from urdfcal.sensors.measurements import as_measured
from urdfcal.simulation.simulated import Simulation, simulate


@pytest.fixture(scope="module")
def lasers() -> tuple[Robot, Simulation]:
    """Spots on a card that is carried, and on a wall, of a robot without errors."""
    robot = robot_of(CELL)
    return robot, simulate(robot, 20, sensors=["laser:laser_1@card", "laser:laser_3@wall"], errors=(0, 0), spot_noise=0, seed=3)


def test_marks_stand_where_the_room_has_them(lasers: tuple[Robot, Simulation]) -> None:
    """All marks are in the frame that stands still; at every pose the laser, by Pinocchio, is where its beam's line begins."""
    robot, made = lasers
    scene = Scene(as_measured(robot, made.measurements), None, made.measurements)
    placed = scene.placed[-1]
    assert scene.solid.rig.instruments.every[placed.drawn_frame].name == "wall"
    q = made.measurements.q
    whole = whole_configurations(scene.solid, q)
    to_root = frame_placements(placed, whole, q)
    for mark in placed.marks:
        there = link_placements(scene.solid, mark.target, whole)
        for pose in np.flatnonzero(mark.was_read):
            off = np.linalg.norm(to_root[pose].act(mark.start[pose]) - there[pose].translation)
            assert off < 0.1  # as far as the laser was put off its link, and some


def test_each_instrument_has_its_rows(lasers: tuple[Robot, Simulation], robots: dict[str, Robot]) -> None:
    """The legend has the frame, the camera and the sheet of each of several instruments, and a box for each; alone there are none."""
    robot, made = lasers
    words = [layer.words for layer in layers(Scene(as_measured(robot, made.measurements), None, made.measurements))]
    assert {"frame of card", "sheet of card, about its spots", "sheet of wall, about its spots"} <= set(words)
    stations = Stations({"beside": "", "leica": ""}, cameras={"beside": CAMERA})
    seen = simulate(robots["ur5"], 12, sensors=["pixels:tool0@beside", "point:tool0:a@leica"], boards={"tool0": GRID}, stations=stations)
    scene = Scene(as_measured(robots["ur5"], seen.measurements), None, seen.measurements)
    rows = {layer.words: layer.paths for layer in layers(scene)}
    assert rows["camera beside, and how far it sees to the sides"] == ("instruments/0/camera",)
    assert rows[f"frame of leica, fixed to {seen.nominal.tree.root}"] == ("instruments/1/axes",)
    alone = simulate(robots["ur5"], 12, sensors=["point:tool0"]).measurements
    assert Scene(as_measured(robots["ur5"], alone), None, alone).instruments == ()
