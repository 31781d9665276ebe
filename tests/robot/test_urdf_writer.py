"""Only the numbers of calibrated origins change in a URDF, and every reader finds the fitted robot in it."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from tests.support.small_robot import URDF, XACRO, robot_of
from urdfcal.base.errors import RobotError
from urdfcal.base.geometry import SE3
from urdfcal.robot.corrections import OriginCorrection, corrected_model
from urdfcal.robot.description import Description
from urdfcal.robot.robot import Robot, load_robot, robot_from
from urdfcal.robot.urdf_writer import numbers, with_origins

NUMBERS = rb"[-+0-9.e]+ [-+0-9.e]+ [-+0-9.e]+"


def random_corrections(robot: Robot, rng: np.random.Generator, names: list[str] | None = None) -> dict[str, OriginCorrection]:
    """Errors of centimetres and degrees in all six directions of some joints, by default of all that do not float."""
    joints = robot.tree.joints
    wanted = names if names is not None else [name for name, joint in joints.items() if joint.type not in ("floating", "planar")]
    deltas = {name: pin.exp6(rng.normal(0.0, 0.02, 6)) for name in wanted}
    return {name: OriginCorrection(joints[name].origin, joints[name].origin * delta, joints[name].moves) for name, delta in deltas.items()}


def written(robot: Robot, corrections: Mapping[str, OriginCorrection]) -> bytes:
    return with_origins(robot.description, {name: correction.corrected for name, correction in corrections.items()})


def random_positions(robot: Robot, rng: np.random.Generator) -> dict[str, float]:
    """A position for every joint that moves, mimic joints after their leaders."""
    own = {name: float(rng.uniform(-1, 1)) for name, joint in robot.tree.joints.items() if joint.moves}

    def position(name: str) -> float:
        mimic = robot.tree.joints[name].mimic
        return own[name] if mimic is None else mimic.multiplier * position(mimic.joint) + mimic.offset

    return {name: position(name) for name in own}


def pinocchio_links(model: object, root: str, positions: Mapping[str, float]) -> dict[str, SE3]:
    """Placements of all links against the root link; a floating joint stands at neutral."""
    data, q = model.createData(), pin.neutral(model)
    for name, value in positions.items():
        joint = model.joints[model.getJointId(name)]
        q[joint.idx_q : joint.idx_q + joint.nq] = value if joint.nq == 1 else (np.cos(value), np.sin(value))
    pin.framesForwardKinematics(model, data, q)
    bodies = {frame.name: data.oMf[index] for index, frame in enumerate(model.frames) if frame.type == pin.FrameType.BODY}
    return {name: bodies[root].actInv(placement) for name, placement in bodies.items()}


def assert_yourdfpy_agrees(text: bytes, root: str, positions: Mapping[str, float], expected: Mapping[str, SE3]) -> None:
    """Fail where yourdfpy reads another placement of a link out of the text."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from yourdfpy import URDF as Yourdf

        urdf = Yourdf.load(io.BytesIO(text), load_meshes=False, build_scene_graph=True)
        urdf.update_cfg({name: positions[name] for name in urdf.actuated_joint_names})
    for link, placement in expected.items():
        np.testing.assert_allclose(urdf.get_transform(link, root), placement.homogeneous, atol=1e-9, err_msg=link)


def assert_read_back(robot: Robot, text: bytes, corrections: Mapping[str, OriginCorrection], rng: np.random.Generator) -> None:
    """Fail unless Pinocchio and yourdfpy find the fitted placements in the text."""
    positions = random_positions(robot, rng)
    fitted = pinocchio_links(corrected_model(robot.model, corrections), robot.tree.root, positions)
    again = robot_from(replace(robot.description, text=text))
    for link, placement in pinocchio_links(again.model, robot.tree.root, positions).items():
        np.testing.assert_allclose(placement.homogeneous, fitted[link].homogeneous, atol=1e-9, err_msg=link)
    assert_yourdfpy_agrees(text, robot.tree.root, positions, fitted)


