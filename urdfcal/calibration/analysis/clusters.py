"""Neighbouring poses at which a calibrated robot is worse than the nominal one.

Every figure is of all readings, those included that were taken out as outliers: a calibration is not made good by leaving out where it
is bad. Only for clusters, the nearest poses in joint space, outliers are left aside that are scattered as bad readings are. Nor does a
bad reading make a cluster that was not told apart: most poses of one must be worse each by itself, and its farthest are spared. With c
the residuals of a cluster under the calibrated robot, n under the nominal one and D = n - c, all in units of the noise, the calibrated
robot is worse there if |c|^2 > |n|^2, and that is no chance if

    z = -c'D / |D|,    standard normal where the calibrated robot is right,

is beyond what any of the clusters would reach.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Mask, Matrix, Vector
from urdfcal.base.terminal import rounded
from urdfcal.calibration.error_table import SpotTable, error_table, main_unit
from urdfcal.calibration.outliers import gross_mask
from urdfcal.calibration.problem import problem_of
from urdfcal.calibration.result import FitResult
from urdfcal.calibration.start.nominal import with_new_places
from urdfcal.calibration.together import lie_together, nearest
from urdfcal.estimation.chi_squared import quantile
from urdfcal.estimation.residual import Linearisation
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.repeats import first_rows
from urdfcal.sensors.sensor import UNITS

MANY = 0.1  # share of the readings beyond which outliers are no few bad readings
ROUNDING = 1e-3  # [main unit] by which nothing is worse than anything else
SETS = {"fit": "fitted", "test": "test", "k-fold": "left-out"}
_CLUSTERS, _SHARE = 6, 0.1  # poses of small clusters, and share of all poses that large ones have
_MOST, _SPARED = 0.75, 1 / 6  # share of a cluster that must be worse pose by pose, and of its farthest poses, which may be bad readings
_BY_CHANCE = 1e-3  # how often any cluster of a good calibration is called worse
_NAMED = 3  # poses, or joints, that a sentence has room for

Rows = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Cluster:
    """Neighbouring poses at which the calibrated robot is worse than the nominal one.

    Attributes:
        set: `fit`, `test` or `k-fold`.
        poses: How messages name them.
        calibrated, nominal: RMS distance of all their readings, in `unit`.
        usual: The same of all poses of the set, with the nominal robot.
        unit: `mm`, `deg` or `px`.
    """

    set: str
    poses: tuple[str, ...]
    calibrated: float
    nominal: float
    usual: float
    unit: str

    @property
    def grave(self) -> bool:
        """Whether the calibrated robot is farther off there than the nominal one is as a whole: who moves there is served worse."""
        return self.calibrated > max(self.nominal, self.usual)

    def words(self) -> str:
        """In a sentence."""
        return (
            f"at neighbouring {SETS[self.set]} poses ({listed(self.poses)}) the calibrated robot is "
            f"{rounded(self.calibrated, 3)} {self.unit} off (RMS), the nominal one {rounded(self.nominal, 3)} {self.unit}"
        )


@dataclass(frozen=True)
class _Set:
    """Poses under the calibrated and the nominal robot.

    Attributes:
        name: `fit`, `test` or `k-fold`.
        data: All readings.
        calibrated, nominal: Their residuals.
        bad: Outliers that are few and scattered as bad readings are, (n, blocks).
    """

    name: str
    data: Measurements
    calibrated: Linearisation
    nominal: Linearisation
    bad: Mask

    @property
    def used(self) -> Mask:
        """Numbers that both robots have, (n, m): beams that do not meet the screen have none."""
        used = self.calibrated.measured & self.nominal.measured
        for one in (self.calibrated, self.nominal):
            used = used & np.isfinite(one.residual) & (True if one.lost is None else ~one.lost[:, one.block_of])
        return np.asarray(used)


def worst_clusters(found: FitResult) -> list[Cluster]:
    """The cluster of each set at which the calibrated robot is worst, of those where it is worse than the nominal one; gravest first.

    All readings count, of the fitted, the test and the left-out poses.
    """
    clusters = [cluster for each in (*_held_out(found), *_fitted(found)) if (cluster := _worst_of(found, each)) is not None]
    return sorted(clusters, key=lambda cluster: -cluster.calibrated / max(cluster.usual, ROUNDING))


def _worst_of(found: FitResult, each: _Set) -> Cluster | None:
    unit, _ = _main(found, each.calibrated)
    used = each.used & _numbers_of(each.calibrated, unit) & ~each.bad[:, each.calibrated.block_of]
    rows = np.flatnonzero(used.any(axis=1))
    rows = rows[first_rows(each.data.pose_of[rows])]  # readings of one pose are no neighbours of each other
    if len(rows) < 2 * _CLUSTERS:
        return None
    c, n = (np.where(used, one.residual, 0.0)[rows] for one in (each.calibrated, each.nominal))
    sigma, q = found.noise_for(each.data).of_numbers(each.calibrated)[rows], each.data.q[rows]
    usual = _rms(n, used[rows], each.nominal) / UNITS[unit]
    best: Cluster | None = None
    for size in {_CLUSTERS, max(_CLUSTERS, round(_SHARE * len(rows)))}:
        for own in _worse(c / sigma, n / sigma, np.column_stack([np.arange(len(rows)), nearest(q, size - 1)])):
            after, before = (_rms(part[own], used[rows[own]], each.calibrated) / UNITS[unit] for part in (c, n))
            if after > before + ROUNDING and (best is None or after > best.calibrated):
                best = Cluster(each.name, tuple(each.data.where(int(pose)) for pose in rows[own]), after, before, usual, unit)
    return best


def _rms(residual: Matrix, used: Mask, linearisation: Linearisation) -> float:
    """Root mean square length of readings."""
    readings = sum(int(np.count_nonzero(used[:, block.columns].any(axis=1))) for block in linearisation.blocks)
    return float(np.sqrt(np.sum(residual**2) / max(readings, 1)))


def _worse(c: Matrix, n: Matrix, clusters: Rows) -> Rows:
    """Clusters that the calibrated robot makes worse beyond chance, without the farthest poses of each, (k, poses)."""
    far, D = (c**2).sum(axis=1), n - c
    worse = far > (n**2).sum(axis=1)
    some = clusters[worse[clusters].mean(axis=1) >= _MOST]
    kept = clusters.shape[1] - ceil(clusters.shape[1] * _SPARED)
    own = np.take_along_axis(some, np.argsort(far[some], axis=1)[:, :kept], axis=1)
    towards, length = -(c * D).sum(axis=1)[own].sum(axis=1), np.sqrt((D**2).sum(axis=1)[own].sum(axis=1))
    z = towards / np.maximum(length, np.finfo(float).tiny)
    limit = np.sqrt(quantile(1 - _BY_CHANCE / len(clusters), 1))  # of one side, for two sizes of clusters
    return np.asarray(own[z > np.maximum(limit, length / 2)])


def _held_out(found: FitResult) -> Iterator[_Set]:
    """Poses that were not fitted."""
    test = found.test_data
    if test is not None and not test.empty:
        noise = found.noise_for(test)
        errors, x = with_new_places(found.errors, found.x, test, noise)
        model = problem_of(errors, test, noise)
        out = gross_mask(model, replace(found.estimate, noise=noise))[: len(test)]
        together = lie_together(errors.chain, test, np.asarray(out.any(axis=1)))
        yield _set("test", test, model.linearise(x), found.nominal.residuals(test), out, bool(together))
    if found.folds is not None and found.folds.left_out is not None and len(found.folds.left_out[0].residual) == len(found.data):
        yield _set("k-fold", found.read, *found.folds.left_out, left_out(found)[0], bool(found.together))


def _fitted(found: FitResult) -> Iterator[_Set]:
    data = found.read
    if not data.empty:
        calibrated = problem_of(found.errors, data, found.estimate.noise).linearise(found.x)
        yield _set("fit", data, calibrated, found.nominal.residuals(data), left_out(found)[0], bool(found.together))


def _set(name: str, data: Measurements, calibrated: Linearisation, nominal: Linearisation, out: Mask, together: bool) -> _Set:
    own = calibrated.of_poses(len(data))
    few = np.count_nonzero(out) <= MANY * np.count_nonzero(own.made)
    return _Set(name, data, own, nominal.of_poses(len(data)), out if few and not together else np.zeros_like(out))


def usual_tables(found: FitResult) -> dict[str, tuple[SpotTable, SpotTable]]:
    """Distances of the held-out poses, nominal and calibrated, by a key of SETS, without a few scattered bad readings."""
    return {
        each.name: (
            error_table(each.nominal.without(each.bad), len(each.data)),
            error_table(each.calibrated.without(each.bad), len(each.data)),
        )
        for each in _held_out(found)
        if each.bad.any()
    }


def pose_distances(found: FitResult) -> tuple[Vector, Vector]:
    """Farthest reading of each pose of `judged_set`, with the calibrated and with the nominal robot, in the main unit.

    A few scattered bad readings say nothing of either.
    """
    each = next(_held_out(found), None) or next(_fitted(found))
    unit, columns = _main(found, each.calibrated)
    sizes = [_distances(each, one)[:, columns] / UNITS[unit] for one in (each.calibrated, each.nominal)]
    return np.asarray(np.max(sizes[0], axis=1, initial=0.0)), np.asarray(np.max(sizes[1], axis=1, initial=0.0))


def _distances(each: _Set, one: Linearisation) -> Matrix:
    """Length of every reading's residual, (n, blocks)."""
    residual = np.where(each.used & ~each.bad[:, one.block_of], one.residual, 0.0)
    return np.column_stack([np.linalg.norm(residual[:, block.columns], axis=1) for block in one.blocks])


