"""Which parameters enter the state."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from urdfcal.base.errors import RigError, UsageError
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions, parse_prior
from urdfcal.model.structure import full_pose_jacobian
from urdfcal.robot.robot import Robot, load_robot


def structural_rank(robot: Robot, options: ModelOptions) -> tuple[int, int]:
    """Number of parameters, and the rank of their full-pose Jacobian by SVD with unit columns."""
    errors = build_error_model(robot.chain, robot.rig, options)
    jacobian = full_pose_jacobian(robot.chain, errors, np.random.default_rng(99))
    lengths = np.linalg.norm(jacobian, axis=0)
    singular = np.linalg.svd(jacobian / np.where(lengths > 0, lengths, 1), compute_uv=False)
    return len(errors.names), int(np.sum(singular > 1e-9 * singular[0]))


@pytest.mark.parametrize(("name", "count"), [("panda", 34), ("ur5", 30), ("tiago", 36)])
def test_auto_is_complete_and_minimal(robots: dict[str, Robot], name: str, count: int) -> None:
    """Under auto the rank equals the number of parameters: 4R + 2P + 6 where the screen's placement is estimated."""
    assert structural_rank(robots[name], ModelOptions()) == (count, count)
    assert structural_rank(robots[name], ModelOptions(error_model="placement"))[1] == count


def test_a_robot_is_built_once_for_what_is_asked(robots: dict[str, Robot]) -> None:
    """The same question has the same answer, any other its own, and a pickled chain carries none of them."""
    robot = robots["panda"]
    before = len(pickle.dumps(robot.chain))
    asked = [ModelOptions(), ModelOptions(fix=("panda_joint3.*",)), ModelOptions(priors={"joint": parse_prior("1mm,1deg")})]
    built = [build_error_model(robot.chain, robot.rig, options, sessions) for options in asked for sessions in (("",), ("a", "b"))]
    assert len({(own.names, own.sessions, own.sigma.tobytes()) for own in built}) == 6
    assert build_error_model(robot.chain, robot.rig, replace(asked[1]), ["a", "b"]) is built[3]
    assert len(pickle.dumps(robot.chain)) <= before


@pytest.mark.parametrize(("name", "count", "rank"), [("arm7", 33, 33), ("arm4", 21, 19)])
def test_the_papers_rigs_have_4n_plus_5(robots: dict[str, Robot], name: str, count: int, rank: int) -> None:
    """Under dh the paper's arms have exactly 4N + 5 parameters; on arm4 only 19 of the 21 can be told apart."""
    assert structural_rank(robots[name], ModelOptions(error_model="dh")) == (count, rank)


def test_the_screens_yaw_completes_the_papers_rig(robots: dict[str, Robot]) -> None:
    """--estimate screen adds the yaw about the screen's own z, and nothing else, to the paper's 33."""
    robot = robots["arm7"]
    errors = build_error_model(robot.chain, robot.rig, ModelOptions(error_model="dh", estimate=("screen",)))
    assert set(errors.names) - set(build_error_model(robot.chain, robot.rig, ModelOptions(error_model="dh")).names) == {"screen.rot_z"}
    assert structural_rank(robot, ModelOptions(error_model="dh", estimate=("screen",))) == (34, 34)


def test_what_screen_and_mount_carry_is_said(robots: dict[str, Robot]) -> None:
    """The first axis of a Panda is carried by the screen, the last zero by the mount."""
    carried = build_error_model(robots["panda"].chain, robots["panda"].rig).carried
    assert carried["panda_joint1.d_theta"] == "the screen"
    assert carried["panda_joint7.d_theta"] == "the mount"
    assert len(carried) == 6


def test_an_explicit_model_keeps_everything(robots: dict[str, Robot]) -> None:
    """A model named explicitly keeps its gauge parameters."""
    assert structural_rank(robots["panda"], ModelOptions(error_model="dh")) == (39, 34)
    assert structural_rank(robots["panda"], ModelOptions(error_model="placement")) == (54, 34)
    assert structural_rank(robots["tiago"], ModelOptions(error_model="offset")) == (20, 17)


