"""Readings that the nominal robot explains better than the calibrated one: no outliers, the calibration is wrong there.

Where outliers lie together (`together.py`) and the nominal robot explains most of them better, and as well as it does other readings,
those are none. A scattered one may be nearer to it by chance: a bad reading is off in any direction. Seen from where the calibrated
robot has it, the nominal robot's prediction lies in a direction of its own, and chance points a bad reading of m numbers as near to it
as the angle t with probability 1/2 I(sin^2 t; (m-1)/2, 1/2) (the share of a sphere's cap; I is the regularised incomplete beta
function). It is none where that is no chance, and the nominal robot has it where it was read.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from urdfcal.base.geometry import Mask, Matrix, Vector
from urdfcal.estimation.noise import Noise
from urdfcal.estimation.residual import Linearisation
from urdfcal.estimation.robust import ordinary, within_noise

_MOST = 0.75  # share of outliers that lie together that the nominal robot must explain
_BY_CHANCE = 0.01  # how often any of the scattered outliers may be taken for one that the nominal robot explains


@dataclass(frozen=True)
class _Compared:
    """Gated readings of each pose, in units of their noise.

    Attributes:
        calibrated: Length of the residual with the calibrated robot, (n,).
        nominal: The same with the nominal one.
        cosine: Of the angle between the reading and the nominal prediction, seen from the calibrated one, (n,).
        numbers: How many numbers, (n,).
    """

    calibrated: Vector
    nominal: Vector
    cosine: Vector
    numbers: Vector

    @property
    def better(self) -> Mask:
        return np.asarray((self.numbers > 0) & (self.nominal < self.calibrated))

    @property
    def chance(self) -> Vector:
        """Probability that a reading that is off in any direction points so nearly to the nominal prediction, (n,)."""
        from scipy.special import betainc

        half = np.where(self.numbers > 1, betainc(np.maximum(self.numbers - 1, 1) / 2, 0.5, 1 - self.cosine**2), 1.0) / 2
        return np.where(self.cosine > 0, half, 1 - half)


def explained_by_nominal(calibrated: Linearisation, nominal: Linearisation, noise: Noise, out: Mask, together: bool) -> Mask:
    """Which readings that were taken for outliers are none, (n, blocks).

    Args:
        calibrated: All poses with the calibrated robot.
        nominal: With the nominal one.
        noise: Of the measurements.
        out: What was taken for outliers, (n, blocks).
        together: Whether those lie together.
    """
    read, outliers = out & ~_lost(calibrated) & ~_lost(nominal), np.count_nonzero(out.any(axis=1))
    of_sensors = replace(noise, joint_sigma=np.zeros_like(noise.joint_sigma))
    usual = read & (ordinary(nominal, of_sensors, kept=~out) if together else within_noise(nominal, of_sensors))
    compared = _compare(calibrated, nominal, noise, usual)
    if together:
        back = compared.better & (np.count_nonzero(compared.better) >= _MOST * outliers)
    else:
        back = compared.better & (compared.chance * outliers < _BY_CHANCE)
    return np.asarray(usual & back[:, None])


def _lost(linearisation: Linearisation) -> Mask:
    return np.zeros_like(linearisation.made) if linearisation.lost is None else linearisation.lost


def _compare(calibrated: Linearisation, nominal: Linearisation, noise: Noise, out: Mask) -> _Compared:
    numbers = calibrated.measured & out[:, calibrated.block_of]
    sigma = noise.of_numbers(calibrated)
    c, n = (np.where(numbers, each.residual / sigma, 0.0) for each in (calibrated, nominal))
    towards = c - n
    lengths = np.maximum(_length(c) * _length(towards), np.finfo(float).tiny)
    return _Compared(_length(c), _length(n), np.clip((c * towards).sum(axis=1) / lengths, -1, 1), numbers.sum(axis=1))


def _length(rows: Matrix) -> Vector:
    return np.asarray(np.linalg.norm(rows, axis=1))