def _main(found: FitResult, linearisation: Linearisation) -> tuple[str, Rows]:
    """The unit in which people read the result, and the blocks that are in it."""
    unit = main_unit(found.after)
    return unit, np.array([index for index, block in enumerate(linearisation.blocks) if block.unit == unit], dtype=np.intp)


def _numbers_of(linearisation: Linearisation, unit: str) -> Mask:
    own = np.zeros(linearisation.residual.shape[1], dtype=bool)
    for block in linearisation.blocks:
        own[block.columns] = block.unit == unit
    return own


def listed(names: Sequence[str]) -> str:
    """As many names as a sentence has room for, and how many more there are."""
    return ", ".join(names[:_NAMED]) + (f" and {len(names) - _NAMED} more" if len(names) > _NAMED else "")


def left_out(found: FitResult) -> tuple[Mask, Mask]:
    """Which readings of the fitted poses were left out, and which were read, (n, readings)."""
    kept, read = (_read(data) for data in (found.data, found.read))
    return read & ~kept, read


def _read(data: Measurements) -> Mask:
    return np.column_stack([reading.measured.any(axis=1) for reading in data.readings])


def judged_set(found: FitResult) -> str:
    """Which poses speak first, a key of SETS: test poses, else those left out in turn, else the fitted ones."""
    each = next(_held_out(found), None) or next(_fitted(found))
    return each.name
