"""What speaks against a calibration, as text: parts of the robot's motion where it is worse than none, and what the gate took away.

Every figure is of all readings, those included that were taken out as outliers: a calibration is not made good by leaving out where it
is bad. Only for clusters, the nearest poses in joint space, outliers are left aside that are scattered as bad readings are. Nor does a
bad reading make a cluster that was not told apart: most poses of one must be worse each by itself, and its farthest are spared. With c
the residuals of a cluster under the calibrated robot, n under the nominal one and D = n - c, all in units of the noise, the calibrated
robot is worse there if |c|^2 > |n|^2, and that is no chance if

    z = -c'D / |D|,    standard normal where the calibrated robot is right,

is beyond what any of the clusters would reach.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import DEG, MM, Mask, Matrix, Vector
from urdfcal.calibration.error_table import main_unit
from urdfcal.calibration.outliers import gross_mask
from urdfcal.calibration.problem import problem_of
from urdfcal.calibration.result import FitResult
from urdfcal.calibration.start.nominal import with_new_places
from urdfcal.calibration.together import lie_together, nearest
from urdfcal.estimation.chi_squared import quantile
from urdfcal.estimation.residual import Linearisation
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.sensor import UNITS

MANY = 0.1  # share of the readings whose loss needs a word
_LOST = 0.1  # share of a joint's range that is left, under which its motion is lost
_LEAST_RANGE = {True: 5 * MM, False: 1 * DEG}  # motion that there was to lose, of sliding and of turning joints
_CLUSTERS, _SHARE = 6, 0.1  # poses of small clusters, and share of all poses that large ones have
_MOST, _SPARED = 0.75, 1 / 6  # share of a cluster that must be worse pose by pose, and of its farthest poses, which may be bad readings
_BY_CHANCE = 1e-3  # how often any cluster of a good calibration is called worse
_NAMED = 3  # poses, or joints, that a sentence has room for
_ROUNDING = 1e-3  # [main unit] by which nothing is worse than anything else
_WORDS = {"sag": "the joints' sag", "scale": "the encoders' scale", "eccentricity": "the encoders' eccentricity"}
_WORDS |= {"approach": "the direction of the last move"}

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
        named = ", ".join(self.poses[:_NAMED]) + (f" and {len(self.poses) - _NAMED} more" if len(self.poses) > _NAMED else "")
        kind = {"fit": "fitted", "test": "test", "k-fold": "left-out"}[self.set]
        return (
            f"at neighbouring {kind} poses ({named}) the calibrated robot is {self.calibrated:.3g} {self.unit} off (RMS), "
            f"the nominal one {self.nominal:.3g} {self.unit}"
        )


@dataclass(frozen=True)
class _Set:
    """Poses under the calibrated and the nominal robot.

    Attributes:
        name: `fit`, `test` or `k-fold`.
        data: All readings.
        calibrated, nominal: Their residuals.
        bad: Outliers that are scattered as bad readings are, (n, blocks); those that lie together are not among them.
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


def objections(found: FitResult) -> tuple[str, ...]:
    """Why the calibration must not be used, in words: a cluster of poses that is gravely worse than with the nominal robot."""
    return tuple(cluster.words() for cluster in _worst_clusters(found) if cluster.grave)[:1]


def reservations(found: FitResult) -> tuple[str, ...]:
    """What must be known before it is used, in words."""
    return (
        *many_outliers(found),
        *lost_motion(found),
        *outliers_together(found),
        *beyond_geometry(found),
        *worse_somewhere(found),
        *worst_poses(found),
        *bad_test_readings(found),
    )


def many_outliers(found: FitResult) -> tuple[str, ...]:
    """More than a tenth of the readings were left out."""
    out, read = _left_out(found)
    left = int(np.count_nonzero(out))
    if left <= MANY * np.count_nonzero(read):
        return ()
    return (f"{left} of {np.count_nonzero(read)} readings were left out as outliers; so many are seldom bad readings",)


