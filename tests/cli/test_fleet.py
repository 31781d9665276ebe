"""`urdfcal fleet`: many robots, resumed, named where they fail, and what all of them say of each."""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from tests.conftest import CliResult
from tests.support.small_robot import URDF

Run = Callable[..., CliResult]
ROBOTS = 5


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A description and what was measured of five robots, of which the last has a joint that is far off."""
    import urdfcal
    from urdfcal.cli.run import called
    from urdfcal.cli.simulate_commands import simulate

    folder = tmp_path_factory.mktemp("measured")
    (folder / "small.urdf").write_text(URDF)
    assert urdfcal.__version__
    for robot in range(ROBOTS):
        errors = "1mm,0.1deg" if robot < ROBOTS - 1 else "1mm,4deg"
        words = (folder / "small.urdf", "-o", folder / f"r{robot}.csv", "--sensor", "point:tool", "--poses", "25")
        assert called(simulate, [*map(str, words), "--errors", errors, "--seed", str(robot), "-q"]).code == 0
    rows = [f"small.urdf,r{robot}.csv" for robot in range(ROBOTS)]
    (folder / "fleet.csv").write_text("\n".join(["description,measurements", *rows]) + "\n")
    return folder


@pytest.fixture
def fleet(measured: Path, tmp_path: Path) -> Path:
    """The same, to be written beside."""
    shutil.copytree(measured, tmp_path, dirs_exist_ok=True)
    return tmp_path


def test_each_robot_is_fitted_as_by_itself(run_cli: Run, fleet: Path) -> None:
    """Its folder holds what `fit` writes, to the byte; the summary has its row; one that is unlike the others is named on the page."""
    done = run_cli("fleet", "fleet.csv", "-o", "out", "--workers", "1", "--fit", "--no-sag --no-ask", "--json")
    assert (done.code, done.err) == (0, "")
    told = json.loads(done.out)
    assert [row["name"] for row in told["robots"]] == [f"r{robot}" for robot in range(ROBOTS)]
    assert run_cli("fit", "small.urdf", "r2.csv", "-o", "alone.urdf", "--no-sag", "--no-ask").code == 0
    assert (fleet / "out" / "r2" / "r2_calibrated.urdf").read_bytes() == (fleet / "alone.urdf").read_bytes()
    with (fleet / "out" / "summary.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["after_mm"]) for row in rows] == pytest.approx([row["after_mm"] for row in told["robots"]])
    assert all(float(row["after_mm"]) < float(row["before_mm"]) for row in rows)
    page = (fleet / "out" / "index.html").read_text().replace("\N{NO-BREAK SPACE}", " ")
    assert page.count("with reservations") >= ROBOTS
    assert f"{ROBOTS} robots: {ROBOTS} with reservations" in page
    assert "Who stands out" in page
    assert (fleet / "out" / "parameters.parquet").read_bytes()[:4] == b"PAR1"


def test_what_is_done_stays_done(run_cli: Run, fleet: Path) -> None:
    """A second run fits what has changed or is missing, and nothing else."""
    words = ("fleet", "fleet.csv", "-o", "out", "--workers", "1", "--fit", "--no-sag --no-ask", "--json")
    first = json.loads(run_cli(*words).out)
    times = {robot: (fleet / "out" / robot / "result.json").stat().st_mtime_ns for robot in ("r0", "r1", "r3")}
    shutil.rmtree(fleet / "out" / "r1")
    (fleet / "r3.csv").write_text((fleet / "r3.csv").read_text() + "# read once more\n")
    again = json.loads(run_cli(*words).out)
    assert (first["kept"], again["kept"]) == (0, ROBOTS - 2)
    now = {robot: (fleet / "out" / robot / "result.json").stat().st_mtime_ns for robot in times}
    assert [robot for robot in times if now[robot] != times[robot]] == ["r1", "r3"]
    assert [row["after_mm"] for row in again["robots"]] == pytest.approx([row["after_mm"] for row in first["robots"]])


def test_a_bad_row_is_named_and_the_others_go_on(run_cli: Run, fleet: Path) -> None:
    """Missing files, options that are none and names that are no folders: exit code 3, everything else as if they were not there."""
    bad = ["small.urdf,r9.csv,,", ",r1.csv,two,", "small.urdf,r1.csv,three,--nonsense", "small.urdf,r1.csv,../four,"]
    bad += ["small.urdf,r1.csv,five,'", "small.urdf,r1.csv,six,-oelse.urdf", "small.urdf,r1.csv,seven,--help"]
    rows = ["description,measurements,name,options", "small.urdf,r0.csv,good,--no-sag", *bad]
    (fleet / "mixed.csv").write_text("\n".join(rows))
    done = run_cli("fleet", "mixed.csv", "-o", "out", "--workers", "1")
    assert done.code == 3
    for said in (
        "r9: ",
        "r9.csv: cannot be read: No such file",
        "two: names no description",
        "--nonsense",
        "../four: '../four' can be no folder",
        "five: options: No closing quotation",
        "six: row 7: -o cannot be among the options of fit here: each robot's results go into its folder",
        "seven: row 8: --help cannot be among the options of fit here",
        "urdfcal: of 8 robots 7 failed: see ",
    ):
        assert said in done.err
    assert "8 robots: 1 with reservations, 7 failed" in done.out
    assert sorted(path.name for path in (fleet / "out").iterdir() if path.is_dir()) == ["good"]
    assert not (fleet / "out" / "prior.yaml").exists()


def test_the_fleets_prior_serves_the_next_robot(run_cli: Run, fleet: Path) -> None:
    """`fit --prior-from` takes it in place of its own; two statements of one prior are refused."""
    assert run_cli("fleet", "fleet.csv", "-o", "out", "--workers", "1", "--fit", "--no-sag --no-ask").code == 0
    done = run_cli("fit", "small.urdf", "r0.csv", "--prior-from", "out/prior.yaml", "--no-sag", "-o", "a.urdf", "--json")
    assert done.code == 0, done.err
    told = {entry["name"]: entry["prior_sigma"] for entry in json.loads(done.out)["parameters"]}
    prior = yaml.safe_load((fleet / "out" / "prior.yaml").read_text())["joint"]
    lengths = [sigma for name, sigma in told.items() if name.endswith(".d_a")]
    assert lengths == pytest.approx([prior["translation_mm"] / 1e3] * len(lengths))
    assert lengths
    twice = run_cli("fit", "small.urdf", "r0.csv", "--prior-from", "out/prior.yaml", "--prior-joint", "1mm,1deg", "-o", "b.urdf")
    assert (twice.code, twice.err) == (2, "urdfcal: --prior-from and --prior-joint both state the joints' prior; use one of the two\n")


def test_folders_are_a_manifest_too(run_cli: Run, fleet: Path) -> None:
    """A pattern means each folder with one description and one file of measurements; others are named."""
    for robot, files in (("a", ("r0.csv",)), ("b", ("r1.csv", "r2.csv"))):
        (fleet / "cells" / robot).mkdir(parents=True)
        for file in ("small.urdf", *files):
            shutil.copy(fleet / file, fleet / "cells" / robot / file)
    done = run_cli("fleet", "cells/*", "-o", "out", "--workers", "1", "--fit", "--no-sag --no-ask")
    assert done.code == 3
    assert "b: holds 2 files of measurements, expected one" in done.err
    assert (fleet / "out" / "a" / "a_calibration.yaml").is_file()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("nothing.csv", "-o", "out"), "nothing.csv: cannot be read: No such file"),
        (("nowhere/*", "-o", "out"), "nowhere/*: no such manifest (.csv), and no folder matches"),
        (("small.urdf", "-o", "out"), "small.urdf: no such manifest (.csv), and no folder matches"),
        (("r0.csv", "-o", "out"), "r0.csv:"),
        (("twice.csv", "-o", "out"), "twice.csv: 1 names stand for several robots, such as 'r0'"),
        (("fleet.csv", "-o", "."), "-o .: is there already and is no folder of urdfcal fleet"),
        (("fleet.csv", "-o", "out", "--fit", "'"), "--fit ': No closing quotation"),
        (("fleet.csv", "-o", "out", "--fit", "--format xacro --in-place"), "--fit: --in-place cannot be among the options of fit"),
        (("fleet.csv", "-o", "r0.csv/out"), "-o r0.csv/out: cannot be made"),
    ],
)
def test_what_is_no_fleet_is_refused(run_cli: Run, fleet: Path, words: tuple[str, ...], said: str) -> None:
    """One line, exit code 2."""
    (fleet / "twice.csv").write_text("description,measurements\nsmall.urdf,r0.csv\nsmall.urdf,r0.csv\n")
    done = run_cli("fleet", *words)
    assert said in done.err
    assert (done.code, done.err.count("\n")) == (2, 1)


def test_several_processes_give_the_same(run_cli: Run, fleet: Path) -> None:
    """Two workers on a local dask cluster: the same figures, in the manifest's order."""
    pytest.importorskip("distributed")
    words = ("fleet", "fleet.csv", "--fit", "--no-sag --no-ask", "--json")
    one, two = (json.loads(run_cli(*words, "-o", f"out{count}", "--workers", count).out) for count in ("1", "2"))
    assert [{**row, "seconds": 0} for row in one["robots"]] == [{**row, "seconds": 0} for row in two["robots"]]


