"""Simulated instruments: reproducible, noisy as stated, within reach; and from the command line to a fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from tests.conftest import CliResult
from tests.support.paths import ROBOTS_DIR
from tests.support.sensor_cases import CASES, NOISE, SensorCase, setup_of
from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import DEG, MM
from urdfcal.base.rotations import matrices, rotation_vectors
from urdfcal.calibration.error_table import error_table
from urdfcal.calibration.problem import Problem
from urdfcal.robot.configurations import joint_limits
from urdfcal.robot.robot import Robot
from urdfcal.simulation.readings import ReadingNoise, reading_noise, simulate_readings
from urdfcal.simulation.setup import parse_sensors, place_labels, seen_with
from urdfcal.simulation.touching import turns_of

Run = Callable[..., CliResult]
UR5 = ROBOTS_DIR / "ur5" / "ur5.urdf.xacro"


@pytest.mark.parametrize("name", ["pose", "socket", "every kind", "sessions"])
def test_the_same_seed_gives_the_same_readings(name: str, robots: dict[str, Robot]) -> None:
    """Randomness comes from the generator that is passed, and from nowhere else."""
    first, second = (
        simulate_readings(setup_of(CASES[name], robots, rng), 16, rng, NOISE)
        for rng in (np.random.default_rng(3), np.random.default_rng(3))
    )
    np.testing.assert_array_equal(first.q, second.q)
    for one, other in zip(first.readings, second.readings, strict=True):
        np.testing.assert_array_equal(one.values, other.values)
        assert one.labels.tolist() == other.labels.tolist()


@pytest.mark.parametrize("distribution", ["gaussian", "uniform"])
def test_readings_have_the_stated_noise(distribution: str, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Coordinates, distances, orientations and how far touches are off: the standard deviation, or half the width."""
    case = SensorCase("ur5", ("pose:tool0", "distance:tool0:bar", "socket:tool0:ball", "plane:tool0:probe"))
    setup = setup_of(case, robots, rng)
    size, factor = reading_noise(0.0, 0.0, distribution, 2.0, 0.1), 1.0 if distribution == "gaussian" else 3**-0.5
    data = simulate_readings(setup, 600, rng, size)
    here = Problem(setup.errors, data).linearise(setup.x)
    for block in here.blocks:
        left = here.residual[:, block.columns][here.measured[:, block.columns]]
        stated = 0.1 * DEG if block.unit == "deg" else 2.0 * MM
        assert np.std(left) == pytest.approx(stated * factor, rel=0.1), block.name


def test_joint_readings_are_noisy_and_the_robot_is_not(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Noise of turning joints is on the readings alone: what was read of the target is as without it."""
    setup = setup_of(CASES["head camera"], robots, rng)
    still, noisy = (simulate_readings(setup, 400, np.random.default_rng(0), ReadingNoise(joint=size)) for size in (0.0, 1e-3))
    assert np.std(noisy.q - still.q) == pytest.approx(1e-3, rel=0.05)
    np.testing.assert_array_equal(noisy.readings[0].values, still.readings[0].values)
    turned = matrices(noisy.readings[1].values) @ matrices(still.readings[1].values).transpose(0, 2, 1)
    assert np.abs(rotation_vectors(turned)).max() < 1e-12


def test_touches_take_turns_within_the_joints_limits(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Every place is touched alike, one a pose, by joint positions that the robot can have."""
    setup = setup_of(CASES["every kind"], robots, rng)
    assert [turn.label for turn in turns_of(setup.sensors)] == ["1", "2", "3", "4", "1", "2", "3", "4"]
    data = simulate_readings(setup, 24, rng, NOISE)
    touches = [own for own in data.readings if own.kind.touches]
    assert sum(own.seen.astype(int) for own in touches).tolist() == [1] * 24
    for own in touches:
        assert np.unique(own.labels[own.seen], return_counts=True)[1].tolist() == [3] * 4
    lower, upper = joint_limits(setup.robot)
    assert ((data.q >= lower) & (data.q <= upper)).all()


def test_labels_of_places_are_counted_over_the_sensors(robots: dict[str, Robot]) -> None:
    """Two probes touch planes of their own."""
    sensors, lasers = parse_sensors(["plane:tool0:a", "point:tool0", "plane:tool0:b", "socket:tool0"], robots["ur5"], 2)
    assert place_labels(sensors) == [("1", "2"), (), ("3", "4"), ("1", "2")]
    assert not lasers


def test_what_cannot_be_reached_is_said(robots: dict[str, Robot], rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    """A socket out of reach is named, with what should have touched it."""
    monkeypatch.setattr("urdfcal.simulation.touching._MOST_DRAWS", 1000)
    setup = setup_of(CASES["socket"], robots, rng)
    x = np.where([name == "socket:3.x" for name in setup.errors.names], 9.0, setup.x)
    with pytest.raises(UsageError, match=r"only 6 of 8 poses within the joints' limits touch what they should: tool0:ball .* socket 3"):
        simulate_readings(replace(setup, x=x), 8, rng)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["foo:tool0"], "--sensor foo:tool0: expected laser, or one of point:LINK, pose:LINK, distance:LINK, plane:LINK, socket:LINK"),
        (["point"], "--sensor point: expected laser, or one of"),
        (["point:"], "--sensor point:: expected laser, or one of"),
        (["point:tool"], "--sensor point:tool: no link named 'tool' among 15 links; did you mean 'tool0'?"),
        (["point:tool0", "pose:tool0"], "two sensors read the same of one target; tell targets on one link apart by a label, LINK:LABEL"),
        (["point:world"], "no moving joint between the reference 'world' and the target 'world'"),
        (["point:tool0", "--reference", "toool0"], "no link named 'toool0' among 15 links; did you mean 'tool0'?"),
        (["point:tool0", "--target-noise-mm", "-1"], "noise must be finite and not negative"),
        (["point:tool0", "--orientation-noise-deg", "nan"], "noise must be finite and not negative"),
        (["point:tool0", "--noise", "pink"], "'pink' is not one of 'gaussian', 'uniform'"),
    ],
)
def test_what_cannot_be_simulated_is_refused(words: list[str], message: str, run_cli: Run, tmp_path: Path) -> None:
    """One line, exit code 2, nothing written."""
    sensors = [word for each in words for word in (["--sensor", each] if each.startswith(("foo", "point", "pose")) else [each])]
    code, out, err = run_cli("simulate", UR5, "-o", "m.csv", *sensors)
    assert message in err
    assert (code, out, err.count("\n"), list(tmp_path.iterdir())) == (2, "", 1, [])


