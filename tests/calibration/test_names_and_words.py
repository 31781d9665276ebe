"""Robots whose joints and links share names, and words that fit what measures: no screen without lasers."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml

from tests.conftest import CliResult
from tests.support.helpers import assert_poses_close
from tests.support.sensor_cases import CASES, NOISE, seen_robot, setup_of
from tests.support.small_robot import URDF, joint, robot_of, robot_text
from urdfcal.base.errors import UsageError
from urdfcal.calibration.analysis.validation import kfold
from urdfcal.model.gauge import build_error_model, model_warnings
from urdfcal.model.options import ModelOptions
from urdfcal.output.joint_offsets import offset_loss
from urdfcal.robot.rig import SIX, Instruments, Target
from urdfcal.robot.robot import Robot, load_robot
from urdfcal.sensors.measurements import placed_by_session
from urdfcal.simulation.readings import simulate_readings

MODELS = ("auto", "dh", "hayati", "placement", "offset")
TWIN = robot_text(  # every joint has the name of the link that it carries
    joint("neck", "base", "neck", '<origin xyz="0 0 0.5"/><axis xyz="0 0 1"/>'),
    joint("arm", "base", "arm", '<origin xyz="0.1 0 0.3"/><axis xyz="0 0 1"/>'),
    joint("elbow", "arm", "elbow", '<origin xyz="0.4 0 0" rpy="0.2 0 0"/><axis xyz="0 1 0"/>'),
    joint("gripper", "elbow", "gripper", '<origin xyz="0.3 0 0.1"/><axis xyz="1 0 0"/>'),
    joint("tip", "gripper", "tip", '<origin xyz="0.05 0 0.02"/>', kind="fixed"),
    links="base neck arm elbow gripper tip",
)
SIMULATED = ("--errors", "1mm,0.1deg", "--poses", "40", "--target-noise-mm", "0.05", "--orientation-noise-deg", "0.01")
KNOWN = ("--reference-known", "--target-known")


@pytest.mark.parametrize("case", [name for name, case in CASES.items() if "laser" not in case.sensors])
def test_no_screen_is_spoken_of_where_there_is_none(case: str, robots: dict[str, Robot]) -> None:
    """Without lasers no error model warns of a screen, a module or its mount, wherever the instruments are."""
    robot = seen_robot(CASES[case], robots)
    for model in MODELS:
        options = ModelOptions(error_model=model, reference_known=CASES[case].known)
        said = " ".join(model_warnings(robot, options))
        assert not re.search("screen|module|mount", said)


def test_the_screen_that_a_joint_carries_is_still_warned_of() -> None:
    """With lasers the warning is as it was: that screen's placement cannot be estimated."""
    lasers, links = joint("m1", "c", "laser_1", kind="fixed"), "a screen b c laser_1"
    robot = robot_of(robot_text(joint("pan", "a", "screen"), joint("j1", "a", "b"), joint("j2", "b", "c"), lasers, links=links))
    warnings = model_warnings(robot, ModelOptions())
    assert warnings[0].startswith("the screen 'screen' is the very link that 'pan' moves")


@pytest.mark.parametrize("command", ["fit twin.urdf q.csv", "check twin.urdf q.csv", "dh twin.urdf", "simulate twin.urdf -o s.csv"])
def test_where_nothing_measures_the_ways_out_are_named(command: str, run_cli: Callable[..., CliResult], tmp_path: Path) -> None:
    """A robot without lasers, and no word of what else is measured, is not asked for a screen alone; a file says what it looks like."""
    (tmp_path / "twin.urdf").write_text(TWIN)
    (tmp_path / "q.csv").write_text("arm,elbow,gripper,x,y,z\n0,0,0,1,2,3\n")
    run = run_cli(*command.split())
    assert (run.code, run.out, len(run.err.splitlines())) == (2, "", 1)
    ways = "name a link in the columns (tip.x, tip.y, tip.z) or options (dh --tip tip, simulate --sensor point:tip)"
    read = "q.csv:1: column 'x': the file looks like points (x, y, z); which link are they of? name it with --target LINK"
    assert (read if "q.csv" in command else ways) in run.err