TURN = '<joint name="turn" type="revolute">\n    <parent link="base"/>\n    <child link="upper"/>\n    <origin xyz="0 0 0.2" rpy="0 0 0"/>'
assert TURN in URDF
CALIBRATED = ["base_mount", "turn", "lift", "slide", "slm_mount", "laser_1_mount"]
MARKED = (  # « » stands for three numbers that may change, §...§ for an origin or attribute that is put in
    URDF.replace('xyz="-1.4 0 -0.1" rpy="0 0 0"', 'xyz="«-1.4 0 -0.1»" rpy="«0 0 0»"')
    .replace(TURN, TURN.replace("0 0 0.2", "«0 0 0.2»").replace('rpy="0 0 0"', 'rpy="«0 0 0»"'))
    .replace('xyz="0.3 0 0" rpy="0.1 0 0"', 'xyz="«0.3 0 0»" rpy="«0.1 0 0»"')
    .replace('xyz="0.2 0 0"', 'xyz="«0.2 0 0»"§ rpy="N"§')
    .replace('xyz="0.05 0.04 0.02" rpy="0 1.5707963267948966 0"', 'xyz="«0.05 0.04 0.02»" rpy="«0 1.5707963267948966 0»"')
    .replace('rpy="-0.2 0 0"', 'rpy="«-0.2 0 0»"§ xyz="N"§')
)
MARKED_TURN = '<origin xyz="«0 0 0.2»" rpy="«0 0 0»"/>'
MARKED_MOUNT = '<origin xyz="«-1.4 0 -0.1»" rpy="«0 0 0»"/>'


def changed(old: str, new: str, text: str = MARKED) -> str:
    assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times in the text"
    return text.replace(old, new)


HOSTILE = {
    "as it is": MARKED,
    "single quotes": MARKED.replace('"', "'").replace("'N'", '"N"'),
    "byte-order mark": "\ufeff" + MARKED,
    "no declaration": MARKED.removeprefix('<?xml version="1.0"?>\n'),
    "CDATA": changed(
        '<link name="tool"/>', '<link name="tool"/><gazebo><![CDATA[<joint name="turn"><origin xyz="1 1 1"/></joint>]]></gazebo>'
    ),
    "origin over three lines": changed(MARKED_TURN, '<origin\n      xyz="«0 0 0.2»"\n      rpy="«0 0 0»"\n    />'),
    "missing origin": changed("\n    " + MARKED_TURN, "").replace(
        '<joint name="turn" type="revolute">', '<joint name="turn" type="revolute">§\n    <origin xyz="N" rpy="N"/>§'
    ),
    "missing origin on one line": changed(f"    {MARKED_TURN}\n", "").replace(
        '<joint name="turn" type="revolute">\n    <parent', '<joint name="turn" type="revolute">§<origin xyz="N" rpy="N"/>§<parent'
    ),
    "empty origin": changed(MARKED_TURN, '<origin§ xyz="N"§§ rpy="N"§/>'),
    "open and shut origin": changed(MARKED_TURN, '<origin§ xyz="N"§§ rpy="N"§></origin>'),
    "origin with content": changed(MARKED_TURN, '<origin xyz="«0 0 0.2»"§ rpy="N"§  ><!-- > --></origin  >'),
    "comment with an origin": changed(
        MARKED_TURN, f'<!-- <origin xyz="7 7 7" rpy="1 1 1"/> -->{MARKED_TURN}<!-- <origin xyz="8 8 8"/> -->'
    ),
    "comment with a joint": changed('<joint name="turn"', '<!-- <joint name="turn"><origin xyz="7 7 7"/></joint> --><joint name="turn"'),
    "processing instruction": changed("<robot ", '<?edit <joint name="turn"><origin xyz="7 7 7"/></joint> ?>\n<robot '),
    "same name in a transmission": changed(
        '  <link name="base"/>',
        '  <transmission name="t"><joint name="turn"><origin xyz="7 7 7"/></joint></transmission>\n  <link name="base"/>',
    ),
    "same name in ros2_control": changed(
        "</robot>",
        '<ros2_control name="r"><joint name="turn"><origin xyz="7 7 7"/><param name="p">1</param></joint></ros2_control></robot>',
    ),
    "same name in gazebo": changed(
        "</robot>", '<gazebo reference="turn"><joint name="turn"><origin xyz="7 7 7"/></joint></gazebo></robot>'
    ),
    "origin of a link": changed(
        '<link name="base"/>',
        '<link name="base"><visual><origin xyz="7 7 7" rpy="1 1 1"/><geometry><box size="1 1 1"/></geometry></visual></link>',
    ),
    "two joints on one line": re.sub(r"</joint>\s*<joint", "</joint><joint", MARKED),
    "everything on one line": re.sub(r">\s*<", "><", MARKED),
    "greater-than in attribute values": changed(
        '<joint name="turn" type="revolute">', '<joint note="a > b" name="turn" type="revolute">'
    ).replace(MARKED_MOUNT, MARKED_MOUNT.replace("<origin", "<origin note='/>'")),
    "attribute within an attribute": changed(MARKED_TURN, MARKED_TURN.replace("<origin", "<origin note=\" xyz='1 2 3' rpy='1 1 1'\"")),
    "attributes of similar name": changed(MARKED_TURN, MARKED_TURN.replace("<origin", '<origin old_xyz="1 2 3" x:xyz="1 2 3"')).replace(
        "<robot ", '<robot xmlns:x="u" '
    ),
    "attributes the other way round": changed(MARKED_TURN, '<origin rpy="«0 0 0»" xyz="«0 0 0.2»"/>'),
    "blanks around =": changed(MARKED_TURN, "<origin\txyz\n=\t'«0 0 0.2»'   rpy =\r\n \"«0 0 0»\"\t/>"),
    "blanks in numbers": changed(MARKED_TURN, '<origin xyz="«\n  0 0\t 0.2  »" rpy="«  0 0 0»"/>'),
    "character references": changed(MARKED_TURN, '<origin xyz="«&#48; 0&#x20;0.2»" rpy="«0 0 0»"/>'),
    "other digits": changed("«0 0 0.2»", "«+0 -.0 2e-1»"),
    "DOCTYPE": changed("<robot ", '<!DOCTYPE robot SYSTEM "urdf.dtd" [<!-- <joint> --><?pi x?>]>\n<robot '),
    "unknown tags": changed(
        '<axis xyz="0 1 0"/>',
        '<axis xyz="0 1 0"/><calibration rising="0"/><origins xyz="7 7 7"/><child_origin><origin xyz="7 7 7"/></child_origin>',
    ),
    "names of other letters": MARKED.replace('"upper"', '"Oberarm_\u00fc\u4e2d"').replace(
        "<robot", "<!-- \u4e2d\u6587 \u00e4\u00f6\u00fc -->\n<robot"
    ),
    "escaped names": MARKED.replace('"upper"', '"a&amp;b&lt;c&#65;"'),
    "text at the end": MARKED + "<!-- <origin/> -->\n\n<?end?>",
    "tall": changed("<robot ", "<!--" + "x" * 3_000_000 + "-->\n<robot "),
}


