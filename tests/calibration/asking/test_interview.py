"""Simulated arms and rigs that do one thing: it is named, and what depends on it holds."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import urdfcal
from tests.support.disturbed import DisturbedArm, disturbed_arm
from tests.support.paths import ROBOTS_DIR
from urdfcal.api import Calibration
from urdfcal.calibration.problem import Problem

SENSORS = {"panda": "laser", "ur5": "point:tool0", "tiago": "pose:arm_tool_link"}
NAMED = [
    ("panda", "sag", "sag"),
    ("ur5", "eccentricity", "eccentricity"),
    ("panda", "two_cycles", "eccentricity"),
    ("tiago", "harmonics", "harmonics"),
    ("tiago", "scale", "scale"),
    ("ur5", "approach", "approach"),
    ("panda", "joint_noise", "joint_noise"),
    ("tiago", "drift", "drift"),
    ("panda", "walk", "drift"),
    ("ur5", "temperature", "temperature"),
    ("panda", "screen_bow", "screen_bow"),
    ("panda", "lens", "lens"),
    ("tiago", "readings_scale", "readings_scale"),
]
OF_THE_RIG = [each for each in NAMED if each[2] in ("joint_noise", "drift", "temperature", "screen_bow", "lens")]


@cache
def fitted(name: str, what: str, seed: int = 1) -> tuple[DisturbedArm, Calibration]:
    """One arm, and its fit."""
    robot = urdfcal.load_robot(ROBOTS_DIR / name / f"{name}.urdf.xacro")
    arm = disturbed_arm(robot, SENSORS[name], what, seed)
    return arm, urdfcal.fit(arm.robot, arm.fit)


def coverage(arm: DisturbedArm, found: Calibration) -> float:
    """How often the 95 % intervals of readings at unseen poses, by the covariance alone, hold what a perfect instrument reads."""
    linearised = Problem(found.errors, arm.unseen).linearise(found.x)
    J, off = linearised.jacobian, linearised.residual
    if found.errors.rig is not None:  # a perfect instrument in a rig that stands still
        own = [found.errors.names.index(term.name) for term in found.errors.rig.terms]
        off, J = off + J[:, :, own] @ found.x[own], J.copy()
        J[:, :, own] = 0.0
    sigma = np.sqrt(np.einsum("nmp,pr,nmr->nm", J, found.covariance, J))
    return float(np.mean((np.abs(off) < 1.96 * sigma)[linearised.measured]))


@pytest.mark.parametrize(("name", "what", "named"), NAMED)
def test_what_an_arm_or_its_rig_does_is_named_first(name: str, what: str, named: str) -> None:
    """Whatever the sensor, of all that could be."""
    _, found = fitted(name, what)
    assert found.stands_out
    assert found.stands_out[0].what == named


@pytest.mark.parametrize("name", SENSORS)
@pytest.mark.parametrize("seed", [1, 2])
def test_nothing_is_named_where_nothing_is(name: str, seed: int) -> None:
    """Geometric errors and white noise alone ask for no more."""
    _, found = fitted(name, "none", seed)
    assert found.stands_out == ()
    assert found.lacking is None


@pytest.mark.parametrize(("name", "what", "named"), OF_THE_RIG)
def test_what_the_rig_does_is_in_the_fit_and_out_of_the_joints(name: str, what: str, named: str) -> None:
    """It is in the fit, and unseen poses are as near to the truth as the fit says."""
    arm, found = fitted(name, what)
    assert found.stands_out[0].entered
    assert coverage(arm, found) > 0.85


@pytest.mark.parametrize(("name", "what", "named"), [each for each in NAMED if each[2] in ("sag", "eccentricity", "scale", "approach")])
def test_what_is_not_in_the_fit_is_in_its_sigmas(name: str, what: str, named: str) -> None:
    """The arm's own doings stay out of the URDF; what geometry predicts is off by as much as it says."""
    arm, found = fitted(name, what)
    assert not found.stands_out[0].entered
    assert found.lacking is not None
    assert coverage(arm, found) > 0.9


def test_a_gear_is_named_with_its_joint_and_cycles() -> None:
    """Fifty waves a turn are found as fifty, at a joint that has them."""
    _, found = fitted("tiago", "harmonics")
    assert found.stands_out[0].cycles == 50
    assert found.stands_out[0].where in found.data.joints
