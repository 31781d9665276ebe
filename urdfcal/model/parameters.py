"""Parameters: names, units, groups and the priors that each group has by default."""

from __future__ import annotations

import fnmatch
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from urdfcal.base.errors import UsageError, did_you_mean
from urdfcal.base.geometry import DEG, MM

_ZERO = ".d_theta"  # how names of joints' zeros end
FLAT = 1e3  # [m] and [rad]: the standard deviation that stands for no prior at all

Kind = Literal["joint", "mount", "screen", "beam", "reference", "target", "place", "soft", "camera", "lens", "rig"]


@dataclass(frozen=True)
class PriorScale:
    """Standard deviations of a group of parameters: translations in metres, rotations in radians.

    Attributes:
        translation: [m].
        rotation: [rad].
        zero: Of joints' zeros, [rad]; None where they are like other rotations.

    Raises:
        UsageError: one of them is not above zero; a parameter that is known is fixed instead.
    """

    translation: float
    rotation: float
    zero: float | None = None

    def __post_init__(self) -> None:
        if not (self.translation > 0 and self.rotation > 0 and (self.zero is None or self.zero > 0)):
            raise UsageError(f"a prior's standard deviations must be above zero, found {self.translation:g} m and {self.rotation:g} rad")

    def sigma(self, unit: str, name: str = "") -> float:
        """The one for a parameter's unit, and for its name where zeros have their own."""
        if self.zero is not None and name.endswith(_ZERO):
            return self.zero
        return self.translation if unit == "m" else self.rotation


DEFAULT_PRIORS: dict[Kind, PriorScale] = {
    "joint": PriorScale(10 * MM, 1 * DEG),
    "mount": PriorScale(20 * MM, 2 * DEG),
    "screen": PriorScale(100 * MM, 5 * DEG),
    "beam": PriorScale(5 * MM, 1 * DEG),
    "reference": PriorScale(1.0, 1.0),
    "target": PriorScale(1.0, 1.0),
    "place": PriorScale(1.0, 1.0),
    "soft": PriorScale(1e-3, 1e-3),
    "camera": PriorScale(5 * MM, 0.5 * DEG),
    "lens": PriorScale(1.0, 1.0),
    "rig": PriorScale(1 * MM, 1e-3),
}
SESSION_KINDS = ("screen", "reference")  # placements that each session has for itself
INSTRUMENTS = ("reference", "target", "place")  # what moves no beam

_SOFT = {"sag": "sag", "sag_1": "sag across", "sag_2": "sag across", "scale": "scale", "approach": "approach"}


@dataclass(frozen=True)
class Parameter:
    """One number that may be estimated.

    Attributes:
        name: `<joint or link>.<parameter>`, with `:<session>` behind the link for a later session's screen.
        unit: `m` or `rad`; the empty string for a share.
        kind: Group that it belongs to.
        mean: Prior mean, in `unit`.
        sigma: Prior standard deviation, in `unit`; FLAT for none.
    """

    name: str
    unit: str
    kind: Kind
    mean: float
    sigma: float

    @property
    def scale_group(self) -> str:
        """Which scale the data may choose for its prior: of a joint's `translation`, `rotation` or `zero`, or of how joints give way.

        Empty where the prior is kept.
        """
        if self.kind == "soft":
            what = self.name.rpartition(".")[2]
            return _SOFT.get(what, "eccentricity" if what.startswith("ecc_") else "gear" if what.startswith("gear") else "")
        if self.kind != "joint":
            return ""
        return "translation" if self.unit == "m" else "zero" if self.name.endswith(_ZERO) else "rotation"


def matching(parameters: Sequence[Parameter], pattern: str) -> set[str]:
    """Names that a `--fix` or `--only` pattern means; `*` and `?` as in a shell.

    Raises:
        UsageError: the pattern means nothing here.
    """
    names = [parameter.name for parameter in parameters]
    found = set(fnmatch.filter(names, pattern))
    if not found:
        raise UsageError(f"no parameter matches '{pattern}'{did_you_mean(pattern, names)}")
    return found
