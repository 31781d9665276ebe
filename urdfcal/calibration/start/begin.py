"""Where a fit begins: the prior where it can be believed, else where the rig is found to be.

Three kinds of data need a word before: spots in pixels begin where the same spots on the screen lead, touches of unknown places fit an
arm of any size, whose scale is then held, and data with a common mistake in them are refused.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from urdfcal.base.errors import FitRejected
from urdfcal.base.geometry import Vector
from urdfcal.calibration.problem import Problem, problem_of
from urdfcal.calibration.start.hypotheses import Hypothesis
from urdfcal.calibration.start.reading_hypotheses import best_reading_hypothesis, readings_explained
from urdfcal.calibration.start.references import links_of_reference
from urdfcal.calibration.start.rig_search import INCREDIBLE, Start, find_start
from urdfcal.calibration.start.spot_hypotheses import best_spot_hypothesis
from urdfcal.estimation.ekf import Belief, Estimate
from urdfcal.estimation.estimators import Method
from urdfcal.estimation.noise import Noise
from urdfcal.model.error_model import ErrorModel
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements, as_spots, unreached_words
from urdfcal.sensors.registry import start_sigma_of

_NEAR = 5e-3  # [m] median distance beyond which a fit from the prior is not taken for granted


def is_credible(model: Problem, found: Estimate, noise: Noise) -> bool:
    """Whether a fit from the prior put most spots where they were seen and believes nothing that the prior does not.

    Else the start or the data need a second look: a robot shrunk to nothing explains spots in the wrong unit, and a module that is
    turned round explains a joint that was read off by a right angle.
    """
    if np.any(np.abs(found.belief.x - model.errors.mean) > INCREDIBLE * model.errors.sigma):
        return False
    linearisation = model.linearise(found.belief.x).of_poses(len(model.data))
    beams = [index for index, channel in enumerate(model.channels) if channel.sensor.on_screen]
    distances = [
        np.linalg.norm(linearisation.residual[:, linearisation.blocks[index].columns], axis=1)[linearisation.made[:, index]]
        for index in beams
    ]
    near = max(_NEAR, 3 * noise.spot_sigma if noise.all_stated else 0.0)
    return found.converged and bool(np.median(np.concatenate(distances)) < near)


def searched_start(model: Problem, noise: Noise, sane: bool) -> Start:
    """Where to begin when the prior is too far off: where the rig is found to be; data with a common mistake in them are refused.

    Raises:
        FitRejected: names the mistake.
    """
    begun = find_start(model, noise)
    if sane and not begun.plausible:
        _refuse(best_spot_hypothesis(model, noise))
    return begun


def require_sane_readings(robot: Robot, errors: ErrorModel, model: Problem, found: Estimate, noise: Noise) -> None:
    """Refuse readings of instruments beside lasers that a common mistake explains far better.

    Args:
        robot: Whose links may be what was measured from.
        errors: The error model before its instruments were placed.
        model: Of the measurements, with the instruments placed.
        found: Their fit.
        noise: As stated, or where its estimation started.

    Raises:
        FitRejected: names the mistake.
    """
    if any(not reading.kind.beam for reading in model.data.readings) and not readings_explained(model, found, noise):
        _refuse(best_reading_hypothesis(errors, model.data, noise, links_of_reference(robot)))


def _refuse(mistake: Hypothesis | None) -> None:
    if mistake is not None:
        way_out = f"{mistake.way_out}, or" if mistake.way_out else "or"
        raise FitRejected(f"{mistake.words}; {way_out} fit them as they are with --no-sanity", forceable=False)


def require_beams_on_screen(model: Problem, x: Vector) -> None:
    """Stop where a beam that was seen does not meet the screen in the model.

    Raises:
        FitRejected: names pose and laser.
    """
    lost = model.linearise(x).lost
    targets = [reading.target for reading in model.data.readings]
    words = unreached_words(model.data, lost, targets, "the model") if lost is not None else ""
    if words:
        way_out = "check the mount of the module, the screen's placement and the joints' units and signs"
        raise FitRejected(f"{words}; {way_out}", forceable=False)


def with_scale(errors: ErrorModel, data: Measurements) -> tuple[ErrorModel, str]:
    """Hold the arm's overall scale where the data leave it open.

    What is held is the growth of all links together: the sum of their translations, each weighted by how long the link is along it.
    The first joint's own are left out, since they move the whole arm and not its size.

    Returns:
        The error model, and what was held, in words; the empty string if the measurements have a scale.
    """
    if data.lengths or not data.readings or not all(reading.kind.touches for reading in data.readings):
        return errors, ""
    first = errors.chain.moving[0].joint.name
    lengths = {name: length for name, length in _lengths(errors) if name in errors.names and not name.startswith(f"{first}.")}
    whole = float(np.linalg.norm(list(lengths.values())))
    if not whole:
        return errors, ""
    words = (
        "touches alone leave the arm's overall scale open, so it is held as the URDF has it, and all lengths are sure only as far as that "
        "holds; two sockets a known distance apart would give it (rig.yaml: sockets: {distances_mm: {'a - b': 50}})"
    )
    return replace(errors, held_sum={name: length / whole for name, length in lengths.items()}), words


def _lengths(errors: ErrorModel) -> Iterator[tuple[str, float]]:
    """How far each joint's origin lies along each of its slot's translations, by parameter, [m]."""
    joints = {step.joint.name: step.joint for step in errors.chain.moving}
    for slot in errors.slots:
        if slot.kind == "joint":
            origin = joints[slot.joints[0]].origin
            along = origin.rotation.T @ origin.translation
            for name, screw in zip(slot.names, slot.screws.T, strict=True):
                if not np.any(screw[3:]):
                    yield f"{slot.label}.{name}", float(screw[:3] @ along)


def start_of(data: Measurements, errors: ErrorModel, noise: Noise, nominal: Vector, sane: bool) -> Vector:
    """Where a fit of all that was measured begins, (p,): at the nominal robot unless a camera saw spots on the screen."""
    return _start_of_pixels(data, errors, noise, sane) if data.corrects_camera else nominal


def _start_of_pixels(data: Measurements, errors: ErrorModel, noise: Noise, sane: bool) -> Vector:
    """Where to begin with spots in pixels: at the fit of the spots that the camera makes of them on the screen as it is calibrated."""
    spots = as_spots(data)
    rest = replace(errors, parameters=tuple(parameter for parameter in errors.parameters if parameter.kind != "camera"))
    alone = Noise(start_sigma_of("spot"), noise.joint_sigma, False)
    model = problem_of(rest, spots, noise)
    found = Method().run(model.linearise, Belief.independent(rest.mean, rest.sigma), alone)
    x = found.belief.x if is_credible(model, found, alone) else searched_start(model, alone, sane).x
    known = dict(zip(rest.names, x, strict=True))
    return np.array([known.get(parameter.name, parameter.mean) for parameter in errors.parameters])