def test_processes_that_cannot_be_started_are_told_of(run_cli: Run, fleet: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A line with the way out, not with a scheduler that nobody named."""
    distributed = pytest.importorskip("distributed")

    def refused(**_: object) -> None:
        raise OSError(24, "Too many open files")

    monkeypatch.setattr(distributed, "LocalCluster", refused)
    done = run_cli("fleet", "fleet.csv", "-o", "out", "--workers", "2")
    said = "urdfcal: 2 processes cannot be started here: [Errno 24] Too many open files; --workers 1 does without\n"
    assert (done.code, done.err) == (2, said)


def test_a_wrong_description_is_told_from_wrong_robots(run_cli: Run, fleet: Path) -> None:
    """A joint that is 8 mm farther out in all robots is named, and `fit --prior-from` begins there; other models have their own prior."""
    wrong = URDF.replace('<origin xyz="0.3 0 0" rpy="0.1 0 0"/>', '<origin xyz="0.292 0 0" rpy="0.1 0 0"/>')
    assert wrong != URDF
    (fleet / "wrong.urdf").write_text(wrong.replace('name="small"', 'name="other"'))
    rows = [f"{file},r{robot}.csv,{file[0]}{robot}" for file, count in (("small.urdf", 3), ("wrong.urdf", 5)) for robot in range(count)]
    (fleet / "two.csv").write_text("\n".join(["description,measurements,name", *rows]))
    done = run_cli("fleet", "two.csv", "-o", "out", "--workers", "1", "--fit", "--no-sag --no-ask --error-model placement")
    assert "all 5 robots of other share lift.trans_x " in done.err
    assert "robots of small share" not in done.err
    priors = {name: yaml.safe_load((fleet / "out" / f"prior_{name}.yaml").read_text()) for name in ("small", "other")}
    assert "shared" not in priors["small"]
    ((name, entry),) = priors["other"]["shared"].items()
    assert abs(abs(entry["value_mm"]) - 8) < 3 * entry["sigma_mm"] < 4
    assert "All 5 robots of other share" in (fleet / "out" / "index.html").read_text()
    words = ("--no-sag", "--no-ask", "--error-model", "placement", "--prior-from", "out/prior_other.yaml", "--json")
    parameters = json.loads(run_cli("fit", "wrong.urdf", "r4.csv", "-o", "next.urdf", *words).out)["parameters"]
    means = {parameter["name"]: parameter["prior_mean"] for parameter in parameters if "prior_mean" in parameter}
    assert means == pytest.approx({name: entry["value_mm"] / 1e3})