def lost_motion(found: FitResult) -> tuple[str, ...]:
    """Joints that hardly move in what was kept, though they did in what was read."""
    out, read = _left_out(found)
    data = found.measured or found.data
    kept, seen = (read & ~out).any(axis=1), read.any(axis=1)
    if not kept.any() or kept.all():
        return ()
    lost = []
    for joint, values in zip(found.robot.chain.inputs, data.q.T, strict=True):
        whole, left = float(np.ptp(values[seen])), float(np.ptp(values[kept]))
        if whole > _LEAST_RANGE[joint.prismatic] and left < _LOST * whole:
            lost.append(joint.name)
    return (f"without the outliers nothing is left of the motion of {_listed(lost)}",) if lost else ()


def outliers_together(found: FitResult) -> tuple[str, ...]:
    """Readings that the fit could not explain lie together, as bad readings do not."""
    if not found.together:
        return ()
    return (
        f"readings that the fit cannot explain lie together ({'; '.join(found.together)}): that is a wrong model, or a rig that moved, "
        "rather than bad readings",
    )


def beyond_geometry(found: FitResult) -> tuple[str, ...]:
    """Readings that geometry alone would have left out, and more explains."""
    if not found.beyond:
        return ()
    names = " and ".join(_WORDS[name] for name in found.beyond)
    regained = f", without which {found.regained} more would be outliers" if found.regained else ""
    return (f"geometry alone does not explain the readings: the data ask for {names} beside it{regained}",)


def bad_test_readings(found: FitResult) -> tuple[str, ...]:
    """Gross outliers among the test readings, and beams that have no distance at all."""
    number, lost = len(found.test_outliers), sum(outlier.kind == "missed" for outlier in found.test_outliers)
    if not number:
        return ()
    missing = f", {lost} of which do not meet the screen in the calibrated robot and have no distance" if lost else ""
    return (f"{number} test reading{'s are' if number > 1 else ' is a'} gross outlier{'s' if number > 1 else ''}{missing}",)


def worst_poses(found: FitResult) -> tuple[str, ...]:
    """The farthest reading is no nearer than with the nominal robot: of the test poses, of those left out in turn, else of the fitted."""
    each = next(_held_out(found), None) or next(_fitted(found), None)
    if each is None:
        return ()
    unit, columns = _main(found, each.calibrated)
    after, before = (float(np.max(_distances(each, one)[:, columns], initial=0.0)) / UNITS[unit] for one in (each.calibrated, each.nominal))
    if not after > before + _ROUNDING:
        return ()
    kind = {"fit": "fitted", "test": "test", "k-fold": "left-out"}[each.name]
    return (f"the worst of the {kind} poses is {after:.3g} {unit} off, with the nominal robot the worst is {before:.3g} {unit}",)


def worse_somewhere(found: FitResult) -> tuple[str, ...]:
    """Neighbouring poses at which the calibrated robot is worse than the nominal one, though better than that is as a whole."""
    clusters = _worst_clusters(found)
    return () if any(cluster.grave for cluster in clusters) else tuple(cluster.words() for cluster in clusters[:1])


def worst_cluster(found: FitResult) -> Cluster | None:
    """The cluster of poses at which the calibrated robot is worst, of those where it is worse than the nominal one; None if it never is.

    All readings count, of the fitted, the test and the left-out poses.
    """
    return next(iter(_worst_clusters(found)), None)


def _worst_clusters(found: FitResult) -> list[Cluster]:
    """The worst one of each set, the gravest first."""
    clusters = [cluster for each in (*_held_out(found), *_fitted(found)) if (cluster := _worst_of(found, each)) is not None]
    return sorted(clusters, key=lambda cluster: -cluster.calibrated / max(cluster.usual, _ROUNDING))


