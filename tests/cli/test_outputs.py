"""Outputs: on no input by whatever road it came, on nothing of others, in a folder or on stdout where that is asked, sets as one."""

from __future__ import annotations

import json
import os
import shutil
import stat
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

import urdfcal
from tests.conftest import CliResult
from tests.support.small_robot import URDF, XACRO
from urdfcal.base.errors import MixedFilesWarning
from urdfcal.output.calibration_yaml import sha256
from urdfcal.output.pairs import mixed

Run = Callable[..., CliResult]
FIT = ("--no-sag", "--prior", "stated", "--no-sanity", "-q")
XHEAD = '<robot name="small" xmlns:xacro="http://www.ros.org/wiki/xacro">'


@pytest.fixture
def cell(run_cli: Run, tmp_path: Path) -> Path:
    """A robot in one file and in several, and two files of its measurements."""
    (tmp_path / "small.urdf").write_text(URDF)
    (tmp_path / "body.xacro").write_text(XACRO.replace('"0.2"', "\"${xacro.load_yaml('sizes.yaml')['height']}\""))
    (tmp_path / "sizes.yaml").write_text("height: 0.2\n")
    (tmp_path / "cell.urdf.xacro").write_text(f'{XHEAD}<xacro:include filename="body.xacro"/></robot>')
    for name, seed in (("a.csv", "1"), ("b.csv", "2")):
        done = run_cli("simulate", "small.urdf", "-o", name, "--poses", "15", "--errors", "5mm,0.5deg", "--seed", seed)
        assert done.code == 0, done.err
    return tmp_path


def state(folder: Path) -> dict[str, tuple[int, bytes]]:
    """Modes and contents of all that is there."""
    return {str(path): (path.lstat().st_mode, path.read_bytes()) for path in folder.rglob("*") if path.is_file()}


def refused(run_cli: Run, folder: Path, words: str, *command: str | Path) -> None:
    """The command is one line with these words, exit code 2, and leaves everything as it was."""
    before = state(folder)
    done = run_cli(*command)
    assert (done.code, done.out, done.err.count("\n")) == (2, "", 1), done
    assert words in done.err
    assert state(folder) == before


@pytest.mark.parametrize("place", ["cell.urdf.xacro", "body.xacro", "sizes.yaml", "link.xacro", "twin.xml"])
def test_no_output_falls_on_an_input_of_a_fit(place: str, run_cli: Run, cell: Path) -> None:
    """Included files, files that xacro loads, links to them and other names of them are inputs, also with --overwrite."""
    (cell / "link.xacro").symlink_to("body.xacro")
    os.link(cell / "body.xacro", cell / "twin.xml")
    form = ("--format", "origins-yaml") if place.endswith(".yaml") else ()
    refused(
        run_cli, cell, f"{place}: is an input of this command", "fit", "cell.urdf.xacro", "a.csv", *FIT, *form, "-o", place, "--overwrite"
    )


@pytest.mark.parametrize(
    "command", [("simulate", "small.urdf", "--errors", "e.csv", "-o", "e.csv"), ("simulate", "small.urdf", "-o", "small.urdf")]
)
def test_no_output_falls_on_an_input_of_a_simulation(command: tuple[str, ...], run_cli: Run, cell: Path) -> None:
    """Nor on stated errors, nor on the robot."""
    (cell / "e.csv").write_text("error_model: dh\nparameters: {turn.d_a: 0.001}\n")
    refused(run_cli, cell, f"{command[-1]}: ", *command, "--overwrite")


@pytest.mark.parametrize(
    "command",
    [
        ("camera", "lens", "--board", "7x5:30mm", "-o", "lens/0.png"),
        ("camera", "lens/*.png", "--board", "7x5:30mm", "-o", "lens/0.png"),
        ("camera", "--lens", "camera.yaml", "--screen", "lens/0.png", "--markers", "screen.yaml", "-o", "camera.yaml"),
        ("spots", "lens", "--pixels", "-o", "lens/1.png"),
        ("spots", "lens", "--camera", "camera.yaml", "-o", "camera.yaml"),
    ],
)
def test_no_output_falls_on_a_picture_or_a_lens(command: tuple[str, ...], run_cli: Run, tmp_path: Path) -> None:
    """Pictures of a folder and of a pattern, and the lens that is taken over, are inputs, also with --overwrite."""
    (tmp_path / "lens").mkdir()
    for number in range(2):
        cv2.imwrite(str(tmp_path / "lens" / f"{number}.png"), np.zeros((20, 30), np.uint8))
    for name in ("camera.yaml", "screen.yaml"):
        (tmp_path / name).write_text("size_px: [30, 20]\n")
    before = state(tmp_path)
    done = run_cli(*command, "--overwrite")
    assert (done.code, done.err.count("\n"), state(tmp_path) == before) == (2, 1, True), done


