"""A calibration on MJCF and SDF: MuJoCo, and a product of the poses that stand there, have the robot where the calibrated URDF has it."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from tests.support.other_models import MJCF, SDF, converted
from tests.support.small_robot import URDF, robot_of
from urdfcal.base.errors import RobotError
from urdfcal.deploy.onto.mujoco_check import off_in_mujoco
from urdfcal.deploy.onto.orientations import WAYS, Angles, read_rotation, written
from urdfcal.deploy.onto.patched import Patched, patched
from urdfcal.deploy.onto.text import Element
from urdfcal.output.stored import corrected_robot
from urdfcal.robot.robot import Robot, load_robot

mujoco = pytest.importorskip("mujoco")
JOINTS = ("turn", "lift", "slide")
NUMBER = re.compile(rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?")


def origins_of(robot: Robot, names: tuple[str, ...], seed: int = 0) -> dict[str, Any]:
    rng = np.random.default_rng(seed)
    return {name: robot.tree.joints[name].origin * pin.exp6(pin.Motion(rng.normal(size=6) * 3e-3)) for name in names}


def onto(text: str, folder: Path, names: tuple[str, ...] = (*JOINTS, "slm_mount"), force: bool = False) -> Patched:
    path = folder / "model.xml"
    path.write_text(text)
    robot = robot_of(URDF)
    return patched(robot, origins_of(robot, names), path, force)


def outside_numbers(text: bytes) -> bytes:
    return re.sub(rb"\s*#(\s+#)*\s*", b"#", NUMBER.sub(b"#", text))


def relative(robot: Robot, positions: dict[str, float], links: tuple[str, ...]) -> list[Any]:
    """Links of a URDF, seen from its base, by Pinocchio."""
    model, data = robot.model, robot.model.createData()
    q = pin.neutral(model)
    for name, value in positions.items():
        joint = model.getJointId(name)
        start = model.idx_qs[joint]
        q[start : start + model.nqs[joint]] = (np.cos(value), np.sin(value)) if model.nqs[joint] == 2 else value
    pin.framesForwardKinematics(model, data, q)
    base = data.oMf[model.getFrameId("base")]
    return [base.actInv(data.oMf[model.getFrameId(link)]) for link in links]


def in_mujoco(text: bytes, positions: dict[str, float]) -> list[Any]:
    """The bodies of the small robot, and its site, seen from its base, by MuJoCo."""
    model = mujoco.MjModel.from_xml_string(text.decode())
    data = mujoco.MjData(model)
    for name, value in positions.items():
        data.joint(name).qpos = value
    mujoco.mj_kinematics(model, data)
    found = [data.body(name) for name in ("base", "upper", "lower", "carriage")]
    found.append(data.site("slm"))
    base, *others = (pin.SE3(np.array(own.xmat).reshape(3, 3), np.array(own.xpos)) for own in found)
    return [base.actInv(own) for own in others]


LINKS = ("upper", "lower", "tool", "slm")


def test_mujoco_has_every_body_where_the_calibrated_urdf_has_its_link(tmp_path: Path) -> None:
    """Degrees, defaults, classes, frames, ref, axis-angle, xyaxes: kinematics agree to 1e-9, and outside numbers bytes are as they were."""
    found = onto(MJCF, tmp_path)
    text = found.whole[tmp_path / "model.xml"]
    calibrated = corrected_robot(robot_of(URDF), origins_of(robot_of(URDF), (*JOINTS, "slm_mount")))
    rng = np.random.default_rng(1)
    for _ in range(5):
        q = dict(zip(JOINTS, rng.uniform(-0.5, 0.5, 3), strict=True))
        for ours, theirs in zip(relative(calibrated, q, LINKS), in_mujoco(text, q), strict=True):
            assert np.abs(ours.homogeneous - theirs.homogeneous).max() < 1e-9
    added = (b' axisangle="#"', b' xyaxes="#"', b' quat="#"')
    was, now = outside_numbers(MJCF.encode()), outside_numbers(text)
    for word in added:
        was, now = was.replace(word, b""), now.replace(word, b"")
    assert now == was
    assert b'<body pos="9 9 9"/>' in text
    assert found.lost == ()


def test_a_body_with_several_joints_gets_axes_of_its_own(tmp_path: Path) -> None:
    """A correction between two joints of one body turns and moves the axis of the first."""
    two = MJCF.replace('<body name="carriage" pos="0.2 0 0">', "").replace("<!-- kept --><geom/>", "")
    site = '<site name="slm" xyaxes="0 0 -1 0 1 0" pos=".05 .04 .02"/>'
    two = two.replace(f"{site}\n            </body>", site)
    found = onto(two, tmp_path, JOINTS)
    calibrated = corrected_robot(robot_of(URDF), origins_of(robot_of(URDF), JOINTS))
    model = mujoco.MjModel.from_xml_string(found.whole[tmp_path / "model.xml"].decode())
    data = mujoco.MjData(model)
    gaps = []
    for q in np.random.default_rng(2).uniform(-0.5, 0.5, (4, 3)):
        positions = dict(zip(JOINTS, q, strict=True))
        for name, value in positions.items():
            data.joint(name).qpos = value
        mujoco.mj_kinematics(model, data)
        bodies = (data.body(name) for name in ("upper", "lower"))
        upper, lower = (pin.SE3(np.array(body.xmat).reshape(3, 3), np.array(body.xpos)) for body in bodies)
        ours = relative(calibrated, positions, ("upper", "tool"))
        gaps.append(ours[0].actInv(ours[1]).inverse() * upper.actInv(lower))
    assert max(np.abs(gap.homogeneous - gaps[0].homogeneous).max() for gap in gaps) < 1e-9  # where the body lies on the link is constant


def sdf_poses(text: bytes) -> dict[str, Any]:
    """Placements of the small SDF's things in its model, each a product of what stands there."""
    model = ET.fromstring(text).find("world/model")
    assert model is not None
    things = {own.get("name", ""): own for own in model if own.tag in ("link", "joint", "frame")}

    def placed(name: str) -> Any:
        if not name:
            return pin.SE3.Identity()
        own = things[name]
        said = own.find("pose")
        words = [float(word) for word in ((said.text or "") if said is not None else "").split()] or [0.0] * 6
        about = said.get("relative_to") if said is not None else None
        about = about or (own.findtext("child") if own.tag == "joint" else own.get("attached_to")) or ""
        if len(words) == 7:
            rotation = pin.Quaternion(np.array(words[3:])).matrix()
        else:
            unit = np.pi / 180 if said is not None and said.get("degrees") else 1.0
            rotation = pin.utils.rpyToMatrix(*(unit * word for word in words[3:]))
        return placed(about) * pin.SE3(rotation, np.array(words[:3]))

    return {name: placed(name) for name in things}


