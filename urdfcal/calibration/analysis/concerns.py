"""What speaks against a calibration, as text: parts of the robot's motion where it is worse than none, and what the gate took away.

Every figure is of all readings, those included that were taken out as outliers.
"""

from __future__ import annotations

import numpy as np

from urdfcal.base.geometry import DEG, MM
from urdfcal.base.terminal import rounded
from urdfcal.calibration.analysis.clusters import MANY, ROUNDING, SETS, judged_set, left_out, listed, pose_distances, worst_clusters
from urdfcal.calibration.analysis.uncounted_lens import uncounted_lens
from urdfcal.calibration.asking.stands_out import WORDS
from urdfcal.calibration.error_table import main_unit
from urdfcal.calibration.result import FitResult

_LOST = 0.1  # share of a joint's range that is left, under which its motion is lost
_LEAST_RANGE = {True: 5 * MM, False: 1 * DEG}  # motion that there was to lose, of sliding and of turning joints
_MUCH = 0.1  # share of what a fit leaves unexplained, from which whoever uses it has to know what explains it


def objections(found: FitResult) -> tuple[str, ...]:
    """Why the calibration must not be used, in words: a cluster of poses that is gravely worse than with the nominal robot."""
    return tuple(cluster.words() for cluster in worst_clusters(found) if cluster.grave)[:1]


def reservations(found: FitResult) -> tuple[str, ...]:
    """What must be known before it is used, in words."""
    return (
        *many_outliers(found),
        *lost_motion(found),
        *outliers_together(found),
        *beyond_geometry(found),
        *worse_somewhere(found),
        *uncounted_lens(found),
        *worst_poses(found),
        *bad_test_readings(found),
    )


def many_outliers(found: FitResult) -> tuple[str, ...]:
    """More than a tenth of the readings were left out."""
    out, read = left_out(found)
    left = int(np.count_nonzero(out))
    if left <= MANY * np.count_nonzero(read):
        return ()
    return (f"{left} of {np.count_nonzero(read)} readings were left out as outliers; so many are seldom bad readings",)


def lost_motion(found: FitResult) -> tuple[str, ...]:
    """Joints that hardly move in what was kept, though they did in what was read."""
    out, read = left_out(found)
    data = found.read
    kept, seen = (read & ~out).any(axis=1), read.any(axis=1)
    if not kept.any() or kept.all():
        return ()
    lost = []
    for joint, values in zip(found.robot.chain.inputs, data.q.T, strict=True):
        whole, left = float(np.ptp(values[seen])), float(np.ptp(values[kept]))
        if whole > _LEAST_RANGE[joint.prismatic] and left < _LOST * whole:
            lost.append(joint.name)
    return (f"without the outliers nothing is left of the motion of {listed(lost)}",) if lost else ()


def outliers_together(found: FitResult) -> tuple[str, ...]:
    """Readings that the fit could not explain lie together, as bad readings do not."""
    if not found.together:
        return ()
    return (
        f"readings that the fit cannot explain lie together ({'; '.join(found.together)}): that is a wrong model, or a rig that moved, "
        "rather than bad readings",
    )


def beyond_geometry(found: FitResult) -> tuple[str, ...]:
    """What readings ask for that geometry has no word for, and that is not in the fit."""
    out = {own.what: WORDS[own.what] for own in found.stands_out if own.share >= _MUCH and not own.in_fit}
    names = list((out | {name: WORDS[name] for name in found.beyond}).values())
    if not names:
        return ()
    regained = f", without which {found.regained} more would be outliers" if found.regained else ""
    widened = "; what that does is in the sigmas" if out else ""
    return (f"geometry alone does not explain the readings: the data ask for {listed(names)} beside it{regained}{widened}",)


def bad_test_readings(found: FitResult) -> tuple[str, ...]:
    """Gross outliers among the test readings, and beams that have no distance at all."""
    number, lost = len(found.test_outliers), sum(outlier.kind == "missed" for outlier in found.test_outliers)
    if not number:
        return ()
    missing = f", {lost} of which do not meet the screen in the calibrated robot and have no distance" if lost else ""
    return (f"{number} test reading{'s are' if number > 1 else ' is a'} gross outlier{'s' if number > 1 else ''}{missing}",)


def worst_poses(found: FitResult) -> tuple[str, ...]:
    """The farthest reading is no nearer than with the nominal robot: of the test poses, of those left out in turn, else of the fitted."""
    if found.read.empty:
        return ()
    after, before = (float(np.max(distances, initial=0.0)) for distances in pose_distances(found))
    if not after > before + ROUNDING:
        return ()
    unit, kind = main_unit(found.after), SETS[judged_set(found)]
    return (
        f"the worst of the {kind} poses is {rounded(after, 3)} {unit} off, with the nominal robot the worst is {rounded(before, 3)} {unit}",
    )


def worse_somewhere(found: FitResult) -> tuple[str, ...]:
    """Neighbouring poses at which the calibrated robot is worse than the nominal one, though better than that is as a whole."""
    clusters = worst_clusters(found)
    return () if any(cluster.grave for cluster in clusters) else tuple(cluster.words() for cluster in clusters[:1])
