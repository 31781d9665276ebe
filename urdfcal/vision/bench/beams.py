"""True beam directions of a laser module from readings on a bench (Fig. 6 of the paper), with what a crooked bench does to them.

The module faces a plane at known distances D along its z; a beam from o = (x0, y0, 0) along d = Rot(x, a) Rot(y, b) z meets the plane
and is read there as (x, y) in module axes. If the plane's normal is off by the small rotations (s, t) about x and y, a point of it is

    p = (0, 0, D) + E (x, y),   E = the first two columns of Rot(x, s) Rot(y, t)

Unknown are a, b, x0, y0 of every laser, and s, t. The readings alone hardly tell s, t from the angles (1 deg of s reads as
sin^2(30 deg) = 0.25 deg of a beam at 30 deg); so s, t have a prior, the stated squareness, and their doubt is in every angle's sigma,
and in the angles' correlations. The noise of a reading is estimated from the residual unless it is stated; few readings know it badly,
which is why the covariance is then widened by dof / (dof - 2), the variance of Student's t.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from urdfcal.base.errors import MeasurementError, UsageError
from urdfcal.base.geometry import DEG, Array3, Matrix, Vector
from urdfcal.base.tables import LENGTHS, Table

_PER_LASER = 4  # a, b, x0, y0
_MOST_STEPS, _CLOSE = 50, 1e-10
LEAST_DOF = 3
_NEAREST, _FARTHEST = 1e-3, 50.0  # [m] that a plane can be away
_WIDEST, _ALWAYS = 10.0, 1.0  # a reading is no farther aside than so many distances, or metres


@dataclass(frozen=True, eq=False)
class BenchReadings:
    """What was read on the bench.

    Attributes:
        lasers: Names of the lasers.
        distance: Of the plane from the module's origin along z, (n,), [m].
        spots: (n, lasers, 2) in module axes, [m]; nan where not read.
    """

    lasers: tuple[str, ...]
    distance: Vector
    spots: Array3


@dataclass(frozen=True, eq=False)
class BenchResult:
    """Beam directions of a module.

    Attributes:
        lasers: Names of the lasers.
        angles: (lasers, 2), a and b of Rot(x, a) Rot(y, b), [rad].
        origins: (lasers, 2), where each beam crosses the module's plane z = 0, [m].
        covariance: Of a, b, x0, y0 of each laser in turn, (4 lasers, 4 lasers).
        noise: Of a reading, [m].
        stated: Whether the noise was stated and not estimated.
        residual: Read minus predicted, (n, lasers, 2), [m]; nan where not read.
        apex: The point nearest to all beams, (3,), in module axes, [m]; None with one laser.
        distance: Of the plane, (n,), [m].
    """

    lasers: tuple[str, ...]
    angles: Matrix
    origins: Matrix
    covariance: Matrix
    noise: float
    stated: bool
    residual: Array3
    apex: Vector | None
    distance: Vector

    @property
    def rms(self) -> float:
        """RMS of a coordinate's residual, [m]."""
        return float(np.sqrt(np.nanmean(self.residual**2)))

    @property
    def worst(self) -> tuple[int, int]:
        """Row and laser of the reading that is farthest off."""
        row, laser = np.unravel_index(np.nanargmax(np.linalg.norm(self.residual, axis=2)), self.residual.shape[:2])
        return int(row), int(laser)

    @property
    def angle_sigmas(self) -> Matrix:
        """(lasers, 2), [rad]."""
        return np.sqrt(np.diag(self.covariance)).reshape(-1, _PER_LASER)[:, :2]


def beam_direction(a: float, b: float) -> Vector:
    """Rot(x, a) Rot(y, b) applied to +z, (3,)."""
    return np.array([np.sin(b), -np.sin(a) * np.cos(b), np.cos(a) * np.cos(b)])


