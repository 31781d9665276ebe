"""A measuring frame that is taken for another: named as the link that it is, and only where it is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from tests.support.helpers import assert_poses_close
from tests.support.sensor_cases import NOISE, SensorCase, setup_of
from urdfcal import FitRejected, fit
from urdfcal.base.geometry import SE3, Matrix
from urdfcal.calibration.start.references import links_of_reference, mistakes_of_reference
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.simulation.readings import simulate_readings

KNOWN = SensorCase("ur5", ("pose:tool0",), "base_link", known=True)


def measured(robots: dict[str, Robot], case: SensorCase = KNOWN) -> tuple[Robot, Measurements]:
    rng = np.random.default_rng(3)
    setup = setup_of(case, robots, rng, model="auto")
    return setup.robot, simulate_readings(setup, 40, rng, NOISE)


def seen_in(T_new_old: SE3, data: Measurements) -> Measurements:
    """The same poses, told in another frame."""

    def told(sensor: str, values: Matrix) -> Matrix:
        if sensor == "point":
            return np.array([T_new_old.act(own) for own in values])
        return np.array([(pin.Quaternion(T_new_old.rotation) * pin.Quaternion(*own[[3, 0, 1, 2]])).coeffs() for own in values])

    return replace(data, readings=tuple(replace(each, values=told(each.sensor, each.values)) for each in data.readings))


def refused(robot: Robot, data: Measurements) -> str:
    with pytest.raises(FitRejected) as error:
        fit(robot, data, options=ModelOptions(reference_known=True))
    return str(error.value)


def test_the_link_that_it_is_is_named(robots: dict[str, Robot]) -> None:
    """Poses in UR's `base`, which is half a turn off, fitted as in `base_link`: no joint is blamed that would do the same."""
    robot, data = measured(robots)
    T_link_base = links_of_reference(robot)["base"]
    words = refused(robot, seen_in(T_link_base.inverse(), data))
    assert "with the reference turned by 180 deg about z, as link base is: --reference base; or fit" in words
    assert "mend" not in words
    assert "added to" not in words


def test_a_turn_that_no_link_has_is_named(robots: dict[str, Robot]) -> None:
    """A quarter turn, with what to do about it."""
    robot, data = measured(robots)
    quarter = pin.SE3(pin.exp3(np.array([0, 0, np.pi / 2])), np.zeros(3))
    assert "with the reference turned by 90 deg about z; put the frame" in refused(robot, seen_in(quarter.inverse(), data))


def test_frames_that_are_placed_are_not_tried(robots: dict[str, Robot]) -> None:
    """Where the measuring frame is estimated there is nothing to name; where it is known no two hypotheses are alike."""
    robot, data = measured(robots)
    links = links_of_reference(robot)
    assert not list(mistakes_of_reference(build_error_model(robot.chain, robot.rig), links))
    known = build_error_model(robot.chain, robot.rig, ModelOptions(reference_known=True))
    found = [mistake.change(data) for mistake in mistakes_of_reference(known, links)]
    prints = {tuple(np.round(own.readings[index].values, 9).tobytes() for index in (0, 1)) for own in found}
    assert len(prints) == len(found) >= 5


def test_links_stand_where_pinocchio_has_them(robots: dict[str, Robot]) -> None:
    """Every link that is fixed to the reference, and no other."""
    robot, _ = measured(robots)
    model = robot.model
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    T_reference = data.oMf[model.getFrameId("base_link")]
    links = links_of_reference(robot)
    assert "base" in links
    assert not {"base_link", "shoulder_link", "tool0"} & set(links)
    for link, T in links.items():
        assert_poses_close(T, T_reference.actInv(data.oMf[model.getFrameId(link)]))
