"""Whether a fit from the prior can be believed, and where to begin if not."""

from __future__ import annotations

import numpy as np

from urdfcal.ekf import Estimate
from urdfcal.error_model import ErrorModel
from urdfcal.errors import FitRejected
from urdfcal.geometry import Vector
from urdfcal.hypotheses import Hypothesis, best_hypothesis
from urdfcal.noise import Noise
from urdfcal.reading_hypotheses import best_reading_hypothesis, readings_explained
from urdfcal.spot_model import SpotModel
from urdfcal.start import INCREDIBLE, Start, find_start

_NEAR = 5e-3  # [m] median distance beyond which a fit from the prior is not taken for granted


def explains(model: SpotModel, found: Estimate, noise: Noise) -> bool:
    """Whether a fit from the prior put most spots where they were seen and believes nothing that the prior does not.

    Else the start or the data need a second look: a robot shrunk to nothing explains spots in the wrong unit, and a module that is
    turned round explains a joint that was read off by a right angle.
    """
    if np.any(np.abs(found.belief.x - model.errors.mean) > INCREDIBLE * model.errors.sigma):
        return False
    distance = np.linalg.norm(model.predict(found.belief.x)[0] - model.data.spots, axis=-1)
    near = max(_NEAR, 3 * noise.spot_sigma if noise.all_stated else 0.0)
    return found.converged and bool(np.nanmedian(distance) < near)


def begin(model: SpotModel, noise: Noise, sane: bool) -> Start:
    """Where to begin when the prior is too far off: where the rig is found to be; data with a common mistake in them are refused.

    Raises:
        FitRejected: names the mistake.
    """
    begun = find_start(model, noise)
    if sane and not begun.plausible:
        _refuse(best_hypothesis(model, noise))
    return begun


def require_sane_readings(errors: ErrorModel, model: SpotModel, found: Estimate, noise: Noise) -> None:
    """Refuse readings of instruments beside lasers that a common mistake explains far better.

    Args:
        errors: The error model before its instruments were placed.
        model: Of the measurements, with the instruments placed.
        found: Their fit.
        noise: As stated, or where its estimation started.

    Raises:
        FitRejected: names the mistake.
    """
    if any(not model.data.of_laser(each) for each in model.data.readings) and not readings_explained(model, found, noise):
        _refuse(best_reading_hypothesis(errors, model.data, noise))


def _refuse(mistake: Hypothesis | None) -> None:
    if mistake is not None:
        raise FitRejected(f"{mistake.words}; mend the measurements, or fit them as they are with --no-sanity", forceable=False)


def require_beams_on_screen(model: SpotModel, x: Vector) -> None:
    """Stop where a beam that was seen does not meet the screen in the model.

    Raises:
        FitRejected: names pose and laser.
    """
    missing = model.unreached(x)
    if missing is not None:
        pose, laser = missing
        raise FitRejected(
            f"{model.data.where(pose)}: {model.data.lasers[laser]} was seen, but in the model its beam does not meet the screen; "
            "check the mount of the module, the screen's placement and the joints' units and signs",
            forceable=False,
        )
