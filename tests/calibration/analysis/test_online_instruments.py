"""One pose at a time from several instruments, in sessions: the batch answer, and what waits for what."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from tests.support.sensor_cases import TWO_ARMS
from tests.support.small_robot import robot_of
from urdfcal.api import OnlineCalibrator, fit
from urdfcal.base.geometry import DEG, MM
from urdfcal.model.parameters import INSTRUMENTS
from urdfcal.robot.robot import Robot
from urdfcal.sensors.columns import Stations
from urdfcal.sensors.measurements import Measurements
from urdfcal.simulation.simulated import simulate

SIGMAS = {"point": 0.1 * MM, "orientation": 0.02 * DEG}
STATIONS = Stations({"leica": "screen", "eye": "d"})
PAIRS = {"g@leica": "leica", "d@leica": "leica", "g@eye": "eye"}


@pytest.fixture(scope="module")
def robot() -> Robot:
    """A lift with two arms."""
    return robot_of(TWO_ARMS)


@pytest.fixture(scope="module")
def data(robot: Robot) -> Measurements:
    """Poses of both hands from a tracker, and of one from the other, by turns; the second half after the tracker was moved."""
    made = simulate(robot, 36, sensors=["pose:g@leica", "point:d:ball@leica", "pose:g@eye"], stations=STATIONS, seed=5).measurements
    turn = np.arange(len(made)) % 2 == 0
    by_turns = tuple(own.without(turn if own.instrument == "eye" else ~turn) for own in made.readings)
    return replace(made, readings=by_turns, sessions=np.repeat(["one", "two"], 18))


def apart(calibrator: OnlineCalibrator, robot: Robot, data: Measurements) -> tuple[float, float]:
    """By how many sigmas the robot's own errors are apart from the batch fit's, and by how much their sigmas differ."""
    batch = fit(robot, data, sigmas=SIGMAS, gated=False, evidence=False, asking=False, sane=False)
    own = [index for index, each in enumerate(batch.errors.parameters) if each.kind not in INSTRUMENTS]
    same = [calibrator.errors.names.index(batch.errors.names[index]) for index in own]
    state = calibrator.state
    off = np.abs(state.x[same] - batch.x[own]) / batch.sigma[own]
    return float(off.max()), float(np.abs(state.sigma[same] / batch.sigma[own] - 1).max())


def test_it_ends_where_the_batch_fit_does(robot: Robot, data: Measurements) -> None:
    """With several instruments that read by turns, and a tracker that was moved between, the belief is the batch answer."""
    calibrator = OnlineCalibrator(robot, sigmas=SIGMAS, stations=STATIONS)
    state = calibrator.update(data)
    assert (state.poses, state.waiting) == (len(data), "")
    assert max(apart(calibrator, robot, data)) < 0.03


def test_what_one_instrument_shows_does_not_wait_for_another(robot: Robot, data: Measurements) -> None:
    """A tracker's poses are in the belief while those of what has been seen too seldom wait, by name; so in a later session."""
    calibrator = OnlineCalibrator(robot, sigmas=SIGMAS, stations=STATIONS)
    by_leica, by_eye = (np.flatnonzero(next(own for own in data.readings if own.instrument == name).seen) for name in ("leica", "eye"))
    state = calibrator.update(data.subset(np.sort(np.concatenate([by_leica[:6], by_eye[:2]]))))
    assert state.poses == 6
    assert state.waiting.startswith("2 poses wait until eye can be placed: 12 numbers were read")
    state = calibrator.update(data.subset(by_eye[2:6]))
    assert (state.poses, state.waiting) == (12, "")
    later = by_leica[data.sessions[by_leica] == "two"]
    state = calibrator.update(data.subset(later[:1]))
    assert state.waiting.startswith("1 pose waits until leica can be placed")
    assert calibrator.update(data.subset(later[1:4])).poses == 16


def rows_of(data: Measurements, instrument: str) -> list[Mapping[str, object]]:
    """The rows that an instrument reads, each as somebody would hand it over: all joints, and what was read."""
    rows = []
    for row in np.flatnonzero(next(own for own in data.readings if own.instrument == instrument).seen)[:7]:
        cells: dict[str, object] = dict(zip(data.joints, data.q[row].tolist(), strict=True))
        for own in (own for own in data.readings if own.instrument == instrument and own.sensor == "point"):
            turned = next((each for each in data.readings if (each.label, each.sensor) == (own.label, "orientation")), None)
            if turned is None:
                cells |= {f"{own.label}.{axis}": value for axis, value in zip("xyz", own.values[row].tolist(), strict=True)}
            else:
                R = pin.Quaternion(turned.values[row]).toRotationMatrix()
                cells[f"{own.label}.pose"] = pin.SE3(R, own.values[row]).homogeneous
        rows.append(cells)
    return rows


def test_rows_that_show_another_branch_later(robot: Robot, data: Measurements) -> None:
    """Rows of one arm first, then of both: the joints of the other arm are read once more from the rows that came before."""
    calibrator = OnlineCalibrator(robot, sigmas=SIGMAS, stations=STATIONS)
    first = replace(data, readings=tuple(own for own in data.readings if own.target == "g"), sessions=np.full(len(data), ""))
    both = replace(data, sessions=np.full(len(data), ""))
    for row in rows_of(first, "leica"):
        calibrator.update(row)
    alone = set(calibrator.errors.joint_names)
    for row in [*rows_of(both, "leica"), *rows_of(both, "eye")]:
        state = calibrator.update(row)
    assert not {"left_1", "left_2"} & alone
    assert {"left_1", "left_2"} <= set(calibrator.errors.joint_names)
    assert state.waiting == ""
    assert state.poses == 21
    assert max(apart(calibrator, robot, calibrator.measurements())) < 0.03
