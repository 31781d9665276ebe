"""The commands as a user types them."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from tests.conftest import CliResult
from tests.support.paths import ROBOTS_DIR
from urdfcal.sensors.registry import SENSORS
from urdfcal.simulation.setup import SENSOR_KINDS

ARM7 = ROBOTS_DIR / "arm7" / "arm7.urdf.xacro"
MEASUREMENTS = ROBOTS_DIR / "arm7" / "measurements.csv"
Run = Callable[..., "object"]


def test_fit_writes_both_files_and_prints_both_tables(run_cli: Run, tmp_path: Path) -> None:
    """The default outputs fall into the current folder, and the table has fit and test poses before and after."""
    done = run_cli("fit", ARM7, MEASUREMENTS, "-q")
    assert (done.code, done.err) == (0, "")
    assert {path.name for path in tmp_path.iterdir()} == {"arm7_calibrated.urdf", "arm7_calibration.yaml"}
    for words in ("fit     laser_1", "test    laser_2", "joint1.d_a", "±", "expanded arm7.urdf.xacro"):
        assert words in done.out


def test_json_holds_what_is_promised(run_cli: Run) -> None:
    """`fit --json` has every key of the contract, in SI units, and nothing else on stdout."""
    done = run_cli("fit", ARM7, MEASUREMENTS, "--json", "--error-model", "dh")
    result = json.loads(done.out)
    assert {"converged", "iterations", "rank", "parameters", "combinations", "before", "after", "test"} <= set(result)
    assert len(result["parameters"]) == 33
    assert set(result["parameters"][0]) >= {"name", "value", "sigma", "unit", "determined"}
    assert result["parameters"][0]["value"] == pytest.approx(0.01, abs=0.002)
    assert set(result["before"]["laser_1"]) == {"mean_mm", "std_mm", "max_mm", "n"}
    assert result["test"]["after"]["laser_2"]["n"] == 30


def test_the_calibrated_urdf_evaluates_as_the_fit_said(run_cli: Run) -> None:
    """evaluate on the written URDF prints the `after` figures of fit."""
    fitted = json.loads(run_cli("fit", ARM7, MEASUREMENTS, "--json").out)
    evaluated = json.loads(run_cli("evaluate", "arm7_calibrated.urdf", MEASUREMENTS, "--json").out)
    assert evaluated["test"]["after"]["laser_1"]["mean_mm"] == pytest.approx(fitted["test"]["after"]["laser_1"]["mean_mm"], abs=1e-6)


def test_apply_repeats_the_fit(run_cli: Run, tmp_path: Path) -> None:
    """The stored calibration put on the nominal robot gives the calibrated robot; put on that, it says so and stops."""
    run_cli("fit", ARM7, MEASUREMENTS, "-o", "out.urdf")
    assert run_cli("apply", ARM7, "out_calibration.yaml", "-o", "again.urdf").code == 0
    first, again = (json.loads(run_cli("evaluate", name, MEASUREMENTS, "--json").out) for name in ("out.urdf", "again.urdf"))
    assert first["after"]["laser_1"]["max_mm"] == pytest.approx(again["after"]["laser_1"]["max_mm"], abs=1e-9)
    done = run_cli("apply", "out.urdf", "out_calibration.yaml", "-o", "twice.urdf")
    assert done.code == 2
    assert "already calibrated" in done.err
    assert not (tmp_path / "twice.urdf").exists()


def test_the_truth_of_a_simulation_can_be_applied(run_cli: Run) -> None:
    """simulate's truth put on the robot leaves only the noise; the nominal robot is far off."""
    assert (
        run_cli("simulate", ARM7, "-o", "m.csv", "--errors", "5mm,0.5deg", "--spot-noise-mm", "0.5", "--poses", "40", "--seed", "3").code
        == 0
    )
    assert run_cli("apply", ARM7, "m_truth.yaml", "-o", "true.urdf").code == 0
    means = [json.loads(run_cli("evaluate", robot, "m.csv", "--json").out)["after"]["laser_1"]["mean_mm"] for robot in (ARM7, "true.urdf")]
    assert means[0] > 10
    assert means[1] == pytest.approx(0.5 * 1.2533, rel=0.3)


def test_simulated_files_say_that_they_are(run_cli: Run, tmp_path: Path) -> None:
    """Simulated measurements and truth call themselves simulated in their first line."""
    run_cli("simulate", ARM7, "-o", "m.csv", "--poses", "5")
    for name in ("m.csv", "m_truth.yaml"):
        assert "SIMULATED" in (tmp_path / name).read_text().splitlines()[0]
    assert yaml.safe_load((tmp_path / "m_truth.yaml").read_text())["simulated"] is True


