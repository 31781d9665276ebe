"""Branches one after the other, and ends that are known, on the command line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support.two_ends import WAIST, arm, robot_of


@pytest.fixture
def waist(tmp_path: Path) -> Path:
    """The URDF of a waist with two arms."""
    arms = [*arm("l", "pitch_link", "0 0.2 0.3", "0 1 0"), *arm("r", "pitch_link", "0 -0.2 0.3", "0 1 0")]
    path = tmp_path / "waist.urdf"
    path.write_bytes(robot_of([*WAIST, *arms], [("left", "l6_link"), ("right", "r6_link")]).description.text)
    return path


def test_a_calibration_may_follow_another(run_cli: Callable, waist: Path) -> None:
    """fit warns where it would spoil what the calibration beside the URDF decided, takes it with --after, and refuses another robot."""
    for hand in ("left", "right"):
        assert run_cli("simulate", waist, "-o", f"{hand}.csv", "--sensor", f"pose:{hand}_link").code == 0
    common = ("--no-sag", "-q")
    assert run_cli("fit", waist, "left.csv", "-o", "l.urdf", *common).code == 0
    blind = run_cli("fit", "l.urdf", "right.csv", "-o", "blind.urdf", "--no-sag")
    assert blind.code == 0
    assert "l.urdf was written with l_calibration.yaml, which calibrated roll, pitch together with l1, l2" in blind.err
    assert "--after l_calibration.yaml keeps what it decided" in blind.err
    after = run_cli("fit", "l.urdf", "right.csv", "-o", "lr.urdf", "--after", "l_calibration.yaml", "--no-sag")
    assert (after.code, "keeps what it decided" in after.err) == (0, False)
    assert "l1:" in Path("lr_calibration.yaml").read_text()
    for robot, calibration, word in (
        (waist, "l_calibration.yaml", "from where l_calibration.yaml has it; fit the URDF that was written with that calibration"),
        ("l.urdf", "left_truth.yaml", "left_truth.yaml: has no entry 'posterior'"),
        ("l.urdf", "left.csv", "left.csv"),
    ):
        refused = run_cli("fit", robot, "right.csv", "-o", "no.urdf", "--after", calibration)
        assert refused.code == 2
        assert word in refused.err
        assert refused.err.count("\n") == 1
        assert not Path("no.urdf").exists()


def test_a_posterior_that_is_none_is_refused(run_cli: Callable, waist: Path) -> None:
    """A covariance of another size is refused with file, line and what was expected."""
    assert run_cli("simulate", waist, "-o", "left.csv", "--sensor", "pose:left_link").code == 0
    assert run_cli("fit", waist, "left.csv", "-o", "l.urdf", "--no-sag", "-q").code == 0
    text = Path("l_calibration.yaml").read_text()
    Path("bad.yaml").write_text(text.replace("  prior_sigma: [", "  prior_sigma: [0.1, ", 1))
    refused = run_cli("fit", "l.urdf", "left.csv", "--after", "bad.yaml", "-o", "m.urdf")
    assert refused.code == 2
    assert "bad.yaml:" in refused.err
    assert "expected a standard deviation, a twist and a row of" in refused.err


def test_known_ends_are_for_frames_and_targets(run_cli: Callable, waist: Path) -> None:
    """What is measured of the links themselves is fitted so, evaluated so, and means nothing for spots."""
    known = ("--reference-known", "--target-known")
    assert run_cli("simulate", waist, "-o", "left.csv", "--sensor", "pose:left_link", *known).code == 0
    assert "urdfcal fit ... --reference base --reference-known --target-known" in Path("left.csv").read_text()
    found = run_cli("fit", waist, "left.csv", "-o", "l.urdf", "--no-sag", *known)
    assert found.code == 0
    assert "Frames found" not in found.out
    assert run_cli("evaluate", "l.urdf", "left.csv", *known).code == 0
    assert run_cli("check", "l.urdf", "left.csv", *known).code == 0
    root = Path(__file__).parents[2] / "robots/arm7"
    for command in ("fit", "evaluate", "check"):
        refused = run_cli(command, root / "arm7.urdf.xacro", root / "measurements.csv", "--target-known")
        assert refused.code == 2
        assert "--target-known is about frames and targets, and these measurements are laser spots alone" in refused.err