def nominal(marked: str) -> str:
    return re.sub("§.*?§", "", marked, flags=re.DOTALL).replace("«", "").replace("»", "")


def pattern(marked: bytes) -> bytes:
    """The text as a pattern: every byte as it is, but for the marked places."""
    parts = re.split(rb"(\xc2\xab.*?\xc2\xbb|\xc2\xa7.*?\xc2\xa7)", marked, flags=re.DOTALL)
    return b"".join(
        NUMBERS
        if part.startswith(b"\xc2\xab")
        else re.escape(part.strip(b"\xc2\xa7")).replace(b"N", NUMBERS)
        if part.startswith(b"\xc2\xa7")
        else re.escape(part)
        for part in parts
    )


@pytest.mark.parametrize("line_end", ["\n", "\r\n"], ids=["LF", "CRLF"])
@pytest.mark.parametrize("case", HOSTILE)
def test_every_other_byte_stays(case: str, line_end: str, rng: np.random.Generator) -> None:
    """In hostile text nothing but the six numbers of each calibrated origin changes, and both readers find the fitted robot there."""
    marked = HOSTILE[case].replace("\n", line_end)
    robot = robot_of(nominal(marked))
    corrections = random_corrections(robot, rng, CALIBRATED)
    text = written(robot, corrections)
    if case != "tall":
        match = re.fullmatch(pattern(marked.encode()), text)
        assert match, text.decode()
    else:
        assert re.fullmatch(pattern(marked.encode()[3_000_010:]), text[3_000_010:])
        assert text[:3_000_010] == robot.description.text[:3_000_010]
    assert_read_back(robot, text, corrections, rng)


@pytest.mark.parametrize("encoding", ["ISO-8859-1", "windows-1252", "US-ASCII", "iso-8859-15"])
def test_other_encodings_stay(encoding: str, rng: np.random.Generator) -> None:
    """A text in a declared encoding of single bytes keeps every byte, umlauts in front of the joints included."""
    umlauts = "" if encoding == "US-ASCII" else " \u00e4\u00f6\u00fc\u00df"
    marked = (
        MARKED.replace('version="1.0"', f'version="1.0" encoding="{encoding}"')
        .replace('"upper"', f'"Arm{umlauts.strip()}"')
        .replace("<link", f"<!--{umlauts} --><link", 1)
    )
    robot = robot_of(nominal(marked).encode(encoding))
    corrections = random_corrections(robot, rng, CALIBRATED)
    text = written(robot, corrections)
    assert re.fullmatch(pattern(marked.encode()), text.decode(encoding).encode())
    assert_read_back(robot, text, corrections, rng)