def test_the_record_says_where_it_comes_from(run_cli: Run, tmp_path: Path) -> None:
    """The calibration YAML has origins, delta, parameters with sigmas, rig, hashes, version and command line."""
    run_cli("fit", ARM7, MEASUREMENTS, "--error-model", "dh")
    record = yaml.safe_load((tmp_path / "arm7_calibration.yaml").read_text())
    assert set(record["joints"]["joint3"]) == {"moves", "nominal", "corrected", "delta"}
    assert {"urdfcal", "created", "command", "robot", "rig", "measurements", "noise", "parameters", "combinations"} <= set(record)
    assert len(record["measurements"]["sha256"]) == len(record["robot"]["sha256"]) == 64
    assert record["command"].startswith("urdfcal fit")


def test_a_rejected_fit_writes_nothing_unless_forced(run_cli: Run, tmp_path: Path) -> None:
    """Exit code 3 with one line and no file; with --force the files and a warning."""
    done = run_cli("fit", ARM7, MEASUREMENTS, "--spot-sigma-mm", "0.1", "-q")
    assert done.code == 3
    assert "chi-square is" in done.err
    assert len(done.err.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []
    forced = run_cli("fit", ARM7, MEASUREMENTS, "--spot-sigma-mm", "0.1", "--force")
    assert forced.code == 3
    assert len(list(tmp_path.iterdir())) == 2


def test_what_must_not_be_used_is_not_written(run_cli: Run, tmp_path: Path) -> None:
    """Eight poses for 34 unknowns: exit code 3 in one line; with --force terminal, reports, JSON and exit code all say the same."""
    few = tmp_path / "few.csv"
    few.write_text("".join(MEASUREMENTS.read_text().splitlines(keepends=True)[:12]))
    done = run_cli("fit", ARM7, few, "-q", "--report", "r.html")
    assert (done.code, len(done.err.splitlines())) == (3, 1)
    assert "fewer than the 34 unknowns" in done.err
    assert [path.name for path in tmp_path.iterdir()] == ["few.csv"]
    forced = run_cli("fit", ARM7, few, "-q", "--force", "--report", "r.html", "--report", "r.md", "--report", "r.json")
    assert forced.code == 3
    assert forced.out.startswith("Verdict: do not use:\n  ")
    reason = json.loads((tmp_path / "r.json").read_text())["verdict"]["reasons"][0]
    assert "fewer than the 34 unknowns" in reason
    assert reason in forced.out
    for name in ("r.html", "r.md"):
        text = (tmp_path / name).read_text()
        assert "Verdict: do not use" in text
        assert reason[1:] in text


def test_verdict_and_tool_in_json(run_cli: Run) -> None:
    """`--json` has the verdict, and with --tool both errors of that link; nothing is judged that was not fitted."""
    result = json.loads(run_cli("fit", ARM7, MEASUREMENTS, "--json", "--tool", "link3").out)
    assert (result["verdict"]["use"], result["verdict"]["reasons"], result["tool"]["link"]) == ("yes", [], "link3")
    for key in ("up_to_constant_mm", "in_base_mm"):
        figures = result["tool"][key]
        assert 0 < figures["median"] <= figures["p95"] <= figures["worst"]
    assert json.loads(run_cli("evaluate", ARM7, MEASUREMENTS, "--json").out)["verdict"] is None


def test_test_poses_of_their_own_file(run_cli: Run) -> None:
    """--test evaluates another file; marked test poses and --test together are refused."""
    run_cli("simulate", ARM7, "-o", "m.csv", "--poses", "40", "--errors", ROBOTS_DIR / "arm7" / "errors.yaml")
    run_cli("simulate", ARM7, "-o", "t.csv", "--poses", "20", "--seed", "5", "--errors", ROBOTS_DIR / "arm7" / "errors.yaml")
    assert json.loads(run_cli("fit", ARM7, "m.csv", "--test", "t.csv", "--json").out)["test"]["after"]["laser_1"]["mean_mm"] < 5
    assert run_cli("fit", ARM7, MEASUREMENTS, "--test", "t.csv").code == 2


def test_dh_prints_table_i(run_cli: Run) -> None:
    """The paper's table comes back on the terminal, with what the mount carries."""
    out = run_cli("dh", ARM7).out
    assert "joint1   -500.0000     0.0000   -90.0000   -90.0000" in out.replace("\u2212", "-")
    assert "carried by the mount: joint7.d_theta" in out
    machine = json.loads(run_cli("dh", ARM7, "--json").out)
    assert machine["nominal"][0]["a"] == -0.5


def test_any_two_links_can_be_screen_and_laser(run_cli: Run, example_robots: Path) -> None:
    """dh works on a robot without a rig, with two of its links named."""
    out = run_cli(
        "dh", example_robots / "panda_description" / "urdf" / "panda.urdf", "--screen", "panda_link0", "--laser", "panda_hand_tcp"
    ).out
    assert re.search(r"panda_joint4 +82.5000 +316.0000 +90.0000", out)


def test_warnings_go_to_stderr_and_can_be_silenced(run_cli: Run, tmp_path: Path) -> None:
    """A column that means nothing is warned of on stderr; -q keeps still."""
    text = MEASUREMENTS.read_text().splitlines()
    odd = [line if line.startswith("#") else line + (",humidity" if line.startswith("pose") else ",20") for line in text]
    (tmp_path / "odd.csv").write_text("\n".join(odd))
    done = run_cli("evaluate", ARM7, "odd.csv")
    assert "column 'humidity' means nothing here" in done.err
    assert "temperature" not in done.out
    assert run_cli("evaluate", ARM7, "odd.csv", "-q").err == ""


def test_help_names_every_option_with_its_unit(run_cli: Run) -> None:
    """--help documents the contract's options of fit."""
    out = run_cli("fit", "--help").out
    for option in (
        "--spot-sigma-mm",
        "--joint-sigma-deg",
        "--prior-joint",
        "--estimator",
        "--error-model",
        "--estimate",
        "--fix",
        "--only",
        "--rig",
        "--force",
        "--xacro-arg",
        "--package-dir",
    ):
        assert option in out


def test_help_of_simulate_names_every_sensor(run_cli: Run) -> None:
    """Whatever the registry can read at any pose, touch, aim, or see as a target, can be asked for, and the help of --sensor lists how."""
    words = " ".join(run_cli("simulate", "--help").out.split())
    *most, last = (kind for kind in SENSOR_KINDS if kind != "laser")  # the robot's own, which has words of its own
    assert f"or {', '.join(most)} or {last} of a target on LINK" in words
    assert "laser (the robot's; laser:LINK@SCREEN" in words
    told = {
        name: sensor.anywhere or sensor.touches or sensor.aimed or (sensor.by_camera and not sensor.beam)
        for name, sensor in SENSORS.items()
    }
    can = {name for name, asked_for in told.items() if asked_for}
    assert {name for names in SENSOR_KINDS.values() for name in names} == can


@pytest.mark.parametrize("command", ["fit", "evaluate", "dh", "simulate", "apply", "paper"])
def test_every_command_has_help(run_cli: Run, command: str) -> None:
    """Each command explains itself and exits with 0."""
    done = run_cli(command, "--help")
    assert done.code == 0
    assert "Usage: urdfcal" in done.out


def test_a_closed_pipe_is_no_traceback() -> None:
    """`urdfcal paper | head` ends quietly when the reader goes away."""
    words = f"'{sys.executable}' -m urdfcal.cli dh '{ARM7}' | true"
    done = subprocess.run(["bash", "-c", words], capture_output=True, text=True, check=False)
    assert "Traceback" not in done.stderr


def test_evaluate_says_which_beams_miss(run_cli: Run, tmp_path: Path) -> None:
    """A beam that was seen and points away from the screen in this robot is warned of with file and line."""
    lines = MEASUREMENTS.read_text().splitlines()
    cells = lines[4].split(",")
    cells[1] = str(float(cells[1]) - 3.0)
    (tmp_path / "away.csv").write_text("\n".join([*lines[:4], ",".join(cells), *lines[5:]]))
    done = run_cli("evaluate", ARM7, "away.csv")
    assert "away.csv:5: laser_1 was seen, but in this robot its beam does not meet the screen" in done.err


def test_an_error_of_ours_is_one_line(run_cli: Callable[..., CliResult], monkeypatch: pytest.MonkeyPatch) -> None:
    """What we did not foresee is told in a line with its place, exit code 70, and writes nothing; --verbose adds the traceback."""
    from urdfcal.calibration import fitting

    def broken(*_: object) -> None:
        raise IndexError("beyond\nthe end")

    monkeypatch.setattr(fitting, "fit_and_test", broken)
    words = ("fit", ROBOTS_DIR / "arm7/arm7.urdf.xacro", ROBOTS_DIR / "arm7/measurements.csv")
    done = run_cli(*words)
    assert done.code == 70
    assert done.err.count("\n") == 1
    assert "an error of ours, nothing was written: IndexError: beyond the end (test_main.py:" in done.err
    assert "please report it" in done.err
    assert "Traceback" in run_cli(*words, "-v").err
