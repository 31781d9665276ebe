"""What the user ought to know of a fit's noise and scales."""

from __future__ import annotations

from urdfcal.error_model import DEFAULT_PRIORS
from urdfcal.evidence import Evidence
from urdfcal.fit_result import FitResult
from urdfcal.geometry import MM
from urdfcal.measurements import Measurements
from urdfcal.noise import LEAST_FREEDOM, Noise
from urdfcal.reading_kinds import KINDS, start_sigma_of

_LARGE = 10.0  # times the usual noise, beyond which it is no noise
_FAR = 3.0  # times the default prior, beyond which a scale that the data chose is no robot's


def disagreement(found: FitResult) -> tuple[str, ...]:
    """Chi-squared far from its degrees of freedom: the noise that was stated is not the noise that is seen."""
    return tuple(f"{words}; leave the noise out to have it estimated" for words in found.disagreements)


def large_noise(found: FitResult) -> tuple[str, ...]:
    """Noise that was estimated far beyond what is usual: something is wrong with the data, or the model cannot follow."""
    warnings = []
    for kind, sigma, stated in zip(found.kinds, found.estimate.noise.sigma.tolist(), found.estimate.noise.stated, strict=True):
        if not stated and sigma > _LARGE * start_sigma_of(kind):
            warnings.append(
                f"the {KINDS[kind].several} scatter by {KINDS[kind].told(sigma)} after the fit, far more than is usual; look for rows, "
                "columns or units that do not belong together, and for what the URDF lacks"
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
