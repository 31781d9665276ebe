"""What one more pose of the same kind would say: how much the data would tell if more had been taken.

A further pose takes each joint's position from a pose of its own, so that it lies within the ranges of those that were measured and
is none of them. What the sensors would read there is what the model predicts. Touches reach their place at no such pose: there, as many
more of the same are taken.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from urdfcal.base.geometry import Matrix, Vector
from urdfcal.calibration.problem import Problem, problem_of
from urdfcal.estimation.noise import Noise
from urdfcal.estimation.residual import Linearisation
from urdfcal.model.error_model import ErrorModel
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.sensor import UNITS

FURTHER = (5, 10, 15, 20, 30, 40, 60, 80, 120, 160, 240, 320)  # poses that are tried beyond those that there are
_TRIED = 300  # further poses that are looked at
_FAR_OFF = 1e5  # [mm, deg or px per rad] beams that graze the screen tell nothing that anyone could read


def information_of_a_pose(errors: ErrorModel, data: Measurements, noise: Noise, x: Vector, rng: np.random.Generator) -> Matrix:
    """What a further pose tells on average: its whitened H'H, (p, p).

    Args:
        errors: The error model.
        data: The poses that there are.
        noise: Of their readings.
        x: Where the measurement is linearised, (p,).
        rng: Source of randomness.
    """
    data = replace(data, lengths=())
    further = data if any(reading.kind.touches for reading in data.readings) else _elsewhere(errors, data, x, rng)
    linearisation = without_lost(problem_of(replace(errors, held_sum={}, earlier=None), further, noise).linearise(x))
    if further is not data:  # drawn poses are poses of their own, also where some of them came out the same
        linearisation = replace(linearisation, poses=None)
    return np.asarray(noise.normal(linearisation).A / (data.pose_count if further is data else len(further)))


def _elsewhere(errors: ErrorModel, data: Measurements, x: Vector, rng: np.random.Generator) -> Measurements:
    """Poses between those that were measured, with the readings that are predicted there."""
    there = data.subset(rng.integers(0, len(data), _TRIED))
    there = replace(there, q=np.column_stack([rng.permutation(column) for column in there.q.T]))
    with np.errstate(invalid="ignore"):
        values = Problem(errors, there).read(x)
    readings = (replace(own, values=np.where(own.seen[:, None], read, np.nan)) for own, read in zip(there.readings, values, strict=True))
    return replace(there, readings=tuple(readings))


def without_lost(linearisation: Linearisation) -> Linearisation:
    """Readings that could not be made do not count."""
    J, sizes = linearisation.jacobian, np.empty(linearisation.residual.shape[1])
    for block in linearisation.blocks:
        sizes[block.columns] = UNITS[block.unit]
    bad = ~np.isfinite(J).all(axis=2) | ~np.isfinite(linearisation.residual) | (np.abs(J).max(axis=2, initial=0.0) > _FAR_OFF * sizes)
    if linearisation.lost is not None:
        bad = bad | linearisation.lost[:, linearisation.block_of]
    return replace(
        linearisation,
        residual=np.where(bad, 0.0, linearisation.residual),
        jacobian=np.where(bad[..., None], 0.0, J),
        joint_jacobian=np.where(bad[..., None], 0.0, linearisation.joint_jacobian),
    )


def covariance(information: Matrix, sigma: Vector) -> Matrix:
    """(information + diag(sigma)^-2)^-1, (p, p): in units of the prior, and by eigenvalues, so that it is positive whatever they are."""
    values, vectors = np.linalg.eigh(information * np.outer(sigma, sigma))
    scaled = (vectors / (1 + np.maximum(values, 0.0))) @ vectors.T
    return np.asarray(scaled * np.outer(sigma, sigma))
