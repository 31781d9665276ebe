"""Instruments in words and figures: what measured, how noisily, and where its frames were found."""

from __future__ import annotations

from typing import Any

import numpy as np

from urdfcal.fit_result import FitResult
from urdfcal.geometry import DEG, MM, exponentials, product, xyz_rpy
from urdfcal.robot import Robot
from urdfcal.slots import Slot
from urdfcal.spot_model import kinds_of

_NOISE = {
    "spot": ("spot noise", MM, "mm"),
    "point": ("point noise", MM, "mm"),
    "orientation": ("orientation noise", DEG, "deg"),
    "distance": ("distance noise", MM, "mm"),
    "plane": ("noise across planes", MM, "mm"),
    "socket": ("socket noise", MM, "mm"),
    "pixel": ("pixel noise", 1.0, "px"),
}


def noise_in_words(calibration: FitResult) -> str:
    """`spot noise 1.1 mm`, `point noise 0.28 mm, orientation noise 0.034 deg`: standard deviations of single coordinates."""
    words, data = [], calibration.data
    for kind, sigma in zip(kinds_of(data), calibration.estimate.noise.sigma.tolist(), strict=True):
        if kind == "spot" and not data.seen.any() and data.readings:  # spots were read as pixels
            continue
        name, size, unit = _NOISE[kind]
        words.append(f"{name} {sigma / size:.3g} {unit}")
    return ", ".join(words)


def rig_in_words(robot: Robot) -> str:
    """Screen, module and lasers; reference and targets."""
    rig, words = robot.rig, []
    if rig.lasers:
        words.append(f"screen {rig.screen}; module {rig.module}; lasers {', '.join(rig.lasers)}")
    if rig.instruments.targets:
        words.append(f"reference {rig.instruments.reference}; targets {', '.join(target.name for target in rig.instruments.targets)}")
    return "; ".join(words)


def frame_entries(calibration: FitResult) -> list[dict[str, Any]]:
    """Placement of every measuring frame and target on its link, SI, with the root mean variance of its translations and rotations."""
    errors, links = calibration.errors, {target.name: target.link for target in calibration.robot.rig.instruments.targets}
    entries = []
    for slot in errors.slots:
        if slot.frame is None:
            continue
        for session in errors.sessions if slot.kind == "reference" else errors.sessions[:1]:
            values = errors.slot_values(calibration.x, session)[errors.slots.index(slot)]
            placement = product([*([slot.found[session]] if session in slot.found else []), *exponentials(slot.screws, values)])
            xyz, rpy = xyz_rpy(placement)
            label = f"{slot.label}:{session}" if session != errors.sessions[0] else slot.label
            name = f"measuring frame{f' of session {session}' if session else ''}" if slot.kind == "reference" else slot.label
            entries.append(
                {
                    "name": name,
                    "link": links.get(slot.label, slot.label),
                    "xyz": [float(value) for value in xyz],
                    "rpy": [float(value) for value in rpy],
                    "sigma": _sigma(calibration, slot, label, "trans"),
                    "rotation_sigma": _sigma(calibration, slot, label, "rot") if len(slot.names) > 3 else None,
                }
            )
    return entries


def _sigma(calibration: FitResult, slot: Slot, label: str, part: str) -> float:
    names = [f"{label}.{name}" for name in slot.names if name.startswith(part)]
    own = [index for index, name in enumerate(calibration.errors.names) if name in names]
    return float(np.sqrt(np.mean(calibration.sigma[own] ** 2))) if own else 0.0
