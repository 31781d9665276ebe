"""Origins and frames as a calibration's file has them."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from urdfcal.base.geometry import SE3, pose
from urdfcal.robot.corrections import OriginCorrection
from urdfcal.robot.frames import FoundFrame
from urdfcal.robot.urdf_xml import FARTHEST

Finite = Annotated[float, Field(ge=-FARTHEST, le=FARTHEST, allow_inf_nan=False)]
Triple = tuple[Finite, Finite, Finite]


class Loose(BaseModel):
    """An entry that may hold more than is read."""

    model_config = ConfigDict(extra="ignore", frozen=True)


class OriginEntry(Loose):
    """xyz in metres, rpy in radians."""

    xyz: Triple
    rpy: Triple

    def placement(self) -> SE3:
        """As a placement."""
        return pose(np.array(self.xyz), np.array(self.rpy))


Six = Literal["trans_x", "trans_y", "trans_z", "rot_x", "rot_y", "rot_z"]
SixNumbers = tuple[Finite | None, Finite | None, Finite | None, Finite | None, Finite | None, Finite | None]


class FrameJointEntry(Loose):
    """The fixed joint of a link that can stand for a frame."""

    name: str
    nominal: OriginEntry
    corrected: OriginEntry


class FrameEntry(OriginEntry):
    """A frame that was found beside the joints, on the link that it was measured on."""

    name: str
    kind: Literal["instrument", "target"]
    label: str
    session: str = ""
    link: str
    parent: str
    child: str
    pose: OriginEntry
    covariance: tuple[SixNumbers, SixNumbers, SixNumbers, SixNumbers, SixNumbers, SixNumbers]
    known: tuple[Six, ...]
    undetermined: tuple[Six, ...] = ()
    joint: FrameJointEntry | None = None
    why_not: str = ""

    def frame(self) -> FoundFrame:
        """As the fit had it."""
        own = self.joint
        return FoundFrame(
            label=self.label,
            name=self.name,
            kind=self.kind,
            session=self.session,
            link=self.link,
            child=self.child,
            joint="" if own is None else own.name,
            why_not=self.why_not,
            parent=self.parent,
            placement=self.pose.placement(),
            on_link=self.placement(),
            covariance=np.array([[np.nan if value is None else value for value in row] for row in self.covariance]),
            found=self.known,
            undetermined=self.undetermined,
            origin=None if own is None else OriginCorrection(own.nominal.placement(), own.corrected.placement(), False),
        )

    @model_validator(mode="after")
    def _writable_or_not(self) -> FrameEntry:
        if (self.joint is None) != bool(self.why_not):
            raise ValueError("expected a joint, or in 'why_not' why there is none")
        return self
