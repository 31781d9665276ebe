"""Frames beside the joints: where a state has them, and their covariance."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from tests.support.framed_cell import TEXT, cell
from tests.support.helpers import assert_poses_close
from urdfcal.base.errors import ShapeMismatch
from urdfcal.model.found_frames import found_frames
from urdfcal.robot.rig import SIX

SESSIONS = ("", "later")


@pytest.mark.parametrize("scale", [0.0, 1e-2, 1.0], ids="x~{:g}".format)
def test_the_right_jacobian_is_the_derivative_of_the_placement(scale: float, rng: np.random.Generator) -> None:
    """Its columns are the twist of each frame in its own axes by central differences, in every session, also far from zero."""
    own = cell(rng, SESSIONS)
    x, step = own.x * scale / 0.01, 1e-5
    for number, slot in enumerate(own.errors.slots):
        for session in SESSIONS if slot.frame is not None else ():
            placed, J = own.errors.frame_placement(number, x, session)
            label = f"{slot.label}:{session}" if session and slot.kind == "reference" else slot.label
            moving = [column for column, name in enumerate(own.errors.names) if name.rpartition(".")[0] == label]
            assert len(moving) == len(slot.names)
            assert not np.delete(J, moving, axis=1).any()
            for column in moving:
                ahead, behind = (
                    own.errors.frame_placement(number, x + sign * step * np.eye(len(x))[column], session)[0] for sign in (1.0, -1.0)
                )
                twist = (pin.log6(placed.actInv(ahead)).vector - pin.log6(placed.actInv(behind)).vector) / (2 * step)
                np.testing.assert_allclose(J[:, column], twist, atol=1e-9)


def test_a_covariance_is_that_of_drawn_states(rng: np.random.Generator) -> None:
    """Twists from the estimate to the frames of states that are drawn from the posterior scatter as the covariance says."""
    own = cell(rng)
    names = ("mount_frame", "tool_target", "table_target")
    draws = rng.multivariate_normal(own.x, own.P, 1500)
    numbers = {slot.label: number for number, slot in enumerate(own.errors.slots)}
    for name in names:
        number, frame = numbers[name.rpartition("_")[0]], own.frame(name)
        twists = [pin.log6(frame.on_link.actInv(own.errors.frame_placement(number, x)[0])).vector for x in draws]
        scale = np.sqrt(np.diag(frame.covariance))
        scatter = np.cov(np.array(twists).T) / np.outer(scale, scale)
        np.testing.assert_allclose(scatter, frame.covariance / np.outer(scale, scale), atol=6 / np.sqrt(len(draws)))


def test_a_pose_is_told_in_the_link_that_a_joint_moves(rng: np.random.Generator) -> None:
    """T_parent_child is what Pinocchio finds between them, and its quaternion and matrix are the same placement."""
    own = cell(rng)
    model = own.robot.model
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    parents = {frame.child: frame.parent for frame in own.frames()}
    assert parents["tool_target"] == "c"
    assert parents["mount_frame"] == "base"
    for frame in own.frames():
        parent, link = (data.oMf[model.getFrameId(name, pin.FrameType.BODY)] for name in (frame.parent, frame.link))
        expected = parent.actInv(link) * frame.on_link
        assert_poses_close(frame.placement, expected, mm=1e-10, mrad=1e-10)
        x, y, z, w = frame.quaternion
        assert_poses_close(pin.SE3(pin.Quaternion(w, x, y, z).toRotationMatrix(), frame.xyz), expected, mm=1e-10, mrad=1e-6)
        assert_poses_close(pin.SE3(frame.matrix), expected, mm=1e-10, mrad=1e-6)
        assert_poses_close(pin.SE3(pin.rpy.rpyToMatrix(*frame.rpy.tolist()), frame.xyz), expected, mm=1e-10, mrad=1e-6)


def test_of_a_point_nothing_is_said_of_its_axes(rng: np.random.Generator) -> None:
    """A point keeps its link's axes, and its covariance has no number for what is not known."""
    point = cell(rng).frame("pad_1")
    assert point.found == SIX[:3]
    np.testing.assert_array_equal(point.on_link.rotation, np.eye(3))
    known = np.isfinite(point.covariance)
    np.testing.assert_array_equal(known, np.outer([True] * 3 + [False] * 3, [True] * 3 + [False] * 3))


def test_what_the_data_did_not_decide_is_named(rng: np.random.Generator) -> None:
    """Of each frame, in each session, those of its parameters that are not among the determined ones."""
    own = cell(rng, SESSIONS)
    undecided = {"tool.rot_z", "leica:later.trans_x"}
    frames = own.frames([name for name in own.errors.names if name not in undecided])
    assert {frame.child: frame.undetermined for frame in frames if frame.undetermined} == {
        "tool_target": ("rot_z",),
        "leica_later": ("trans_x",),
    }


@pytest.mark.parametrize(
    ("on_mount", "link", "why_not"),
    [
        ("", "base", "is the root"),
        ("", "head", "hangs on the joint 'neck'"),
        ("", "pad", "has 2 frames"),
        *(("", link, "") for link in ("tool", "mount", "table", "eye")),
        ("table", "mount", "carries 'table'"),
        ("a", "mount", "carries '"),
    ],
)
def test_only_a_link_that_carries_nothing_else_stands_for_its_frame(
    on_mount: str, link: str, why_not: str, rng: np.random.Generator
) -> None:
    """Moving the root, a link on a moving joint, one with several frames, or one below which the fit knows more would move other things."""
    was, child = '<parent link="base"/>', f'<child link="{on_mount}"/>'
    own = cell(rng, text=TEXT.replace(was + child, was.replace("base", "mount") + child))
    for frame in (frame for frame in own.frames() if frame.link == link):
        assert frame.why_not.startswith(why_not) if why_not else not frame.why_not
        assert (frame.origin is None) == bool(why_not) == (not frame.joint)


def test_an_instrument_that_was_moved_has_a_frame_a_session(rng: np.random.Generator) -> None:
    """Each session has its own, none of which the link can stand for; targets have one for all."""
    own = cell(rng, SESSIONS)
    eyes = [frame for frame in own.frames() if frame.label == "eye"]
    assert [frame.session for frame in eyes] == ["", "later"]
    assert all(frame.why_not.startswith("has 2 frames") for frame in eyes)
    assert len({frame.child for frame in own.frames()}) == len(own.frames()) == 3 * 2 + 5


@pytest.mark.parametrize("known", ["reference", "target"])
def test_what_is_known_is_no_frame_and_stays(known: str, rng: np.random.Generator) -> None:
    """Frames that are taken as known are not found, and nothing that carries them may be moved."""
    frames = cell(rng, known=known).frames()
    assert {frame.kind for frame in frames} == ({"target"} if known == "reference" else {"instrument"})
    on_head = [frame for frame in frames if frame.link == "eye"]
    assert all(not frame.why_not for frame in on_head)


def test_a_state_of_another_length_is_refused(rng: np.random.Generator) -> None:
    """A number too few is told, and not read as another parameter's."""
    own = cell(rng)
    with pytest.raises(ShapeMismatch, match="parameters, x has shape"):
        found_frames(own.robot.tree, own.robot.rig, own.errors, own.x[1:], own.P, ())