def test_results_of_others_stay(run_cli: Run, cell: Path) -> None:
    """The same fit again is written; over other measurements, another robot and an edited result only with --overwrite, named or not."""
    fit = ("fit", "small.urdf", "a.csv", *FIT)
    for words in (fit, fit, (*fit, "-o", "x.urdf"), (*fit, "-o", "x.urdf"), (*fit, "--seed", "2")):
        assert run_cli(*words).code == 0, words
    refused(run_cli, cell, "small_calibration.yaml: is a calibration from other measurements (a.csv)", "fit", "small.urdf", "b.csv", *FIT)
    refused(run_cli, cell, "x_calibration.yaml: is a calibration from other", "fit", "small.urdf", "b.csv", *FIT, "-o", "x.urdf")
    shutil.copy(cell / "small.urdf", cell / "before.urdf")
    (cell / "small.urdf").write_text(URDF.replace("1.4", "1.41"))
    refused(run_cli, cell, "of another robot (small, small.urdf as it was", *fit)
    shutil.copy(cell / "before.urdf", cell / "small.urdf")
    with (cell / "small_calibrated.urdf").open("a") as stream:
        stream.write("<!-- my tool -->\n")
    refused(run_cli, cell, "small_calibrated.urdf: is not what small_calibration.yaml was written with: it was edited", *fit)
    assert run_cli(*fit, "--overwrite").code == 0
    assert "my tool" not in (cell / "small_calibrated.urdf").read_text()
    (cell / "small_calibration.yaml").unlink()
    refused(run_cli, cell, "small_calibrated.urdf: is there already and is no earlier result", *fit)


def test_reports_of_others_stay(run_cli: Run, cell: Path) -> None:
    """A report of the same robot and measurements gives way, under whatever name the URDF goes; another's does not."""
    for words in (("-o", "x.urdf"), ("-o", "y.urdf")):
        assert run_cli("fit", "small.urdf", "a.csv", *FIT, *words, "--report", "r.html", "--report", "r.md").code == 0
    refused(run_cli, cell, "r.md: is there already", "fit", "small.urdf", "b.csv", *FIT, "-o", "z.urdf", "--report", "r.md")
    (cell / "mine.json").write_text("{}")
    refused(run_cli, cell, "mine.json: is there already", "fit", "small.urdf", "a.csv", *FIT, "--report", "mine.json")


def test_what_was_measured_is_not_simulated_over(run_cli: Run, cell: Path) -> None:
    """Simulated measurements give way to simulated ones; what somebody measured, and a truth that is none, do not."""
    simulate = ("simulate", "small.urdf", "--poses", "5", "-o")
    assert run_cli(*simulate, "a.csv").code == 0
    (cell / "m.csv").write_text("turn\n0.1\n")
    refused(run_cli, cell, "m.csv: is there already and is no result of urdfcal simulate", *simulate, "m.csv")
    (cell / "n_truth.yaml").write_text("mine: 1\n")
    refused(run_cli, cell, "n_truth.yaml: is there already", *simulate, "n.csv")
    assert run_cli(*simulate, "m.csv", "--overwrite").code == 0
    (cell / "small.urdf").write_text(URDF.replace('"0.3 0 0"', '"0.31 0 0"'))
    refused(run_cli, cell, "a_truth.yaml: is there already and is no result of urdfcal simulate for this robot", *simulate, "a.csv")


def test_a_page_of_other_files_stays(run_cli: Run, cell: Path) -> None:
    """The page of the same files is made again, that of others is left."""
    view = ("view", "small.urdf", "--html", "v.html")
    assert (run_cli(*view).code, run_cli(*view).code) == (0, 0)
    refused(
        run_cli,
        cell,
        "v.html: is there already and is no page that urdfcal view has made of the same files",
        *view,
        "--calibrated",
        "a_truth.yaml",
    )
    assert run_cli(*view, "--calibrated", "a_truth.yaml", "--overwrite").code == 0


def test_apply_replaces_the_same_alone(run_cli: Run, cell: Path) -> None:
    """Applied again, the same is written again; over anything else --overwrite is needed."""
    assert run_cli("apply", "small.urdf", "a_truth.yaml", "-o", "true.urdf").code == 0
    assert run_cli("apply", "small.urdf", "a_truth.yaml", "-o", "true.urdf").code == 0
    refused(run_cli, cell, "true.urdf: is there already and holds something else", "apply", "small.urdf", "b_truth.yaml", "-o", "true.urdf")
    assert run_cli("apply", "small.urdf", "b_truth.yaml", "-o", "true.urdf", "--overwrite").code == 0


