"""`prior.yaml`: what errors of a fleet's joints look like, for the next robot of its model."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from urdfcal.base.errors import InputError
from urdfcal.base.files import YamlFile, read_yaml
from urdfcal.base.geometry import DEG, MM
from urdfcal.base.yaml_kinds import is_not
from urdfcal.fleet.prior import FleetPrior
from urdfcal.fleet.shared import Shared
from urdfcal.model.parameters import DEFAULT_PRIORS, PriorScale

_WORDS = {"translation": ("translation_mm", MM), "rotation": ("rotation_deg", DEG), "zero": ("zero_deg", DEG)}
_SHARED = {"m": ("value_mm", MM), "rad": ("value_deg", DEG)}


def prior_name(prior: FleetPrior, priors: Sequence[FleetPrior]) -> str:
    """`prior.yaml`; of several models, each has its own."""
    return "prior.yaml" if len(priors) == 1 else f"prior_{re.sub('[^A-Za-z0-9._-]+', '_', prior.model)}.yaml"


@dataclass(frozen=True)
class FleetsWord:
    """What a fleet says of the next robot of its model.

    Attributes:
        scale: Standard deviations of the joints' errors.
        mean: Errors that all robots share, [m] and [rad], by parameter.
    """

    scale: PriorScale
    mean: Mapping[str, float] = field(default_factory=dict)


def prior_entries(prior: FleetPrior) -> dict[str, Any]:
    """The content of prior.yaml."""
    return {
        "urdfcal": "prior",
        **({"model": prior.model} if prior.model else {}),
        "robots": len(prior.gains),
        "joint": {_WORDS[group][0]: float(f"{scale / _WORDS[group][1]:.6g}") for group, scale in prior.scales.items()},
        "told_by": {group: round(count, 1) for group, count in prior.counts.items()},
        **({"shared": {own.name: _shared_entry(own) for own in prior.shared}} if prior.shared else {}),
        "left_out_nats": {name: round(gain, 2) for name, gain in prior.gains.items()},
    }


def _shared_entry(own: Shared) -> dict[str, float]:
    word, size = _SHARED[own.unit]
    return {word: float(f"{own.value / size:.6g}"), word.replace("value", "sigma"): float(f"{own.sigma / size:.3g}")}


def read_prior(path: str | Path) -> FleetsWord:
    """What a prior.yaml says.

    Raises:
        InputError: the file is none.
    """
    file = read_yaml(path, InputError)
    content = file.content
    if not isinstance(content, dict) or content.get("urdfcal") != "prior" or not isinstance(content.get("joint"), dict):
        raise InputError(is_not("prior", content, "joint", "fleet"), path)
    stated, usual = content["joint"], DEFAULT_PRIORS["joint"]
    scales = {"translation": usual.translation, "rotation": usual.rotation, "zero": usual.rotation}
    for group, (word, size) in _WORDS.items():
        if stated.get(word) is not None:
            scales[group] = _number(file, ("joint", word), stated[word], (1e-9, 1e6), "a number above zero") * size
    return FleetsWord(PriorScale(scales["translation"], scales["rotation"], scales["zero"]), _mean(file, content.get("shared") or {}))


def _mean(file: YamlFile, shared: Any) -> dict[str, float]:
    if not isinstance(shared, dict):
        raise InputError("entry 'shared': expected parameters with a value_mm or value_deg each", file.path, file.line(("shared",)))
    found = {}
    for name, entry in shared.items():
        stated = [(word, size) for word, size in _SHARED.values() if isinstance(entry, dict) and word in entry]
        if len(stated) != 1:
            raise InputError(f"entry 'shared.{name}': expected a value_mm or a value_deg", file.path, file.line(("shared", name)))
        ((word, size),) = stated
        found[str(name)] = _number(file, ("shared", name, word), entry[word], (-1e3, 1e3), "a number from -1000 to 1000") * size
    return found


def _number(file: YamlFile, where: tuple[Any, ...], value: Any, ends: tuple[float, float], expected: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not ends[0] < value < ends[1]:
        raise InputError(f"entry '{'.'.join(map(str, where))}': found {value!r}, expected {expected}", file.path, file.line(where))
    return float(value)
