"""Noise as it is stated for kinds of readings, with each of them, or not at all: then it says where its estimation starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from urdfcal.base.errors import ShapeMismatch, UsageError
from urdfcal.base.geometry import Vector
from urdfcal.estimation.noise import Noise
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements, start_sigma
from urdfcal.sensors.registry import noun


def stated_noise(data: Measurements, spot_sigma: float | None, sigmas: Mapping[str, float] | None = None) -> dict[str, float]:
    """Noise that is stated by kind of reading, [m], [rad] or [px].

    Raises:
        UsageError: nothing of that kind was measured, every reading of it states its own noise, or the noise is not above zero.
    """
    stated, kinds = {**(sigmas or {}), **({} if spot_sigma is None else {"spot": spot_sigma})}, data.kinds
    for kind, sigma in stated.items():
        if kind not in kinds:
            raise UsageError(f"noise of a {kind} is stated, but the measurements have none; they have {', '.join(kinds)}")
        if not 0 < sigma < np.inf:
            raise UsageError(f"the {kind} noise must be above zero and finite, found {sigma:g}")
        if states_all(data, kind):
            raise UsageError(f"every {noun(kind, 1)} states its own noise in a .sigma column; leave out that, or the {kind} noise")
    return stated


def noise_of(data: Measurements, known: Mapping[str, float], joint_sigma: Vector) -> Noise:
    """Noise of every kind of measurement: stated with the measurements, known by kind, or where its estimation starts."""
    sigma, stated = start_sigma(data), np.zeros(len(data.kinds), dtype=bool)
    for kind, name in enumerate(data.kinds):
        own = _own_sigma(data, name)
        if not len(own):  # nothing to estimate it from, and nothing that it matters to
            stated[kind] = True
        elif states_all(data, name):
            sigma[kind], stated[kind] = np.sqrt(np.mean(own**2)), True
        elif name in known:
            sigma[kind], stated[kind] = known[name], True
    return Noise(sigma, joint_sigma, stated)


def noise_for(noise: Noise, kinds: Sequence[str], data: Measurements) -> Noise:
    """The noise of some kinds of readings as another set has them, in its own order; what it alone has is as usual, and stated.

    Args:
        noise: Of the kinds, as a fit has it.
        kinds: Those kinds, in its order.
        data: The other set.
    """
    if data.kinds == tuple(kinds):
        return noise
    index = [kinds.index(kind) if kind in kinds else -1 for kind in data.kinds]
    new = np.array(index) < 0

    def of_kinds(known: Vector, usual: Any) -> Vector:
        return np.where(new, usual, np.append(known, known[:1])[index])

    return replace(
        noise, sigma=of_kinds(noise.sigma, start_sigma(data)), stated=of_kinds(noise.stated, True), common=of_kinds(noise.common, 1.0)
    )


def stating_kinds(data: Measurements) -> frozenset[str]:
    """Kinds of readings of which any state their own noise."""
    return frozenset(kind for kind in data.kinds if np.isfinite(_own_sigma(data, kind)).any())


def states_all(data: Measurements, kind: str) -> bool:
    """Whether every reading of a kind states its own noise."""
    own = _own_sigma(data, kind)
    return bool(len(own) and np.isfinite(own).all())


def _own_sigma(data: Measurements, kind: str) -> Vector:
    """What every reading of a kind states of its own noise, nan for nothing."""
    return np.concatenate([reading.sigma[reading.seen] for reading in data.readings if reading.noise == kind])


def joint_sigmas(robot: Robot, joint_sigma: float | Vector) -> Vector:
    """Standard deviation of every measured joint: one number for all turning joints, or one a joint, (inputs,)."""
    turning = np.array([0.0 if joint.prismatic else 1.0 for joint in robot.chain.inputs])
    sigmas = np.asarray(joint_sigma, dtype=float)
    if sigmas.ndim and sigmas.shape != turning.shape:
        raise ShapeMismatch(f"the joint noise is one number, or {len(turning)}; found shape {sigmas.shape}")
    if not (np.isfinite(sigmas).all() and (sigmas >= 0).all()):
        raise UsageError("the joint noise must be finite and not negative")
    return sigmas * turning if sigmas.ndim == 0 else sigmas
