"""What a calibration file says, as far as it is read back; pydantic takes longer to load than a fit takes."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from urdfcal.base.geometry import SE3, pose
from urdfcal.robot.urdf_xml import FARTHEST

Finite = Annotated[float, Field(ge=-FARTHEST, le=FARTHEST, allow_inf_nan=False)]
Triple = tuple[Finite, Finite, Finite]


class _Loose(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)


class OriginEntry(_Loose):
    """xyz in metres, rpy in radians."""

    xyz: Triple
    rpy: Triple

    def placement(self) -> SE3:
        """As a placement."""
        return pose(np.array(self.xyz), np.array(self.rpy))


class JointEntry(_Loose):
    """One calibrated joint."""

    moves: bool
    nominal: OriginEntry
    corrected: OriginEntry


class PosteriorEntry(_Loose):
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


class RobotEntry(_Loose):
    """The description that was calibrated."""

    file: str = ""


class RigEntry(_Loose):
    """What measured."""

    module: str = ""
    targets: list[str] = Field(default_factory=list)


class CalibrationEntries(_Loose):
    """The part of the file that is read back."""

    joints: dict[str, JointEntry] = Field(min_length=1)
    posterior: PosteriorEntry | None = None
    robot: RobotEntry | None = None
    rig: RigEntry | None = None
