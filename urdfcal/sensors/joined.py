"""Measurements that were made one after the other, as one set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from urdfcal.base.errors import ShapeMismatch, UsageError
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.readings import Readings, blank_readings


def joined(parts: Sequence[Measurements]) -> Measurements:
    """All of them in their order, of beams first; what one part did not read, it did not see.

    Args:
        parts: At least one, of the same joints.

    Raises:
        ShapeMismatch: they are of different joints.
        UsageError: they were measured from different links.
    """
    first = parts[0]
    for part in parts:
        if part.joints != first.joints:
            raise ShapeMismatch(f"measurements of joints {', '.join(part.joints)} do not go on with those of {', '.join(first.joints)}")
    references = dict.fromkeys(part.reference for part in parts if part.instruments.placed)
    if len(references) > 1:
        raise UsageError(f"measurements from {' and '.join(name or 'the default link' for name in references)} do not go together")
    per_pose: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in ("q", "poses", "sets", "sessions")
    }
    known: dict[str, Any] = {name: _where_all(parts, name) for name in ("approach", "time", "temperature")}
    return replace(
        first,
        **per_pose,
        **known,
        readings=_readings(parts),
        payload=np.concatenate([np.zeros(len(part)) if part.payload is None else part.payload for part in parts])
        if any(part.payload is not None for part in parts)
        else None,
        order=None,
        lines=None,
        source="",
        sha256="",
        warnings=tuple(dict.fromkeys(line for part in parts for line in part.warnings)),
        reference=next(iter(references), first.reference),
        camera=next((part.camera for part in parts if part.camera is not None), None),
        stations={name: link for part in parts for name, link in part.stations.items()},
        cameras={name: camera for part in parts for name, camera in part.cameras.items()},
        boards={name: grid for part in parts for name, grid in part.boards.items()},
        lengths=tuple(dict.fromkeys(length for part in parts for length in part.lengths)),
    )


def _where_all(parts: Sequence[Measurements], name: str) -> Any:
    """What all parts say of their poses; None where some say nothing."""
    own = [getattr(part, name) for part in parts if len(part)]
    return None if not own or any(each is None for each in own) else np.concatenate(own)


def _readings(parts: Sequence[Measurements]) -> tuple[Readings, ...]:
    every = {(own.sensor, own.target, own.instrument): own.link for part in parts for own in part.readings}
    of_part = [{(own.sensor, own.target, own.instrument): own for own in part.readings} for part in parts]
    found = []
    for (sensor, target, instrument), link in every.items():
        own = [
            known.get((sensor, target, instrument)) or blank_readings(sensor, target, link, len(part), instrument)
            for known, part in zip(of_part, parts, strict=True)
        ]
        values, labels, sigma = (np.concatenate([getattr(each, name) for each in own]) for name in ("values", "labels", "sigma"))
        found.append(Readings(sensor, target, link, values, labels, sigma, instrument))
    return tuple(sorted(found, key=lambda each: not each.kind.beam))
