"""Corrected origins, and how they are put on a Pinocchio model.

Pinocchio has no fixed joints: whatever is rigidly joined to a moving joint is placed in that joint's own frame. So a correction is
carried as the motion S, in the frame of the joint above, of everything that hangs behind it,

    S_below = S_above * a C a^-1,        new placement = S * old placement,

with a the placement of the parent link and C = corrected * nominal^-1 (equal to origin * delta * origin^-1). Moving joints, fixed
frames, links, what is mounted on them (shapes, user's frames) and the inertias merged into a joint all follow by the same rule.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import pinocchio as pin

from urdfcal.base.errors import RobotError, UsageError, did_you_mean
from urdfcal.base.geometry import SE3, distance_mm_mrad

SAME = 1e-6  # [mm] and [mrad]: closer than that two origins are the same


@dataclass(frozen=True)
class OriginCorrection:
    """One joint's origin before and after calibration.

    Attributes:
        nominal: Placement of the joint in its parent link, as it was.
        corrected: As it was found to be.
        moving: Whether the joint moves; if not it belongs to the rig or the base.
    """

    nominal: SE3
    corrected: SE3
    moving: bool

    @property
    def delta(self) -> SE3:
        """What stands behind the nominal origin: corrected = nominal * delta."""
        return self.nominal.actInv(self.corrected)


def same_origin(a: SE3, b: SE3) -> bool:
    """Whether two origins differ by less than a nanometre and a nanoradian."""
    return max(distance_mm_mrad(a, b)) < SAME


class _Corrected(Protocol):
    """What holds corrected origins."""

    @property
    def corrections(self) -> Mapping[str, OriginCorrection]:
        """By URDF joint name."""


class Applicable:
    """What can be put on a Pinocchio model: a fit's result, or one that is read from its file."""

    def apply_to(self: _Corrected, model: Any, *geometry_models: Any) -> Any:
        """Corrected copies of a Pinocchio model of this robot and of its geometry models; for a controller.

        The model may be without the rig, free-flying, or reduced. Joints, frames and inertias come out as if the calibrated
        URDF had been read, so the corrected model costs what the nominal one costs.

        Args:
            model: `pin.Model`; left unchanged.
            geometry_models: `pin.GeometryModel`s of it (visual, collision); left unchanged.

        Returns:
            The corrected model; with geometry models the tuple (model, *geometry_models).

        Raises:
            UsageError: something else than Pinocchio's models is given, such as a `Robot`.
            RobotError: the model lacks a joint that was calibrated, is calibrated already, or is of another description.
        """
        return applied(model, geometry_models, self.corrections)


def applied(model: Any, geometry_models: Sequence[Any], corrections: Mapping[str, OriginCorrection]) -> Any:
    """The corrected model alone or, where geometry models come with it, the tuple of all: what `apply_to` gives back.

    Raises:
        UsageError, RobotError: as for `corrected_models`.
    """
    corrected = corrected_models(model, geometry_models, corrections)
    return corrected if geometry_models else corrected[0]


def corrected_model(model: Any, corrections: Mapping[str, OriginCorrection]) -> Any:
    """A copy of a Pinocchio model with corrected joints, frames and inertias: what reading the calibrated URDF would give.

    Args:
        model: Model of the same robot, with or without the rig, free-flying or reduced; left unchanged.
        corrections: By URDF joint name. Fixed joints that the model does not have are passed over.

    Raises:
        UsageError: something else than a Pinocchio model is given.
        RobotError: the model lacks a moving joint that was calibrated, is corrected already, or has a joint elsewhere.
    """
    return corrected_models(model, (), corrections)[0]


def corrected_models(model: Any, geometry_models: Sequence[Any], corrections: Mapping[str, OriginCorrection]) -> tuple[Any, ...]:
    """Copies of a Pinocchio model and of its geometry models (visual, collision), corrected alike.

    Args:
        model: As for `corrected_model`.
        geometry_models: `pin.GeometryModel`s that belong to it; left unchanged.
        corrections: By URDF joint name.

    Raises:
        UsageError: something else than Pinocchio's models is given.
        RobotError: as for `corrected_model`, or a geometry model belongs to another model.
    """
    _require_models(model, geometry_models)
    _require_joints(model, corrections)
    shifts = _Shifts(model, corrections)
    return (shifts.moved_model(), *(shifts.moved_geometry(geometry) for geometry in geometry_models))


