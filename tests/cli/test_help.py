"""The command line explains itself: groups, choices, examples, versions, completion."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conftest import CliResult
from tests.support.paths import ROBOTS_DIR
from urdfcal.base.version import __version__
from urdfcal.cli import options
from urdfcal.cli.described import COMMANDS
from urdfcal.estimation.estimators import ESTIMATORS, SCHEDULES
from urdfcal.model.options import ADDITIONS
from urdfcal.model.slots import MODELS
from urdfcal.model.softness import EXTRAS
from urdfcal.output.formats import ENDINGS

Run = Callable[..., CliResult]


@pytest.fixture(autouse=True)
def narrow(monkeypatch: pytest.MonkeyPatch) -> None:
    """A terminal of 80 columns."""
    monkeypatch.setenv("COLUMNS", "80")


def test_nothing_but_the_name_prints_the_help(run_cli: Run) -> None:
    """`urdfcal` alone says on stdout what `--help` does, and is no mistake."""
    alone = run_cli()
    assert (alone.code, alone.err) == (0, "")
    assert alone.out.strip() == run_cli("--help").out.strip()
    assert "130 interrupted (Ctrl-C)" in alone.out


def test_the_version_is_an_option_and_a_command(run_cli: Run) -> None:
    """`--version` prints what `version` does, and nothing else."""
    assert run_cli("--version") == run_cli("version") == (0, f"{__version__}\n", "")


def test_the_package_runs_as_a_module() -> None:
    """`python -m urdfcal` is the command line."""
    done = subprocess.run([sys.executable, "-m", "urdfcal", "--version"], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == (f"{__version__}\n", "")


def test_a_shell_can_complete_commands() -> None:
    """What a shell asks for while somebody types `urdfcal me` is answered with the command's name."""
    asked = {"_URDFCAL_COMPLETE": "complete_bash", "COMP_WORDS": "urdfcal me", "COMP_CWORD": "1"}
    code = "from urdfcal.cli.main import main; main()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, env=os.environ | asked)
    assert done.stdout.split() == ["measurements"]


def test_every_command_is_in_a_group_and_on_a_line(run_cli: Run) -> None:
    """The list has every command once, its summary whole on one line of 80 columns."""
    lines = run_cli("--help").out.splitlines()
    assert max(map(len, lines)) <= 80
    assert not [line for line in lines if line.endswith("...") and "Usage" not in line]
    for name, own in COMMANDS.items():
        (line,) = [line for line in lines if re.match(rf"  {name} ", line)]
        assert line.endswith(own.line)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_an_example_of_options_that_it_has(command: str, run_cli: Run) -> None:
    """The help ends in an example that fits a line and uses nothing that the command has not; no word of the help is broken."""
    help_text, example = run_cli(command, "--help").out, COMMANDS[command].example
    assert help_text.rstrip().endswith(f"Example:\n  {example}")
    assert example.startswith(f"urdfcal {command}")
    assert all(option in help_text for option in re.findall(r"(?<= )--?[a-z][\w-]*", example))
    assert max(map(len, help_text.splitlines())) <= 80


def test_what_few_need_stands_last(run_cli: Run) -> None:
    """Of the many options of fit, where to write and test poses come first, the rest under Expert at the end."""
    first, _, rest = run_cli("fit", "--help").out.partition("\nExpert:\n")
    assert all(option in first for option in ("--output", "--holdout", "--target", "--screen", "--json", "--xacro-arg"))
    assert all(option in rest for option in ("--schedule", "--prior-joint", "--process-noise", "--kfold"))
    assert first.count(" --") < 30


def test_choices_are_those_that_there_are(run_cli: Run) -> None:
    """Estimators, schedules, error models, formats and additions of the command line are the library's own, and the help lists them."""
    kinds = {
        options.EstimatorName: ESTIMATORS,
        options.Schedule: SCHEDULES,
        options.ErrorModelName: MODELS,
        options.FormatName: tuple(ENDINGS),
        options.Addition: ADDITIONS,
        options.Beside: EXTRAS,
    }
    out = " ".join(run_cli("fit", "--help").out.split())
    for kind, names in kinds.items():
        assert tuple(kind) == tuple(names)
        assert "|".join(names) in out or f"of {', '.join(names)}." in out  # those that one line cannot hold


def test_a_choice_that_there_is_not_is_refused_with_those_that_there_are(run_cli: Run) -> None:
    """One line on stderr names the option, what was found, and the choices."""
    done = run_cli("fit", "a.urdf", "m.csv", "--estimator", "ukf")
    assert (done.code, done.out, len(done.err.splitlines())) == (2, "", 1)
    assert "--estimator" in done.err
    assert "'ukf' is not one of 'ekf', 'lse', 'robust', 'evolution'; did you mean 'ekf'?" in done.err