@pytest.mark.parametrize(("case", "words"), [("point", "measuring frame"), ("lasers and points", "screen or measuring frame")])
def test_what_stands_elsewhere_in_a_session_is_named(case: str, words: str, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Refusals about sessions speak of the screen where there is one, and of the measuring frame where there is that."""
    setup = setup_of(CASES[case], robots, rng)
    data = simulate_readings(setup, 4, rng, NOISE)
    assert placed_by_session(data) == words
    with pytest.raises(UsageError, match=f"so its {words} is unknown when that pose is held out"):
        kfold(setup.robot, replace(data, sessions=np.array(["a", "a", "a", "b"])), 2, rng)


def test_a_reference_may_have_its_joint_s_name() -> None:
    """A camera on a link that is named like the joint that moves it has parameters of its own, under every error model."""
    seen = Instruments((Target("tip", "tip", SIX),), "neck", placed=True)
    robot = robot_of(TWIN).seen_by(seen, ())
    for model in MODELS:
        errors = build_error_model(robot.chain, robot.rig, ModelOptions(error_model=model))
        assert {f"neck:frame.{name}" for name in SIX} <= {*errors.names, *errors.carried}
        assert len(set(errors.names)) == len(errors.names)


def test_joints_and_links_of_one_name_are_told_apart(run_cli: Callable[..., CliResult], tmp_path: Path) -> None:
    """Every format of a calibrated robot in which each joint is named like its link; offsets put the tool where differences say."""
    (tmp_path / "twin.urdf").write_text(TWIN)
    assert run_cli("simulate", "twin.urdf", "-o", "m.csv", "--sensor", "pose:tip", *SIMULATED, *KNOWN).code == 0
    formats = [word for name in ("urdf", "offsets", "origins-yaml") for word in ("--format", name)]
    run = run_cli("fit", "twin.urdf", "m.csv", "--no-sag", "--tool", "tip", *KNOWN, *formats)
    assert (run.code, "Traceback" in run.err) == (0, False)
    offsets = yaml.safe_load((tmp_path / "twin_offsets.yaml").read_text())
    assert (offsets["off_from_the_whole_correction"]["tool"], set(offsets["joints"])) == ("tip", {"arm", "elbow", "gripper"})
    rig = yaml.safe_load((tmp_path / "twin_calibration.yaml").read_text())["rig"]
    assert rig == {"reference": "base", "targets": ["tip"]}
    assert run_cli("apply", "twin.urdf", "twin_calibration.yaml", "-o", "again.urdf").code == 0
    again, written = (load_robot(tmp_path / name) for name in ("again.urdf", "twin_calibrated.urdf"))
    for name, own in written.tree.joints.items():
        assert_poses_close(again.tree.joints[name].origin, own.origin)
    for tip in ("tip", "gripper"):
        assert run_cli("dh", "twin.urdf", "--tip", tip, "--calibration", "twin_calibration.yaml").code == 0


def test_offsets_lose_the_same_under_other_names() -> None:
    """A module whose fixed joint, and a screen whose first joint, have their names changes no figure of an offsets-only deployment."""
    shift, names = pin.SE3(np.eye(3), np.array([0.003, 0, 0.004])), {"slm_mount": "slm", "base_mount": "screen", "slide": "tool"}
    twin = URDF
    for old, new in names.items():
        twin = twin.replace(f'<joint name="{old}"', f'<joint name="{new}"')
    plain, renamed = (
        offset_loss(robot, {"turn": robot.tree.joints["turn"].origin * shift}, np.random.default_rng(1), 50)
        for robot in (robot_of(URDF), robot_of(twin))
    )
    assert plain == renamed
    assert plain.mean_mm == pytest.approx(5)
