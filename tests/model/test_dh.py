"""The D-H table that is derived from a URDF."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from tests.support.helpers import ROBOTS, assert_poses_close
from tests.support.small_robot import robot_of
from urdfcal.base.geometry import pose
from urdfcal.model.dh import DhRow, dh_table, table_with_slides
from urdfcal.robot.rig import SIX, Instruments, Target
from urdfcal.robot.robot import Robot, load_robot

TABLE_I = {
    "joint1": (-500, 0, -90, -90),
    "joint2": (0, 100, -90, 90),
    "joint3": (0, 0, -90, -90),
    "joint4": (0, 200, 90, 0),
    "joint5": (0, 0, -90, 0),
    "joint6": (0, 200, 90, 90),
    "joint7": (0, 0, 90, 0),
    "slm": (50, 0, 0, 180),
}
TABLE_IV = {
    "joint1": (-365, 690, 0, -90),
    "joint2": (0, -30, -90, 90),
    "joint3": (0, 0, -90, 0),
    "joint4": (100, 0, 0, 180),
    "slm": (-30, 0, -90, 0),
}


def as_published(row: DhRow) -> tuple[float, float, float, float]:
    """A row in mm and deg."""
    return row.a * 1e3, row.d * 1e3, float(np.degrees(row.alpha)), float(np.degrees(row.theta))


def transform(row: DhRow) -> pin.SE3:
    """Trans(x,a) Trans(z,d) Rot(x,alpha) Rot(y,beta) Rot(z,theta) Trans(z,slide) by Pinocchio's own exponentials."""

    def turn(axis: int, angle: float) -> pin.SE3:
        return pin.SE3(pin.exp3(np.eye(3)[axis] * angle), np.zeros(3))

    start = pin.SE3(np.eye(3), np.array([row.a, 0.0, row.d]))
    return start * turn(0, row.alpha) * turn(1, row.beta) * turn(2, row.theta) * pin.SE3(np.eye(3), np.array([0.0, 0.0, row.slide]))


@pytest.mark.parametrize(("name", "published"), [("arm7", TABLE_I), ("arm4", TABLE_IV)])
def test_the_published_tables_come_back(robots: dict[str, Robot], name: str, published: dict[str, tuple[float, ...]]) -> None:
    """Tables I and IV are read off the URDFs to 1e-9, signs included."""
    rows = dh_table(robots[name].chain)
    assert [row.name for row in rows] == list(published)
    np.testing.assert_allclose([as_published(row) for row in rows], list(published.values()), atol=1e-9)


@pytest.mark.parametrize("hayati", [False, True], ids=["dh", "hayati"])
@pytest.mark.parametrize("name", ["arm7", "arm4", "panda", "ur5"])
def test_the_table_is_the_robot(robots: dict[str, Robot], name: str, hayati: bool, rng: np.random.Generator) -> None:
    """The product of the rows, each with q added to theta, moves as Pinocchio's model of the whole URDF."""
    robot = robots[name]
    rows, chain = dh_table(robot.chain, hayati), robot.chain
    motions = []
    for _ in range(3):
        q = rng.uniform(-1, 1, len(chain.inputs))
        table = pin.SE3.Identity()
        for row, angle in zip(rows, [*q, 0.0], strict=True):
            table = table * transform(row) * pin.SE3(pin.exp3(np.array([0.0, 0.0, angle])), np.zeros(3))
        motions.append((table, module_pose(robot, q)))
    base = motions[0][1] * motions[0][0].inverse()  # the first frame's x is the table's own
    for table, true in motions:
        assert_poses_close((base * table).actInv(true), motions[0][0].actInv(base.actInv(motions[0][1])), mm=1e-7, mrad=1e-7)


def module_pose(robot: Robot, q: np.ndarray) -> pin.SE3:
    """Pose of the module on the link that the first joint hangs on, by the whole robot's model."""
    model, data = robot.model, robot.model.createData()
    full = pin.neutral(model)
    for joint, value in zip(robot.chain.inputs, q, strict=True):
        index = model.joints[model.getJointId(joint.name)]
        full[index.idx_q : index.idx_q + index.nq] = [np.cos(value), np.sin(value)] if index.nq == 2 else [value]
    pin.framesForwardKinematics(model, data, full)
    base = robot.chain.moving[0].joint.parent
    return data.oMf[model.getFrameId(base)].actInv(data.oMf[model.getFrameId(robot.rig.tip)])


