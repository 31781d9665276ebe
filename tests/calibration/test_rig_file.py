"""rig.yaml: what the user knows of the rig, in millimetres and degrees."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from tests.support.small_robot import URDF, robot_of
from urdfcal.base.errors import RigError, UsageError
from urdfcal.calibration.rig_file import RigFile, read_rig_file
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions

WHOLE = """\
screen: screen
lasers: [laser_2]
error_model: placement
error_models: {lift: offset}
estimate: [beams]
noise: {spot_mm: 0.5, joint_deg: 0.05, joints_deg: {turn: 0.1}}
priors: {joint: '1mm,0.1deg', mount: 'flat', screen: '0.1m,5mrad'}
parameters:
  turn.rot_x: {sigma_deg: 0.1, value_deg: 0.5}
  slm.trans_x: {value_mm: 2.5, sigma_mm: 0.2}
  slide.*: {fixed: true}
"""


def read(folder: Path, text: str) -> RigFile:
    (folder / "rig.yaml").write_text(text, "utf-8")
    return read_rig_file(folder / "rig.yaml")


def test_every_entry_reaches_the_error_model(tmp_path: Path) -> None:
    """Links, models, priors and single parameters arrive in metres and radians."""
    rig = read(tmp_path, WHOLE)
    assert (rig.screen, rig.lasers, rig.noise.spot_mm, rig.noise.joints_deg) == ("screen", ["laser_2"], 0.5, {"turn": 0.1})
    robot = robot_of(URDF)
    errors = build_error_model(robot.chain, robot.rig, rig.options())
    found = {parameter.name: parameter for parameter in errors.parameters}
    assert (found["turn.rot_x"].sigma, found["turn.rot_x"].mean) == pytest.approx((math.radians(0.1), math.radians(0.5)))
    assert (found["slm.trans_x"].sigma, found["slm.trans_x"].mean) == pytest.approx((0.0002, 0.0025))
    assert (found["turn.trans_x"].sigma, found["turn.rot_y"].sigma) == pytest.approx((0.001, math.radians(0.1)))
    assert (found["screen.trans_x"].sigma, found["screen.rot_x"].sigma) == pytest.approx((0.1, 0.005))
    assert [name for name in found if name.startswith(("slide", "lift"))] == ["lift.d_theta"]
    assert [name for name in found if name.startswith("laser_2")] == ["laser_2.rot_x", "laser_2.rot_y"]


@pytest.mark.parametrize("text", ["", "# nothing\n", "{}", "null"])
def test_an_empty_file_says_nothing(text: str, tmp_path: Path) -> None:
    """A file without entries leaves every default."""
    assert read(tmp_path, text).options() == ModelOptions()


BAD = {
    "list": ("- screen\n", ":1: holds a list, expected entries such as `screen: wall`"),
    "word": ("screen", ":1: holds a str, expected entries"),
    "unknown": ("screen: wall\nlaser: [a]\n", ":2: entry 'laser' is unknown; did you mean 'lasers'?"),
    "unknown below": ("noise:\n  spot: 1\n", ":2: entry 'noise.spot' is unknown; did you mean 'spot_mm'?"),
    "unknown parameter entry": (
        "parameters:\n  joint1.d_a: {sigma: 1}\n",
        ":2: entry 'parameters.joint1.d_a.sigma' is unknown; did you mean 'sigma_mm'?",
    ),
    "model": (
        "error_model: denavit",
        ":1: entry 'error_model': Input should be 'auto', 'dh', 'hayati', 'placement' or 'offset', found 'denavit'",
    ),
    "model of a joint": (
        "error_models:\n  lift: auto",
        ":2: entry 'error_models.lift': Input should be 'dh', 'hayati', 'placement' or 'offset', found 'auto'",
    ),
    "estimate": ("estimate: [beam]", ":1: entry 'estimate.0': Input should be 'beams', 'beams4', 'screen' or 'lens', found 'beam'"),
    "lasers": ("lasers: laser_1", ":1: entry 'lasers': Input should be a valid list, found 'laser_1'"),
    "noise zero": ("noise: {spot_mm: 0}", ":1: entry 'noise.spot_mm': Input should be greater than"),
    "noise infinite": ("noise: {spot_mm: .inf}", ":1: entry 'noise.spot_mm': Input should be a finite number, found inf"),
    "noise word": (
        "noise: {spot_mm: 1mm}",
        ":1: entry 'noise.spot_mm': Input should be a valid number, unable to parse string as a number, found '1mm'",
    ),
    "noise negative": ("noise: {joint_deg: -1}", ":1: entry 'noise.joint_deg': Input should be greater than or equal to 0, found -1"),
    "prior": (
        "priors: {joint: 1mm}",
        ":1: entry 'priors': '1mm' is not a prior; expected a length and an angle such as 10mm,1deg, or flat",
    ),
    "prior of nothing": (
        "priors: {tool: '1mm,1deg'}",
        ":1: entry 'priors.tool': Input should be 'joint', 'mount', 'screen', 'beam', 'reference', 'target' or 'place', found 'tool'",
    ),
    "both units": (
        "parameters:\n  a.b: {value_mm: 1, sigma_deg: 1}",
        ":2: entry 'parameters': a parameter is a length or an angle, not both; use _mm or _deg",
    ),
    "sigma negative": ("parameters: {a.b: {sigma_mm: -1}}", ":1: entry 'parameters.a.b.sigma_mm': Input should be greater than"),
    "fixed": (
        "parameters: {a.b: {fixed: perhaps}}",
        ":1: entry 'parameters.a.b.fixed': Input should be a valid boolean, unable to interpret input, found 'perhaps'",
    ),
    "no direction": ("beams: {laser_1: [0, 0, 0]}", ":1: entry 'beams': the beam of laser_1 has no direction"),
    "half a direction": ("beams: {laser_1: [0, 1]}", ":1: entry 'beams.laser_1.2': Field required"),
    "huge": (f"noise: {{spot_mm: {'9' * 99}{'9' * 99}{'9' * 99}{'9' * 99}}}", ":1: a number of 396 digits"),
    "tiny prior": ("priors: {joint: '1e-300mm,1deg'}", ":1: entry 'priors': '1e-300mm,1deg' is not a prior"),
    "tiny sigma": ("parameters: {a.b: {sigma_mm: 1e-300}}", ":1: entry 'parameters.a.b.sigma_mm': Input should be greater than"),
    "number as link": ("screen: 5", ":1: entry 'screen': Input should be a valid string, found 5"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_entries_are_refused(case: str, tmp_path: Path) -> None:
    """Each fault is one message with file, line, entry, what was found and what was expected."""
    text, message = BAD[case]
    with pytest.raises(RigError) as error:
        read(tmp_path, text)
    assert str(error.value).startswith(f"{tmp_path}/rig.yaml{message}")


def test_names_that_mean_nothing_to_the_robot_are_refused(tmp_path: Path) -> None:
    """A joint or parameter that the robot does not have is refused with those that it has."""
    robot = robot_of(URDF)
    with pytest.raises(RigError, match="error_models: no joint 'elbow' that is calibrated; there are: turn, lift, slide"):
        build_error_model(robot.chain, robot.rig, read(tmp_path, "error_models: {elbow: dh}").options())
    with pytest.raises(UsageError, match=r"no parameter matches 'lift\.d_alfa'; did you mean 'lift\.d_alpha'"):
        build_error_model(robot.chain, robot.rig, read(tmp_path, "parameters: {lift.d_alfa: {fixed: true}}").options())
