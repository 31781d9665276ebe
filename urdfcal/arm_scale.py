"""The overall scale of an arm, where no measurement has one: touches of unknown places fit an arm of any size."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from urdfcal.error_model import ErrorModel
from urdfcal.measurements import Measurements


def with_scale(errors: ErrorModel, data: Measurements) -> tuple[ErrorModel, str]:
    """Hold the arm's overall scale where the data leave it open.

    What is held is the growth of all links together: the sum of their translations, each weighted by how long the link is along it.
    The first joint's own are left out, since they move the whole arm and not its size.

    Returns:
        The error model, and what was held, in words; the empty string if the measurements have a scale.
    """
    kinds = {each.kind for each in data.readings}
    if data.lasers or not kinds or kinds - {"socket", "plane"} or data.lengths:
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
        if slot.kind == "joint" and slot.joint is not None:
            origin = joints[slot.joint].origin
            along = origin.rotation.T @ origin.translation
            for name, screw in zip(slot.names, slot.screws.T, strict=True):
                if not np.any(screw[3:]):
                    yield f"{slot.label}.{name}", float(screw[:3] @ along)