def serial_arm(folder: Path, types: str, axes: list[tuple[float, ...]] | None, rng: np.random.Generator, carried: bool) -> Robot:
    """A random arm of revolute (R) and prismatic (P) joints; `carried` puts the screen at the tip and the lasers on the base."""
    text, above = ['<robot name="r"><link name="base"/>'], "base"
    for index, letter in enumerate(types):
        axis = axes[index % len(axes)] if axes else rng.normal(size=3)
        rpy = np.zeros(3) if axes else rng.uniform(-3, 3, 3)
        numbers = [" ".join(map(str, values)) for values in (rng.uniform(-0.5, 0.5, 3), rpy, axis)]
        text.append(
            f'<link name="l{index}"/><joint name="j{index}" type="{"revolute" if letter == "R" else "prismatic"}"><parent link="{above}"/>'
            f'<child link="l{index}"/><origin xyz="{numbers[0]}" rpy="{numbers[1]}"/><axis xyz="{numbers[2]}"/>'
            '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        )
        above = f"l{index}"
    tool, foot = ("base", above) if carried else (above, "base")
    for link, parent, xyz in (("screen", foot, "1 0 0"), ("slm", tool, "0.05 0.02 0.1"), ("laser_1", "slm", "0 0 0")):
        text.append(
            f'<link name="{link}"/><joint name="to_{link}" type="fixed"><parent link="{parent}"/><child link="{link}"/>'
            f'<origin xyz="{xyz}"/></joint>'
        )
    path = folder / "arm.urdf"
    path.write_text("".join([*text, "</robot>"]))
    return load_robot(path)


AXES = {"random": None, "parallel": [(0, 0, 1)], "crossed": [(0, 0, 1), (0, 1, 0)], "two and one": [(0, 0, 1), (0, 0, 1), (0, 1, 0)]}


@pytest.mark.parametrize("carried", [False, True], ids=["screen fixed", "screen carried"])
@pytest.mark.parametrize("axes", AXES.values(), ids=AXES)
@pytest.mark.parametrize("types", ["RRR", "PRRR", "RPR", "RRP", "RPPR", "PPP", "RPRPR", "PPPRRR", "RP", "PR"])
def test_auto_is_complete_for_any_arm(
    tmp_path: Path, types: str, axes: list[tuple[float, ...]] | None, carried: bool, rng: np.random.Generator
) -> None:
    """Whatever its joints, the parameters of auto have the rank of all six directions of every joint."""
    robot = serial_arm(tmp_path, types, axes, rng, carried)
    rank = structural_rank(robot, ModelOptions())[1]
    assert rank == structural_rank(robot, ModelOptions(error_model="placement"))[1]
    if axes is None:
        assert rank == 4 * types.count("R") + 2 * types.count("P") + 6


def test_priors_are_read_with_their_units() -> None:
    """10mm,1deg and flat are understood, anything else is refused with what was expected."""
    scale = parse_prior("0.3mm, 0.7mrad")
    assert (scale.translation, scale.rotation) == pytest.approx((3e-4, 7e-4))
    for text in ("10", "1deg,10mm", "10mm,-1deg", "a,b", "10mm,1deg,3", ""):
        with pytest.raises(UsageError, match="expected a length and an angle such as 10mm,1deg"):
            parse_prior(text)


def test_unknown_options_are_refused(robots: dict[str, Robot]) -> None:
    """Error models, additions and joints that do not exist are named."""
    with pytest.raises(UsageError, match="no error model 'dhh'; there are: auto, dh"):
        ModelOptions(error_model="dhh")
    with pytest.raises(UsageError, match="cannot estimate 'beam'"):
        ModelOptions(estimate=("beam",))
    with pytest.raises(RigError, match="no joint 'joint9'"):
        build_error_model(robots["arm7"].chain, robots["arm7"].rig, ModelOptions(per_joint={"joint9": "offset"}))


def test_sessions_have_screens_of_their_own(robots: dict[str, Robot]) -> None:
    """Every session but the first adds six screen parameters with its label."""
    robot = robots["arm7"]
    errors = build_error_model(robot.chain, robot.rig, ModelOptions(error_model="dh"), ("monday", "tuesday"))
    assert errors.names[33:] == tuple(f"screen:tuesday.{name}" for name in ("trans_x", "trans_y", "trans_z", "rot_x", "rot_y", "rot_z"))


def test_coincident_axes_are_complete_too(tmp_path: Path) -> None:
    """Two joints on one line have no normal to turn; auto offers the missing shift last, and then has full rank."""
    limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
    joints = [("0 0 0.1", "0 0 0"), ("0.3 0 0.2", "1.2 0 0"), ("0 0 0.2", "0 0 0"), ("0.2 0.1 0.3", "0 1.1 0")]
    text, above = ['<robot name="coaxial"><link name="base"/>'], "base"
    for number, (xyz, rpy) in enumerate(joints):
        text.append(
            f'<link name="l{number}"/><joint name="j{number}" type="revolute"><parent link="{above}"/><child link="l{number}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="0 0 1"/>{limit}</joint>'
        )
        above = f"l{number}"
    for link, parent, xyz in (("screen", "base", "1 0 0"), ("slm", above, "0.05 0.02 0.1"), ("laser_1", "slm", "0 0 0")):
        text.append(
            f'<link name="{link}"/><joint name="to_{link}" type="fixed"><parent link="{parent}"/><child link="{link}"/>'
            f'<origin xyz="{xyz}"/></joint>'
        )
    path = tmp_path / "coaxial.urdf"
    path.write_text("".join([*text, "</robot>"]))
    robot = load_robot(path)
    assert structural_rank(robot, ModelOptions()) == (4 * 4 + 6, 4 * 4 + 6)


def test_what_is_held_carries_nothing(robots: dict[str, Robot]) -> None:
    """With screen and mount fixed the joints' parameters that they would have carried enter the state."""
    robot = robots["panda"]
    errors = build_error_model(robot.chain, robot.rig, ModelOptions(fix=("screen.*", "slm.*")))
    assert "the screen" not in errors.carried.values()
    assert "the mount" not in errors.carried.values()
    assert {"panda_joint1.d_theta", "panda_joint7.d_theta"} <= set(errors.names)


def test_a_single_session_may_have_a_name(robots: dict[str, Robot]) -> None:
    """A session label on all poses changes nothing about the parameters."""
    for name in ("arm7", "panda"):
        robot = robots[name]
        assert build_error_model(robot.chain, robot.rig, None, ("A",)).names == build_error_model(robot.chain, robot.rig).names


def test_a_colon_in_a_name_is_no_session(robots: dict[str, Robot], tmp_path: Path) -> None:
    """Joints whose names hold a colon fall under the gauge rule like any others."""
    path = tmp_path / "colon.urdf"
    path.write_bytes(robots["ur5"].description.text.replace(b"shoulder_pan_joint", b"left:pan"))
    assert structural_rank(load_robot(path), ModelOptions()) == (30, 30)
