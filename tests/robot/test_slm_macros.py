"""The macros that put a module on, and a screen in front of, any robot."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conftest import CliResult
from tests.support.helpers import assert_poses_close
from tests.support.paths import ROBOTS_DIR
from tests.support.small_robot import joint, robot_of
from urdfcal.base.errors import RobotError
from urdfcal.output.view.shapes import robot_shapes
from urdfcal.robot.rig import Instruments, Target
from urdfcal.robot.robot import Robot, load_robot

FACE = '<visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual>'
ROBOT = (
    '<robot name="r">'
    + "".join(f'<link name="{name}"/>' for name in ("base", "a", "b", "tool", "slm", "laser_1"))
    + f'<link name="screen">{FACE}</link>'  # as Baxter's face
    + joint("j1", "base", "a", '<axis xyz="0 0 1"/>').replace('9"', '0.4"')
    + joint("j2", "a", "b", '<origin xyz="0.1 0 0.3"/><axis xyz="0 1 0"/>').replace('9"', '0.4"')
    + joint("j3", "b", "tool", '<origin xyz="0.3 0 0" rpy="0 1.5707963 0"/><axis xyz="1 0 0"/>').replace('9"', '0.4"')
    + joint("neck", "base", "screen", '<origin xyz="0 0 0.8"/>')
    + joint("own_1", "tool", "slm", kind="fixed")
    + joint("own_2", "tool", "laser_1", kind="fixed")
    + "</robot>"
)
NAMES = 'link="module" laser_1="red" laser_2="green"'
OPTIONS = ("--screen", "wall", "--laser", "red", "--laser", "green")


def cell(folder: Path, names: str = NAMES, screen: str = 'link="wall"', robot: str = ROBOT) -> Path:
    (folder / "robot.urdf").write_text(robot)
    (folder / "cell.urdf.xacro").write_text(
        f"""<robot name="cell" xmlns:xacro="http://www.ros.org/wiki/xacro">
        <xacro:include filename="robot.urdf"/><xacro:include filename="{ROBOTS_DIR / "slm.urdf.xacro"}"/>
        <xacro:slm {names} parent="tool" xyz="0.05 0 0.02" laser_1_rot_x="-12" laser_2_rot_y="9"/>
        <xacro:screen {screen} parent="base" xyz="1.6 0 0.3"/></robot>"""
    )
    return folder / "cell.urdf.xacro"


def placed(robot: Robot, link: str) -> object:
    return robot.tree.by_child[link].origin


def test_other_names_change_nothing_else(tmp_path: Path) -> None:
    """Under names of one's own the rig is the one that the default names give, on a robot that leaves them free."""
    free = re.sub(r"screen|slm|laser_1", lambda match: f"own_{match[0]}", ROBOT)
    (tmp_path / "free").mkdir()
    plain = load_robot(cell(tmp_path / "free", "", "", free))
    named = load_robot(cell(tmp_path), screen="wall", lasers=["red", "green"])
    assert (plain.rig.base, plain.rig.tip, plain.rig.lasers) == ("screen", "slm", ("laser_1", "laser_2"))
    assert (named.rig.base, named.rig.tip, named.rig.lasers) == ("wall", "module", ("red", "green"))
    assert [named.tree.by_child[link].name for link in ("wall", "module", "red")] == ["wall_mount", "module_mount", "red_mount"]
    for old, new in {"screen": "wall", "slm": "module", "laser_1": "red", "laser_2": "green"}.items():
        assert_poses_close(placed(named, new), placed(plain, old))


def test_a_third_laser_and_a_joint_s_name(tmp_path: Path) -> None:
    """slm_laser takes the module's name and its own, and the joints of module and screen are named as asked."""
    path = cell(tmp_path, f'{NAMES} joint="bolt"', 'link="wall" joint="nail"')
    third = '<xacro:slm_laser number="3" rot_x="0" rot_y="0" rgba="0 0 1 1" parent="module" link="blue"/></robot>'
    path.write_text(path.read_text().replace("</robot>", third))
    joints = load_robot(path).tree.joints
    assert {"bolt": "module", "nail": "wall", "blue_mount": "blue"}.items() <= {name: own.child for name, own in joints.items()}.items()
    assert joints["blue_mount"].parent == "module"


