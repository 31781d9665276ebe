"""The inclinometer against Pinocchio's roll-pitch-yaw, against a robot of known errors, and as a file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from tests.conftest import CliResult
from tests.support.paths import ROBOTS_DIR
from tests.support.sensor_cases import SensorCase, setup_of
from urdfcal.api import fit
from urdfcal.base.errors import FitRejected
from urdfcal.base.geometry import DEG
from urdfcal.robot.robot import Robot
from urdfcal.sensors.registry import SENSORS
from urdfcal.sensors.sensor import View
from urdfcal.simulation.readings import ReadingNoise, simulate_readings

CASE = SensorCase("ur5", ("inclination:tool0",))
NOISE = ReadingNoise(angle=0.01 * DEG)


def test_readings_are_roll_and_pitch(rng: np.random.Generator) -> None:
    """Of a robot that stands upright the readings are the roll and pitch of the link, whatever its yaw."""
    angles = rng.uniform(-1.5, 1.5, (20, 3))
    R = np.array([pin.rpy.rpyToMatrix(*own) for own in angles])
    upright = np.broadcast_to(np.eye(3)[:, [2, 0, 1]], (20, 3, 3))
    view = View(np.zeros((20, 3)), R, np.zeros((20, 2)), upright)
    np.testing.assert_allclose(SENSORS["inclination"].read(view), angles[:, :2], atol=1e-12)


def test_mount_and_gravity_are_found_from_nothing(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """However the instrument sits and the robot hangs, what is left is the noise, and the truth is within its sigmas."""
    for _ in range(4):
        setup = setup_of(CASE, robots, rng, model="auto")
        found = fit(setup.robot, simulate_readings(setup, 80, rng, NOISE), sane=False)
        assert found.converged
        assert found.after["tool0 inclination"].mean < 2 * 0.01
        assert found.estimate.noise.sigma[0] == pytest.approx(NOISE.angle, rel=0.25)
        truth = dict(zip(setup.errors.names, setup.x.tolist(), strict=True))
        known = [index for index, name in enumerate(found.errors.names) if name.endswith(("d_alpha", "d_beta"))]
        off = [(found.x[index] - truth[found.errors.names[index]]) / found.sigma[index] for index in known]
        assert any(found.identifiability.determined[index] for index in known)
        assert np.sqrt(np.mean(np.square(off))) < 2


def test_translations_are_nobodys_business(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """An inclinometer sees no length: every translation is said to be not determined, and stays where its prior has it."""
    setup = setup_of(CASE, robots, rng, model="auto")
    found = fit(setup.robot, simulate_readings(setup, 60, rng, NOISE), sane=False)
    lengths = [index for index, unit in enumerate(found.errors.units) if unit == "m"]
    assert not any(found.identifiability.determined[index] for index in lengths)
    np.testing.assert_allclose(found.x[lengths], 0.0, atol=1e-9)


def test_swapped_axes_are_refused(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Readings whose two columns were taken for each other are named as such."""
    setup = setup_of(CASE, robots, rng, model="auto")
    data = simulate_readings(setup, 60, rng, NOISE)
    own = data.readings[0]
    with pytest.raises(FitRejected, match="incl_x and incl_y swapped"):
        fit(setup.robot, replace(data, readings=(replace(own, values=own.values[:, ::-1]),)))


def test_from_the_command_line(run_cli: Callable[..., CliResult], tmp_path: Path) -> None:
    """`simulate --sensor inclination:LINK`, then `fit`; a column that is missing, and a lone cell, are named."""
    robot = ROBOTS_DIR / "ur5" / "ur5.urdf.xacro"
    assert run_cli("simulate", robot, "-o", "m.csv", "--sensor", "inclination:tool0", "--poses", "40", "--seed", "1").code == 0
    text = (tmp_path / "m.csv").read_text()
    assert "tool0.incl_x,tool0.incl_y" in text
    done = run_cli("fit", robot, "m.csv", "--no-sag", "--json")
    assert (done.code, '"gravity"' in done.out) == (0, True)
    (tmp_path / "one.csv").write_text(text.replace("tool0.incl_y", "other"))
    done = run_cli("fit", robot, "one.csv")
    assert done.code == 2
    assert "column 'tool0.incl_y': is missing; an inclination needs .incl_x and .incl_y" in done.err
