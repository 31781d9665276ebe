"""Frames that were found, put into a URDF: links that stand for them, and links that are added."""

from __future__ import annotations

import io
import re
import shlex
from collections.abc import Iterator, Mapping

import numpy as np
import pinocchio as pin
import pytest

from tests.support.framed_cell import TEXT, Cell, cell
from tests.support.helpers import assert_poses_close
from tests.support.sensor_cases import CASES, setup_of
from tests.support.small_robot import joint, robot_of
from urdfcal.base.errors import RigError, RobotError, UsageError
from urdfcal.base.geometry import SE3
from urdfcal.model.jacobian import arm_motion
from urdfcal.output.formats import Deployed
from urdfcal.robot.configurations import random_positions, whole_configurations
from urdfcal.robot.frames import FoundFrame
from urdfcal.robot.placed_frames import NOTE, Chosen, FramesWish, frame_origins, frames_wish
from urdfcal.robot.rig import SIX
from urdfcal.robot.robot import Robot

ALL = FramesWish(write=True, add=True)
SESSIONS = {"one session": ("",), "moved": ("", "later")}


def deployed(own: Cell, chosen: Chosen[FoundFrame]) -> Deployed:
    """The cell's robot with all its errors, and frames."""
    links = {name: origin.corrected for name, origin in frame_origins(chosen.written).items()}
    return Deployed(own.robot, own.errors.corrected_origins(own.x), links=links, added=chosen.added)


def predicted(own: Cell, q: np.ndarray, session: str) -> Iterator[tuple[str, str, SE3]]:
    """Link or board of every target, name of every instrument, and where the state has the one in the other."""
    frames, motion = own.errors.chain.frames, arm_motion(own.errors, q[None], own.x, session)
    for there in own.errors.chain.instrument_frames:
        for index, frame in enumerate(frames):
            if frame.role == "target" and not any(frame.at):
                (p,), (R,) = motion.seen(index, there)
                yield frame.name.removesuffix(":0"), frames[there].name, pin.SE3(R, p)


@pytest.mark.parametrize("sessions", SESSIONS.values(), ids=list(SESSIONS))
def test_what_is_written_is_what_the_calibration_predicts(sessions: tuple[str, ...], rng: np.random.Generator) -> None:
    """Pinocchio and yourdfpy read every target in every instrument where the state has it, at any pose, to 1e-9."""
    from yourdfpy import URDF

    own = cell(rng, sessions)
    chosen = ALL.chosen(own.frames(), own.robot.tree)
    text = deployed(own, chosen).content("urdf")
    link = {(frame.label, frame.session): frame.link for frame in chosen.written}
    link |= {(frame.label, frame.session): frame.child for frame in chosen.added}
    model = robot_of(text).model
    data, other = model.createData(), URDF.load(io.BytesIO(text), load_meshes=False, build_scene_graph=True)
    for _ in range(3):
        q = rng.uniform(-1, 1, len(own.robot.chain.inputs))
        positions = dict(zip(own.robot.chain.input_names, q.tolist(), strict=True))
        full = pin.neutral(model)
        for name, value in positions.items():
            full[model.joints[model.getJointId(name)].idx_q] = value
        pin.framesForwardKinematics(model, data, full)
        other.update_cfg(positions)
        for session in sessions:
            for target, instrument, expected in predicted(own, q, session):
                ends = link[instrument, session], link[target, ""]
                found = data.oMf[model.getFrameId(ends[0])].actInv(data.oMf[model.getFrameId(ends[1])])
                again = np.linalg.inv(other.get_transform(ends[0], "base")) @ other.get_transform(ends[1], "base")
                if target == "pad:1":  # a point: its axes are its link's
                    np.testing.assert_allclose(found.translation, expected.translation, atol=1e-9)
                    np.testing.assert_allclose(again[:3, 3], expected.translation, atol=1e-9)
                    continue
                np.testing.assert_allclose(found.homogeneous, expected.homogeneous, atol=1e-9)
                np.testing.assert_allclose(again, expected.homogeneous, atol=1e-9)


