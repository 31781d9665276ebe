"""What a calibration file says, as far as it is read back; pydantic takes longer to load than a fit takes."""

from __future__ import annotations

import numpy as np
from pydantic import Field, ValidationInfo, field_validator, model_validator
from pydantic_core import PydanticCustomError

from urdfcal.output.stored_frames import Finite, FrameEntry, Loose, OriginEntry


class JointEntry(Loose):
    """One calibrated joint."""

    moves: bool
    nominal: OriginEntry
    corrected: OriginEntry


class PosteriorEntry(Loose):
    """What was decided of the joints' parameters."""

    names: list[str] = Field(min_length=1)
    prior_sigma: list[Finite]
    twists: list[tuple[Finite, Finite, Finite, Finite, Finite, Finite]]
    covariance: list[list[Finite]]

    @model_validator(mode="after")
    def _gaussian(self) -> PosteriorEntry:
        size = len(self.names)
        counts = {len(self.prior_sigma), len(self.twists), len(self.covariance), *map(len, self.covariance)}
        if counts != {size}:
            raise ValueError(f"expected a standard deviation, a twist and a row of {size} covariances for each of the {size} names")
        covariance = np.array(self.covariance)
        scale = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
        correlation = covariance / np.outer(scale, scale)
        if not np.allclose(correlation, correlation.T, atol=1e-6) or np.linalg.eigvalsh(correlation).min() <= 0:
            raise ValueError("the covariance is not symmetric and positive")
        if min(self.prior_sigma, default=1.0) <= 0:
            raise ValueError("a prior's standard deviation must be above zero")
        return self


class RobotEntry(Loose):
    """The description that was calibrated."""

    file: str = ""


class RigEntry(Loose):
    """What measured."""

    module: str = ""
    targets: list[str] = Field(default_factory=list)


class CalibrationEntries(Loose):
    """The part of the file that is read back."""

    frames: list[FrameEntry] = Field(default_factory=list)
    joints: dict[str, JointEntry]
    posterior: PosteriorEntry | None = None
    robot: RobotEntry | None = None
    rig: RigEntry | None = None

    @field_validator("joints")
    @classmethod
    def _something(cls, joints: dict[str, JointEntry], info: ValidationInfo) -> dict[str, JointEntry]:
        if not (joints or info.data.get("frames", True)):
            raise PydanticCustomError("nothing", "Dictionary should have at least 1 item, or frames stand beside it")
        return joints