NOT_UNDERSTOOD = {
    "fitt a.urdf m.csv": "there is no command 'fitt'; did you mean 'fit'? urdfcal --help lists all",
    "wiggle": "there is no command 'wiggle'; urdfcal --help lists all",
    "arm.urdf m.csv": "'arm.urdf' is no command, but looks like a file; the command comes first, as in: urdfcal fit ROBOT MEASUREMENTS",
    "fit a.urdf m.csv --holdot 0.3": "fit has no option '--holdot'; did you mean '--holdout'? urdfcal fit --help says what it takes",
    "fit a.urdf": "Missing argument 'MEASUREMENTS'; urdfcal fit --help says what it takes",
    "dh a.urdf --tip": "Option '--tip' requires an argument; urdfcal dh --help says what it takes",
    "--versoin": "urdfcal has no option '--versoin'; did you mean '--version'? urdfcal --help says what it takes",
    "apply a.urdf c.yaml -o o.urdf --format uri": "'uri' is not one of 'urdf', 'origins-yaml', 'ur', 'offsets', 'rising', "
    "'ros2-control', 'xarm', 'franka', 'flexiv', 'tesseract', 'xacro'; did you mean 'ur'?",
    "apply a.urdf c.yaml -o o.urdf --format kinova": "--format kinova: Kinova's drivers read no geometry of a single arm",
    "fit a.urdf m.csv --format pal": "--format pal: how PAL's robots read master_calibration.yaml is not public",
    "fit a.urdf m.csv --format Fanuc": "its controllers keep their geometry; urdfcal correct changes what they are told",
}


@pytest.mark.parametrize("words", NOT_UNDERSTOOD)
def test_a_line_that_is_not_understood_is_told_where_to_read_on(words: str, run_cli: Run) -> None:
    """One line names what was found, what comes near, and the help that has the rest."""
    done = run_cli(*words.split())
    assert (done.code, done.out, len(done.err.splitlines())) == (2, "", 1)
    assert NOT_UNDERSTOOD[words] in done.err


def test_usage_names_arguments_as_everything_else_does(run_cli: Run) -> None:
    """No braces: what must be given stands alone, what may be left out in brackets."""
    assert run_cli("fit", "--help").out.startswith("Usage: urdfcal fit [OPTIONS] ROBOT MEASUREMENTS\n")
    assert run_cli("view", "--help").out.startswith("Usage: urdfcal view [OPTIONS] ROBOT [MEASUREMENTS]\n")


def test_measurements_says_what_is_understood(run_cli: Run) -> None:
    """Joints with their ranges and share, readings with counts and units, poses and sets, in 80 columns; the same for machines in SI."""
    arm7 = ROBOTS_DIR / "arm7" / "arm7.urdf.xacro", ROBOTS_DIR / "arm7" / "measurements.csv"
    done = run_cli("measurements", *arm7)
    assert (done.code, done.err) == (0, "")
    assert max(map(len, done.out.splitlines())) <= 80
    for words in ("90 poses with 180 spots", "joint4", "(rad)", "\u2212120 to 0", "laser_2   90 spots", "60 rows to fit, 30 to test"):
        assert words in done.out
    found = json.loads(run_cli("measurements", *arm7, "--json").out)
    assert found["sets"] == {"fit": 60, "test": 30}
    assert [entry["seen"] for entry in found["readings"]] == [90, 90]
    assert found["joints"][3]["limits"] == pytest.approx([-2.0943951, 0.0], abs=1e-6)
    assert found["joints"][3]["share"] == pytest.approx((found["joints"][3]["upper"] - found["joints"][3]["lower"]) / 2.0943951, rel=1e-6)


def test_measurements_says_what_is_missing(run_cli: Run) -> None:
    """Few poses, copies, a joint that hardly moves and no test poses are said."""
    arm7, csv = ROBOTS_DIR / "arm7" / "arm7.urdf.xacro", (ROBOTS_DIR / "arm7" / "measurements.csv").read_text().splitlines()
    start = next(number for number, line in enumerate(csv) if line.startswith("pose"))
    head, row = csv[start].split(","), csv[start + 1].split(",")
    kept = [number for number, name in enumerate(head) if name not in ("pose", "set")]
    lines = [",".join(cells[number] for number in kept) for cells in (head, row, row)]
    with open("m.csv", "w", encoding="utf-8") as file:
        file.write("\n".join(lines))
    out = run_cli("measurements", arm7, "m.csv").out
    for words in (
        "2 rows, 1 different pose; 1 row of them copied from others",
        "joint7 moved through less than 20% of the limits",
        "only 1 different pose: 20 or more are better",
        "no test poses",
    ):
        assert words in out


@pytest.mark.parametrize("options_given", [(), ("-q",)], ids=["usual", "quiet"])
def test_fit_shows_what_it_does_to_who_looks_at_it(options_given: tuple[str, ...], tmp_path: Path) -> None:
    """On a terminal the fit says what it is doing and for how long; with -q it is silent; what is printed stays the same."""
    words = [
        sys.executable,
        "-m",
        "urdfcal",
        "fit",
        str(ROBOTS_DIR / "arm7" / "arm7.urdf.xacro"),
        str(ROBOTS_DIR / "arm7" / "measurements.csv"),
    ]
    looked_at, terminal = pty.openpty()
    running = subprocess.Popen(
        [*words, *options_given], stdout=subprocess.PIPE, stderr=terminal, cwd=tmp_path, env=os.environ | {"TERM": "xterm"}
    )
    os.close(terminal)
    seen = b""
    with contextlib.suppress(OSError):  # how Linux says that the other end is closed
        while chunk := os.read(looked_at, 4096):
            seen += chunk
    os.close(looked_at)
    out, _ = running.communicate()
    assert running.returncode == 0
    assert (b"fitting 60 rows (ekf)" in seen) == (not options_given)
    assert b"Verdict" in out
    assert b"\x1b" not in out