@pytest.mark.parametrize("name", CASES)
def test_every_kind_of_sensor_finds_what_the_calibration_predicts(name: str, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Whatever reads, on whatever link that is carried or stands, the written robot has targets where the state has them, to 1e-9."""
    setup = setup_of(CASES[name], robots, rng)
    own = Cell(setup.robot, setup.errors, setup.x, np.zeros((len(setup.x), len(setup.x))))
    frames, seen = own.frames(), setup.robot.rig.instruments
    chosen = ALL.chosen(frames, setup.robot.tree) if frames else Chosen((), ())
    link = {target.placed_by: target.link for target in seen.targets} | {instrument.name: instrument.link for instrument in seen.every}
    model, q = robot_of(deployed(own, chosen).content("urdf")).model, random_positions(setup.robot, 1, rng)[0]
    data = model.createData()
    pin.framesForwardKinematics(model, data, whole_configurations(setup.robot, q[None])[0])
    for session in setup.errors.sessions:
        now = {frame.label: frame for frame in (*chosen.written, *chosen.added) if frame.session in ("", session)}
        ends = link | {label: frame.child if frame in chosen.added else frame.link for label, frame in now.items()}
        for target, instrument, expected in predicted(own, q, session):
            there, here = (data.oMf[model.getFrameId(ends[end])] for end in (instrument, target))
            found, known = there.actInv(here), now[target].found if target in now else SIX
            if SIX[0] in known:
                np.testing.assert_allclose(found.translation, expected.translation, atol=1e-9)
            if SIX[3] in known:
                np.testing.assert_allclose(found.rotation, expected.rotation, atol=1e-9)


def test_every_other_byte_stays(rng: np.random.Generator) -> None:
    """Beside the numbers of corrected origins and the new elements the text is the one before."""
    own = cell(rng)
    chosen = ALL.chosen(own.frames(), own.robot.tree)
    text = deployed(own, chosen).content("urdf").decode()
    start = text.index(f"  <!-- {NOTE} -->")
    end = text.index("</robot>", start)
    assert len(re.findall(r"<link ", text[start:end])) == len(chosen.added) == 4
    origin = re.compile(r"<origin [^>]*>")
    corrected = {name for name in own.robot.tree.joints if name not in ("grip", "glued")}
    for before, after in zip(TEXT.splitlines(), (text[:start] + text[end:]).splitlines(), strict=True):
        name = re.search(r'<joint name="(\w+)"', before)
        if name and name[1] in corrected:
            assert origin.sub("", before) == origin.sub("", after)
        else:
            assert before == after


def test_nothing_asked_changes_nothing(rng: np.random.Generator) -> None:
    """Without an option no frame is written, added or refused."""
    own = cell(rng)
    assert FramesWish().chosen(own.frames(), own.robot.tree) == Chosen((), ())
    assert not frames_wish(False, False, ())


def test_writing_comes_before_adding(rng: np.random.Generator) -> None:
    """With both, links that can stand for their frame do, and the others are added; alone, each option takes what it can."""
    own = cell(rng)

    def names(wish: FramesWish) -> tuple[set[str], set[str]]:
        chosen = wish.chosen(own.frames(), own.robot.tree)
        return {frame.link for frame in chosen.written}, {frame.child for frame in chosen.added}

    able = {"mount", "eye", "tool", "table"}
    assert names(ALL) == (able, {"leica", "pad_1", "pad_2", "head_target"})
    assert names(FramesWish(write=True)) == (able, set())
    assert names(FramesWish(add=True, only={"tool": "tcp", "leica": ""})) == (set(), {"tcp", "leica"})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ((True, False, ["eye_frame", "nose"]), "--frame nose: no frame named 'nose' among 8 frames"),
        ((True, False, ["leica"]), "--write-frames: 'base' is the root, which no joint places; --add-frames adds it as the link 'leica'"),
        ((False, True, ["pad=x"]), "--frame pad=x: means 2 frames: pad_1, pad_2"),
        ((False, True, ["tool=a"]), "has a link 'a' already; name the new link with --frame tool=NAME"),
        ((False, True, ["tool=x", "leica=x"]), "has a .* 'x' already"),
        ((True, False, ["tool=x"]), "--frame tool=x: names a link that is added, which --add-frames does"),
        ((False, False, ["tool"]), "--frame tool: says which of the frames --write-frames or --add-frames mean; neither is there"),
        ((False, True, ["tool=a b"]), "--frame tool=a b: expected NAME=LINK"),
    ],
)
def test_what_cannot_be_is_refused_by_name(options: tuple[bool, bool, list[str]], message: str, rng: np.random.Generator) -> None:
    """A frame that there is not, a link that cannot move, a name that is taken or is none: each says what and the way out."""
    own = cell(rng)
    with pytest.raises((UsageError, RigError), match=message):
        frames_wish(*options).chosen(own.frames(), own.robot.tree)


def test_another_robot_is_refused(rng: np.random.Generator) -> None:
    """A frame's link, and where that is to be moved its joint, must be there."""
    own = cell(rng)
    with pytest.raises(RobotError, match="no link named 'tool'"):
        FramesWish(add=True).chosen(own.frames(), robot_of(TEXT.replace('"tool"', '"hand"')).tree)
    with pytest.raises(RigError, match="expected link 'tool' on the fixed joint 'flange'"):
        FramesWish(write=True).chosen(own.frames(), robot_of(TEXT.replace('"flange"', '"flansch"')).tree)


def test_names_of_new_links_are_free(rng: np.random.Generator) -> None:
    """The name of a frame is left where a link or joint has it, and where one has the name that the new joint would get."""
    text = TEXT.replace('<joint name="grip"', '<joint name="leica"')
    crowd = joint("more", "c", "pad_1_joint", kind="fixed") + joint("eye_frame", "c", "d", kind="fixed")
    text = text.replace("</robot>", f'<link name="pad_1_joint"/><link name="d"/>{crowd}</robot>')
    own = cell(rng, text=text)
    names = {frame.label: frame.child for frame in own.frames()}
    assert names == {
        "mount": "mount_frame",
        "eye": "eye_frame_2",
        "leica": "leica_frame",
        "tool": "tool_target",
        "pad:1": "pad_1_target",
        "pad:2": "pad_2",
        "head": "head_target",
        "table": "table_target",
    }


def published(command: str) -> tuple[Mapping[str, str], SE3]:
    """What tf2's static_transform_publisher makes of its arguments."""
    words = shlex.split(command)
    assert words[:4] == ["ros2", "run", "tf2_ros", "static_transform_publisher"]
    given = dict(zip(words[4::2], words[5::2], strict=True))
    x, y, z, qx, qy, qz, qw = (float(given[f"--{name}"]) for name in ("x", "y", "z", "qx", "qy", "qz", "qw"))
    return given, pin.SE3(pin.Quaternion(qw, qx, qy, qz).toRotationMatrix(), np.array([x, y, z]))


def test_ros_2_is_told_the_same(rng: np.random.Generator) -> None:
    """The arguments of the static transform are parent, child, and the placement to 1e-9."""
    for frame in cell(rng).frames():
        given, placement = published(frame.static_transform)
        assert (given["--frame-id"], given["--child-frame-id"]) == (frame.parent, frame.child)
        assert_poses_close(placement, frame.placement, mm=1e-6, mrad=1e-6)