def test_sdf_has_every_link_where_the_calibrated_urdf_has_it(tmp_path: Path) -> None:
    """Degrees, quaternions, relative_to, expressed_in: links and frame at zero, and axes, are the calibrated URDF's."""
    found = onto(SDF, tmp_path)
    text = found.whole[tmp_path / "model.xml"]
    robot = corrected_robot(robot_of(URDF), origins_of(robot_of(URDF), (*JOINTS, "slm_mount")))
    poses, was = sdf_poses(text), sdf_poses(SDF.encode())
    for link, ours in zip(("upper", "lower", "carriage", "slm"), relative(robot, {}, LINKS), strict=True):
        assert np.abs((poses["base"].actInv(poses[link])).homogeneous - ours.homogeneous).max() < 1e-12
    slide = ET.fromstring(text).find(".//joint[@name='slide']/axis/xyz")
    assert slide is not None
    expected = poses["carriage"].rotation @ np.array([0.6, 0, 0.8])
    assert poses["lower"].rotation @ [float(word) for word in (slide.text or "").split()] == pytest.approx(expected, abs=1e-12)
    shape = ET.fromstring(text).find(".//collision/pose")
    assert shape is not None
    assert [float(word) for word in (shape.text or "").split()] != [0, 0, 1, 0, 0, 0]  # it stays on its link, whichever frame tells it
    there = pin.SE3(np.eye(3), np.array([0.0, 0, 1]))
    words = np.array([float(word) for word in (shape.text or "").split()])
    now = poses["upper"] * pin.SE3(pin.utils.rpyToMatrix(*words[3:]), words[:3])
    held = poses["carriage"].actInv(now).homogeneous
    assert held == pytest.approx(was["carriage"].actInv(was["upper"] * there).homogeneous, abs=1e-12)
    for piece in (b"<pose>0 0 1 0 0 0</pose><geometry/>", b"<pose>5 6 7 0 0 1</pose>", b'<pose degrees="true">1 2 3 0 0 90</pose>'):
        assert piece in text


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("seq", ["xyz", "ZYX", "zxz"])
def test_mujoco_reads_an_orientation_as_it_was_meant(way: str, seq: str) -> None:
    """Whatever way it is written in, MuJoCo reads the rotation that was to be written, and we read what MuJoCo reads."""
    angles = Angles(eulerseq=seq)
    for turn in ([0.3, -0.4, 2.1], [0, np.pi / 2, 0], [0, 0, 0], [0.2, 0.1, 0]):
        rotation = pin.exp3(np.array(turn))
        name, values = written(way, rotation, angles)
        attributes = {name: " ".join(map(repr, values.tolist()))}
        tag = f'<body {name}="{attributes[name]}"><geom size="1"/></body>'
        model = mujoco.MjModel.from_xml_string(f'<mujoco><compiler eulerseq="{seq}"/><worldbody>{tag}</worldbody></mujoco>')
        w, x, y, z = model.body_quat[1]
        assert pin.Quaternion(w, x, y, z).matrix() == pytest.approx(rotation, abs=1e-11)
        assert read_rotation(Element(Path(), "body", {}, None, 1, 0), attributes, angles) == pytest.approx(rotation, abs=1e-11)


