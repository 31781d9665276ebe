"""What the user asks of the error model: which one, what beside it, what is held, and which priors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from urdfcal.base.errors import UsageError
from urdfcal.model.earlier import EarlierJoints
from urdfcal.model.parameters import FLAT, Kind, PriorScale
from urdfcal.model.slots import MODELS

LENS = "lens"
ADDITIONS = ("screen", "beams", "beams4", LENS)  # what can be estimated beside the joints
_UNITS = {"mm": 1e-3, "m": 1.0, "deg": np.pi / 180, "mrad": 1e-3, "rad": 1.0}
_LEAST, _MOST = 1e-12, 1e6  # [m] and [rad]: priors beyond are no statement about a robot


@dataclass(frozen=True)
class ParameterPrior:
    """What a rig.yaml says of one parameter or pattern, [m] or [rad]; None leaves the default."""

    mean: float | None = None
    sigma: float | None = None
    fixed: bool = False


@dataclass(frozen=True)
class ModelOptions:
    """What is to be calibrated.

    Attributes:
        error_model: One of MODELS.
        per_joint: Other error models for single joints, by name.
        estimate: Additions to the state: `beams`, `beams4`, `screen`, `lens`.
        fix: Patterns of parameters held at their nominal value.
        only: Patterns; if any, every other parameter is held.
        priors: Standard deviations by group.
        single: What is said of single parameters, by pattern.
        reference_known: Whether targets are measured in the very frame of the reference link, so that no placement is estimated.
        target_known: Whether what is measured is the very frame of each target's link, so that no offset is estimated.
        earlier: What an earlier calibration decided of the joints; the robot is the one that it wrote.
    """

    error_model: str = "auto"
    per_joint: Mapping[str, str] = field(default_factory=dict)
    estimate: tuple[str, ...] = ()
    fix: tuple[str, ...] = ()
    only: tuple[str, ...] = ()
    priors: Mapping[Kind, PriorScale] = field(default_factory=dict)
    single: Mapping[str, ParameterPrior] = field(default_factory=dict)
    reference_known: bool = False
    target_known: bool = False
    earlier: EarlierJoints | None = None

    def __post_init__(self) -> None:
        for model in (self.error_model, *self.per_joint.values()):
            if model not in MODELS:
                raise UsageError(f"no error model '{model}'; there are: {', '.join(MODELS)}")
        for addition in self.estimate:
            if addition not in ADDITIONS:
                raise UsageError(f"cannot estimate '{addition}'; there are: {', '.join(ADDITIONS)}")


def laid_over(
    options: ModelOptions,
    error_model: str | None = None,
    estimate: Sequence[str] = (),
    fix: Sequence[str] = (),
    only: Sequence[str] = (),
    priors: Mapping[Kind, PriorScale] | None = None,
) -> ModelOptions:
    """Options with others laid over them."""
    return replace(
        options,
        error_model=error_model or options.error_model,
        estimate=(*options.estimate, *estimate),
        fix=(*options.fix, *fix),
        only=(*options.only, *only),
        priors={**options.priors, **(priors or {})},
    )


def parse_prior(text: str) -> PriorScale:
    """A prior scale as the command line has it: `10mm,1deg`, or `flat` for none.

    Raises:
        UsageError: anything else.
    """
    if text.strip() == "flat":
        return PriorScale(FLAT, FLAT)
    scales = length_and_angle(text)
    if scales is None or min(scales) <= _LEAST:
        raise UsageError(f"'{text}' is not a prior; expected a length and an angle such as 10mm,1deg, or flat")
    return PriorScale(*scales)


def length_and_angle(text: str) -> tuple[float, float] | None:
    """`10mm,1deg` in [m] and [rad], neither below zero; None for anything else."""
    try:
        length, angle = (_number_with_unit(word.strip()) for word in text.split(","))
    except ValueError:
        return None
    return (length[0], angle[0]) if length[1] in ("mm", "m") and angle[1] in ("deg", "mrad", "rad") else None


def _number_with_unit(word: str) -> tuple[float, str]:
    unit = word.lstrip("0123456789.eE+-")
    value = float(word[: len(word) - len(unit)]) * _UNITS.get(unit, np.nan)
    if not 0 <= value < _MOST:
        raise ValueError(word)
    return value, unit
