"""Frames of a fit, from the command line to its files and back again."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import yaml

from tests.conftest import CliResult
from tests.support.framed_cell import TEXT, cell
from tests.support.helpers import assert_poses_close
from tests.support.small_robot import robot_of
from urdfcal.api import Calibration, Measurements, Robot, fit, load_robot, measurements_from
from urdfcal.base.errors import CalibrationFileError, UsageError
from urdfcal.output.stored import StoredCalibration, read_calibration
from urdfcal.output.text.frames import frame_lines, undetermined
from urdfcal.robot.placed_frames import FramesWish
from urdfcal.sensors.columns import Stations
from urdfcal.sensors.measurements_csv import write_measurements

STATIONS = Stations({"leica": "base"})
ALL = "--write-frames", "--add-frames"
CHOSEN = "--frame", "eye", "--frame", "tool", "--frame", "leica=tracker"


def measured(robot: Robot, rng: np.random.Generator) -> Measurements:
    """The tool's pose seen by a tracker that stands anywhere, and by a camera in the head some millimetres off its link."""
    q = rng.uniform(-1, 1, (40, 4))
    model, names = robot.model.copy(), ("turn", "lift", "slide", "neck")
    for joint in range(1, model.njoints):
        model.jointPlacements[joint] = model.jointPlacements[joint] * pin.exp6(rng.normal(0, 1, 6) * np.repeat([2e-3, 4e-3], 3))
    data, T_tool_ball = model.createData(), pin.SE3(np.eye(3), np.array([0.0, 0.02, 0.1]))
    T_base_leica = pin.exp6(np.array([0.5, -0.7, 0.9, 1.0, 0.3, -2.0]))
    T_eye_lens = pin.exp6(np.array([0.002, -0.001, 0.003, 0.01, 0.0, -0.005]))
    seen: dict[str, list[np.ndarray]] = {"leica": [], "eye": []}
    for row in q:
        full = pin.neutral(model)
        for name, value in zip(names, row, strict=True):
            full[model.joints[model.getJointId(name)].idx_q] = value
        pin.framesForwardKinematics(model, data, full)
        tool, eye = (data.oMf[model.getFrameId(name, pin.FrameType.BODY)] for name in ("tool", "eye"))
        for name, T_base_here in (("leica", T_base_leica), ("eye", eye * T_eye_lens)):
            noise = pin.exp6(rng.normal(0, 1, 6) * np.repeat([1e-4, 3e-4], 3))
            seen[name].append((T_base_here.actInv(tool * T_tool_ball) * noise).homogeneous)
    table = dict(zip(names, q.T, strict=True)) | {f"tool@{name}.pose": np.array(poses) for name, poses in seen.items()}
    return measurements_from(robot, table, stations=STATIONS)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Robot, measurements, and what the instruments are called."""
    folder = tmp_path_factory.mktemp("frames")
    (folder / "cell.urdf").write_text(TEXT)
    (folder / "rig.yaml").write_text("instruments: {leica: {link: base}}\n")
    robot = load_robot(folder / "cell.urdf")
    write_measurements(folder / "m.csv", measured(robot, np.random.default_rng(4)))
    return folder


@pytest.fixture(scope="module")
def calibration(folder: Path) -> Calibration:
    """The fit in memory."""
    robot = load_robot(folder / "cell.urdf")
    return fit(robot, measured(robot, np.random.default_rng(4)))


@pytest.fixture(scope="module")
def stored(calibration: Calibration, folder: Path) -> StoredCalibration:
    """The same by way of its file."""
    calibration.write(folder / "c.yaml")
    return read_calibration(folder / "c.yaml")


@pytest.fixture(scope="module")
def content(stored: StoredCalibration) -> dict[str, Any]:
    """What stands in that file."""
    found: dict[str, Any] = yaml.safe_load(stored.path.read_text())
    return found


def placements(text: bytes) -> dict[str, pin.SE3]:
    """Every link of a URDF at zero."""
    model = robot_of(text).model
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    return {frame.name: place for frame, place in zip(model.frames, data.oMf, strict=True) if frame.type == pin.FrameType.BODY}


def test_the_command_line_python_and_a_stored_calibration_write_one_robot(
    folder: Path, calibration: Calibration, run_cli: Callable[..., CliResult]
) -> None:
    """`fit` with frames, `Calibration.urdf` and `apply` of the file put every link at the same place."""
    inputs = folder / "cell.urdf", folder / "m.csv", "--rig", folder / "rig.yaml", "--no-sag", "--no-ask"
    done = run_cli("fit", *inputs, *ALL, *CHOSEN, "-o", "a.urdf")
    assert done.code == 0, done.err
    assert re.search(r"eye moved \d.* mm, 0\.\d+ deg, by its joint 'lens'", done.out)
    assert "tracker is a new link on 'base', by the joint 'tracker_joint'" in done.out
    wanted = placements(Path("a.urdf").read_bytes())
    assert wanted.keys() == {*placements(TEXT.encode()), "tracker"}
    for robot, frames in ((folder / "cell.urdf", ["corrected"]), ("bare.urdf", [])):
        if not frames:
            assert run_cli("apply", folder / "cell.urdf", "a_calibration.yaml", "-o", "bare.urdf").code == 0
        words = "apply", robot, "a_calibration.yaml", *ALL, *CHOSEN, "-o", "b.urdf", "--overwrite"
        applied = run_cli(*words, "--json", "-q")
        assert json.loads(applied.out)["frames_in_urdf"] == {"written": {"eye": "lens", "tool": "flange"}, "added": {"tracker": "base"}}
        for name, place in placements(Path("b.urdf").read_bytes()).items():
            assert_poses_close(place, wanted[name], mm=1e-6, mrad=1e-6)
    in_python = placements(calibration.urdf(write_frames=True, add_frames=True, only={"eye": "", "tool": "", "leica": "tracker"}))
    for name, place in in_python.items():
        assert_poses_close(place, wanted[name], mm=1e-6, mrad=1e-6)


def test_a_robot_with_its_frames_needs_no_more_of_them(folder: Path, calibration: Calibration, run_cli: Callable[..., CliResult]) -> None:
    """Measured from the written frames themselves, and of the written targets themselves, it is as far off as the fit says."""
    calibration.write_urdf("w.urdf", write_frames=True, add_frames=True, only={"eye": "", "tool": "", "leica": "tracker"})
    Path("known.yaml").write_text("instruments: {leica: {link: tracker}}\nreference_known: true\ntarget_known: true\n")
    done = run_cli("evaluate", "w.urdf", folder / "m.csv", "--rig", "known.yaml", "--json", "-q")
    rows = json.loads(done.out)["before"]
    assert rows.keys() == calibration.after.keys()
    for name, row in calibration.after.items():
        assert rows[name]["max_mm" if row.unit == "mm" else "max_deg"] == pytest.approx(row.max, rel=1e-6)


def test_frames_go_nowhere_unless_they_are_asked_for(calibration: Calibration, stored: StoredCalibration) -> None:
    """Neither the URDF, nor a Pinocchio model, nor what a stored calibration gives has a joint of theirs in it."""
    fixed = {"stand", "flange", "grip", "glued", "lens", "floor"}
    assert fixed.isdisjoint(calibration.corrections)
    assert fixed.isdisjoint(stored.corrections)
    assert fixed.isdisjoint(stored.origins_for(calibration.robot)[0])
    assert calibration.urdf() == calibration.deployed().content("urdf")
    assert b"urdfcal found" not in calibration.urdf()


def test_the_file_keeps_every_number(calibration: Calibration, stored: StoredCalibration) -> None:
    """What is read back has the placements, covariances and words of the fit."""
    assert len(stored.frames) == len(calibration.frames) == 3
    for found, kept in zip(calibration.frames, stored.frames, strict=True):
        np.testing.assert_array_equal(kept.covariance, found.covariance)
        for name in ("on_link", "placement"):
            assert_poses_close(getattr(kept, name), getattr(found, name), mm=1e-9, mrad=1e-9)
        words = ("label", "name", "kind", "session", "link", "child", "joint", "why_not", "parent", "found", "undetermined")
        assert [getattr(kept, word) for word in words] == [getattr(found, word) for word in words]


def test_a_command_for_ros_2_stands_in_one_line(folder: Path, content: dict[str, Any]) -> None:
    """Whoever copies it out of the file has the whole of it."""
    lines = [line.strip() for line in (folder / "c.yaml").read_text().splitlines()]
    for entry in content["frames"]:
        assert entry["static_transform"] in lines
    assert all("--child-frame-id" in line for line in lines if line.startswith("ros2 run"))


def test_people_are_told_what_would_change(calibration: Calibration, folder: Path) -> None:
    """Each frame has a line: what moves and how far, or which link would be added and why."""
    lines = frame_lines(calibration, FramesWish(), folder / "c.yaml")
    assert lines[1].startswith(f"The calibrated robot is without these frames ({folder / 'c.yaml'} has their poses")
    told = "\n".join(lines)
    assert re.search(r"eye would move \d[.\d]* mm, 0\.\d+ deg \(± \d[.\d]* mm, 0\.\d+ deg\): --write-frames", told)
    assert "frame of leica: --add-frames adds it to 'base' as the link 'leica' ('base' is the root, which no joint places)" in told
    assert re.search(r"tool, 1\d\d mm, \d[.\d]* deg off 'tool': ", told)
    assert "--add-frames adds it as the link 'tool_target'; --write-frames would move 'tool' there, with finger" in told


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--write-frames", "--frame", "leica"), "--write-frames: 'base' is the root, which no joint places; --add-frames adds it"),
        (("--add-frames", "--frame", "leica=tool"), "has a link 'tool' already; name the new link with --frame leica=NAME"),
        (("--write-frames", "--frame", "nose"), "--frame nose: no frame named 'nose' among 3 frames"),
        (("--frame", "eye"), "--frame eye: says which of the frames"),
        (
            ("--write-frames", "--format", "offsets"),
            "--format offsets cannot hold origins of fixed joints; add --format urdf",
        ),
        (("--add-frames", "--format", "origins-yaml"), "--format origins-yaml cannot hold further links; add --format urdf"),
        (("--write-frames", "--reference-known", "--target-known"), "--write-frames: no frame is found beside the joints"),
    ],
)
def test_what_cannot_be_is_refused_before_any_work(
    words: tuple[str, ...], message: str, folder: Path, run_cli: Callable[..., CliResult]
) -> None:
    """One line, exit 2, and nothing written."""
    known = ("--reference", "eye") if "--reference-known" in words else ()
    done = run_cli("fit", folder / "cell.urdf", folder / "m.csv", "--rig", folder / "rig.yaml", *words, *known)
    assert (done.code, done.out) == (2, "")
    assert message in done.err
    assert len(done.err.splitlines()) == 1
    assert not list(Path().iterdir())


def test_a_frame_is_not_put_on_twice(calibration: Calibration, stored: StoredCalibration) -> None:
    """A link that stands for its frame already gets no link for it, nor is it moved again; one that stands elsewhere is refused."""
    written = robot_of(calibration.urdf(write_frames=True, only=["eye"]), "w.urdf")
    again = FramesWish(write=True, only={"eye": ""}).chosen(stored.frames, written.tree)
    with pytest.raises(CalibrationFileError, match=r"the robot w\.urdf is already calibrated"):
        stored.origins_for(written, frames=again)
    adding = FramesWish(add=True, only={"eye": ""}).chosen(stored.frames, written.tree)
    with pytest.raises(CalibrationFileError, match=r"link 'eye' of w\.urdf stands at the frame 'eye_frame' already"):
        stored.origins_for(written, frames=adding)
    elsewhere = robot_of(TEXT.replace('<child link="eye"/>', '<child link="eye"/><origin xyz="0 0 0.01"/>'), "e.urdf")
    with pytest.raises(CalibrationFileError, match=r"link 'eye' of e\.urdf is 10 mm, 0 mrad from where the frame 'eye_frame' was found"):
        stored.origins_for(elsewhere, frames=adding)
    with pytest.raises(CalibrationFileError, match=r"joint 'lens' of e\.urdf is neither at its nominal nor at its corrected origin"):
        stored.origins_for(elsewhere, frames=again)
    assert stored.origins_for(elsewhere, force=True, frames=adding)[0].keys() == stored.corrections.keys()


def test_an_unknown_frame_is_refused_in_python(calibration: Calibration) -> None:
    """The same names, and the same words, as on the command line."""
    with pytest.raises(UsageError, match="no frame named 'nose' among 3 frames"):
        calibration.urdf(write_frames=True, only=["nose"])


def test_what_goes_into_a_urdf_undetermined_is_told(rng: np.random.Generator) -> None:
    """A warning names the frame and the numbers of it that the data did not decide, or that something else carries."""
    own = cell(rng)
    number = own.errors.names.index("tool.rot_x")
    fewer = replace(own.errors, parameters=tuple(np.delete(np.array(own.errors.parameters), number)), carried={"tool.rot_x": "a joint"})
    own = replace(own, errors=fewer, x=np.delete(own.x, number), P=np.delete(np.delete(own.P, number, 0), number, 1))
    decided = [name for name in own.errors.names if name not in ("tool.rot_z", "leica.trans_x")]
    chosen = FramesWish(write=True, add=True).chosen(own.frames(decided), own.robot.tree)
    assert undetermined((*chosen.written, *chosen.added)) == [
        "tool: rot_x, rot_z of this frame are not determined by the data; the URDF has what its prior left",
        "leica: trans_x of this frame is not determined by the data; the URDF has what its prior left",
    ]


BROKEN = {
    "covariance": (("covariance", [[0.0] * 6 for _ in range(5)]), "entry 'frames.0.covariance.5': Field required"),
    "known": (("known", ["yaw"]), "entry 'frames.0.known.0': Input should be 'trans_x'"),
    "joint": (("why_not", "is tired"), "entry 'frames.0': Value error, expected a joint, or in 'why_not' why there is none"),
    "pose": (("pose", {}), "entry 'frames.0.pose.xyz': Field required"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_frame_is_refused(case: str, content: dict[str, Any], tmp_path: Path) -> None:
    """File, line and entry, what was found and what was expected."""
    (entry, value), message = BROKEN[case]
    first, *rest = sorted(content["frames"], key=lambda frame: frame["joint"] is None)
    (tmp_path / "c.yaml").write_text(json.dumps(content | {"frames": [first | {entry: value}, *rest]}))
    with pytest.raises(CalibrationFileError, match=r"c\.yaml:\d+: ") as error:
        read_calibration(tmp_path / "c.yaml")
    assert message in str(error.value)


def test_a_calibration_may_hold_frames_alone(calibration: Calibration, content: dict[str, Any], tmp_path: Path) -> None:
    """Without joints it is one that only frames can be taken from, and says so."""
    (tmp_path / "c.yaml").write_text(json.dumps(content | {"joints": {}}))
    alone, tree = read_calibration(tmp_path / "c.yaml"), calibration.robot.tree
    with pytest.raises(CalibrationFileError, match="holds frames alone; --write-frames or --add-frames puts them on a robot"):
        alone.origins_for(calibration.robot)
    chosen = FramesWish(write=True).chosen(alone.frames, tree)
    assert set(alone.origins_for(calibration.robot, frames=chosen)[0]) == {frame.joint for frame in chosen.written} == {"lens", "flange"}


@pytest.mark.parametrize("name", ["origins-yaml", "tesseract", "urdf", "rising"])
def test_formats_that_have_fixed_joints_hold_links_that_stand_for_frames(name: str, rng: np.random.Generator) -> None:
    """The fixed joint of a written frame is in them."""
    from tests.robot.test_placed_frames import ALL as EVERY
    from tests.robot.test_placed_frames import deployed

    own = cell(rng)
    content = deployed(own, EVERY.chosen(own.frames(), own.robot.tree)).content(name).decode()
    assert "flange" in content
    assert ("leica" in content) == (name in ("urdf", "rising"))


@pytest.mark.parametrize("onto", [False, True])
def test_apply_refuses_frames_that_have_no_place(
    onto: bool, content: dict[str, Any], folder: Path, run_cli: Callable[..., CliResult]
) -> None:
    """A calibration without any, and a model in another language, are told in a line, and nothing is written."""
    Path("c.yaml").write_text(json.dumps(content | {"frames": []}))
    further = ("--onto", folder / "cell.urdf", "-o", "o.xml") if onto else ("-o", "o.urdf")
    done = run_cli("apply", folder / "cell.urdf", "c.yaml", "--write-frames", *further)
    message = "frames go into descriptions in URDF" if onto else "c.yaml: holds no frames; expected what urdfcal fit writes"
    assert (done.code, done.out, len(done.err.splitlines())) == (2, "", 1)
    assert message in done.err
    assert [path.name for path in Path().iterdir()] == ["c.yaml"]