def _require_models(model: Any, geometry_models: Sequence[Any]) -> None:
    if not isinstance(model, pin.Model):
        raise UsageError(f"found a {type(model).__name__} where the Pinocchio model belongs; expected a pin.Model, such as robot.model")
    for geometry in geometry_models:
        if not isinstance(geometry, pin.GeometryModel):
            raise UsageError(f"found a {type(geometry).__name__} behind the model; expected a pin.GeometryModel, of shapes or collisions")


def _require_joints(model: Any, corrections: Mapping[str, OriginCorrection]) -> None:
    known = {frame.name for frame in model.frames if _is_joint(frame)} | set(model.names)
    missing = [name for name, correction in corrections.items() if correction.moving and name not in known]
    if not missing:
        return
    joints = list(model.names)[1:]
    listed, were = ", ".join(f"'{name}'" for name in missing), "was" if len(missing) == 1 else "were"
    raise RobotError(f"the model has no joint {listed}, which {were} calibrated{_hint(missing[0], joints)}")


def _hint(name: str, joints: list[str]) -> str:
    return did_you_mean(name, joints) or f"; there are {len(joints)}: {', '.join(joints[:6])} ..."


def _is_joint(frame: Any) -> bool:
    return bool(frame.type in (pin.FrameType.JOINT, pin.FrameType.FIXED_JOINT))