def test_xacro_input_is_written_expanded(tmp_path: Path, rng: np.random.Generator) -> None:
    """For xacro the text is the expanded document, changed in the numbers alone."""
    (tmp_path / "small.urdf.xacro").write_text(XACRO, "utf-8")
    robot = load_robot(tmp_path / "small.urdf.xacro")
    corrections = random_corrections(robot, rng)
    text = written(robot, corrections)
    assert_only_origins_differ(robot.description.text, text, len(corrections))
    assert_read_back(robot, text, corrections, rng)


def assert_only_origins_differ(old: bytes, new: bytes, joints: int) -> None:
    """Fail where anything but at most so many <origin> tags differs."""
    origin = re.compile(rb"\s*<origin[^>]*>")
    assert origin.sub(b"", old) == origin.sub(b"", new)
    kept = {tag.strip() for tag in origin.findall(old)} & {tag.strip() for tag in origin.findall(new)}
    assert sum(tag.strip() not in kept for tag in origin.findall(new)) <= joints


REAL = [
    "panda_description/urdf/panda.urdf",
    "ur_description/urdf/ur5_robot.urdf",
    "tiago_description/robots/tiago_no_hand.urdf",
    "talos_data/robots/talos_reduced.urdf",
    "kinova_description/robots/kinova.urdf",
    "xarm_description/urdf/xarm7.urdf",
    "so_arm_description/urdf/so101.urdf",
    "baxter_description/urdf/baxter.urdf",
    "z1_description/urdf/z1.urdf",
]


@pytest.mark.parametrize("name", REAL)
def test_real_robots_are_read_back(name: str, example_robots: Path, rng: np.random.Generator) -> None:
    """Every joint of a real robot corrected: the text keeps all but the origins, and both readers find the fitted placements to 1e-9."""
    robot = load_robot(example_robots / name)
    corrections = random_corrections(robot, rng)
    text = written(robot, corrections)
    assert_only_origins_differ(robot.description.text, text, len(corrections))
    assert_read_back(robot, text, corrections, rng)


def test_pitch_of_ninety_degrees_is_kept(rng: np.random.Generator) -> None:
    """A corrected rotation within rounding of pitch 90 deg reads back to 1e-14."""
    robot = robot_of(URDF)
    for pitch in (np.pi / 2, -np.pi / 2, np.pi / 2 - 1e-9, 1.5707):
        origin = pin.SE3(pin.rpy.rpyToMatrix(0.3, pitch, -0.8), rng.normal(size=3))
        back = robot_of(with_origins(robot.description, {"turn": origin})).tree.joints["turn"].origin
        np.testing.assert_allclose(back.homogeneous, origin.homogeneous, atol=1e-14)


def test_an_origin_that_stays_keeps_its_text() -> None:
    """An origin put back as it was changes no byte, and one that only shifts keeps its rpy."""
    robot = robot_of(URDF)
    assert with_origins(robot.description, {name: joint.origin for name, joint in robot.tree.joints.items()}) == robot.description.text
    turn = robot.tree.joints["slm_mount"].origin
    shifted = pin.SE3(turn.rotation, turn.translation + 1.0)
    assert b'<origin xyz="1.05 1.04 1.02" rpy="0 1.5707963267948966 0"/>' in with_origins(robot.description, {"slm_mount": shifted})


def test_numbers_come_back_to_the_last_bit(rng: np.random.Generator) -> None:
    """Each number is written with as many digits as bring the same double back, and rounding dust as 0."""
    values = np.concatenate([rng.normal(size=300) * 10.0 ** rng.integers(-12, 3, 300), [0.1, -0.0, 1.0, 1e-17]])[: 3 * 101].reshape(-1, 3)
    for triple in values:
        np.testing.assert_array_equal([float(word) for word in numbers(triple).split()], np.where(np.abs(triple) < 1e-16, 0.0, triple))
    assert numbers(np.array([1.0, -0.0, 1e-17])) == "1 0 0"


def test_a_joint_that_is_not_in_the_text_is_refused() -> None:
    """An origin for a joint that the text lacks is an error that names it."""
    description = Description(Path("small.urdf"), URDF.encode(), expanded=False)
    with pytest.raises(RobotError, match=r"small\.urdf: there is no joint 'elbow' in the text"):
        with_origins(description, {"elbow": pin.SE3.Identity()})
