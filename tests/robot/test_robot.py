"""The way from screen to lasers, on robots of every shape, against Pinocchio's kinematics of the whole robot."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np
import pinocchio as pin
import pytest

from tests.support.helpers import assert_poses_close
from tests.support.small_robot import LASERS, URDF, joint, robot_of, robot_text
from urdfcal.base.errors import RigError
from urdfcal.base.geometry import SE3
from urdfcal.model.error_model import ErrorModel
from urdfcal.robot.robot import Robot, robot_from
from urdfcal.sensors.spots import beams_at

TILT = '<axis xyz="0.3 -2 0.5"/><origin xyz="0.1 0.2 0.3" rpy="0.4 -0.5 0.6"/>'
LIFT = '<axis xyz="1 1 0"/><origin xyz="-0.2 0.1 0.3" rpy="-1.2 0.3 2.5"/>'


def witness(robot: Robot, positions: Mapping[str, float]) -> list[SE3]:
    """Placements of the lasers against the screen from Pinocchio's model of the whole robot; every moving joint is stated."""
    model, data = robot.model, robot.model.createData()
    q = pin.neutral(model)
    for name, value in positions.items():
        own = model.joints[model.getJointId(name)]
        q[own.idx_q : own.idx_q + own.nq] = value if own.nq == 1 else (np.cos(value), np.sin(value))
    pin.framesForwardKinematics(model, data, q)
    T_world_screen = data.oMf[model.getFrameId(robot.rig.base)]
    return [T_world_screen.actInv(data.oMf[model.getFrameId(laser)]) for laser in robot.rig.lasers]


def assert_beams_agree(robot: Robot, positions: Mapping[str, float]) -> None:
    """Fail where our chain and Pinocchio's model see a beam at different places."""
    q = np.array([[positions[name] for name in robot.chain.input_names]])
    beams = beams_at(ErrorModel(robot.chain, (), ()), np.empty(0), q)
    expected = witness(robot, positions)
    np.testing.assert_allclose(beams.source[0], [placement.translation for placement in expected], atol=1e-12)
    np.testing.assert_allclose(beams.direction[0], [placement.rotation[:, 2] for placement in expected], atol=1e-12)


@pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic"])
@pytest.mark.parametrize("axis", ["1 0 0", "0 1 0", "0 0 1", "0 0 -1", "-3 0 0", "1 2 -3", "1e-3 0 1e-3"])
def test_axes_of_any_direction_and_length(kind: str, axis: str) -> None:
    """A joint of each kind moves along its axis whatever its direction and length."""
    text = robot_text(
        joint("j1", "screen", "a", f'<axis xyz="{axis}"/><origin xyz="0.1 0.2 0.3" rpy="1 2 3"/>', kind=kind),
        joint("f", "a", "c", kind="fixed"),
        LASERS,
    )
    robot = robot_of(text)
    assert_beams_agree(robot, {"j1": 0.7})


def test_a_branch_off_the_way_is_left_alone() -> None:
    """A gripper beside the lasers needs no column, and moves no beam."""
    robot = robot_of(
        robot_text(
            joint("j1", "screen", "a", TILT),
            joint("side", "a", "b", LIFT),
            joint("finger", "b", "d", kind="prismatic"),
            joint("j2", "a", "c", LIFT),
            LASERS,
        )
    )
    assert robot.chain.input_names == ("j1", "j2")
    assert_beams_agree(robot, {"j1": 0.3, "j2": -0.8, "side": 0.0, "finger": 0.0})


def test_the_screen_may_stand_on_a_branch() -> None:
    """With screen and lasers on two branches of one root, the joints of the screen's branch are walked backward."""
    text = (
        '<link name="root"/>'
        + joint("to_b", "root", "b", TILT, kind="fixed")
        + joint("s1", "b", "d", LIFT)
        + joint("s2", "d", "screen", TILT, kind="prismatic")
    )
    text += joint("j1", "b", "a", LIFT) + joint("j2", "a", "c", TILT, kind="continuous") + LASERS
    robot = robot_of(robot_text(text))
    assert robot.chain.input_names == ("s2", "s1", "j1", "j2")
    assert [step.forward for step in robot.chain.steps] == [False, False, True, True]
    assert_beams_agree(robot, {"s1": 0.4, "s2": -0.1, "j1": 0.9, "j2": 2.5})


