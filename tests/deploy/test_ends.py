"""A controller's own base and flange, which a description has aside of its root and of what was measured."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin

from tests.conftest import CliResult
from urdfcal.base.geometry import DEG
from urdfcal.deploy.ends import base_of, flange_of
from urdfcal.deploy.false_targets import solved
from urdfcal.output.accounts import account_of
from urdfcal.output.stored import read_calibration
from urdfcal.robot.robot import load_robot
from urdfcal.robot.way import Way


def test_programs_are_told_in_the_controllers_base_and_of_its_flange(
    tmp_path: Path, example_robots: Path, run_cli: Callable[..., CliResult]
) -> None:
    """What was measured hangs aside: the controller's own solution of what it is told puts the real flange where it was wanted."""
    urdf = tmp_path / "ur5.urdf"
    text = (example_robots / "ur_description/urdf/ur5_robot.urdf").read_text()
    probe = '<link name="probe"/><joint name="probe_joint" type="fixed"><origin xyz="0.1 0 0.2"/>'
    probe += '<parent link="tool0"/><child link="probe"/></joint>'
    urdf.write_text(text.replace("</robot>", f"{probe}</robot>"))
    assert run_cli("simulate", urdf, "-o", "m.csv", "--sensor", "pose:probe", "--poses", 3, "--seed", 5).code == 0
    q = np.array([[30.0, -70.0, 80.0, -40.0, 70.0, 20.0], [32.0, -68.0, 78.0, -43.0, 72.0, 25.0]]) * DEG
    robot = load_robot(urdf)
    to_base = np.diag([-1.0, -1.0, 1.0, 1.0])  # base is half round in base_link
    way = Way.between(robot, "tool0")
    wanted = to_base @ way.placements(q)
    poses = [[*T[:3, 3], *pin.log3(T[:3, :3])] for T in wanted]
    words = [f"movel(p[{', '.join(f'{number:.9f}' for number in pose)}], a=1)" for pose in poses]
    (tmp_path / "a.script").write_text("\n".join(["set_tcp(p[0,0,0,0,0,0])", f"movej({[float(each) for each in q[0]]})", *words]))
    told = run_cli("correct", urdf, "a.script", "--calibration", "m_truth.yaml", "-o", "b.script")
    assert "3 targets of 'tool0' in 'base': the calibrated robot comes where it was wanted at every one" in told.out

    lists = [list(map(float, found.split(","))) for found in re.findall(r"p\[([^\]]*)\]", (tmp_path / "b.script").read_text())][1:]
    false = np.array([pin.SE3(pin.exp3(np.array(each[3:])), np.array(each[:3])).homogeneous for each in lists])
    reached = solved(way, to_base @ false, q)
    real = Way.between(account_of(read_calibration(tmp_path / "m_truth.yaml"), robot).robot, "tool0")
    np.testing.assert_allclose(to_base @ real.placements(reached.q), wanted, atol=2e-8)
    assert np.abs(real.placements(q) - way.placements(q)).max() > 1e-4


def test_ends_go_by_their_names(example_robots: Path) -> None:
    """`tool0` and `base` of one prefix; a robot without them has none."""
    ur5 = load_robot(example_robots / "ur_description/urdf/ur5_robot.urdf").tree
    assert (flange_of(ur5, "wrist_3_link"), flange_of(ur5, "forearm_link"), base_of(ur5, "tool0")) == ("tool0", "", "base")
    panda = load_robot(example_robots / "panda_description/urdf/panda.urdf").tree
    assert (flange_of(panda, "panda_link8"), base_of(panda, "panda_link8")) == ("", "")
