"""Noise as it is stated for kinds of readings, with each of them, or not at all: then it says where its estimation starts."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from urdfcal.errors import ShapeMismatch, UsageError
from urdfcal.geometry import Vector
from urdfcal.measurements import Measurements
from urdfcal.noise import Noise
from urdfcal.robot import Robot
from urdfcal.spot_model import kinds_of, start_sigma


def stated_noise(data: Measurements, spot_sigma: float | None, sigmas: Mapping[str, float] | None = None) -> dict[str, float]:
    """Noise that is stated by kind of reading, [m], [rad] or [px].

    Raises:
        UsageError: nothing of that kind was measured, or the noise is not above zero.
    """
    stated, kinds = {**(sigmas or {}), **({} if spot_sigma is None else {"spot": spot_sigma})}, kinds_of(data)
    for kind, sigma in stated.items():
        if kind not in kinds:
            raise UsageError(f"noise of a {kind} is stated, but the measurements have none; they have {', '.join(kinds)}")
        if not sigma > 0:
            raise UsageError(f"the {kind} noise must be above zero, found {sigma:g}")
    return stated


def noise_of(data: Measurements, known: Mapping[str, float], joint_sigma: Vector) -> Noise:
    """Noise of every kind of measurement: stated with the measurements, known by kind, or where its estimation starts."""
    sigma, stated = start_sigma(data), np.zeros(len(kinds_of(data)), dtype=bool)
    for kind, name in enumerate(kinds_of(data)):
        of_targets = [each.sigma[each.seen] for each in data.readings if each.kind == name]
        own = data.sigma[data.seen] if name == "spot" else np.concatenate(of_targets)
        if not len(own):  # nothing to estimate it from, and nothing that it matters to
            stated[kind] = True
        elif np.isfinite(own).all():
            sigma[kind], stated[kind] = np.sqrt(np.mean(own**2)), True
        elif name in known:
            sigma[kind], stated[kind] = known[name], True
    return Noise(sigma, joint_sigma, stated)


def joint_sigmas(robot: Robot, joint_sigma: float | Vector) -> Vector:
    """Standard deviation of every measured joint: one number for all turning joints, or one a joint, (inputs,)."""
    turning = np.array([0.0 if joint.prismatic else 1.0 for joint in robot.chain.inputs])
    sigmas = np.asarray(joint_sigma, dtype=float)
    if sigmas.ndim and sigmas.shape != turning.shape:
        raise ShapeMismatch(f"the joint noise is one number, or {len(turning)}; found shape {sigmas.shape}")
    if not (np.isfinite(sigmas).all() and (sigmas >= 0).all()):
        raise UsageError("the joint noise must be finite and not negative")
    return sigmas * turning if sigmas.ndim == 0 else sigmas