def readings_from(table: Table) -> BenchReadings:
    """Readings from a table with the columns `distance`, `<laser>.x`, `<laser>.y`, in m or with [mm].

    Raises:
        MeasurementError: naming line and column.
    """
    table.require("distance", "the distance of the plane from the module's origin")
    distance = table.numbers("distance", LENGTHS)
    lasers = tuple(name.removesuffix(".x") for name in table.columns if name.endswith(".x"))
    if not lasers:
        raise table.fail(None, "laser_1.x", "is missing; expected <laser>.x and <laser>.y in module axes")
    pairs = []
    for laser in lasers:
        table.require(f"{laser}.y", f"it beside {laser}.x")
        pair = np.column_stack([table.numbers(f"{laser}.{axis}", LENGTHS, empty=True) for axis in "xy"])
        lone = np.isnan(pair).sum(axis=1) == 1
        if lone.any():
            raise table.fail(int(np.argmax(lone)), f"{laser}.x", "one cell of the reading is empty; leave both empty if it was not read")
        pairs.append(pair)
    for row in np.flatnonzero(distance <= 0):
        raise table.fail(int(row), "distance", f"'{table.columns['distance'][row]}' is not above zero")
    readings = BenchReadings(lasers, distance, np.stack(pairs, axis=1))
    _require_sense(readings, table)
    for index, laser in enumerate(lasers):
        if len(set(distance[np.isfinite(pairs[index][:, 0])])) < 2:
            raise MeasurementError(f"{laser} was read at fewer than two distances; a direction needs two", table.path)
    return readings


def _require_sense(readings: BenchReadings, table: Table) -> None:
    """Refuse distances and readings that no bench has: their unit is another than the header's.

    Raises:
        MeasurementError: naming line and column.
    """
    for row in np.flatnonzero((readings.distance < _NEAREST) | (readings.distance > _FARTHEST)):
        _refuse(table, int(row), "distance", readings.distance[row] > _FARTHEST, "a distance of 0.001 to 50 m")
    for row, laser, axis in np.argwhere(np.abs(readings.spots) > np.maximum(_WIDEST * readings.distance, _ALWAYS)[:, None, None]):
        _refuse(table, int(row), f"{readings.lasers[laser]}.{'xy'[axis]}", True, f"no more than {_WIDEST:g} times the distance")


def _refuse(table: Table, row: int, column: str, far: bool, expected: str) -> None:
    unit = table.units.get(column, "m")
    other = "mm" if far and unit == "m" else "m" if unit == "mm" and not far else ""
    way_out = f"; if it is in {other}, head the column '{column} [{other}]'" if other else ""
    raise table.fail(row, column, f"{table.columns[column][row]} {unit}, expected {expected}{way_out}")


def beams_from_bench(readings: BenchReadings, squareness: float = 0.2 * DEG, noise: float | None = None) -> BenchResult:
    """The beam directions, by Gauss-Newton with a prior on the plane's two tilts.

    Args:
        readings: What was read.
        squareness: Standard deviation of each of the plane's tilts, [rad]; 0 for a plane known to be square.
        noise: Standard deviation of a reading's coordinate, [m]; estimated where None.

    Raises:
        UsageError: there are too few readings to estimate their noise, or they fit no beams.
    """
    seen = np.isfinite(readings.spots)
    dof = freedom(readings)
    if noise is None and dof < LEAST_DOF:
        raise UsageError(
            f"{int(seen.sum()) // 2} readings leave {dof} to estimate their noise from, at least {LEAST_DOF} are needed; "
            "read more distances, or state it with --reading-sigma-mm"
        )
    x = start(readings)
    weight = noise or 1e-3
    for _ in range(2 if noise is None else 1):  # the weight of the tilts' prior needs the noise
        x, covariance, residual = solved(readings, x, squareness, weight)
        if noise is None:
            weight = max(float(np.sqrt(np.nansum(residual**2) / dof)), 1e-7)
    x, covariance, residual = solved(readings, x, squareness, weight)
    if noise is None and dof > 2:
        own = solved(readings, x, 0.0, weight)[1]  # what comes of the readings' noise alone is known through few degrees of freedom
        covariance = covariance + own * (dof / (dof - 2) - 1)
    states = x[:-2].reshape(-1, _PER_LASER)
    kept = len(x) - 2
    return BenchResult(
        readings.lasers,
        states[:, :2],
        states[:, 2:],
        covariance[:kept, :kept],
        weight,
        noise is not None,
        residual,
        _apex(states),
        readings.distance,
    )


def freedom(readings: BenchReadings) -> int:
    """Degrees of freedom that the readings leave."""
    return int(np.isfinite(readings.spots).sum()) - _PER_LASER * len(readings.lasers)