def test_two_modules_stand_on_one_robot(tmp_path: Path) -> None:
    """A prefix goes before every name that a macro gives, so that the same rig stands twice on one robot, each measured on its own."""
    path = cell(tmp_path, 'prefix="left_"', 'prefix="left_"')
    second = """<xacro:slm prefix="right_" parent="b" xyz="0.05 0 0.02"/><xacro:slm_laser prefix="right_" number="3" rot_x="0" rot_y="5"
        rgba="0 0 1 1"/><xacro:screen prefix="right_" parent="base"/><xacro:board parent="b" prefix="right_" columns="9" rows="6"
        square="0.025"/><xacro:target parent="b" prefix="right_"/></robot>"""
    path.write_text(path.read_text().replace("</robot>", second))
    for side, carrier, count in (("left_", "tool", 2), ("right_", "b", 3)):
        lasers = [f"{side}laser_{number + 1}" for number in range(count)]
        robot = load_robot(path, screen=f"{side}screen", lasers=lasers)
        assert (robot.rig.tip, robot.tree.moving_link(lasers[-1])) == (f"{side}slm", carrier)
    new = {name.partition("_")[2] for name in (*robot.tree.links, *robot.tree.joints) if name.startswith("right_")}
    rig = {"slm", "laser_1", "laser_2", "laser_3", "screen", "board", "target"}
    assert new == rig | {f"{name}_mount" for name in rig}


def test_the_macros_are_found_from_anywhere(tmp_path: Path) -> None:
    """A file of one's own includes them by the package, or copied beside it; who copies one of our robots is told how."""
    path = cell(tmp_path)
    text = path.read_text().replace(str(ROBOTS_DIR / "slm.urdf.xacro"), "{}")
    (tmp_path / "slm.urdf.xacro").write_bytes((ROBOTS_DIR / "slm.urdf.xacro").read_bytes())
    texts = []
    for way in ("$(find urdfcal)/robots/slm.urdf.xacro", "package://urdfcal/robots/slm.urdf.xacro", "slm.urdf.xacro"):
        path.write_text(text.format(way))
        texts.append(load_robot(path).description.text)
    assert texts[0] == texts[1] == texts[2]
    path.write_text((ROBOTS_DIR / "ur5" / "ur5.urdf.xacro").read_text())
    with pytest.raises(
        RobotError, match=r"slm\.urdf\.xacro cannot be read: .*; it comes with urdfcal: include \$\(find urdfcal\)/robots/slm"
    ):
        load_robot(path)


def test_taken_names_lead_to_the_way_out(tmp_path: Path) -> None:
    """Default names that the robot has already are refused with the word that there are others."""
    with pytest.raises(RobotError, match=r"link 'screen' is declared twice, first on line \d+; the macros of robots/slm\.urdf\.xacro take"):
        load_robot(cell(tmp_path, NAMES, ""))


def test_such_a_cell_is_simulated_fitted_and_drawn(run_cli: Callable[..., CliResult], tmp_path: Path) -> None:
    """From measurements to the URDF under names of one's own; the robot's own screen is drawn as it is."""
    path = cell(tmp_path)
    assert run_cli("simulate", path, "-o", "m.csv", "--poses", "30", *OPTIONS).code == 0
    run = run_cli("fit", path, "m.csv", "--no-sag", *OPTIONS)
    assert run.code == 0, run.err
    assert "wall.trans_x" in (tmp_path / "cell_calibration.yaml").read_text()
    assert "screen" in robot_shapes(load_robot(path, screen="wall", lasers=["red", "green"])).links
    plain = robot_of(ROBOT.replace("laser_1", "pointer")).seen_by(Instruments((Target("tool", "tool"),)), ())
    assert "screen" in robot_shapes(plain).links
