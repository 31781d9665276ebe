"""One pose at a time with whatever reads: the batch answer, what waits until it can be placed, and the ways to hand a pose over."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.support.sensor_cases import CASES, NOISE, TWO_ARMS, robot_named, setup_of
from tests.support.small_robot import robot_of
from urdfcal.api import OnlineCalibrator, fit
from urdfcal.base.errors import MeasurementError, UsageError
from urdfcal.base.geometry import DEG, Matrix
from urdfcal.base.rotations import matrices
from urdfcal.model.options import ModelOptions
from urdfcal.model.parameters import INSTRUMENTS
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.simulation.readings import simulate_readings

SIGMAS = {
    "spot": NOISE.spot,
    **dict.fromkeys(("point", "distance", "plane", "socket"), NOISE.length),
    **dict.fromkeys(("orientation", "inclination"), 0.02 * DEG),
}
QUICK = ("socket", "hand sees hand", "lasers and points")


@pytest.fixture(scope="module")
def poses(robots: dict[str, Robot]) -> Measurements:
    """Poses of a UR5's tool."""
    return simulated("pose", robots, 12)


def simulated(name: str, robots: dict[str, Robot], count: int, seed: int = 2) -> Measurements:
    """What the instruments of a case read."""
    rng = np.random.default_rng(seed)
    return simulate_readings(setup_of(CASES[name], robots, rng), count, rng, NOISE)


def calibrator_for(name: str, robots: dict[str, Robot], data: Measurements) -> OnlineCalibrator:
    """One for a case, which knows the noise."""
    case = CASES[name]
    sigmas = {kind: SIGMAS[kind] for kind in data.kinds}
    return OnlineCalibrator(
        robot_named(case, robots), ModelOptions(reference_known=case.known), sigmas=sigmas, reference=case.reference or None
    )


@pytest.mark.parametrize("name", [*QUICK, *(pytest.param(name, marks=pytest.mark.slow) for name in CASES if name not in QUICK)])
def test_every_sensor_ends_where_the_batch_fit_does(robots: dict[str, Robot], name: str) -> None:
    """Between two looks at the whole history mean and sigma of the robot's own errors are those of `fit` to a fiftieth of a sigma, also of
    those that no reading sees."""
    data = simulated(name, robots, 14 if name in QUICK else 40)
    calibrator = calibrator_for(name, robots, data)
    state = calibrator.update(data)
    batch = fit(
        robot_named(CASES[name], robots),
        data,
        options=calibrator.options,
        sigmas={kind: SIGMAS[kind] for kind in data.kinds},
        gated=False,
        evidence=False,
        asking=False,
        sane=False,
    )
    assert (state.poses, state.waiting) == (len(data), "")
    own = [index for index, each in enumerate(batch.errors.parameters) if each.kind not in INSTRUMENTS]
    same = [calibrator.errors.names.index(batch.errors.names[index]) for index in own]
    assert np.max(np.abs(state.x[same] - batch.x[own]) / batch.sigma[own]) < 0.02
    np.testing.assert_allclose(state.sigma[same], batch.sigma[own], rtol=0.02)


def test_a_pose_is_one_however_it_is_handed_over(robots: dict[str, Robot], poses: Measurements) -> None:
    """Measurements, rows with columns as in a file, positions with arrays by sensor, and matrices give the same belief."""
    point, orientation = poses.readings
    T = np.tile(np.eye(4), (len(poses), 1, 1))
    T[:, :3, 3], T[:, :3, :3] = point.values, matrices(orientation.values)
    quaternion = ("tool0.qx", "tool0.qy", "tool0.qz", "tool0.qw")
    columns = {f"{name} [deg]": np.degrees(q) for name, q in zip(poses.joints, poses.q.T, strict=True)}
    columns |= dict(zip(("tool0.x", "tool0.y", "tool0.z"), point.values.T, strict=True)) | dict(
        zip(quaternion, orientation.values.T, strict=True)
    )
    every = [calibrator_for("pose", robots, poses) for _ in range(4)]
    for row in range(4):
        every[0].update(poses.subset([row]))
        every[1].update({name: float(cells[row]) for name, cells in columns.items()})
        every[2].update(poses.q[row], {"tool0.point": point.values[row], "tool0.orientation": orientation.values[row]})
        every[3].update(poses.q[row], {"tool0.pose": T[row]})
    assert {each.state.poses for each in every} == {4}
    for each in every[1:]:
        np.testing.assert_allclose(each.state.x, every[0].state.x, atol=1e-9)
    assert list(every[1].measurements().poses) == ["1", "2", "3", "4"]