def predicted_readings(x: Vector, distance: Vector) -> Array3:
    """Readings (n, lasers, 2) for the state (a, b, x0, y0 of each laser, then s, t)."""
    states, (s, t) = x[:-2].reshape(-1, _PER_LASER), x[-2:]
    tilted = np.array([[np.cos(t), 0.0], [np.sin(s) * np.sin(t), np.cos(s)], [-np.cos(s) * np.sin(t), np.sin(s)]])
    found = np.empty((len(distance), len(states), 2))
    for index, (a, b, x0, y0) in enumerate(states):
        # o + k d = (0, 0, D) + E r, linear in (r, k): E r - k d = o - (0, 0, D)
        system = np.column_stack([tilted, -beam_direction(a, b)])
        right = np.column_stack([np.full(len(distance), x0), np.full(len(distance), y0), -distance])
        found[:, index] = np.linalg.solve(system, right.T).T[:, :2]
    return found


def start(readings: BenchReadings) -> Vector:
    """A state, from straight lines through the readings, the plane taken as square."""
    state = []
    for index in range(len(readings.lasers)):
        seen = np.isfinite(readings.spots[:, index, 0])
        basis = np.column_stack([np.ones(seen.sum()), readings.distance[seen]])
        (x0, y0), (by_x, by_y) = np.linalg.lstsq(basis, readings.spots[seen, index], rcond=None)[0]
        a = -np.arctan(by_y)
        state += [a, np.arctan(by_x * np.cos(a)), x0, y0]
    return np.array([*state, 0.0, 0.0])


def solved(readings: BenchReadings, x: Vector, squareness: float, noise: float) -> tuple[Vector, Matrix, Array3]:
    """State, its covariance and the residuals, from a first state, the squareness [rad] and the noise of a reading [m]."""
    seen = np.isfinite(readings.spots).ravel()
    free = len(x) if squareness > 0 else len(x) - 2
    for _ in range(_MOST_STEPS):
        residual = (readings.spots - predicted_readings(x, readings.distance)).ravel()[seen]
        by_x = jacobian(x, readings.distance)[seen] / noise
        normal, right = by_x.T @ by_x, by_x.T @ (residual / noise)
        if squareness > 0:
            normal[-2:, -2:] += np.eye(2) / squareness**2
            right[-2:] -= x[-2:] / squareness**2
        step = np.zeros(len(x))
        step[:free] = np.linalg.solve(normal[:free, :free], right[:free])
        x = x + step
        if np.abs(step).max() < _CLOSE:
            break
    if not np.isfinite(x).all():
        raise UsageError("the readings fit no beams; check the columns' units and that x, y are in module axes")
    covariance = np.zeros_like(normal)
    covariance[:free, :free] = np.linalg.inv(normal[:free, :free])
    return x, covariance, readings.spots - predicted_readings(x, readings.distance)


def jacobian(x: Vector, distance: Vector, step: float = 1e-6) -> Matrix:
    """How readings move with the state, (2 n lasers, states), by central differences: it has a dozen numbers, and they are smooth."""
    shifts = np.eye(len(x)) * step
    return np.stack(
        [(predicted_readings(x + d, distance) - predicted_readings(x - d, distance)).ravel() / (2 * step) for d in shifts], axis=1
    )


def _apex(states: Matrix) -> Vector | None:
    """The point with the least sum of squared distances to all beams."""
    if len(states) < 2:
        return None
    normal, right = np.zeros((3, 3)), np.zeros(3)
    for a, b, x0, y0 in states:
        d = beam_direction(a, b)
        across = np.eye(3) - np.outer(d, d)
        normal += across
        right += across @ [x0, y0, 0.0]
    return np.asarray(np.linalg.lstsq(normal, right, rcond=None)[0])


def relative_angles(nominal: Sequence[float] | Vector, a: float, b: float) -> Vector:
    """The corrections rot_x, rot_y of a beam, as `--estimate beams` has them, that turn a nominal beam into the bench's.

    The calibrated laser is nominal * Rot(x, rot_x) Rot(y, rot_y), so its beam in the nominal laser's axes is
    (sin rot_y, -sin rot_x cos rot_y, cos rot_x cos rot_y), which is solved for the two.

    Args:
        nominal: The nominal laser's axes in the module's, (3, 3).
        a: Angle about x on the bench, [rad].
        b: Angle about y on the bench, [rad].

    Returns:
        rot_x and rot_y, (2,), [rad].
    """
    x, y, z = np.asarray(nominal).T @ beam_direction(a, b)
    return np.array([np.arctan2(-y, z), np.arcsin(np.clip(x, -1, 1))])
