"""How far each reading of a calibration lies from what the robot predicts, for every sensor alike.

The length of a residual is taken in its own standard deviations, d^2 = r' S^-1 r, where S = R for a pose that was fitted and
R + J P J' for one that was not. R is what the noise puts on a reading, joint noise included. For Gaussian noise d^2 is chi-squared with
as many degrees of freedom as numbers were read.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Array3, Labels, Matrix, Vector
from urdfcal.calibration.analysis.verdict import honest_covariance
from urdfcal.calibration.channel import Channel
from urdfcal.calibration.problem import Problem, problem_of
from urdfcal.calibration.result import FitResult
from urdfcal.calibration.start.nominal import with_new_places
from urdfcal.estimation.residual import Linearisation
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.sensor import Sensor, View

Rows = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Residuals:
    """What one sensor read of one target, put to the nominal and to the calibrated robot; only poses at which it read.

    Attributes:
        label: What the poses are for: `fit` or `test`.
        name: What tables call it.
        sensor: How it was read.
        rows: Which of the set's poses these are, (n,).
        poses: Their labels, (n,).
        touched: Which plane or socket was touched, (n,); the empty string for other sensors.
        before: Measured less predicted by the nominal robot, (n, k), in `unit`; nan for a number that was not read.
        after: The same with the calibrated robot.
        sigma: Standard deviation that the noise puts on each number, (n, k), in `unit`.
        lengths: Length of each residual in its own standard deviations, (n,).
        places: Where a map has each reading before and after calibration, (2, n, k), in `unit`; None for sensors that have no map.
    """

    label: str
    name: str
    sensor: Sensor
    rows: Rows
    poses: Labels
    touched: Labels
    before: Matrix
    after: Matrix
    sigma: Matrix
    lengths: Vector
    places: Array3 | None

    @property
    def unit(self) -> str:
        """`mm`, `deg` or `px`."""
        return self.sensor.words.unit

    @cached_property
    def numbers(self) -> Rows:
        """How many numbers each reading has, (n,)."""
        return np.asarray(np.isfinite(self.sigma).sum(axis=1))

    @cached_property
    def before_size(self) -> Vector:
        """Length of each residual with the nominal robot, (n,), in `unit`."""
        return _size(self.before)

    @cached_property
    def after_size(self) -> Vector:
        """Length of each residual with the calibrated robot, (n,), in `unit`."""
        return _size(self.after)


def residuals_of(calibration: FitResult) -> list[Residuals]:
    """Every sensor's readings of every target at the fitted poses and, if there are any, at the test poses."""
    found = _of_set(calibration, "fit", calibration.data)
    return found + (_of_set(calibration, "test", calibration.test_data) if calibration.test_data is not None else [])


def numbered(sets: Sequence[Residuals]) -> dict[str, int]:
    """A number for every laser and target, by which all pictures have the same colour for it."""
    return {name: number for number, name in enumerate(dict.fromkeys(own.name for own in sets))}


@dataclass(frozen=True)
class _State:
    """A robot put to some poses, at one state.

    Attributes:
        here: What is left of their readings.
        views: What every channel looks at.
    """

    here: Linearisation
    views: tuple[View, ...]

    @staticmethod
    def of(problem: Problem, x: Vector) -> _State:
        with np.errstate(invalid="ignore"):
            return _State(problem.linearise(x), problem.views(x))


def _of_set(calibration: FitResult, label: str, data: Measurements) -> list[Residuals]:
    noise, nominal = calibration.noise_for(data), calibration.nominal
    start, instruments = nominal.with_new_places(data)
    errors, x = (calibration.errors, calibration.x) if label == "fit" else with_new_places(calibration.errors, calibration.x, data, noise)
    model = problem_of(errors, data, noise)
    before, after = _State.of(Problem(start, data), instruments), _State.of(model, x)
    R = noise.pose_covariance(after.here)
    uncertain = label == "test" and honest_covariance(calibration) and errors is calibration.errors
    S = R + after.here.jacobian @ calibration.covariance @ after.here.jacobian.transpose(0, 2, 1) if uncertain else R
    return _by_name([_of_channel(label, index, model, (before, after), R, S) for index in range(len(model.channels))])


def _of_channel(label: str, index: int, model: Problem, states: tuple[_State, _State], R: Array3, S: Array3) -> Residuals:
    channel = model.channels[index]
    rows, own, size = np.flatnonzero(channel.readings.seen), channel.block.columns, channel.sensor.words.size
    read = channel.readings.measured[rows]
    before, after = (np.where(read, state.here.residual[rows, own], np.nan) / size for state in states)
    return Residuals(
        label=label,
        name=channel.block.name,
        sensor=channel.sensor,
        rows=rows,
        poses=model.data.poses[rows],
        touched=channel.readings.labels[rows],
        before=before,
        after=after,
        sigma=np.where(read, np.sqrt(np.diagonal(R, axis1=1, axis2=2))[rows, own], np.nan) / size,
        lengths=_lengths(states[1].here.residual[rows, own], S[rows, own, own]),
        places=_places(channel, rows, [state.views[index] for state in states]),
    )


def _places(channel: Channel, rows: Rows, views: Sequence[View]) -> Array3 | None:
    drawn = [channel.sensor.drawn_at(view, channel.readings.values) for view in views]
    found = [each[rows] / channel.sensor.words.size for each in drawn if each is not None]
    return np.array(found) if found else None


def _by_name(parts: Sequence[Residuals]) -> list[Residuals]:
    """One for every name, as the corners of a board share theirs; what was never read is left out."""
    named: dict[tuple[str, str], list[Residuals]] = {}
    for part in parts:
        if len(part.rows):
            named.setdefault((part.name, part.sensor.name), []).append(part)
    return [_joined(own) for own in named.values()]


def _joined(parts: Sequence[Residuals]) -> Residuals:
    if len(parts) == 1:
        return parts[0]
    names = ("rows", "poses", "touched", "before", "after", "sigma", "lengths")
    together: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    drawn = [part.places for part in parts if part.places is not None]
    return replace(parts[0], **together, places=np.concatenate(drawn, axis=1) if drawn else None)


def _lengths(residual: Matrix, S: Array3) -> Vector:
    """Lengths (n,) of residuals (n, k) under their covariances (n, k, k); nan where there is none."""
    good = np.isfinite(residual).all(axis=1) & np.isfinite(S).all(axis=(1, 2))
    lengths = np.full(len(residual), np.nan)
    lengths[good] = np.sqrt(np.sum(residual[good] * np.linalg.solve(S[good], residual[good][..., None])[..., 0], axis=-1))
    return lengths


def _size(residual: Matrix) -> Vector:
    return np.asarray(np.sqrt(np.nansum(residual**2, axis=1)))
