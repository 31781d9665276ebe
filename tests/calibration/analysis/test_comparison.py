"""Two accounts of one robot: what differs, whatever joint it is booked on, and whether chance explains it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from urdfcal.base.errors import RobotError
from urdfcal.base.geometry import six_screws
from urdfcal.calibration.analysis.comparison import Account, compare, default_tool
from urdfcal.model.earlier import EarlierJoints
from urdfcal.output.stored import corrected_robot
from urdfcal.robot.rig import SIX
from urdfcal.robot.robot import Robot

JOINTS = tuple(f"joint{number}" for number in range(1, 8))


@pytest.fixture(scope="module")
def arm(robots: dict[str, Robot]) -> Robot:
    """The arm of Table I."""
    return robots["arm7"]


def moved(robot: Robot, twists: dict[str, np.ndarray]) -> Robot:
    """The robot with some joints' placements moved by twists in their own axes."""
    return corrected_robot(robot, {name: robot.tree.joints[name].origin * pin.exp6(twist) for name, twist in twists.items()})


def known(robot: Robot, sigma: float) -> EarlierJoints:
    """Every joint's placement with the same standard deviation in all six numbers, [m] and [rad]."""
    names = tuple(f"{joint}.{name}" for joint in JOINTS for name in SIX)
    origins = {joint: robot.tree.joints[joint].origin for joint in JOINTS}
    return EarlierJoints(names, np.full(42, 1.0), np.tile(six_screws(), 7), sigma**2 * np.eye(42), origins)


def test_what_may_be_booked_on_either_joint_is_no_difference(arm: Robot, rng: np.random.Generator) -> None:
    """A shift along one joint's axis that the next one takes back leaves every row and the tool at zero."""
    axis = np.array(arm.tree.joints["joint3"].axis)
    screw = np.concatenate([2e-3 * axis, 5e-3 * axis])
    behind = arm.tree.joints["joint4"].origin
    back = -behind.actInv(pin.Motion(screw)).vector
    found = compare(Account("a", arm), Account("b", moved(arm, {"joint3": screw, "joint4": back})), "slm", rng)
    assert found.identical
    assert max(joint.distance for joint in found.joints) < 1e-8
    assert max(joint.angle for joint in found.joints) < 1e-8


def test_distances_at_the_tool_are_those_of_the_two_models(arm: Robot, rng: np.random.Generator) -> None:
    """At the worst configuration, which is named, Pinocchio has the two tools as far apart as is said."""
    other = moved(arm, {"joint2": np.array([1e-3, 0, 2e-3, 0, 1e-3, 0]), "joint5": np.array([0, 2e-3, 0, 0, 0, 3e-3])})
    worst = compare(Account("a", arm), Account("b", other), "slm", rng, count=50).at_tool
    q = np.array([worst.worst[joint] for joint in JOINTS])
    places = []
    for robot in (arm, other):
        data = robot.model.createData()
        pin.framesForwardKinematics(robot.model, data, q)
        places.append(data.oMf[robot.model.getFrameId("slm")].translation.copy())
    assert np.linalg.norm(places[1] - places[0]) == pytest.approx(worst.distance.max(), abs=1e-12)


def test_a_constant_of_base_and_tool_is_told_apart(arm: Robot, rng: np.random.Generator) -> None:
    """A robot on another base is elsewhere by as much, and not at all up to a constant."""
    base = moved(arm, {"joint1": np.array([5e-3, 0, 0, 0, 0, 0])})
    found = compare(Account("a", arm), Account("b", base), "slm", rng, count=100)
    assert found.at_tool.distance == pytest.approx(np.full(100, 5e-3), rel=1e-9)
    assert found.at_tool.apart.max() < 1e-9


def test_chance_explains_a_difference_as_often_as_it_says(arm: Robot) -> None:
    """Of pairs that differ by what their covariances say, one in twenty is said to differ by more."""
    rng, sigma = np.random.default_rng(5), 3e-4
    accounts = known(arm, sigma)
    probabilities = []
    for _ in range(60):
        drawn = {joint: rng.normal(0.0, sigma * np.sqrt(2), 6) for joint in JOINTS}
        found = compare(Account("a", arm, accounts), Account("b", moved(arm, drawn), accounts), "slm", rng, count=60)
        probabilities.append(found.by_chance)
    assert np.mean(np.array(probabilities) < 0.05) < 0.15
    assert 0.35 < np.mean(probabilities) < 0.65


def test_more_than_chance_is_said_to_differ(arm: Robot, rng: np.random.Generator) -> None:
    """A difference of five standard deviations at one joint is not the same, and nobody's certainty says nothing of it."""
    sure, other = known(arm, 1e-4), moved(arm, {"joint4": np.array([0, 0, 0, 5e-3, 0, 0])})
    assert compare(Account("a", arm, sure), Account("b", other), "slm", rng).same is False
    assert compare(Account("a", arm), Account("b", other), "slm", rng).same is None


def test_what_nobody_estimated_is_not_booked_on_its_neighbours(arm: Robot, rng: np.random.Generator) -> None:
    """A joint that is in neither account's covariance has its difference without a sigma, and the others are as far apart as they say."""
    sigma = 1e-4
    sure = known(arm, sigma)
    own = [index for index, name in enumerate(sure.names) if not name.startswith("joint3.")]
    names, screws = tuple(sure.names[index] for index in own), sure.screws[:, own]
    origins = {name: origin for name, origin in sure.origins.items() if name != "joint3"}
    part = EarlierJoints(names, sure.sigma[own], screws, sure.covariance[np.ix_(own, own)], origins)
    drawn = {joint: rng.normal(0.0, sigma, 6) for joint in JOINTS} | {"joint3": np.full(6, 5e-3)}
    rows = {row.name: row for row in compare(Account("a", arm, part), Account("b", moved(arm, drawn)), "slm", rng, 50).joints}
    assert (rows["joint3"].distance_sigma, rows["joint3"].angle_sigma) == (None, None)
    assert rows["joint3"].distance > 2e-3
    assert all(row.sigmas < 5 for name, row in rows.items() if name not in ("joint3", "slm"))


def test_two_robots_are_not_compared(arm: Robot, rng: np.random.Generator) -> None:
    """A joint that slides in one and turns in the other is named."""
    joint = replace(arm.tree.joints["joint3"], type="prismatic")
    other = replace(arm, tree=replace(arm.tree, joints=arm.tree.joints | {"joint3": joint}))
    with pytest.raises(RobotError, match="'joint3' on the way to 'slm' is not the same joint in both"):
        compare(Account("a", arm), Account("b", other), "slm", rng)


def test_the_tool_lies_behind_what_differs(arm: Robot) -> None:
    """Without a link named, the one behind the joints that differ and no others is taken."""
    other = moved(arm, {"joint2": np.array([1e-3, 0, 0, 0, 0, 0])})
    path = [joint.name for joint in arm.tree.path_from_root(default_tool(Account("a", arm), Account("b", other))) if joint.moves]
    assert path == ["joint1", "joint2"]
