"""Readings of one pose: what they have in common, and what each has of its own.

With p what a pose has in common (an arm that comes back a little elsewhere, a target seated anew, what no error model follows) and e what
one reading has of its own (the sensor), readings i of pose g are

    y_gi = J_g x + p_g + e_gi,   var p = rho sigma^2,   var e = (1 - rho) sigma^2

where sigma is the standard deviation of a single reading and rho the *intraclass correlation*. J is the same for all of them, so that
their mean holds all that they say of x, with a variance of sigma^2 (1 - rho + rho k) / k, and their scatter about it holds all that
they say of e. So k copies of a reading, rho = 1, are worth one, and k readings whose noise is their own, rho = 0, are worth k.

The variances follow from the scatter within poses and that of their means, the latter by Paule and Mandel (Consensus values and
weighting factors, 1982), the moment estimator that allows for poses of different numbers of readings.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from urdfcal.base.geometry import Array3, Matrix, Vector
from urdfcal.estimation.residual import Kinds, Linearisation

_STILL = 1e-9  # share of a variance
_CHI_SQUARED_MEDIAN = 0.454936  # of one degree of freedom


@dataclass(frozen=True)
class PoseMeans:
    """From the numbers of readings to those of poses, and back.

    A mean is taken as b = sum of u_i y_i / sigma_i with u a unit vector over the readings, so that independent readings give it unit
    variance; putting u_i b in the place of every reading keeps sums of squares, and with them information and chi-squared.

    Attributes:
        poses: Index of the pose of each row, (n,).
        unit: u, (n, m); 0 where nothing was measured.
        weight: u over sigma, (n, m).
        readings: How many readings each number of a pose has, (poses, m); what is weighed down counts for less. 1 where there is none.
        seen: Which numbers of a pose were measured at all, (poses, m).
    """

    poses: Kinds
    unit: Matrix
    weight: Matrix
    readings: Matrix
    seen: Any

    @staticmethod
    def of(linearisation: Linearisation, sigma: Matrix) -> PoseMeans:
        """Those of a set whose readings have these standard deviations, (n, m)."""
        poses = np.arange(len(linearisation.residual)) if linearisation.poses is None else linearisation.poses
        root = np.where(linearisation.measured, 1.0 if linearisation.root is None else linearisation.root, 0.0)
        precise = root / sigma
        squared, most = total(poses, precise**2), np.zeros((poses.max() + 1, root.shape[1]))
        np.maximum.at(most, poses, root**2)
        seen = squared > 0
        unit = precise / np.sqrt(np.where(seen, squared, 1.0))[poses]
        readings = np.where(seen, total(poses, root**2) / np.where(seen, most, 1.0), 1.0)
        return PoseMeans(poses, unit, unit / sigma, readings, seen)

    def gathered(self, rows: Array3) -> Array3:
        """Numbers of readings, (n, m, c), as those of poses, (poses, m, c), in units of the readings' standard deviations."""
        return np.asarray(total(self.poses, rows * self.weight[..., None]))

    def spread(self, rows: Array3) -> Array3:
        """Numbers of poses, (poses, m, c), laid out over their readings, (n, m, c)."""
        return np.asarray(rows[self.poses] * self.unit[..., None])


def total(poses: Kinds, rows: Any) -> Any:
    """Sums over the rows of each pose, (poses, ...)."""
    order = np.argsort(poses, kind="stable")
    first = np.flatnonzero(np.diff(poses[order], prepend=-1))
    return np.add.reduceat(rows[order], first, axis=0)


@dataclass(frozen=True)
class Scatter:
    """Of the readings of one pose about their mean, by kind of noise, in units of their variance.

    Attributes:
        variance: (kinds,); 0 where no pose has two readings.
        freedom: Degrees of freedom, (kinds,).
    """

    variance: Vector
    freedom: Vector


def scatter_within(linearisation: Linearisation, sigma: Matrix, *, robust: bool = False) -> Scatter:
    """How readings scatter about the mean of their pose.

    Args:
        linearisation: Residual of a set of which some rows are readings of one pose.
        sigma: Standard deviation of each number, (n, m).
        robust: Whether by the median square instead of the mean one, which outliers do not bend.
    """
    means = PoseMeans.of(linearisation, sigma)
    about = linearisation.residual / sigma - means.spread(means.gathered(linearisation.residual[..., None]))[..., 0]
    own = 1 - means.unit**2  # share of its own noise that a reading keeps beside its mean
    repeated = linearisation.measured & (own > _STILL)
    squares = np.where(repeated, about**2, 0.0)
    freedom = linearisation.of_kinds(np.where(repeated, own, 0.0))
    if not robust:
        return Scatter(linearisation.of_kinds(squares) / np.maximum(freedom, 1.0), freedom)
    medians = [
        float(np.median((squares / np.where(repeated, own, 1.0))[which])) / _CHI_SQUARED_MEDIAN if which.any() else 0.0
        for which in (repeated & (linearisation.kinds == kind) for kind in range(len(freedom)))
    ]
    return Scatter(np.array(medians), freedom)


def beyond(known: Vector, squares: Vector, freedom: float) -> float:
    """The s with sum(r^2 / (known + s^2)) = freedom; 0 where the sum is not above it anyway.

    The sum falls with s^2 and is convex, so that Newton's steps from 0 rise to the solution and never pass it.
    """
    if np.sum(squares / known) <= freedom:
        return 0.0
    s_squared, step = 0.0, np.inf
    while step > _STILL * s_squared:
        weights = 1 / (known + s_squared)
        step = float((np.sum(squares * weights) - freedom) / np.sum(squares * weights**2))
        s_squared += step
    return float(np.sqrt(s_squared))