@pytest.mark.parametrize("urdf", ["panda_description/urdf/panda.urdf", "ur_description/urdf/ur5_robot.urdf"])
def test_mujocos_own_conversions_are_calibrated_as_their_urdf(urdf: str, example_robots: Path, tmp_path: Path) -> None:
    """What MuJoCo made of a Panda and of a UR5, to six digits, moves as the calibrated URDF to 1e-6 m, and not before its correction."""
    robot, path = load_robot(example_robots / urdf), converted(example_robots / urdf, tmp_path / "model.xml")
    names = tuple(name for name, joint in robot.tree.joints.items() if joint.moves and "finger" not in name)
    found = patched(robot, origins_of(robot, names), path)
    texts, rng = (found.original, found.whole), np.random.default_rng(0)
    before, after = off_in_mujoco(texts, found.zero, found.before.T_model_base, found.joints, found.theirs, rng)
    unchanged = off_in_mujoco((found.original, found.original), found.zero, found.before.T_model_base, found.joints, found.theirs, rng)[1]
    assert max(*before, *after) < 1e-3
    assert min(unchanged) > 1


REFUSED = {
    "another length": (MJCF, 'pos="0.3 0 0"', 'pos="0.301 0 0"', "joint 'lift': its axis is 1 mm and 0 mrad from where"),
    "another sign": (MJCF, 'axis="0 0 2"', 'axis="0 0 -2"', "joint 'turn': its axis is"),
    "another zero": (MJCF, 'name="lift"', 'name="lift" ref="1"', "joint 'slide': its axis is 0 mm and 17.45 mrad"),
    "no such joint": (MJCF, 'name="lift"', 'name="lifts"', "no joint named 'lift'"),
    "slides": (MJCF, '<joint name="lift"/>', '<joint name="lift" type="slide"/>', "joint 'lift' slides here alone"),
    "stands between": (
        MJCF,
        '<joint name="lift"/>',
        '<joint name="new"/><joint name="lift"/>',
        "hangs behind turn, new here, and behind turn",
    ),
    "no class": (MJCF, 'class="main" name', 'class="man" name', "no default class 'man'"),
    "no number": (MJCF, 'pos="1 2 3"', 'pos="1 2 x"', "model.xml:9: <body base>: pos: 'x' is not a finite number"),
    "two ways": (MJCF, 'pos="1 2 3"', 'quat="1 0 0 0" euler="0 0 0"', "has both quat and euler"),
    "no file": (MJCF, '<geom type="plane" size="1 1 1"/>', '<include file="none.xml"/>', "none.xml: cannot be read"),
    "order of turns": (MJCF, '"zyx"', '"zyq"', "eulerseq: found 'zyq'"),
    "no model": ("<sdf version='1.9'/>", "", "", "has 0 models with joints"),
    "a URDF": (URDF, "", "", "that is a URDF"),
    "old": (SDF, 'version="1.9"', 'version="1.4"', "is SDF 1.4"),
    "circle": (SDF, "relative_to='turn'", "relative_to='upper'", "its pose is relative to itself"),
    "one name": (SDF, '<joint name="lift"', '<joint name="lower"', "<joint lower>: a <link> is called so, too"),
    "no frame": (SDF, "relative_to='turn'", "relative_to='turns'", "no link, joint or frame named 'turns'"),
    "five": (SDF, '<pose relative_to="lower">0.2 0 0 0 0 0', '<pose relative_to="lower">0.2 0 0 0 0', "found 5 numbers, expected 6"),
    "child": (SDF, "<child>upper</child>", "", "has no <child>"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_not_the_nominal_robot_is_refused_by_name(case: str, tmp_path: Path) -> None:
    """A model of other geometry, or one that cannot be read for sure, is refused with the joint, or the line, and how far it is off."""
    text, old, new, said = REFUSED[case]
    with pytest.raises(RobotError, match=re.escape(said)):
        onto(text.replace(old, new), tmp_path)


def test_a_calibrated_model_is_not_calibrated_again(tmp_path: Path) -> None:
    """The patched model, patched again, is refused in words."""
    for text in (MJCF, SDF):
        again = onto(text, tmp_path).whole[tmp_path / "model.xml"].decode()
        with pytest.raises(RobotError, match="is calibrated already"):
            onto(again, tmp_path)


def test_included_files_are_patched_where_the_numbers_stand(tmp_path: Path) -> None:
    """A body in an included file is corrected there, and MuJoCo reads the same as of the model in one piece."""
    inner = body_of_lower(MJCF)
    (tmp_path / "arm.xml").write_text(f"<mujocoinclude>{inner}</mujocoinclude>")
    found = onto(MJCF.replace(inner, '<include file="arm.xml"/>'), tmp_path)
    assert set(found.files) == {tmp_path / "model.xml", tmp_path / "arm.xml"}
    whole = onto(MJCF, tmp_path).whole[tmp_path / "model.xml"].decode()
    assert found.whole[tmp_path / "arm.xml"].decode() == f"<mujocoinclude>{body_of_lower(whole)}</mujocoinclude>"


def body_of_lower(text: str) -> str:
    return text[text.index('<body name="lower"') : text.rindex("\n        </body>\n      </body>")]


def test_other_frames_do_when_the_axes_are_the_same(tmp_path: Path) -> None:
    """Bodies whose frames are turned against the URDF's links, as in models written by hand, are calibrated all the same."""
    q = pin.Quaternion(pin.utils.rpyToMatrix(0, 0, -np.radians(40)) @ pin.utils.rpyToMatrix(0.1, 0, 0))
    lower = f'pos="{0.3 * np.cos(np.radians(40))} {-0.3 * np.sin(np.radians(40))} 0" quat="{q.w} {q.x} {q.y} {q.z}"'
    turned = MJCF.replace('ref="30"', "").replace("euler='30 0 0'", "euler='40 0 0'")
    turned = turned.replace('axisangle="1 0 0 5.729577951308232" pos="0.3 0 0"', lower)
    found = onto(turned, tmp_path, JOINTS)
    before, after = off_in_mujoco(
        (found.original, found.whole), found.zero, found.before.T_model_base, JOINTS, JOINTS, np.random.default_rng(0)
    )
    assert max(*before, *after) < 1e-6
    assert set(found.other_frames) == {"upper"}


@pytest.mark.parametrize(("text", "ours", "theirs"), [(MJCF, "", "r_"), (MJCF, "arm_", ""), (SDF, "", "r_"), (SDF, "arm_", "")])
def test_a_prefix_on_one_side_is_no_other_robot(text: str, ours: str, theirs: str, tmp_path: Path) -> None:
    """Where all joints of one have a prefix that the other's have not, the same comes out as with equal names."""
    path = tmp_path / "prefixed.xml"
    path.write_text(re.sub(r"(name|relative_to)=(['\"])(turn|lift|slide)\2", rf"\1=\2{theirs}\3\2", text))
    robot = robot_of(re.sub(r'joint name="(turn|lift|slide)"', rf'joint name="{ours}\1"', URDF))
    names = tuple(ours + name for name in JOINTS)
    found = patched(robot, origins_of(robot, names), path)
    assert (found.joints, found.theirs) == (names, tuple(theirs + name for name in JOINTS))
    expected = onto(text, tmp_path, JOINTS).whole[tmp_path / "model.xml"]
    assert re.sub(rb"r_(?=turn|lift|slide)", b"", found.whole[path]) == expected


def test_apply_writes_the_model(run_cli: Callable[..., Any], tmp_path: Path) -> None:
    """`apply --onto` writes the patched model, says what MuJoCo makes of it, and nothing onto its inputs."""
    (tmp_path / "small.urdf").write_text(URDF)
    (tmp_path / "model.xml").write_text(MJCF)
    assert run_cli("simulate", "small.urdf", "-o", "m.csv", "--poses", "5").code == 0
    done = run_cli("apply", "small.urdf", "m_truth.yaml", "--onto", "model.xml", "-o", "./")
    said = "wrote model_calibrated.xml with the calibration in it; MuJoCo has its bodies within"
    assert (done.code, said in done.out) == (0, True)
    assert done.err == ""
    (tmp_path / "model.xml").write_text(MJCF.replace('site name="slm"', "site").replace('ref="30"', 'ref="31"'))
    done = run_cli("apply", "small.urdf", "m_truth.yaml", "--onto", "model.xml", "-o", "other.xml")
    assert "nothing in it is named after what slm_mount holds" in done.err
    assert "and 17.5 mrad), so that axes are all that was compared" in done.err
    onto_itself = run_cli("apply", "small.urdf", "m_truth.yaml", "--onto", "model.xml", "-o", "model.xml")
    assert (onto_itself.code, "is an input of this command" in onto_itself.err) == (2, True)
    both = run_cli("apply", "small.urdf", "m_truth.yaml", "--onto", "model.xml", "-o", "x.xml", "--format", "offsets")
    assert (both.code, "leave --format" in both.err) == (2, True)