def test_a_table_of_poses_is_taken_row_by_row(robots: dict[str, Robot], poses: Measurements) -> None:
    """Several rows at once end where they end one by one."""
    first = poses.subset(np.arange(5))
    table = dict(zip(poses.joints, first.q.T, strict=True)) | {"tool0.point": first.readings[0].values, "pose": list("abcde")}
    calibrator, single = (calibrator_for("pose", robots, poses) for _ in range(2))
    state = calibrator.update(table)
    single.update(replace(first, readings=first.readings[:1]))
    assert list(calibrator.measurements().poses) == list("abcde")
    np.testing.assert_allclose(state.x, single.state.x, atol=1e-9)


def test_what_cannot_be_placed_yet_waits(robots: dict[str, Robot], poses: Measurements) -> None:
    """Until frame and target can be placed the belief is the prior, and why is said; then all poses are in it."""
    calibrator = calibrator_for("pose", robots, poses)
    first = calibrator.update(poses.subset([0]))
    assert first.poses == 0
    assert (
        first.waiting == "1 pose waits until tool0, the measuring frame can be placed: 6 numbers were read, it takes 18 in 3 poses or more"
    )
    np.testing.assert_array_equal(first.sigma, calibrator.errors.sigma)
    with pytest.raises(UsageError, match="there is nothing to fit: 1 pose waits until tool0"):
        calibrator.calibration()
    last = calibrator.update(poses.subset([1, 2]))
    assert (last.poses, last.waiting) == (3, "")
    assert last.tool_sigma_mm < first.tool_sigma_mm


def test_a_place_that_is_new_waits_aside(robots: dict[str, Robot]) -> None:
    """A plane that is touched for the first time waits for its third touch, while the belief goes on with what it knows."""
    data = simulated("every kind", robots, 40, seed=0)
    plane, points = next(own for own in data.readings if own.kind.touches), next(own for own in data.readings if own.sensor == "point")
    touched = np.flatnonzero(plane.labels == "1")[:3]
    others = np.flatnonzero(plane.labels == "")[:7]
    known, data = replace(data, readings=(points,)).subset(others), replace(data, readings=(points, plane))
    calibrator = calibrator_for("point", robots, data)
    assert calibrator.update(known.subset(np.arange(6))).poses == 6
    assert "plane:1" in calibrator.update(data.subset(touched[:1])).waiting
    going = calibrator.update(known.subset([6]))
    assert (going.poses, "plane:1" in going.waiting) == (7, True)
    last = calibrator.update(data.subset(touched[1:]))
    assert (last.poses, last.waiting) == (10, "")
    assert "plane:1.offset" in calibrator.errors.names
    assert list(calibrator.measurements().q[:, 0]) == [*known.q[:6, 0], data.q[touched[0], 0], known.q[6, 0], *data.q[touched[1:], 0]]


def test_a_robot_without_lasers_knows_nothing_before_it_is_read() -> None:
    """Without lasers there is no state before the first pose, and that is said; columns that mean nothing are refused as in a file."""
    calibrator = OnlineCalibrator(robot_of(TWO_ARMS.replace("screen", "base")), reference="d")
    with pytest.raises(UsageError, match="no pose was taken yet; what is calibrated follows from what is read"):
        calibrator.state  # noqa: B018
    with pytest.raises(MeasurementError, match=r"measurements: column 'hand\.x': no link named 'hand'"):
        calibrator.update({"lift": 0.1, "left_1": 0.2, "hand.point": np.zeros(3)})
    assert repr(calibrator).endswith("before any pose>")


def test_a_gate_knows_the_noise_of_what_is_read(robots: dict[str, Robot], poses: Measurements) -> None:
    """With a gate a kind of reading whose noise is not stated is refused, and a wild point is left out and named."""
    robot = robots["ur5"]
    with pytest.raises(UsageError, match="state that of orientations in sigmas"):
        OnlineCalibrator(robot, gate=True, sigmas={"point": 1e-4}).update(poses.subset([0]))
    with pytest.raises(UsageError, match=r"no kind named 'points'.*did you mean 'point'"):
        OnlineCalibrator(robot, sigmas={"points": 1e-4})
    point = poses.readings[0]
    wild = point.values.copy()
    wild[-1] += 0.05
    calibrator = OnlineCalibrator(robot, gate=True, sigmas={"point": NOISE.length})
    state = calibrator.update(replace(poses, readings=(replace(point, values=wild),)))
    assert state.skipped.startswith("pose 12: its points are")
    assert state.poses == 11


def steps(q: Matrix) -> Matrix:
    """Joint positions a little further."""
    return q + 1e-5


def test_a_pose_read_again_is_no_new_pose(robots: dict[str, Robot], poses: Measurements) -> None:
    """A further reading of a pose is looked at with the whole history, in which the two are one pose."""
    calibrator = calibrator_for("pose", robots, poses)
    calibrator.update(poses)
    again = calibrator.update(replace(poses.subset([3]), q=steps(poses.q[3:4])))
    assert again.relinearised
    assert calibrator.measurements().pose_count == len(poses)
