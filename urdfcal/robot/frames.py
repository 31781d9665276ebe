"""Frames that a calibration finds beside the joints (a camera's, a tracker's, a board's, a tool's), and their places in a URDF.

A frame F is known on the link L that it was measured on. Either L itself is what was meant: then its fixed joint is corrected so that L
comes to stand where F is,

    new origin = corrected origin * T_L_F,

which moves all that hangs on L; or F becomes a link of its own on L, by a fixed joint whose origin is T_L_F. A covariance is that of the
twist [v, w] in the frame's own axes, T = T_found exp([v, w]), and so the same on whatever link that is rigidly joined to it.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import pinocchio as pin

from urdfcal.base.geometry import MM, SE3, Matrix, Vector, distance_mm_mrad, xyz_rpy
from urdfcal.robot.corrections import OriginCorrection
from urdfcal.robot.rig import SIX
from urdfcal.robot.urdf_tree import UrdfTree


@dataclass(frozen=True)
class FrameSite:
    """What a frame is of, and what of a URDF could hold it.

    Attributes:
        label: What it is called in columns and `rig.yaml`: the instrument, the board or the target.
        name: What results call it.
        kind: Whether it measures or is measured.
        session: Session that it belongs to, of an instrument that was moved; else the empty string.
        link: Link that it was measured on.
        child: Name for a link of its own, which the URDF does not have.
        joint: The link's own fixed joint; the empty string where the link cannot stand for the frame.
        why_not: Why it cannot, after the link's name; the empty string where it can.
        along: Links that would be moved with it.
    """

    label: str
    name: str
    kind: Literal["instrument", "target"]
    session: str
    link: str
    child: str
    joint: str = ""
    why_not: str = ""
    along: tuple[str, ...] = ()

    @property
    def words(self) -> tuple[str, ...]:
        """What it may be called by."""
        return tuple(dict.fromkeys((self.child, self.label, self.link, self.name)))


@dataclass(frozen=True, repr=False)
class FoundFrame(FrameSite):
    """A frame where a calibration found it.

    Attributes:
        parent: The link that its `placement` is told in: of those rigidly joined to it the nearest to the root.
        placement: T_parent_child, with corrected origins between them.
        on_link: T_link_child.
        covariance: Of its twist [v, w] in its own axes beside the calibrated joints, (6, 6), [m] and [rad]; nan where nothing is known.
        found: Which of the six are known at all, of SIX: of a point its translation.
        undetermined: Which of those the data did not decide.
        origin: Nominal and new origin of the link's joint, if the link is made to stand there; None where it cannot.
    """

    parent: str = ""
    placement: SE3 = field(default_factory=pin.SE3.Identity)
    on_link: SE3 = field(default_factory=pin.SE3.Identity)
    covariance: Matrix = field(default_factory=lambda: np.full((6, 6), np.nan))
    found: tuple[str, ...] = SIX
    undetermined: tuple[str, ...] = ()
    origin: OriginCorrection | None = None

    def __repr__(self) -> str:
        """In a line."""
        xyz = ", ".join(f"{length:.4f}" for length in self.placement.translation)
        return f"<{type(self).__name__} {self.child} on {self.parent}: xyz {xyz}>"

    @property
    def placed(self) -> bool:
        """Whether its origin is known."""
        return SIX[0] in self.found

    @property
    def turned(self) -> bool:
        """Whether its axes are known."""
        return SIX[3] in self.found

    @property
    def xyz(self) -> Vector:
        """Its origin in the parent link, (3,), [m]."""
        return xyz_rpy(self.placement)[0]

    @property
    def rpy(self) -> Vector:
        """Roll, pitch and yaw in the parent link, (3,), [rad]."""
        return xyz_rpy(self.placement)[1]

    @property
    def quaternion(self) -> Vector:
        """Its axes in the parent link as a unit quaternion x, y, z, w, (4,), w not below zero."""
        found = np.asarray(pin.Quaternion(self.placement.rotation).normalized().coeffs())
        return np.asarray(-found if found[3] < 0 else found) + 0.0

    @property
    def matrix(self) -> Matrix:
        """T_parent_child, (4, 4)."""
        return np.array(self.placement.homogeneous)

    @property
    def moved(self) -> tuple[float, float]:
        """How far it is from its link as the URDF has that, [m] and [rad]."""
        mm, mrad = distance_mm_mrad(pin.SE3.Identity(), self.on_link)
        return mm * MM, mrad * 1e-3

    @property
    def static_transform(self) -> str:
        """The command by which ROS 2 publishes it beside the calibrated URDF."""
        named = [*zip(("x", "y", "z"), self.xyz, strict=True), *zip(("qx", "qy", "qz", "qw"), self.quaternion, strict=True)]
        values = " ".join(f"--{name} {value + 0.0:.12g}" for name, value in named)
        names = f"--frame-id {shlex.quote(self.parent)} --child-frame-id {shlex.quote(self.child)}"
        return f"ros2 run tf2_ros static_transform_publisher {values} {names}"

    def sigma(self, half: slice) -> float:
        """Root mean variance of its translations or rotations, [m] or [rad]."""
        return float(np.sqrt(np.mean(np.diag(self.covariance)[half])))


def with_place(site: FrameSite, tree: UrdfTree, on: Mapping[str, int], given: Collection[str]) -> FrameSite:
    """The same with what of the URDF could hold it; its `child` is the name that is wished for.

    Args:
        site: What the frame is of.
        tree: Links and joints.
        on: Links that the fit knows: that frames were measured on, with the number of these, and that moving joints of the way carry (0).
        given: Names of links that were given to other frames.
    """
    child, why_not = _free_name(tree, site.child, site.kind, given), _why_not(tree, site.link, on)
    if why_not:
        return replace(site, child=child, why_not=why_not)
    joint = tree.by_child[site.link]
    along = tuple(other for other in tree.links if other != site.link and joint in tree.path_from_root(other))
    return replace(site, child=child, joint=joint.name, along=along)


def _why_not(tree: UrdfTree, link: str, on: Mapping[str, int]) -> str:
    """Why a link cannot be made to stand where a frame is, after its name; the empty string if it can."""
    joint = tree.by_child.get(link)
    if joint is None:
        return "is the root, which no joint places"
    if not joint.rigid:
        return f"hangs on the joint '{joint.name}', which is not fixed"
    if on[link] > 1:
        return f"has {on[link]} frames on it, and can stand for one"
    behind = next((other for other in on if other != link and joint in tree.path_from_root(other)), None)
    return "" if behind is None else f"carries '{behind}', which was calibrated where it is"


def _free_name(tree: UrdfTree, wanted: str, kind: str, given: Collection[str]) -> str:
    """A name that neither a link nor a joint has, nor the joint that a link of that name gets."""
    taken = {*tree.links, *tree.joints, *given}
    plain = re.sub(r"\W", "_", wanted)
    candidates = [plain, f"{plain}_{'target' if kind == 'target' else 'frame'}"]
    candidates += [f"{candidates[1]}_{number}" for number in range(2, len(taken) + 3)]
    return next(name for name in candidates if name not in taken and joint_of(name) not in taken)


def joint_of(child: str) -> str:
    """The joint of a link that is added."""
    return f"{child}_joint"
