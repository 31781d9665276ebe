"""What stands where an output goes: an earlier result of the same gives way, all else is named and left alone."""

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
from urdfcal.output.replaced import inputs_sha256, require_earlier, require_marked
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import spots_measured
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
    """What a fit says of what it would replace; nothing where it was written."""
    run = run_cli("fit", *words, *FIT)
    assert run.code in (0, 2)
    return run.err if run.code else ""


def test_a_dotted_name_keeps_its_dots(run_cli: Run, cell: Path) -> None:
    """cell.left and cell.right in one folder write files of their own, without a word."""
    (cell / "cell.right.urdf.xacro").write_text(XACRO)
    assert fitted(run_cli, "cell.left.urdf.xacro", "a.csv") == fitted(run_cli, "cell.right.urdf.xacro", "a.csv") == ""
    for side in ("left", "right"):
        assert (cell / f"cell.{side}_calibrated.urdf").exists()
        assert (cell / f"cell.{side}_calibration.yaml").exists()


def test_another_calibration_is_refused_by_what_differs(run_cli: Run, cell: Path) -> None:
    """The same fit again is written; other measurements, other xacro arguments and an edited file are named, and --overwrite is the way."""
    robot, place = "cell.left.urdf.xacro", "cell.left_calibration.yaml"
    assert fitted(run_cli, robot, "a.csv") == fitted(run_cli, robot, "a.csv") == ""
    said = fitted(run_cli, robot, "b.csv")
    assert f"{place}: is a calibration from other measurements (a.csv); --overwrite replaces it, -o names another" in said
    said = fitted(run_cli, robot, "a.csv", "--xacro-arg", "height:=0.21")
    assert f"{place}: is a calibration of another robot (small, {robot} as it was, or with other xacro arguments); --overwrite" in said
    (cell / "a.csv").write_text((cell / "b.csv").read_text())
    assert "from other measurements (a.csv as it was)" in fitted(run_cli, robot, "a.csv")
    assert fitted(run_cli, robot, "a.csv", "--overwrite") == fitted(run_cli, robot, "b.csv") == fitted(run_cli, robot, "a.csv") == ""


@pytest.mark.parametrize("words", [(), ("-o", "cell.left_calibrated.urdf"), ("--format", "ur")])
def test_what_others_wrote_is_left_alone(words: tuple[str, ...], run_cli: Run, cell: Path) -> None:
    """A file of the default name that is not urdfcal's, such as the one that ur_calibration extracts, is refused and stays."""
    factory = cell / "cell.left_calibration.yaml"
    factory.write_text("kinematics:\n  shoulder: {x: 0}\n  hash: calib_1\n")
    assert "cell.left_calibration.yaml: is there already and is no calibration by urdfcal; --overwrite" in fitted(
        run_cli, "cell.left.urdf.xacro", "a.csv", *words
    )
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


def test_a_broken_file_is_no_calibration(run_cli: Run, cell: Path) -> None:
    """A calibration that can no longer be read was edited, and stays."""
    (cell / "cell.left_calibration.yaml").write_text("# Calibration by urdfcal\njoints: [")
    assert "is no calibration by urdfcal" in fitted(run_cli, "cell.left.urdf.xacro", "a.csv")


def test_a_lens_is_no_camera_that_a_fit_has_corrected(tmp_path: Path) -> None:
    """A camera of urdfcal's own is spared where a fit would write the corrected one, and the corrected one gives way to the next."""
    place = tmp_path / "cell_camera.yaml"
    require_marked(place, (CORRECTED,), "camera that an earlier fit has corrected")
    place.write_bytes(camera_yaml(arm_camera(), {"urdfcal": "1"}))
    with pytest.raises(UsageError, match=r"cell_camera\.yaml: is there already and is no camera that an earlier fit"):
        require_marked(place, (CORRECTED,), "camera that an earlier fit has corrected")
    place.write_bytes(camera_yaml(arm_camera(), {"urdfcal": "1", CORRECTED: "0"}))
    require_marked(place, (CORRECTED,), "camera that an earlier fit has corrected")


def test_a_calibration_of_arrays_is_named_without_a_file(robots: dict[str, Robot], rng: np.random.Generator, tmp_path: Path) -> None:
    """Measurements that came from no file are other ones all the same."""
    robot = robots["arm7"]
    data = spots_measured(robot, rng.normal(size=(3, 7)), rng.normal(size=(3, 2, 2)))
    place = tmp_path / "c.yaml"
    place.write_text(f"urdfcal: 1\njoints: {{}}\nrobot: {{sha256: {sha256(robot.description.text)}}}\nmeasurements: {{poses: 9}}\n")
    require_earlier(place, (), robot, data)
    with pytest.raises(UsageError, match=f"{place}: is a calibration from other measurements; --overwrite"):
        require_earlier(place, (), robot, dataclasses.replace(data, sha256="1", source="m.csv"))


def test_the_hash_of_inputs_is_that_of_their_contents(tmp_path: Path) -> None:
    """It follows contents and their order, not names; what is not there has no part in it."""
    one, two, three = (tmp_path / name for name in "abc")
    for path, text in ((one, "x"), (two, "y"), (three, "x")):
        path.write_text(text)
    assert inputs_sha256((one, two)) == inputs_sha256((three, None, two, tmp_path / "nope"))
    assert len({inputs_sha256(paths) for paths in ((one, two), (two, one), (one,), ())}) == 4