def _worst_of(found: FitResult, each: _Set) -> Cluster | None:
    unit, _ = _main(found, each.calibrated)
    used = each.used & _numbers_of(each.calibrated, unit) & ~each.bad[:, each.calibrated.block_of]
    rows = np.flatnonzero(used.any(axis=1))
    if len(rows) < 2 * _CLUSTERS:
        return None
    c, n = (np.where(used, one.residual, 0.0)[rows] for one in (each.calibrated, each.nominal))
    sigma, q = found.estimate.noise.of_numbers(each.calibrated)[rows], each.data.q[rows]
    usual = _rms(n, used[rows], each.nominal) / UNITS[unit]
    best: Cluster | None = None
    for size in {_CLUSTERS, max(_CLUSTERS, round(_SHARE * len(rows)))}:
        for own in _worse(c / sigma, n / sigma, np.column_stack([np.arange(len(rows)), nearest(q, size - 1)])):
            after, before = (_rms(part[own], used[rows[own]], each.calibrated) / UNITS[unit] for part in (c, n))
            if after > before + _ROUNDING and (best is None or after > best.calibrated):
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
    test, noise = found.test_data, found.estimate.noise
    if test is not None and not test.empty:
        errors, x = with_new_places(found.errors, found.x, test, noise)
        model = problem_of(errors, test, noise)
        out = gross_mask(model, found.estimate)[: len(test)]
        together = lie_together(errors.chain, test, np.asarray(out.any(axis=1)))
        yield _set("test", test, model.linearise(x), found.nominal.linearise(test), out, bool(together))
    if found.folds is not None and found.folds.left_out is not None and len(found.folds.left_out[0].residual) == len(found.data):
        yield _set("k-fold", found.measured or found.data, *found.folds.left_out, _left_out(found)[0], bool(found.together))


def _fitted(found: FitResult) -> Iterator[_Set]:
    data = found.measured or found.data
    if not data.empty:
        calibrated = problem_of(found.errors, data, found.estimate.noise).linearise(found.x)
        yield _set("fit", data, calibrated, found.nominal.linearise(data), _left_out(found)[0], bool(found.together))


def _set(name: str, data: Measurements, calibrated: Linearisation, nominal: Linearisation, out: Mask, together: bool) -> _Set:
    bad = np.zeros_like(out) if together else out
    return _Set(name, data, calibrated.of_poses(len(data)), nominal.of_poses(len(data)), bad)


def _distances(each: _Set, one: Linearisation) -> Matrix:
    """Length of every reading's residual, (n, blocks)."""
    residual = np.where(each.used, one.residual, 0.0)
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


def _left_out(found: FitResult) -> tuple[Mask, Mask]:
    """Which readings of the fitted poses were left out, and which were read, (n, readings)."""
    kept, read = (_read(data) for data in (found.data, found.measured or found.data))
    return read & ~kept, read


def _read(data: Measurements) -> Mask:
    return np.column_stack([reading.measured.any(axis=1) for reading in data.readings])


def _listed(names: list[str]) -> str:
    return ", ".join(names[:_NAMED]) + (f" and {len(names) - _NAMED} more" if len(names) > _NAMED else "")


def left_out_share(found: FitResult) -> float:
    """Share of the readings of the fitted poses that were left out."""
    out, read = _left_out(found)
    return int(np.count_nonzero(out)) / max(int(np.count_nonzero(read)), 1)


def pose_distances(found: FitResult) -> tuple[Vector, Vector]:
    """Farthest reading of each held-out pose, else of each fitted one, with the calibrated and with the nominal robot, in the main unit."""
    each = next(_held_out(found), None) or next(_fitted(found))
    unit, columns = _main(found, each.calibrated)
    sizes = [_distances(each, one)[:, columns] / UNITS[unit] for one in (each.calibrated, each.nominal)]
    return np.asarray(np.max(sizes[0], axis=1)), np.asarray(np.max(sizes[1], axis=1))
