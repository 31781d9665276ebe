"""Many configurations at once: placements and Jacobians of the way to a link."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from urdfcal.base.errors import RobotError
from urdfcal.robot.configurations import WholeRobot
from urdfcal.robot.robot import Robot, load_robot
from urdfcal.robot.way import Way

ARMS = {
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "tool0", None),
    "ur5_base_aside": ("ur_description/urdf/ur5_robot.urdf", "tool0", "base"),
    "panda": ("panda_description/urdf/panda.urdf", "panda_leftfinger", None),
    "tiago": ("tiago_description/robots/tiago.urdf", "arm_tool_link", "torso_lift_link"),
    "tiago_torso": ("tiago_description/robots/tiago.urdf", "arm_7_link", None),
}


@pytest.fixture(scope="module", params=ARMS)
def way(request: pytest.FixtureRequest, example_robots: Path) -> Way:
    """Arms that turn, slide, and stand on a base that moves."""
    path, tool, base = ARMS[request.param]
    return Way.between(load_robot(example_robots / path), tool, base)


def seen(way: Way, q: np.ndarray) -> np.ndarray:
    """The tool in the base, as Pinocchio has it."""
    model = way.robot.model
    data, base, tool = model.createData(), *(model.getFrameId(link, pin.BODY) for link in (way.base, way.tool))
    placed = []
    for configuration in WholeRobot(way.robot, way.names).configurations(q):
        pin.framesForwardKinematics(model, data, configuration)
        placed.append(data.oMf[base].actInv(data.oMf[tool]).homogeneous)
    return np.array(placed)


def drawn(way: Way, rng: np.random.Generator, count: int) -> np.ndarray:
    """Positions within the limits."""
    lower, upper = np.maximum(way.limits[0], -np.pi), np.minimum(way.limits[1], np.pi)
    return rng.uniform(lower, upper, (count, len(lower)))


def test_placements_are_pinocchios(way: Way, rng: np.random.Generator) -> None:
    """The tool stands where Pinocchio's forward kinematics has it."""
    q = drawn(way, rng, 20)
    assert np.allclose(way.placements(q), seen(way, q), atol=1e-13)


def test_jacobians_are_finite_differences(way: Way, rng: np.random.Generator) -> None:
    """The twist in the tool's own axes is that of Pinocchio's placements a little further along each joint."""
    q, step = drawn(way, rng, 5), 1e-6
    placed, J = way.jacobians(q)
    assert np.allclose(placed, way.placements(q), atol=0)
    for column in range(q.shape[1]):
        ahead, behind = (seen(way, q + sign * step * np.eye(q.shape[1])[column]) for sign in (1, -1))
        moved = [pin.log6(pin.SE3(back).actInv(pin.SE3(front))).vector / (2 * step) for back, front in zip(behind, ahead, strict=True)]
        assert np.allclose(J[:, :, column], moved, atol=1e-8)


def test_mimic_joints_follow(rng: np.random.Generator, tmp_path: Path) -> None:
    """A joint that mimics another is no position of its own; its motion is in that of its leader."""
    limit = '<limit lower="-2" upper="2" effort="1" velocity="1"/>'
    text = f"""<robot name="m"><link name="a"/><link name="b"/><link name="c"/>
    <joint name="one" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0.1 0 0.2"/><axis xyz="0 1 0"/>{limit}</joint>
    <joint name="two" type="revolute"><parent link="b"/><child link="c"/><origin xyz="0.4 0 0" rpy="0.1 0 0"/><axis xyz="0 0 1"/>{limit}
    <mimic joint="one" multiplier="-2" offset="0.3"/></joint></robot>"""
    path = tmp_path / "m.urdf"
    path.write_text(text)
    way = Way.between(load_robot(path), "c")
    assert way.names == ("one",)
    test_placements_are_pinocchios(way, rng)
    test_jacobians_are_finite_differences(way, rng)


def test_a_way_that_is_none_is_refused(robots: dict[str, Robot]) -> None:
    """A link that is not there, one that the base does not carry, and one that nothing moves."""
    for tool, base, word in (
        ("hand", None, "no link named 'hand'"),
        ("link2", "link4", "does not carry"),
        ("screen", None, "no joint moves"),
    ):
        with pytest.raises(RobotError, match=word):
            Way.between(robots["arm7"], tool, base)