@dataclass(frozen=True)
class _Shifts:
    """The motion S of every frame of a model, in the frame of the joint that carries it; None where it stays."""

    model: Any
    corrections: Mapping[str, OriginCorrection]

    def moved_model(self) -> Any:
        """The model with everything moved."""
        result = self.model.copy()
        for joint in range(1, self.model.njoints):
            result.jointPlacements[joint] = _after(self.of_joint(joint), self.model.jointPlacements[joint])
        for index, frame in enumerate(self.frames):
            if self.of_frame[index] is not None:
                result.frames[index].placement = self.of_frame[index] * frame.placement
                was = _after(self.with_lock[index], frame.placement)
                inertia = result.inertias[frame.parentJoint]
                result.inertias[frame.parentJoint] = _exchanged(inertia, frame.inertia, was, result.frames[index].placement)
        return result

    def moved_geometry(self, geometry: Any) -> Any:
        """The shapes moved with the links that they belong to.

        Raises:
            RobotError: a shape hangs on a joint or link that it cannot hang on in this model.
        """
        result = geometry.copy()
        for shape in result.geometryObjects:
            stated = 0 < shape.parentFrame < len(self.frames)
            if shape.parentJoint >= self.model.njoints or (stated and self.frames[shape.parentFrame].parentJoint != shape.parentJoint):
                raise RobotError(f"the geometry '{shape.name}' does not belong to this model")
            if stated:
                shape.placement = _after(self.of_frame[shape.parentFrame], shape.placement)
        return result

    @cached_property
    def frames(self) -> list[Any]:
        """The model's frames; each look-up in the model itself makes a new Python object."""
        return list(self.model.frames)

    @cached_property
    def of_frame(self) -> list[SE3 | None]:
        """The shift of every frame."""
        found: dict[int, SE3 | None] = {0: None}
        for index in range(len(self.frames)):
            self._walk(index, found)
        return [found[index] for index in range(len(self.frames))]

    def _walk(self, index: int, found: dict[int, SE3 | None]) -> SE3 | None:
        """The shift of a frame from that of the frame it hangs on; the latter may come later in a model put together by hand."""
        if index in found:
            return found[index]
        frame, above = self.frames[index], self.frames[index].parentFrame
        shift = None
        if frame.type != pin.FrameType.JOINT:
            if above == index:
                above = self._link_above(index, found)
            elif self.frames[above].parentJoint != frame.parentJoint:
                above = 0  # placed in the joint by the user, on no link
            shift = self._walk(above, found)
            if frame.type == pin.FrameType.FIXED_JOINT and frame.name in self.corrections:
                shift = _behind(shift, self.frames[above].placement, self.corrections[frame.name])
        found[index] = shift
        return shift

    @cached_property
    def with_lock(self) -> list[SE3 | None]:
        """How far each frame's inertia has moved with that of the locked joint in front of it, which holds all that is behind."""
        found: list[SE3 | None] = []
        for index, frame in enumerate(self.frames):
            above = frame.parentFrame
            rigid = frame.type != pin.FrameType.JOINT and above < index and self.frames[above].parentJoint == frame.parentJoint
            locked_above = rigid and self._is_locked(above)
            found.append(self.of_frame[above] if locked_above else found[above] if rigid else None)
        return found

    def _is_locked(self, index: int) -> bool:
        frame = self.frames[index]
        correction = self.corrections.get(frame.name)
        fixed = frame.type == pin.FrameType.FIXED_JOINT and index > 0
        return fixed and (frame.parentFrame == index or (correction is not None and correction.moving))

    def _link_above(self, index: int, found: dict[int, SE3 | None]) -> int:
        """The link that a joint locked by `pin.buildReducedModel` hangs on, which the reduced model no longer says.

        Raises:
            RobotError: it matters, and cannot be told.
        """
        frame, correction = self.frames[index], self.corrections.get(self.frames[index].name)
        links = [other for other in range(index) if self._is_link_on(other, frame.parentJoint)]
        if correction is not None:  # a joint turns about its origin, so locked at any angle it stays there
            origins = {other: self.frames[other].placement * correction.nominal for other in links}
            links = [other for other, origin in origins.items() if distance_mm_mrad(origin, frame.placement)[0] < SAME]
        if not links or (correction is None and any(self._walk(other, found) is not None for other in links)):
            raise RobotError(
                f"joint '{frame.name}' is locked in this reduced model, which does not say what it hangs on; "
                "apply the calibration to the whole model and reduce the corrected one"
            )
        return links[-1]

    def _is_link_on(self, index: int, joint: int) -> bool:
        return bool(self.frames[index].type == pin.FrameType.BODY and self.frames[index].parentJoint == joint)

    @cached_property
    def link_above_joint(self) -> dict[str, int]:
        """The link that each moving joint hangs on."""
        return {frame.name: frame.parentFrame for frame in self.frames if frame.type == pin.FrameType.JOINT}

    def of_joint(self, joint: int) -> SE3 | None:
        """The shift of a moving joint's placement, in the frame of the joint before it.

        Raises:
            RobotError: the joint is not where the calibration found it.
        """
        name, placement = self.model.names[joint], self.model.jointPlacements[joint]
        correction = self.corrections.get(name)
        if name not in self.link_above_joint:  # a model without links: all that is known is the joint itself
            return None if correction is None else placement * correction.delta * placement.inverse()
        above = self.link_above_joint[name]
        if correction is None:
            return self.of_frame[above]
        link = self.frames[above].placement
        _require_nominal(name, link.actInv(placement), correction)
        return _behind(self.of_frame[above], link, correction)


def _require_nominal(name: str, origin: SE3, correction: OriginCorrection) -> None:
    if same_origin(origin, correction.nominal):
        return
    if same_origin(origin, correction.corrected):
        raise RobotError(f"joint '{name}' of the model stands at its corrected origin: this model is calibrated already")
    off_mm, off_mrad = distance_mm_mrad(origin, correction.nominal)
    raise RobotError(
        f"joint '{name}' of the model is {off_mm:.4g} mm and {off_mrad:.4g} mrad from the origin that was calibrated; "
        "expected a model of the same robot description"
    )


def _behind(above: SE3 | None, link: SE3, correction: OriginCorrection) -> SE3:
    """S_above * a C a^-1."""
    return _after(above, link * correction.corrected * correction.nominal.inverse() * link.inverse())


def _after(shift: SE3 | None, placement: SE3) -> SE3:
    return placement if shift is None else shift * placement


def _exchanged(whole: Any, part: Any, was: SE3, now: SE3) -> Any:
    """A joint's inertia with one part of it moved; ten dynamic parameters, in which sums are linear."""
    if not part.mass > 0:
        return whole
    change = now.act(part).toDynamicParameters() - was.act(part).toDynamicParameters()
    return pin.Inertia.FromDynamicParameters(whole.toDynamicParameters() + change)