@pytest.mark.parametrize("hayati", [False, True], ids=["dh", "hayati"])
@pytest.mark.parametrize("place", ["first", "between", "last"])
def test_joints_that_slide_have_their_place_in_the_table(place: str, hayati: bool, rng: np.random.Generator) -> None:
    """The product of the rows with Rot(z, q) and Trans(direction q) moves as Pinocchio's model of a robot with slides anywhere."""
    kinds = {"first": ("prismatic", "revolute", "revolute"), "between": ("revolute", "prismatic", "revolute")}
    order = kinds.get(place, ("revolute", "revolute", "prismatic"))
    joints = ""
    for number, kind in enumerate(order):
        xyz, rpy, axis = (" ".join(map(str, rng.uniform(-1, 1, 3))) for _ in range(3))
        joints += (
            f'<joint name="j{number}" type="{kind}"><parent link="l{number}"/><child link="l{number + 1}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        )
    links = "".join(f'<link name="l{number}"/>' for number in range(len(order) + 1))
    tip = Instruments((Target("l3", "l3", SIX),), "", True)
    robot = robot_of(f'<robot name="slides">{links}{joints}</robot>').seen_by(tip, ())
    rows = table_with_slides(robot.chain, hayati)
    assert [row.name for row in rows[:3]] == ["j0", "j1", "j2"]
    assert [row.name for row in dh_table(robot.chain, hayati)] == [row.name for row in rows if row.direction is None]
    motions = []
    for _ in range(3):
        q = rng.uniform(-1, 1, 3)
        table, data = pin.SE3.Identity(), robot.model.createData()
        for row, value in zip(rows, [*q, 0.0], strict=False):
            turned = pin.SE3(pin.exp3(np.array([0.0, 0.0, value])), np.zeros(3))
            table = table * transform(row) * (turned if row.direction is None else pin.SE3(np.eye(3), value * row.direction))
        pin.framesForwardKinematics(robot.model, data, q)
        motions.append((table, data.oMf[robot.model.getFrameId("l3")].copy()))
    (first, true), *others = motions
    base = true * first.inverse()  # the first frame's x is the table's own
    for table, moved in others:
        assert_poses_close(base * table, moved, mm=1e-7, mrad=1e-7)


@pytest.mark.parametrize("name", ROBOTS)
def test_axes_are_the_urdf_axes(robots: dict[str, Robot], name: str) -> None:
    """d_theta turns about the joint's own axis, so q counts positive."""
    joints = robots[name].tree.joints
    for row in dh_table(robots[name].chain)[:-1]:
        axis = np.array(joints[row.name].axis)
        np.testing.assert_allclose(row.screws["d_theta"][3:], axis, atol=1e-12)


def two_axis_robot(folder: Path, xyz: str, rpy: str, axis: str = "0 0 1") -> Robot:
    """A robot of two turning joints, the second placed as said."""
    path = folder / "two.urdf"
    limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
    path.write_text(
        f"""<robot name="two"><link name="screen"/><link name="a"/><link name="b"/><link name="slm"/><link name="laser_1"/>
        <joint name="j1" type="revolute"><parent link="screen"/><child link="a"/><origin xyz="0 0 0.3"/><axis xyz="0 0 1"/>{limit}</joint>
        <joint name="j2" type="revolute"><parent link="a"/><child link="b"/>
        <origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>{limit}</joint>
        <joint name="m" type="fixed"><parent link="b"/><child link="slm"/><origin xyz="0.1 0.02 0.03"/></joint>
        <joint name="l" type="fixed"><parent link="slm"/><child link="laser_1"/></joint></robot>"""
    )
    return load_robot(path)


def test_skew_axes_have_their_common_normal(tmp_path: Path) -> None:
    """For skew axes a is their distance and positive, alpha their angle."""
    row = dh_table(two_axis_robot(tmp_path, "0.2 0.3 0.1", "0.7 0.4 -0.3").chain)[1]
    origin, axis = np.array([0.2, 0.3, 0.1]), pose(np.zeros(3), np.array([0.7, 0.4, -0.3])).rotation[:, 2]
    normal = np.cross([0, 0, 1], axis)
    assert row.a == pytest.approx(abs(origin @ normal) / np.linalg.norm(normal), abs=1e-12)
    assert abs(row.alpha) == pytest.approx(np.arccos(axis[2]), abs=1e-12)


def test_parallel_axes_take_the_normal_through_the_origin(tmp_path: Path) -> None:
    """For parallel axes d reaches to the joint's URDF origin."""
    row = dh_table(two_axis_robot(tmp_path, "0.3 0.4 0.25", "0 0 0.5").chain)[1]
    assert (row.a, row.d, row.alpha) == pytest.approx((0.5, 0.25, 0.0), abs=1e-12)
    assert row.parallel


def test_hayati_has_beta_where_axes_are_nearly_parallel(tmp_path: Path) -> None:
    """Nearly parallel axes keep their joint's own origin under Hayati; the common normal would lie far off."""
    chain = two_axis_robot(tmp_path, "0.5 0 0.25", "0.003 0.004 0").chain
    plain, tilted = dh_table(chain)[1], dh_table(chain, hayati=True)[1]
    assert abs(tilted.beta) > 1e-3
    assert (tilted.a, tilted.d) == pytest.approx((0.5, 0.25), abs=1e-12)
    assert abs(plain.d) > 1


def test_a_negative_axis_counts_positive(tmp_path: Path) -> None:
    """An axis along -z gives alpha of 180 deg and a theta that counts with q."""
    row = dh_table(two_axis_robot(tmp_path, "0.5 0 0", "0 0 0", axis="0 0 -1").chain)[1]
    assert abs(row.alpha) == pytest.approx(np.pi)
