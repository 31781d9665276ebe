"""What cameras' lenses leave out of the sigmas of a fit that takes them as their files have them: a considered parameter's share.

A lens with the covariance F F', taken as it stands, moves the answer by G z with G = -P H' L for z ~ N(0, 1): P is the fit's covariance, H
its whitened Jacobian, and L the one by the lens, in units of F.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from urdfcal.base.geometry import Vector
from urdfcal.calibration.analysis.suggestions import whitened
from urdfcal.calibration.result import FitResult
from urdfcal.model.gauge import lens_parameters
from urdfcal.sensors.measurements import as_measured, refining

_MATTERS = 0.5  # of a sigma, by which a lens may move a parameter before it has to be said


def uncounted_lens(found: FitResult) -> tuple[str, ...]:
    """A word where the lenses' own uncertainty moves joints by much of their sigmas, and is not in these."""
    known = [name for name, camera in found.data.seeing.items() if camera is not None and camera.lens_covariance is not None]
    if found.data.refines or not known:
        return ()
    share = moved_by_lenses(found, known)
    told = zip(found.errors.parameters, found.identifiability.determined, share.tolist(), strict=True)
    worst = max((moved for own, determined, moved in told if own.kind == "joint" and determined), default=0.0)
    if worst < _MATTERS:
        return ()
    lenses = f"the {'lenses' if len(known) > 1 else 'lens'} of {' and '.join(known)}" if known != ["camera"] else "the camera's lens"
    return (
        f"how well {lenses} {'are' if len(known) > 1 else 'is'} known is not in the sigmas, and may move joints by {worst:.1f} of theirs: "
        "--estimate lens refines what the readings tell of it, and counts the rest",
    )


def moved_by_lenses(found: FitResult, names: list[str]) -> Vector:
    """By how much lenses that are off by one standard deviation of their calibration move each parameter, in its sigmas, (p,)."""
    data, p = refining(found.data, lens=True), len(found.errors.names)
    lenses = [own for own in lens_parameters(as_measured(found.robot, data).rig) if own.name.rpartition(".")[0] in names]
    errors = replace(found.errors, parameters=(*found.errors.parameters, *lenses))
    J = whitened(errors, data, found.estimate.noise, np.append(found.x, np.zeros(len(lenses))))
    J = J.reshape(-1, J.shape[-1])
    gain = found.estimate.belief.P @ (J[:, :p].T @ J[:, p:])
    return np.asarray(np.linalg.norm(gain, axis=1) / found.sigma)
