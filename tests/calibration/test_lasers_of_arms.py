"""Lasers of several arms in one fit: each reads spots on the screen that it names, be it on the wall or in another hand."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from tests.conftest import CliResult
from tests.support.small_robot import joint, robot_of, robot_text
from urdfcal.api import fit, measurements_from
from urdfcal.base.errors import MeasurementError, UsageError
from urdfcal.base.geometry import MM
from urdfcal.calibration.problem import Problem
from urdfcal.robot.robot import Robot
from urdfcal.simulation.simulated import Simulation, simulate

CARD = '<visual><geometry><box size="0.002 1.6 1.2"/></geometry></visual>'
CELL = (
    robot_text(
        joint("left_1", "table", "l1", '<origin xyz="0 0.5 0.3"/><axis xyz="0 0 1"/>'),
        joint("left_2", "l1", "l2", '<origin xyz="0.1 0 0.3" rpy="-1.5 0 0"/><axis xyz="0 0 1"/>'),
        joint("left_3", "l2", "left", '<origin xyz="0.4 0.02 0" rpy="0 1.5 0"/><axis xyz="0 0 1"/>'),
        joint("right_1", "table", "r1", '<origin xyz="0 -0.5 0.3"/><axis xyz="0 0 1"/>'),
        joint("right_2", "r1", "r2", '<origin xyz="0.1 0 0.3" rpy="1.5 0 0"/><axis xyz="0 0 1"/>'),
        joint("right_3", "r2", "right", '<origin xyz="0.4 -0.02 0" rpy="0 -1.5 0"/><axis xyz="0 0 1"/>'),
        joint("one", "left", "laser_1", '<origin xyz="0.03 0 0.1" rpy="1.5 0 0"/>', kind="fixed"),
        joint("two", "left", "laser_2", '<origin xyz="-0.05 0.02 0.1" rpy="1.2 0.2 0"/>', kind="fixed"),
        joint("three", "right", "laser_3", '<origin xyz="0.03 0 -0.1" rpy="0.1 1.5 0"/>', kind="fixed"),
        joint("held", "right", "card", '<origin xyz="0 0.05 0" rpy="0 0 1.5708"/>', kind="fixed"),
        joint("stands", "table", "wall", '<origin xyz="2 0 0.6"/>', kind="fixed"),
        links="table l1 l2 left r1 r2 right laser_1 laser_2 laser_3 card wall",
    )
    .replace('"-9"', '"-0.8"')
    .replace('"9"', '"0.8"')
    .replace('<link name="card"/>', f'<link name="card">{CARD}</link>')
)
PAIRS = ("laser:laser_1@card", "laser:laser_2@card", "laser:laser_2@wall", "laser:laser_3@wall")
Run = Callable[..., CliResult]


@pytest.fixture(scope="module")
def cell() -> Robot:
    """Two arms: two lasers on the left one, one and a card on the right one, and a wall."""
    return robot_of(CELL)


@pytest.fixture(scope="module")
def simulated(cell: Robot) -> Simulation:
    """Spots with 0.2 mm of noise, as many on the card as on the wall."""
    return simulate(cell, 90, sensors=PAIRS, spot_noise=0.2 * MM, seed=3)


def spot(T_screen_laser: pin.SE3) -> np.ndarray:
    """Where a beam along +z meets the plane x = 0, (y, z)."""
    p, z = T_screen_laser.translation, T_screen_laser.rotation[:, 2]
    return np.asarray((p - z * p[0] / z[0])[1:])


def test_spots_are_those_of_the_whole_robot(simulated: Simulation) -> None:
    """Every spot is where Pinocchio, on the whole true robot, has the beam meet the plane of its screen; on the card if that is drawn."""
    robot, data = simulated.robot, simulated.measurements
    found = {slot.label: slot.found[""] for slot in simulated.errors.slots if slot.frame is not None}
    model, engine, off = robot.model, robot.model.createData(), []
    columns = [model.joints[model.getJointId(name)].idx_q for name in data.joints]
    for pose in range(len(data)):
        q = pin.neutral(model)
        q[columns] = data.q[pose]
        pin.framesForwardKinematics(model, engine, q)
        for own in (own for own in data.readings if own.seen[pose]):
            at = [engine.oMf[model.getFrameId(name)] * found[name] for name in (own.instrument, own.link)]
            off.append(own.values[pose] - spot(at[0].actInv(at[1])))
            if own.instrument == "card":
                assert (np.abs(own.values[pose]) < np.array([0.8, 0.6]) + 1 * MM).all()
    assert np.std(off) == pytest.approx(0.2 * MM, rel=0.15)


def test_the_jacobian_is_that_of_differences(simulated: Simulation, rng: np.random.Generator) -> None:
    """Spots go with every parameter of both arms, of lasers and of screens as central differences say."""
    problem = Problem(fit(simulated.nominal, simulated.measurements, evidence=False, asking=False).errors, simulated.measurements)
    x, h = rng.normal(0, 1e-3, len(problem.errors.names)), 1e-6
    jacobian = problem.linearise(x).jacobian
    for column in range(len(x)):
        step = h * (np.arange(len(x)) == column)
        numeric = (problem.linearise(x - step).residual - problem.linearise(x + step).residual) / (2 * h)
        np.testing.assert_allclose(jacobian[:, :, column], numeric, rtol=1e-5, atol=2e-6)


def test_unseen_spots_are_predicted_and_the_noise_is_found(cell: Robot) -> None:
    """Spots at poses that were not measured lie within what noise does."""
    made = simulate(cell, 120, sensors=PAIRS, spot_noise=0.2 * MM, test_poses=40, seed=7)
    found = fit(cell, made.measurements)
    assert found.converged
    assert found.estimate.noise.sigma == pytest.approx([0.2 * MM], rel=0.1)
    assert found.test is not None
    before, after = ([row.mean for row in table.values()] for table in found.test)
    assert min(before) > 1.5
    assert max(after) < 0.4
    assert {f"{own.removeprefix('laser:')}" for own in PAIRS} == set(found.after)


def test_half_named_spots_are_refused(cell: Robot, simulated: Simulation) -> None:
    """A laser that names no screen where others do, a laser without one, and pixels before a named one are named with the way out."""
    table = {**{name: [0.1] for name in simulated.measurements.joints}, "laser_1@card.y": [0.1], "laser_1@card.z": [0.1]}
    with pytest.raises(MeasurementError, match=r"column 'laser_2.y': other spots name the screen .* 'laser_2@screen.y'"):
        measurements_from(cell, table | {"laser_2.y": [0.1], "laser_2.z": [0.2]})
    with pytest.raises(MeasurementError, match=r"laser_1@card.z.* a spot of laser_1@card needs"):
        measurements_from(cell, {name: own for name, own in table.items() if name != "laser_1@card.z"})
    with pytest.raises(UsageError, match=r"laser:laser_1: expected the screen that it beams onto, too, such as laser:laser_1@screen"):
        simulate(cell, 9, sensors=["laser:laser_1"])


def test_lasers_on_two_arms_say_how_to_name_their_screens(cell: Robot, run_cli: Run, tmp_path: Path) -> None:
    """Plain columns of lasers on two arms are refused with the columns that would do; `simulate` writes such, and they are read."""
    (tmp_path / "cell.urdf").write_bytes(cell.description.text)
    done = run_cli("simulate", "cell.urdf", "-o", "m.csv", "--screen", "wall")
    assert (done.code, "name the screen of each in its columns, laser_1@wall.y" in done.err) == (2, True)
    words = [word for pair in PAIRS for word in ("--sensor", pair)]
    assert run_cli("simulate", "cell.urdf", "-o", "m.csv", "--poses", "60", *words).code == 0
    for command in ("check", "evaluate", "measurements"):
        looked = run_cli(command, "cell.urdf", "m.csv")
        assert looked.code == 0, looked.err
    assert "laser_3@wall" in looked.out
