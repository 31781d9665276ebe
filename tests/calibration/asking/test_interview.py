"""Simulated arms and rigs that do one thing: it is named, and what depends on it holds."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import urdfcal
from tests.support.disturbed import NOISE, DisturbedArm, disturbed_arm, held_and_off
from tests.support.paths import ROBOTS_DIR
from urdfcal.api import Calibration
from urdfcal.base.terminal import as_text
from urdfcal.calibration.analysis.sag import fit_sag
from urdfcal.calibration.asking.interview import Interview
from urdfcal.calibration.asking.questions import Answer
from urdfcal.output.text.result import calibration_json
from urdfcal.output.text.stands_out import stands_out_blocks

SENSORS = {"panda": "laser", "ur5": "point:tool0", "tiago": "pose:arm_tool_link"}
NAMED = [
    ("panda", "sag", "sag"),
    ("ur5", "eccentricity", "eccentricity"),
    ("panda", "two_cycles", "eccentricity"),
    ("tiago", "harmonics", "harmonics"),
    ("tiago", "scale", "scale"),
    ("ur5", "approach", "approach"),
    ("panda", "joint_noise", "joint_noise"),
    ("tiago", "drift", "drift"),
    ("panda", "walk", "drift"),
    ("ur5", "temperature", "temperature"),
    ("panda", "screen_bow", "screen_bow"),
    ("panda", "lens", "lens"),
    ("tiago", "readings_scale", "readings_scale"),
]
OF_THE_RIG = [each for each in NAMED if each[2] in ("joint_noise", "drift", "temperature", "screen_bow", "lens")]


@cache
def fitted(name: str, what: str, seed: int = 1) -> tuple[DisturbedArm, Calibration]:
    """One arm, and its fit."""
    robot = urdfcal.load_robot(ROBOTS_DIR / name / f"{name}.urdf.xacro")
    arm = disturbed_arm(robot, SENSORS[name], what, seed)
    return arm, urdfcal.fit(arm.robot, arm.fit)


@pytest.mark.parametrize(("name", "what", "named"), NAMED)
def test_what_an_arm_or_its_rig_does_is_named_first(name: str, what: str, named: str) -> None:
    """Whatever the sensor, of all that could be."""
    _, found = fitted(name, what)
    assert found.stands_out
    assert found.stands_out[0].what == named


@pytest.mark.parametrize("name", SENSORS)
@pytest.mark.parametrize("seed", [1, 2])
def test_nothing_is_named_where_nothing_is(name: str, seed: int) -> None:
    """Geometric errors and white noise alone ask for no more."""
    _, found = fitted(name, "none", seed)
    assert found.stands_out == ()
    assert found.lacking is None


@pytest.mark.parametrize(("name", "what", "named"), OF_THE_RIG)
def test_what_the_rig_does_is_in_the_fit_and_out_of_the_joints(name: str, what: str, named: str) -> None:
    """It is in the fit, and unseen poses are as near to the truth as the fit says."""
    arm, found = fitted(name, what)
    assert found.stands_out[0].entered
    assert held_and_off(found.errors, found.x, found.covariance, arm)[0] > 0.85


@pytest.mark.parametrize(("name", "what", "named"), [each for each in NAMED if each[2] in ("sag", "eccentricity", "scale", "approach")])
def test_what_is_not_in_the_fit_is_in_its_sigmas(name: str, what: str, named: str) -> None:
    """The arm's own doings stay out of the URDF; what geometry predicts is off by as much as it says."""
    arm, found = fitted(name, what)
    assert not found.stands_out[0].entered
    assert found.lacking is not None
    assert held_and_off(found.errors, found.x, found.covariance, arm)[0] > 0.9


def test_a_gear_is_named_with_its_joint_and_cycles() -> None:
    """Fifty waves a turn are found as fifty, at a joint that has them."""
    _, found = fitted("tiago", "harmonics")
    assert found.stands_out[0].cycles == 50
    assert found.stands_out[0].where in found.data.joints


def test_a_gear_goes_into_the_compensation(tmp_path: Path) -> None:
    """It is tried there by itself, brings unseen poses to the truth, and a file keeps it."""
    arm, found = fitted("tiago", "harmonics")
    joint = fit_sag(found, folds=0, compare_directions=False)
    assert joint is not None
    assert joint.kept == ("harmonics",)
    before, after = (
        held_and_off(errors, x, P, arm)[1]
        for errors, x, P in ((found.errors, found.x, found.covariance), (joint.errors, joint.estimate.belief.x, joint.estimate.belief.P))
    )
    assert after < 0.2 * before
    urdf, text = joint.files("pair.urdf")
    (tmp_path / "pair.urdf").write_bytes(urdf)
    (tmp_path / "pair.yaml").write_bytes(text)
    loaded = urdfcal.load_compensation(tmp_path / "pair.yaml")
    q = arm.unseen.q[:5]
    np.testing.assert_allclose(loaded.corrected_configuration(q), joint.compensation().corrected_configuration(q), atol=1e-12)
    wave = {name: value for name, value in loaded.values.items() if ".gear50_" in name}
    assert np.hypot(*list(wave.values())[:2]) > 0


def test_machines_and_people_are_told() -> None:
    """What stands out, how surely, where it went, and what would confirm it."""
    _, found = fitted("panda", "walk")
    (entry,) = calibration_json(found)["stands_out"]
    assert entry["what"] == "drift"
    assert entry["where"] == ""
    assert entry["entered"] is True
    assert entry["gain_nats"] > 4
    told = as_text(stands_out_blocks(found))
    assert "a rig that drifts" in told
    assert "in the fit" in told
    assert "a `time` column" in told
    told = as_text(stands_out_blocks(fitted("panda", "sag")[1]))
    assert "in the sigmas" in told
    assert stands_out_blocks(fitted("panda", "none")[1]) == []


def test_questions_may_be_left_out() -> None:
    """Then nothing enters and nothing is widened."""
    arm, _ = fitted("panda", "walk")
    found = urdfcal.fit(arm.robot, arm.fit, asking=False)
    assert found.stands_out == ()
    assert found.errors.rig is None


def test_noise_of_joints_is_found_as_well_where_poses_are_read_several_times() -> None:
    """Readings of one pose share those of the joints: five as exact as one tell no less, and of the same size."""
    arm, once = fitted("ur5", "joint_noise")
    several = arm.fit.subset(np.repeat(np.arange(len(arm.fit)), 5))
    rng = np.random.default_rng(1)
    noisy = tuple(replace(own, values=own.values + rng.normal(0, NOISE.length, own.values.shape)) for own in several.readings)
    found = urdfcal.fit(arm.robot, replace(several, readings=noisy))
    assert [own.what for own in found.stands_out if own.entered] == ["joint_noise"]
    assert 0.8 < found.estimate.noise.joint_sigma[0] / once.estimate.noise.joint_sigma[0] < 1.4


def test_a_fit_is_asked_once_whatever_does_not_pay(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the held-out poses refuse leaves the fit as it was, so that it is not asked again."""
    asked: list[Interview] = []
    answers = Interview.answers

    def counted(interview: Interview, least: float) -> list[Answer]:
        asked.append(interview)
        return answers(interview, least)

    monkeypatch.setattr(Interview, "answers", counted)
    monkeypatch.setattr(Interview, "pays", lambda *_: False)
    arm = fitted("tiago", "drift")[0]
    asked.clear()
    found = urdfcal.fit(arm.robot, arm.fit)
    assert found.stands_out
    assert not any(own.entered for own in found.stands_out)
    assert len(asked) == 1