def test_the_screen_may_be_carried_and_the_lasers_fixed() -> None:
    """A screen in the gripper before lasers on the wall is the same case."""
    robot = robot_of(
        robot_text(
            LASERS,
            joint("j1", "c", "a", TILT),
            joint("j2", "a", "b", LIFT),
            joint("s", "b", "screen", TILT, kind="fixed"),
            links="c a b screen laser_1 laser_2",
        )
    )
    assert robot.tree.root == "c"
    assert robot.chain.input_names == ("j2", "j1")
    assert_beams_agree(robot, {"j1": -0.6, "j2": 1.1})


def test_mimic_joints_follow_without_a_column() -> None:
    """A joint that mimics a mimic joint moves with the first leader: factors multiply, offsets add up."""
    robot = robot_of(
        robot_text(
            joint("j1", "screen", "a", TILT),
            joint("j2", "a", "b", LIFT, '<mimic joint="j1" multiplier="-2" offset="0.1"/>'),
            joint("j3", "b", "c", TILT, '<mimic joint="j2" multiplier="0.5" offset="-0.3"/>', kind="prismatic"),
            LASERS,
        )
    )
    assert robot.chain.input_names == ("j1",)
    follower = -2 * 0.7 + 0.1
    assert_beams_agree(robot, {"j1": 0.7, "j2": follower, "j3": 0.5 * follower - 0.3})


def test_a_leader_off_the_way_is_measured() -> None:
    """Where only the follower is on the way, the leader's column is asked for; backward the sign turns."""
    robot = robot_of(
        robot_text(
            joint("lead", "c", "d", kind="prismatic"),
            joint("j1", "c", "a", LIFT, '<mimic joint="lead" multiplier="3" offset="0.2"/>'),
            joint("s", "a", "screen", kind="fixed"),
            LASERS,
        )
    )
    assert robot.chain.input_names == ("lead",)
    assert_beams_agree(robot, {"lead": 0.25, "j1": 0.95})


def test_fixed_joints_may_stand_anywhere() -> None:
    """Fixed joints before, between and behind the moving ones are part of the way."""
    robot = robot_of(URDF)
    assert [step.joint.name for step in robot.chain.steps] == ["base_mount", "turn", "lift", "slide", "slm_mount"]
    assert_beams_agree(robot, {"turn": 0.2, "lift": -0.4, "slide": 0.1})


def test_one_laser_s_parent_is_the_module() -> None:
    """With one laser the module is the link that it hangs on; with two the nearest link that carries both."""
    assert robot_of(URDF).rig.tip == "slm"
    alone = robot_from(robot_of(URDF).description, lasers=["laser_2"])
    assert (alone.rig.lasers, alone.rig.tip) == (("laser_2",), "slm")
    nested = URDF.replace('<parent link="slm"/>\n    <child link="laser_2"/>', '<parent link="tool"/>\n    <child link="laser_2"/>')
    assert robot_of(nested).rig.tip == "tool"


def test_lasers_are_taken_in_the_order_of_their_numbers() -> None:
    """laser_10 comes after laser_2, and laser_x is none."""
    names = ["laser_10", "laser_2", "laser_x"]
    text = joint("j", "screen", "c") + "".join(joint(f"m{index}", "c", name, kind="fixed") for index, name in enumerate(names))
    assert robot_of(robot_text(text, links=f"screen c {' '.join(names)}")).rig.lasers == ("laser_2", "laser_10")


