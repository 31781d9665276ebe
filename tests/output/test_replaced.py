"""Outputs under names that nobody stated: what they take the place of is told, or left alone."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import CliResult
from tests.support.small_robot import XACRO
from tests.vision.test_render import arm_camera
from urdfcal.base.errors import UsageError
from urdfcal.cli.fit_outputs import CORRECTED
from urdfcal.output.calibration_yaml import sha256
from urdfcal.output.replaced import replaced, require_ours
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import measurements_from
from urdfcal.vision.camera.camera_file import camera_yaml

Run = Callable[..., CliResult]
FIT = ("--no-sag", "--prior", "stated")


@pytest.fixture
def cell(run_cli: Run, tmp_path: Path) -> Path:
    """A xacro with an argument, and two files of its measurements."""
    (tmp_path / "cell.left.urdf.xacro").write_text(XACRO)
    for name, seed in (("a.csv", "1"), ("b.csv", "2")):
        assert run_cli("simulate", "cell.left.urdf.xacro", "-o", name, "--poses", "15", "--errors", "5mm,0.5deg", "--seed", seed).code == 0
    return tmp_path


def fitted(run_cli: Run, *words: str) -> str:
    """What a fit says of what it replaces."""
    run = run_cli("fit", *words, *FIT)
    assert run.code == 0, run.err
    return " ".join(line for line in run.err.splitlines() if "replaced" in line)


def test_a_dotted_name_keeps_its_dots(run_cli: Run, cell: Path) -> None:
    """cell.left and cell.right in one folder write files of their own, without a word."""
    (cell / "cell.right.urdf.xacro").write_text(XACRO)
    assert fitted(run_cli, "cell.left.urdf.xacro", "a.csv") == fitted(run_cli, "cell.right.urdf.xacro", "a.csv") == ""
    for side in ("left", "right"):
        assert (cell / f"cell.{side}_calibrated.urdf").exists()
        assert (cell / f"cell.{side}_calibration.yaml").exists()


def test_another_calibration_is_replaced_with_a_word(run_cli: Run, cell: Path) -> None:
    """The same fit again says nothing; other measurements, other xacro arguments and an edited robot are named."""
    robot, place = "cell.left.urdf.xacro", "cell.left_calibration.yaml"
    assert fitted(run_cli, robot, "a.csv") == fitted(run_cli, robot, "a.csv") == ""
    said = fitted(run_cli, robot, "b.csv")
    assert f"{place}, a calibration from other measurements (a.csv), is replaced, and what stands beside it; -o OUT keeps both" in said
    said = fitted(run_cli, robot, "b.csv", "--xacro-arg", "height:=0.21")
    assert f"{place}, a calibration of another robot (small, {robot} as it was, or with other xacro arguments), is replaced" in said
    (cell / "b.csv").write_text((cell / "a.csv").read_text())
    said = fitted(run_cli, robot, "b.csv")
    assert "of another robot" in said
    assert "and from other measurements (b.csv as it was)" in said
    assert fitted(run_cli, robot, "a.csv", "-o", "mine.urdf") == ""


@pytest.mark.parametrize("words", [(), ("-o", "cell.left_calibrated.urdf"), ("--format", "ur")])
def test_what_others_wrote_is_left_alone(words: tuple[str, ...], run_cli: Run, cell: Path) -> None:
    """A file of the default name that is not urdfcal's, such as the one that ur_calibration extracts, is refused and stays."""
    factory = cell / "cell.left_calibration.yaml"
    factory.write_text("kinematics:\n  shoulder: {x: 0}\n  hash: calib_1\n")
    run = run_cli("fit", "cell.left.urdf.xacro", "a.csv", *FIT, *words)
    assert run.code == 2
    assert "cell.left_calibration.yaml: is there already and is no earlier output of this command; move it away or name another" in run.err
    assert factory.read_text().startswith("kinematics:")
    assert not (cell / "cell.left_calibrated.urdf").exists()


def test_files_beside_a_stated_name_are_not_overwritten(run_cli: Run, cell: Path) -> None:
    """The truth beside simulated measurements, a further format of apply and a compensation's URDF spare what is not urdfcal's."""
    robot = "cell.left.urdf.xacro"
    assert fitted(run_cli, robot, "a.csv") == ""
    for name in ("s_truth.yaml", "x_offsets.yaml", "c.urdf"):
        (cell / name).write_text("<robot/>")
    for command in (
        ("simulate", robot, "-o", "s.csv"),
        ("apply", robot, "cell.left_calibration.yaml", "-o", "x_calibrated.urdf", "--format", "urdf", "--format", "offsets"),
        ("fit", robot, "a.csv", "--compensation", "c.yaml"),
    ):
        run = run_cli(*command)
        assert (run.code, "is there already" in run.err) == (2, True), run.err
    assert (cell / "c.urdf").read_text() == "<robot/>"
    assert not (cell / "x_calibrated.urdf").exists()


def test_a_broken_file_of_ours_gives_way(run_cli: Run, cell: Path) -> None:
    """A calibration that can no longer be read is replaced, and that is said."""
    (cell / "cell.left_calibration.yaml").write_text("# Calibration by urdfcal\njoints: [")
    assert "which cannot be read, is replaced" in fitted(run_cli, "cell.left.urdf.xacro", "a.csv")


def test_a_lens_is_no_camera_that_a_fit_has_corrected(tmp_path: Path) -> None:
    """A camera of urdfcal's own is spared where a fit would write the corrected one, and the corrected one gives way to the next."""
    place = tmp_path / "cell_camera.yaml"
    require_ours([place], CORRECTED)
    place.write_bytes(camera_yaml(arm_camera(), {"urdfcal": "1"}))
    with pytest.raises(UsageError, match=r"cell_camera\.yaml: is there already"):
        require_ours([place], CORRECTED)
    place.write_bytes(camera_yaml(arm_camera(), {"urdfcal": "1", CORRECTED.decode(): "0"}))
    require_ours([place], CORRECTED)


def test_a_calibration_of_arrays_is_named_without_a_file(robots: dict[str, Robot], rng: np.random.Generator, tmp_path: Path) -> None:
    """Measurements that came from no file are other ones all the same."""
    robot = robots["arm7"]
    data = measurements_from(robot, rng.normal(size=(3, 7)), rng.normal(size=(3, 2, 2)))
    (tmp_path / "c.yaml").write_text(f"robot: {{sha256: {sha256(robot.description.text)}}}\nmeasurements: {{poses: 9}}\n")
    assert replaced(tmp_path / "c.yaml", robot, data) == ()
    (said,) = replaced(tmp_path / "c.yaml", robot, dataclasses.replace(data, sha256="1", source="m.csv"))
    assert said == f"{tmp_path}/c.yaml, a calibration from other measurements, is replaced, and what stands beside it; -o OUT keeps both"
