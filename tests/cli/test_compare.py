"""Two files of one robot on the command line."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support.paths import ROBOTS_DIR

ARM7 = ROBOTS_DIR / "arm7" / "arm7.urdf.xacro"


@pytest.fixture
def truths(run_cli: Callable) -> tuple[str, str]:
    """Two robots of one description, each with its own errors."""
    for name, seed in (("a", "1"), ("b", "2")):
        assert run_cli("simulate", ARM7, "-o", f"{name}.csv", "--seed", seed, "--poses", "5", "--errors", f"{seed}mm,0.1deg").code == 0
    return "a_truth.yaml", "b_truth.yaml"


def test_files_and_what_they_lead_to_agree(run_cli: Callable, truths: tuple[str, str]) -> None:
    """A record and the URDF that apply makes of it are the same; two records differ as their two URDFs do."""
    for record, urdf in zip(truths, ("a.urdf", "b.urdf"), strict=True):
        assert run_cli("apply", ARM7, record, "-o", urdf).code == 0
    same = run_cli("compare", "a.urdf", truths[0])
    assert (same.code, "a.urdf and a_truth.yaml are the same but for rounding." in same.out) == (0, True)
    records, urdfs = (json.loads(run_cli("compare", *pair, "--json").out) for pair in (truths, ("a.urdf", "b.urdf")))
    assert records["same"] is None
    assert records["tool"]["distance_mm"]["mean"] == pytest.approx(urdfs["tool"]["distance_mm"]["mean"], rel=1e-9)
    for one, other in zip(records["joints"], urdfs["joints"], strict=True):
        assert one["distance"] == pytest.approx(other["distance"], abs=1e-12)


def test_a_nominal_robot_is_told_from_its_calibration(run_cli: Callable, truths: tuple[str, str]) -> None:
    """Words say that they differ, and how far, at the link that was asked for."""
    found = run_cli("compare", ARM7, truths[1], "--tool", "slm")
    assert found.code == 0
    assert f"{ARM7} and b_truth.yaml differ, and neither says how sure it is: up to a constant of base and tool 'slm'" in found.out


def test_what_cannot_be_compared_is_refused(run_cli: Callable, truths: tuple[str, str], example_robots: Path) -> None:
    """Another robot, a link that is not there, a record whose robot is gone, and no record at all: a line each, exit 2."""
    Path("far").mkdir()
    shutil.copy(truths[0], "far")
    lost = Path("far", truths[0])
    lost.write_text(lost.read_text().replace(str(ARM7), "gone.urdf"))
    panda = example_robots / "panda_description" / "urdf" / "panda.urdf"
    for words, said in (
        ((truths[0], panda), "has no joint 'joint1'"),
        ((ARM7, panda), "are not one robot"),
        ((truths[0], truths[1], "--tool", "hand"), "no link named 'hand'"),
        ((lost, lost), "the robot that was calibrated (gone.urdf) is not found; name its description with --robot"),
        ((truths[0], "a.csv"), "a.csv: is a table where the robot is expected"),
    ):
        refused = run_cli("compare", *words)
        assert (refused.code, refused.err.count("\n")) == (2, 1)
        assert said in refused.err
    assert run_cli("compare", lost, lost, "--robot", ARM7).code == 0


def test_an_imported_calibration_is_one_of_ours(run_cli: Callable, truths: tuple[str, str]) -> None:
    """The URDF of a calibration, imported, is that calibration: for compare, for apply, and as the prior of a later fit."""
    assert run_cli("apply", ARM7, truths[0], "-o", "a.urdf").code == 0
    imported = run_cli("import", ARM7, "a.urdf", "-o", "imported.yaml")
    assert (imported.code, "wrote imported.yaml with" in imported.out) == (0, True)
    assert "the same but for rounding" in run_cli("compare", "imported.yaml", truths[0]).out
    assert run_cli("apply", ARM7, "imported.yaml", "-o", "again.urdf").code == 0
    assert "the same but for rounding" in run_cli("compare", "again.urdf", "a.urdf").out
    assert run_cli("import", ARM7, "a.urdf", "-o", "imported.yaml").code == 0, "the same files may be imported again"
    run_cli("fit", "a.urdf", "a.csv", "--after", "imported.yaml", "--no-sag", "--no-ask", "--force", "-o", "after.urdf")
    found = json.loads(run_cli("compare", "after_calibration.yaml", "imported.yaml", "--json").out)
    assert found["same"], "five poses move what is known so well by no more than it is unsure of"


def test_imports_that_make_no_sense_are_refused(run_cli: Callable, truths: tuple[str, str]) -> None:
    """Nothing to import, a table without its convention, options without a table, our own calibration: a line each, exit 2."""
    Path("dh.csv").write_text("joint,d_a\njoint1,1e-3\n")
    for words, said in (
        ((ARM7, ARM7), "there is nothing to import"),
        ((ARM7, "dh.csv"), "is taken for a table of D-H errors, which needs --convention standard, modified or paper and --tip LINK"),
        ((ARM7, truths[0]), "is a calibration of urdfcal's own already"),
        ((ARM7, ARM7, "--tip", "slm"), "--tip is about tables of D-H errors"),
        ((ARM7, "dh.csv", "--convention", "paper", "--tip", "slm", "--sigma", "3"), "'3' is not a prior"),
    ):
        refused = run_cli("import", *words, "-o", "out.yaml")
        assert (refused.code, refused.err.count("\n"), Path("out.yaml").exists()) == (2, 1, False)
        assert said in refused.err


def test_targets_are_corrected(run_cli: Callable, truths: tuple[str, str]) -> None:
    """Corrected positions bring the real robot where the nominal one would have gone: the same evaluation, the other way round."""
    names = ",".join(f"joint{index} [deg]" for index in range(1, 8))
    Path("t.csv").write_text(f"{names}\n10,20,30,-40,50,20,70\n-10,-20,30,40,50,-20,70\n")
    done = run_cli("correct", ARM7, "t.csv", "--calibration", truths[0], "--tool", "slm", "-o", "out.csv", "--json")
    assert done.code == 0
    found = json.loads(done.out)["targets"]
    assert all(each["left_mm"] < 1e-6 < each["before_mm"] and each["reservation"] is None for each in found)
    assert [len(line.split(",")) for line in Path("out.csv").read_text().splitlines()] == [7, 7, 7]
    again = run_cli("correct", ARM7, "t.csv", "--calibration", truths[1], "--tool", "slm", "-o", "out.csv")
    assert (again.code, "out.csv: is there already and holds something else" in again.err) == (2, True)
    assert run_cli("correct", ARM7, "t.csv", "--calibration", truths[1], "-o", "t.csv").code == 2
