"""Instruments in words and figures: what measured, how noisily, and where its frames were found."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from urdfcal.base.geometry import DEG, Vector, xyz_rpy
from urdfcal.base.terminal import many
from urdfcal.estimation.noise import Noise
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.parameters import INSTRUMENTS
from urdfcal.robot.frames import FoundFrame
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.registry import WORDS, start_sigma_of

if TYPE_CHECKING:  # a robot in words, which many commands say, needs no fit
    from urdfcal.calibration.result import FitResult


def noise_in_words(calibration: FitResult) -> str:
    """`spot noise 1.1 mm (estimated from the residual)`: standard deviations of single coordinates, and where they are known from."""
    data, by_source = calibration.data, dict[str, list[str]]()
    for index, kind in enumerate(data.kinds):
        if len(data.kinds) > 1 and not any(reading.seen.any() for reading in data.readings if reading.noise == kind):
            continue
        sigma = WORDS[kind].told(calibration.estimate.noise.sigma[index])
        by_source.setdefault(_source(calibration, kind, index), []).append(f"{WORDS[kind].noise} {sigma}{_shared(calibration, kind)}")
    words = [f"{', '.join(words)} ({source})" for source, words in by_source.items()]
    return ", ".join([*words, *joint_noise_in_words(calibration)])


def joint_noise_in_words(calibration: FitResult) -> list[str]:
    """`joint readings 0.021 deg (estimated from the residual)`; nothing where they were taken as exact."""
    noise = calibration.estimate.noise
    if not noise.of_joints:
        return []
    found = any(own.what == "joint_noise" and own.entered for own in calibration.stands_out)
    sizes = dict.fromkeys(f"{sigma / DEG:.3g} deg" for sigma in noise.joint_sigma.tolist() if sigma)
    return [f"joint readings {', '.join(sizes)} ({'estimated from the residual' if found else 'stated'})"]


def noise_in_common(calibration: FitResult) -> dict[str, float]:
    """Standard deviation of what all readings of a pose have in common, by kind, [m], [rad] or [px]; empty if no pose was read twice."""
    data, noise = calibration.data, calibration.estimate.noise
    return dict(zip(data.kinds, noise.sigma_in_common.tolist(), strict=True)) if data.again else {}


def _shared(calibration: FitResult, kind: str) -> str:
    """`, of which 0.4 mm is common to all readings of a pose`; empty if no pose was read twice."""
    shared = noise_in_common(calibration)
    return f", of which {WORDS[kind].told(shared[kind])} is common to all readings of a pose" if shared else ""


def _source(calibration: FitResult, kind: str, index: int) -> str:
    noise = calibration.estimate.noise
    if kind in calibration.extra_noise:
        return f"stated, and {WORDS[kind].told(calibration.extra_noise[kind])} on top"
    if noise.stated[index]:
        return "stated"
    return "assumed" if noise.sigma[index] == start_sigma_of(kind) else "estimated from the residual"  # untouched where too few tell


def assumed_noise(data: Measurements, noise: Noise) -> str:
    """`1 mm of spot noise`, `0.5 mm of point noise and 0.05 deg of orientation noise`; what measurements state of their own is not told."""
    return " and ".join(
        f"{WORDS[kind].told(sigma)} of {WORDS[kind].noise}" for kind, sigma in zip(data.kinds, noise.sigma.tolist(), strict=True)
    )


def first_kind(calibration: FitResult) -> tuple[str, str, float]:
    """What the history's residual is of, in words, the unit in which people read it, and that unit's size in SI."""
    words = WORDS[calibration.data.kinds[0]]
    return words.number, words.unit, words.size


def parameters_in_words(errors: ErrorModel) -> str:
    """`33 parameters`; where there are instruments, `18 parameters of the robot, 12 of frames and targets, 36 of places`."""
    of_places = sum(parameter.kind == "place" for parameter in errors.parameters)
    of_frames = sum(parameter.kind in INSTRUMENTS for parameter in errors.parameters) - of_places
    of_camera = sum(parameter.kind == "camera" for parameter in errors.parameters)
    of_lenses = sum(parameter.kind == "lens" for parameter in errors.parameters)
    own = len(errors.parameters) - of_places - of_frames - of_camera - of_lenses
    if own == len(errors.parameters):
        return many(own, "parameter")
    further = [(of_frames, "frames and targets" if any(slot.kind == "reference" for slot in errors.slots) else "targets")]
    further += [(of_places, "places"), (of_camera, "the camera"), (of_lenses, "lenses")]
    return ", ".join([f"{many(own, 'parameter')} of the robot", *(f"{count} of {what}" for count, what in further if count)])


def rig_in_words(robot: Robot) -> str:
    """Screen, module and lasers; reference and targets."""
    rig, words = robot.rig, []
    if rig.lasers:
        words.append(f"screen {rig.base}; module {rig.tip}; lasers {', '.join(rig.lasers)}")
    if rig.instruments.targets:
        seen_from = ", ".join(own.name if own.name == own.link else f"{own.name} on {own.link}" for own in rig.instruments.every)
        what = "instruments" if rig.instruments.others else "reference"
        words.append(f"{what} {seen_from}; targets {', '.join(target.name for target in rig.instruments.targets)}")
    return "; ".join(words)


def measuring_frame(calibration: FitResult) -> str:
    """What coordinates of targets and places are in."""
    instruments = calibration.robot.rig.instruments
    if instruments.others:
        return "the frame of the instrument that read them"
    return "the measuring frame" if instruments.placed else f"the frame of {instruments.reference}"


def frame_entries(calibration: FitResult) -> list[dict[str, Any]]:
    """Where every measuring frame and target was found: on its link, in the link that a joint moves, and with its covariance; SI.

    A sigma is None, and so are variances, where only the other half was seen.
    """
    return [frame_entry(frame) for frame in calibration.frames]


def frame_entry(frame: FoundFrame) -> dict[str, Any]:
    """One of them; the same keys for machines and in the file."""
    xyz, rpy = xyz_rpy(frame.on_link)
    return {
        "name": frame.name,
        "kind": frame.kind,
        "label": frame.label,
        "session": frame.session,
        "link": frame.link,
        "xyz": _floats(xyz),
        "rpy": _floats(rpy),
        "sigma": frame.sigma(slice(3)) if frame.placed else None,
        "rotation_sigma": frame.sigma(slice(3, 6)) if frame.turned else None,
        "parent": frame.parent,
        "child": frame.child,
        "pose": {
            "xyz": _floats(frame.xyz),
            "rpy": _floats(frame.rpy),
            "quaternion": _floats(frame.quaternion),
            "matrix": [_floats(row) for row in frame.matrix],
        },
        "covariance": [[float(value) if np.isfinite(value) else None for value in row] for row in frame.covariance],
        "known": list(frame.found),
        "undetermined": list(frame.undetermined),
        "static_transform": frame.static_transform,
        "joint": _joint_entry(frame),
        "why_not": frame.why_not,
    }


def _joint_entry(frame: FoundFrame) -> dict[str, Any] | None:
    """The link's own fixed joint, and the origin with which the link stands for the frame; None where it cannot."""
    if frame.origin is None:
        return None
    placed = {name: xyz_rpy(placement) for name, placement in (("nominal", frame.origin.nominal), ("corrected", frame.origin.corrected))}
    return {"name": frame.joint, **{name: {"xyz": _floats(xyz), "rpy": _floats(rpy)} for name, (xyz, rpy) in placed.items()}}