@pytest.mark.parametrize(
    "sensors", [["pose:tool0"], ["point:tool0", "point:forearm_link:a", "distance:tool0:bar"], ["laser", "point:tool0"]], ids=" ".join
)
def test_from_simulation_to_a_fit_on_the_command_line(sensors: list[str], run_cli: Run, tmp_path: Path) -> None:
    """What simulate wrote, fit takes; the true robot leaves the noise alone, and a truth can be simulated again."""
    words = [word for sensor in sensors for word in ("--sensor", sensor)]
    assert run_cli("simulate", UR5, "-o", "m.csv", "--poses", "80", "--test-poses", "20", *words).code == 0
    text = (tmp_path / "m.csv").read_text()
    assert text.startswith("# SIMULATED measurements of ur5")
    truth = yaml.safe_load((tmp_path / "m_truth.yaml").read_text())
    assert truth["simulated"] is True
    assert set(truth["instruments"]["frames"]) >= {"measuring frame", "tool0"}
    assert run_cli("apply", UR5, "m_truth.yaml", "-o", "true.urdf").code == 0
    evaluated = yaml.safe_load(run_cli("evaluate", "true.urdf", "m.csv", "--json").out)
    fitted = run_cli("fit", UR5, "m.csv", "--json")
    assert fitted.code == 0, fitted.err
    result = yaml.safe_load(fitted.out)
    for target, row in result["test"]["after"].items():
        if "mean_mm" in row:
            limit = 2.5 if target.startswith("laser") else 0.3
            assert row["mean_mm"] < limit
            assert row["mean_mm"] < result["test"]["before"][target]["mean_mm"] / 4
    assert evaluated
    assert run_cli("simulate", UR5, "-o", "again.csv", "--poses", "80", "--errors", "m_truth.yaml", *words).code == 0


def test_known_lengths_are_written_into_the_comments(run_cli: Run, tmp_path: Path) -> None:
    """Touches alone have no scale; the file says true distances between sockets, ready for a rig.yaml, which a fit takes."""
    assert run_cli("simulate", UR5, "-o", "m.csv", "--sensor", "socket:tool0:ball", "--poses", "90", "--places", "3").code == 0
    line = next(line for line in (tmp_path / "m.csv").read_text().splitlines() if "sockets: {distances_mm" in line)
    (tmp_path / "rig.yaml").write_text(line.partition("rig.yaml: ")[2] + "\n")
    alone, scaled = run_cli("fit", UR5, "m.csv", "-o", "a.urdf"), run_cli("fit", UR5, "m.csv", "-o", "b.urdf", "--rig", "rig.yaml")
    assert (alone.code, scaled.code) == (0, 0), alone.err + scaled.err
    assert "touches alone leave the arm's overall scale open" in alone.err
    assert "touches alone" not in scaled.err


def test_targets_on_two_branches_are_seen_together(robots: dict[str, Robot]) -> None:
    """Targets on both sides of what sees them make a tree, in which every joint between them is once."""
    sensors, _ = parse_sensors(["point:panda_link0", "point:panda_link8"], robots["panda"], 1)
    chain = seen_with(robots["panda"], sensors, "panda_link5").chain
    assert sorted(step.joint.name for step in chain.moving) == [f"panda_joint{number}" for number in range(1, 8)]
    assert len(chain.shoots) == 2


def test_a_table_of_perfect_readings_is_zero(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Without noise, at the truth, nothing is left in any kind's own unit."""
    setup = setup_of(CASES["every kind"], robots, rng)
    data = simulate_readings(setup, 80, rng)
    table = error_table(Problem(setup.errors, data).linearise(setup.x), len(data))
    assert len(table) == 8
    assert max(row.max for row in table.values()) < 1e-7
