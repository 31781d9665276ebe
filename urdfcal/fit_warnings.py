"""What the user ought to know of a fit's noise and scales."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from urdfcal.error_model import DEFAULT_PRIORS
from urdfcal.evidence import Evidence
from urdfcal.geometry import MM, Vector
from urdfcal.measurements import Measurements
from urdfcal.noise import LEAST_FREEDOM, Noise
from urdfcal.reading_kinds import KINDS

_FAR = 3.0  # times the default prior, beyond which a scale that the data chose is no robot's
_CHI_SIGMAS = 4.0  # how far chi-squared may stray before stated and seen noise disagree


def disagreement(kinds: Sequence[str], noise: Noise, misfits: Vector, freedom: Vector) -> tuple[str, ...]:
    """Chi-squared far from its degrees of freedom: the noise that was stated is not the noise that is seen.

    Args:
        kinds: What was measured, in the order of the noise.
        noise: Of the measurements.
        misfits: Chi-squared per degree of freedom of each kind, (kinds,).
        freedom: Those degrees, (kinds,).
    """
    warnings = []
    for kind, stated, misfit, free in zip(kinds, noise.stated.tolist(), misfits.tolist(), freedom.tolist(), strict=True):
        if not stated or free < LEAST_FREEDOM or abs(misfit - 1) < _CHI_SIGMAS * np.sqrt(2 / free):
            continue
        what, times = KINDS[kind].several, np.sqrt(misfit)
        warnings.append(
            f"the {what} scatter {times:.2g} times as much as the stated noise explains (chi-square {misfit:.3g} per degree of freedom): "
            f"{'the sigmas are too small' if times > 1 else 'the sigmas are too large'}; leave the noise out to have it estimated"
        )
    return tuple(warnings)


def few_spots(data: Measurements, noise: Noise, freedom: float) -> tuple[str, ...]:
    """Noise that is assumed, since there are too few measurements to estimate it."""
    if noise.all_stated or freedom >= LEAST_FREEDOM:
        return ()
    if data.readings:
        return (
            f"too few measurements to estimate their noise ({freedom:.0f} degrees of freedom, {LEAST_FREEDOM:.0f} are needed): usual "
            "figures are assumed; measure more poses or state it in .sigma columns",
        )
    return (
        f"too few spots to estimate their noise ({freedom:.0f} degrees of freedom, {LEAST_FREEDOM:.0f} are needed): "
        f"{noise.spot_sigma / MM:g} mm is assumed; measure more poses or state it with --spot-sigma-mm",
    )


def large_scales(chosen: Evidence | None) -> tuple[str, ...]:
    """Joint errors that are far larger than a robot's usually are."""
    usual = DEFAULT_PRIORS["joint"]
    scales = chosen.scales if chosen is not None else {}
    large = [name for name, scale in scales.items() if scale > _FAR * usual.sigma("m" if name == "translation" else "rad")]
    if not large:
        return ()
    sizes = ", ".join(f"{name} {scales[name] / MM:.3g} {'mm' if name == 'translation' else 'mrad'}" for name in large)
    return (f"the data ask for joint errors far larger than robots have ({sizes}); check the URDF, the joints' units, zeros and signs",)