def test_the_same_pictures_make_the_same_spots_again(run_cli: Run, tmp_path: Path) -> None:
    """Spots are written again from the same pictures; from others, or over what somebody measured, they are not."""
    for name, light in (("one", 0), ("other", 1)):
        (tmp_path / name).mkdir()
        cv2.imwrite(str(tmp_path / name / "p.png"), np.full((60, 80, 3), (light, 0, 9), np.uint8))
    spots = ("--pixels", "-o", "s.csv", "-q")
    assert [run_cli("spots", "one", *spots).code for _ in range(2)] == [0, 0]
    refused(run_cli, tmp_path, "s.csv: is there already and is no result of urdfcal spots from the same files", "spots", "other", *spots)
    assert run_cli("spots", "other", *spots, "--overwrite").code == 0


@pytest.mark.parametrize("place", ["out", "out/"])
def test_a_folder_gets_the_default_name(place: str, run_cli: Run, cell: Path) -> None:
    """-o DIR and -o DIR/ write there, under the name that the robot gives; a folder that is not there is refused."""
    (cell / "out").mkdir()
    for command in (
        ("fit", "small.urdf", "a.csv", *FIT, "--report", place),
        ("apply", "small.urdf", "a_truth.yaml", "--format", "origins-yaml"),
        ("simulate", "small.urdf", "--poses", "5"),
    ):
        done = run_cli(*command, "-o", place)
        assert done.code == 0, done.err
    assert run_cli("view", "small.urdf", "--html", place).code == 0
    assert {path.name for path in (cell / "out").iterdir()} == {
        *("small_calibrated.urdf", "small_calibration.yaml", "small_report.html", "small_origins.yaml"),
        *("small_simulated.csv", "small_simulated_truth.yaml", "small.html"),
    }
    refused(run_cli, cell, "the folder nope does not exist", "fit", "small.urdf", "a.csv", *FIT, "-o", "nope/")


def test_stdout_gets_the_main_result(run_cli: Run, cell: Path) -> None:
    """`-o -` is byte for byte what the file holds, what people read goes to stderr, and no file is written."""
    assert run_cli("fit", "small.urdf", "a.csv", *FIT).code == 0
    assert run_cli("apply", "small.urdf", "small_calibration.yaml", "-o", "again.urdf").code == 0
    before = state(cell)
    for command, expected in (
        (("fit", "small.urdf", "a.csv", *FIT), (cell / "small_calibrated.urdf").read_text()),
        (("apply", "small.urdf", "small_calibration.yaml"), (cell / "again.urdf").read_text()),
        (("simulate", "small.urdf", "--poses", "15", "--errors", "5mm,0.5deg", "--seed", "1"), (cell / "a.csv").read_text()),
    ):
        done = run_cli(*command, "-o", "-")
        assert (done.code, done.out == expected, bool(done.err)) == (0, True, True), command
    assert state(cell) == before
    refused(run_cli, cell, "-o - and --json both ask", "fit", "small.urdf", "a.csv", *FIT, "-o", "-", "--json")
    refused(run_cli, cell, "name one --format", "fit", "small.urdf", "a.csv", *FIT, "-o", "-", "--format", "urdf", "--format", "offsets")


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (("view", "small.urdf", "--html", "x.pdf"), "--html x.pdf: a page ends in .html"),
        (("fit", "small.urdf", "a.csv", "--report", "x.pdf"), "x.pdf: a report ends in .html, .md or .json"),
        (("fit", "small.urdf", "a.csv", "-o", "x.yaml"), "x.yaml: --format urdf writes a URDF"),
        (("fit", "small.urdf", "a.csv", "-o", "x.csv"), "x.csv: --format urdf writes a URDF"),
        (("fit", "small.urdf", "a.csv", "--format", "offsets", "-o", "x.urdf"), "x.urdf: --format offsets writes YAML"),
        (("apply", "small.urdf", "a_truth.yaml", "-o", "x.html"), "x.html: --format urdf writes a URDF"),
        (("simulate", "small.urdf", "-o", "x.yaml"), "-o x.yaml: a file of measurements ends in .csv"),
        (("simulate", "small.urdf", "-o", "x.urdf"), "-o x.urdf: a file of measurements ends in .csv"),
    ],
)
def test_endings_that_say_something_else_are_refused(command: tuple[str, ...], words: str, run_cli: Run, cell: Path) -> None:
    """A name that belongs to another kind of file is refused before any work is done."""
    refused(run_cli, cell, words, *command)