FLOAT = joint("free", "a", "b", kind="floating")
TWO_LINKS = (
    joint("j1", "screen", "a")
    + joint("j2", "a", "b")
    + joint("m1", "a", "laser_1", kind="fixed")
    + joint("m2", "b", "laser_2", kind="fixed")
)
REFUSED = {
    "floating": (
        joint("j1", "screen", "a") + FLOAT + joint("j2", "b", "c") + LASERS,
        "joint 'free' on the way from 'screen' to 'c' is floating; expected revolute",
    ),
    "planar": (
        joint("j1", "screen", "a") + FLOAT.replace("floating", "planar") + joint("j2", "b", "c") + LASERS,
        "joint 'free' on the way from 'screen' to 'c' is planar",
    ),
    "floating before the lasers": (
        joint("j1", "screen", "a") + FLOAT + joint("f", "b", "c", kind="fixed") + LASERS,
        "joint 'free' on the way from 'screen' to 'c' is floating",
    ),
    "floating laser": (
        joint("j1", "screen", "c") + LASERS.replace('name="m1" type="fixed"', 'name="m1" type="floating"'),
        "all lasers must sit on one moving link",
    ),
    "two links": (TWO_LINKS, "all lasers must sit on one moving link, found laser_1 on a, laser_2 on b; choose with --laser"),
    "no screen": (joint("j1", "a", "c") + LASERS, "no link named 'screen' among 4 links"),
    "no laser": (joint("j1", "screen", "c"), "no link named laser_<digits>; name the lasers with --laser LINK"),
    "nothing moves": (
        joint("j1", "screen", "c", kind="fixed") + LASERS,
        "no moving joint between the screen 'screen' and the laser 'laser_1'",
    ),
    "laser is the moving link": (joint("j1", "screen", "laser_1"), "laser 'laser_1' hangs on no fixed joint"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_rigs_that_cannot_be_calibrated_are_refused(case: str) -> None:
    """A way that floats, lasers on two links, a missing screen: one line that names the link or joint."""
    text, message = REFUSED[case]
    with pytest.raises(RigError, match=re.escape(message)):
        _ = robot_of(robot_text(text)).chain


def test_links_are_chosen_by_name() -> None:
    """--screen and --laser take other links; a misspelt or repeated one is refused."""
    text = joint("j1", "d", "c", TILT) + joint("m", "c", "a", kind="fixed")
    description = robot_of(robot_text(text)).description
    assert robot_from(description, screen="d", lasers=["a"]).chain.input_names == ("j1",)
    for wrong, message in (
        (["b"], r"no link named 'b' among 3 links; there are: d?.*choose with --laser LINK"),
        (["a", "a"], "a laser is named twice: a, a"),
    ):
        with pytest.raises(RigError, match=message):
            _ = robot_from(description, screen="d", lasers=wrong).rig


def test_no_mesh_is_needed() -> None:
    """Kinematics load with meshes that lie nowhere."""
    mesh = '<visual><geometry><mesh filename="package://nowhere/a.stl"/></geometry></visual>'
    assert robot_of(URDF.replace('<link name="tool"/>', f'<link name="tool">{mesh}</link>')).chain.input_names == ("turn", "lift", "slide")


def test_the_module_of_a_real_robot_stands_where_pinocchio_has_it(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """On every robot that comes with urdfcal, torso and hand included, the beams agree."""
    for robot in robots.values():
        positions = {name: 0.0 for name in robot.tree.joints if robot.tree.joints[name].moves}
        positions |= {name: float(rng.uniform(-1, 1)) for name in robot.chain.input_names}
        assert_beams_agree(robot, positions)


def test_a_correction_of_nothing_changes_nothing(robots: dict[str, Robot]) -> None:
    """The witness itself: the identity correction keeps every placement of the whole model."""
    from urdfcal.robot.corrections import corrected_model

    for robot in robots.values():
        same = corrected_model(robot.model, {})
        for before, after in zip(robot.model.jointPlacements, same.jointPlacements, strict=True):
            assert_poses_close(after, before)