def _floats(values: Vector) -> list[float]:
    return [float(value) + 0.0 for value in values]


def place_entries(calibration: FitResult) -> list[dict[str, Any]]:
    """Where sockets, planes and the ends of wires were found, in the measuring frame, SI; a plane is normal . p = offset, up a normal."""
    errors = calibration.errors
    values = {**errors.held, **dict(zip(errors.names, calibration.x.tolist(), strict=True))}
    sigmas = dict(zip(errors.names, calibration.sigma.tolist(), strict=True))
    entries: list[dict[str, Any]] = []
    for place in calibration.data.instruments.places:
        names = [f"{place.name}.{name}" for name in place.names]
        if not all(name in values for name in names):
            continue
        found = [values[name] for name in names]
        entry: dict[str, Any] = {"name": place.name}
        if place.name in errors.planes:
            lean = errors.planes[place.name] @ np.array([1.0, *found[:2]])
            entry |= {"normal": (lean / np.linalg.norm(lean)).tolist(), **dict(zip(place.names[2:], found[2:], strict=True))}
        else:
            entry["xyz"] = found
        unit = "m" if "m" in place.units else "rad"
        lengths = [sigmas.get(name, 0.0) for name, own in zip(names, place.units, strict=True) if own == unit]
        entries.append({**entry, "sigma": float(np.sqrt(np.mean(np.square(lengths))))})
    return entries


def length_entries(calibration: FitResult) -> list[dict[str, Any]]:
    """Known distances between places, and those that were found, SI."""
    places = {entry["name"]: entry["xyz"] for entry in place_entries(calibration) if "xyz" in entry}
    return [
        {
            "one": known.one,
            "other": known.other,
            "known": known.length,
            "sigma": known.sigma,
            "found": float(np.linalg.norm(np.subtract(places[known.one], places[known.other]))),
        }
        for known in calibration.data.lengths
        if known.one in places and known.other in places
    ]