def test_the_record_tells_a_mixed_pair(run_cli: Run, cell: Path) -> None:
    """The record holds the hash of its URDF; of another one beside it every command that loads one of the two says so, but for -q."""
    assert run_cli("fit", "small.urdf", "a.csv", *FIT).code == 0
    record, urdf = cell / "small_calibration.yaml", cell / "small_calibrated.urdf"
    assert yaml.safe_load(record.read_text())["files"] == {urdf.name: sha256(urdf.read_bytes())}
    commands = [
        ("evaluate", urdf.name, "a.csv"),
        ("apply", "small.urdf", record.name, "-o", "again.urdf"),
        ("view", "small.urdf", "--calibrated", urdf.name, "--html", "v.html", "--overwrite"),
        ("view", "small.urdf", "--calibrated", record.name, "--html", "w.html", "--overwrite"),
        ("dh", "small.urdf", "--calibration", record.name),
        ("fit", urdf.name, "a.csv", *FIT[:-1], "--after", record.name, "--force"),
    ]
    assert not [command for command in commands if "mixed pair" in run_cli(*command).err]
    urdf.write_text(urdf.read_text() + "\n")
    for command in commands:
        assert run_cli(*command).err.count(f"{urdf} and {record}".replace(f"{cell}/", "") + " are a mixed pair") >= 1, command
    assert "mixed" not in run_cli(*commands[0], "-q").err
    for load, path in ((urdfcal.load_robot, urdf), (urdfcal.load_calibration, record)):
        with pytest.warns(MixedFilesWarning, match="are a mixed pair"):
            load(path)


def test_a_corrected_camera_belongs_to_its_record(tmp_path: Path) -> None:
    """The camera that a fit has corrected holds the hash of the record: another one beside it is told, none is no matter."""
    camera, record = tmp_path / "arm_camera.yaml", tmp_path / "arm_calibration.yaml"
    camera.write_text(f"calibration_sha256: {sha256(b'record')}\n")
    assert mixed(camera) == ()
    record.write_bytes(b"record")
    assert mixed(camera) == ()
    record.write_bytes(b"another")
    assert [line.split(" are a mixed pair")[0] for line in mixed(camera)] == [f"{record} and {camera}"]


def test_private_results_stay_private(run_cli: Run, cell: Path) -> None:
    """The mode of each file of a set is kept."""
    assert run_cli("fit", "small.urdf", "a.csv", *FIT).code == 0
    (cell / "small_calibration.yaml").chmod(0o600)
    assert run_cli("fit", "small.urdf", "a.csv", *FIT).code == 0
    assert stat.S_IMODE((cell / "small_calibration.yaml").stat().st_mode) == 0o600
    assert json.loads(run_cli("evaluate", "small_calibrated.urdf", "a.csv", "--json").out)


@pytest.mark.parametrize("command", [("spots", "one", "--pixels", "-o", "s.csv"), ("camera", "one", "--board", "7x5:30mm", "-o", "c.yaml")])
def test_a_picture_of_one_pixel_is_no_error_of_ours(command: tuple[str, ...], run_cli: Run, tmp_path: Path) -> None:
    """It is a picture without spots, and no view of a board."""
    (tmp_path / "one").mkdir()
    cv2.imwrite(str(tmp_path / "one" / "p.png"), np.zeros((1, 1, 3), np.uint8))
    done = run_cli(*command)
    assert done.code in (0, 2), done.err
    assert "error of ours" not in done.err


@pytest.mark.parametrize("noise", [("--measurement-noise", "1e-320"), ("--process-noise", "1e-320"), ("--measurement-noise", "1e300")])
def test_noise_beyond_numbers_is_no_error_of_ours(noise: tuple[str, str], run_cli: Run, cell: Path) -> None:
    """The paper's schedule takes what numbers can hold, and refuses the rest by name."""
    done = run_cli("fit", "small.urdf", "a.csv", *FIT, "--schedule", "paper", "--max-sweeps", "5", *noise)
    assert done.code in (0, 2, 3), done.err
    assert "Warning" not in done.err


def test_python_is_told_of_a_mixed_pair(run_cli: Run, cell: Path) -> None:
    """Of a URDF, and of a calibration, whose partner was written by another run; not of a pair that belongs together."""
    assert run_cli("fit", "small.urdf", "a.csv", *FIT).code == 0
    urdfcal.load_robot("small_calibrated.urdf")
    urdfcal.load_calibration("small_calibration.yaml")
    with (cell / "small_calibrated.urdf").open("a") as stream:
        stream.write("<!-- edited -->\n")
    model = urdfcal.load_robot("small.urdf").model
    for load in (
        lambda: urdfcal.load_robot("small_calibrated.urdf"),
        lambda: urdfcal.load_calibration("small_calibration.yaml"),
        lambda: urdfcal.apply(model, "small_calibration.yaml"),
    ):
        with pytest.warns(UserWarning, match="are a mixed pair"):
            load()
