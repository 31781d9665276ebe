"""`rig.yaml`: what the user knows of his rig beyond the URDF. Narrows links, error models, noise and priors.

    screen: screen                     # links, if not named as usual
    lasers: [laser_1, laser_2]
    error_model: auto
    error_models: {joint3: offset}     # single joints
    noise: {spot_mm: 1.0, joint_deg: 0.05}
    priors: {joint: '1mm,0.1deg', mount: '20mm,2deg', screen: flat}
    parameters:
      joint3.d_alpha: {sigma_deg: 0.1}
      slm.trans_x: {value_mm: 2.5, sigma_mm: 0.2}
      joint*.d_a: {fixed: true}
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from urdfcal.error_model import Kind, PriorScale
from urdfcal.errors import RigError, UsageError
from urdfcal.gauge import ModelOptions, ParameterPrior, parse_prior
from urdfcal.geometry import DEG, MM

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class NoiseEntry(_Strict):
    """Stated noise."""

    spot_mm: Positive | None = None
    joint_deg: NotNegative | None = None
    joints_deg: dict[str, NotNegative] = {}


class ParameterEntry(_Strict):
    """What is said of the parameters that a pattern matches; a translation in mm, a rotation in deg."""

    value_mm: Finite | None = None
    value_deg: Finite | None = None
    sigma_mm: Positive | None = None
    sigma_deg: Positive | None = None
    fixed: bool = False

    def prior(self) -> ParameterPrior:
        """The same in metres and radians."""
        mean = self.value_mm * MM if self.value_mm is not None else self.value_deg * DEG if self.value_deg is not None else None
        sigma = self.sigma_mm * MM if self.sigma_mm is not None else self.sigma_deg * DEG if self.sigma_deg is not None else None
        return ParameterPrior(mean, sigma, self.fixed)

    def unit(self) -> str:
        """`m`, `rad`, or empty where no number is stated."""
        lengths = self.value_mm is not None or self.sigma_mm is not None
        angles = self.value_deg is not None or self.sigma_deg is not None
        if lengths and angles:
            raise ValueError("a parameter is a length or an angle, not both; use _mm or _deg")
        return "m" if lengths else "rad" if angles else ""


class RigFile(_Strict):
    """The whole file; every entry may be missing."""

    screen: str | None = None
    lasers: list[str] | None = None
    error_model: Literal["auto", "dh", "hayati", "placement", "offset"] | None = None
    error_models: dict[str, Literal["dh", "hayati", "placement", "offset"]] = {}
    estimate: list[Literal["beams", "beams4", "screen"]] = []
    noise: NoiseEntry = NoiseEntry()
    priors: dict[Literal["joint", "mount", "screen", "beam"], str] = {}
    parameters: dict[str, ParameterEntry] = {}

    @field_validator("priors")
    @classmethod
    def _readable(cls, priors: dict[Any, str]) -> dict[Any, str]:
        for text in priors.values():
            parse_prior(text)
        return priors

    @field_validator("parameters")
    @classmethod
    def _one_unit(cls, parameters: dict[str, ParameterEntry]) -> dict[str, ParameterEntry]:
        for entry in parameters.values():
            entry.unit()
        return parameters

    def prior_scales(self) -> dict[Kind, PriorScale]:
        """Standard deviations by group."""
        return {kind: parse_prior(text) for kind, text in self.priors.items()}

    def options(self) -> ModelOptions:
        """What is to be calibrated, as the file alone has it."""
        return ModelOptions(
            error_model=self.error_model or "auto",
            per_joint=self.error_models,
            estimate=tuple(self.estimate),
            priors=self.prior_scales(),
            single={pattern: entry.prior() for pattern, entry in self.parameters.items()},
        )


def read_rig_file(path: str | Path) -> RigFile:
    """Read a rig.yaml.

    Raises:
        RigError: naming the file, the entry, what was found and what was expected.
    """
    try:
        content = yaml.safe_load(Path(path).read_text("utf-8"))
    except OSError as error:
        raise RigError(f"cannot be read: {error.strerror or error}", path) from None
    except UnicodeDecodeError:
        raise RigError("is not UTF-8 text", path) from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        raise RigError(f"not readable as YAML: {getattr(error, 'problem', error)}", path, mark.line + 1 if mark else None) from None
    except (ValueError, RecursionError) as error:  # PyYAML lets these through for odd numbers, dates and deep nesting
        raise RigError(f"not readable as YAML: {error}", path) from None
    if content is None:
        return RigFile()
    if not isinstance(content, dict):
        raise RigError(f"holds a {type(content).__name__}, expected entries such as `screen: wall`", path)
    try:
        return RigFile.model_validate(content)
    except ValidationError as error:
        raise RigError(_first(error), path) from None
    except UsageError as error:
        raise RigError(str(error), path) from None


def _first(error: ValidationError) -> str:
    found = error.errors()[0]
    where = ".".join(str(step) for step in found["loc"])
    value = found.get("input")
    shown = f", found {value!r}" if isinstance(value, str | int | float | bool) else ""
    return f"entry '{where}': {found['msg']}{shown}"
