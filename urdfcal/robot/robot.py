"""A robot: its text, its kinematic tree, and its Pinocchio model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from urdfcal.base.errors import RigError, UsageError
from urdfcal.base.foreign_text import shown
from urdfcal.base.geometry import DEG, MM
from urdfcal.base.terminal import many
from urdfcal.robot.chain import Chain, build_chain
from urdfcal.robot.description import Description, read_description
from urdfcal.robot.pinocchio_model import pinocchio_model
from urdfcal.robot.rig import NONE, Instruments, Rig, find_rig
from urdfcal.robot.urdf_tree import UrdfJoint, UrdfTree, read_tree
from urdfcal.robot.xacro_child import USUAL_LIMIT, XacroLimit


@dataclass(frozen=True, repr=False)
class Robot:
    """A robot as its description has it; nothing of it is ever changed.

    Attributes:
        description: The text that a calibrated URDF will be made of.
        tree: Its links and joints.
        model: The whole robot as a Pinocchio model, mimic joints taken as joints of their own.
        screen: Name of the screen link asked for, or None for the default.
        lasers: Names of the laser links asked for, or None for the default.
        instruments: What measures beside lasers, or instead of them.
    """

    description: Description
    tree: UrdfTree
    model: Any
    screen: str | None = None
    lasers: tuple[str, ...] | None = None
    instruments: Instruments = NONE

    @cached_property
    def rig(self) -> Rig:
        """Screen, lasers and module, or reference and targets.

        Raises:
            RigError: they are not in the URDF, or not where they can be.
        """
        return find_rig(self.tree, self.screen, self.lasers, self.instruments)

    @cached_property
    def chain(self) -> Chain:
        """The joints on the way from the screen to the module, as a serial arm that stands on the screen."""
        return build_chain(self.tree, self.rig)

    def seen_by(self, instruments: Instruments, lasers: tuple[str, ...] | None) -> Robot:
        """The same robot, measured with other instruments; without lasers if an empty tuple of them is given."""
        if (instruments, lasers) == (self.instruments, self.lasers):
            return self
        return replace(self, instruments=instruments, lasers=lasers)

    @property
    def name(self) -> str:
        """The name in `<robot name=...>`."""
        return str(self.model.name)

    def __repr__(self) -> str:
        """In a line: the whole of it holds the URDF."""
        return f"<{type(self).__name__} {shown(self.name)}: {self._counted}; {shown(self._measured_by)}>"

    def _repr_html_(self) -> str:
        from urdfcal.base.notebook import Listing, card

        joints = [joint for joint in self.tree.joints.values() if joint.moves]
        rows = [(joint.name, joint.type, joint.parent, joint.child, *_limits_in_words(joint)) for joint in joints]
        described = f"{self.description.path}{', expanded by xacro' if self.description.expanded else ''}"
        table = Listing(
            ("joint", "type", "from link", "to link", "lower", "upper"), rows, words=4, title="Moving joints", folded=len(rows) > 12
        )
        return card(self.name, (self._counted, self._measured_by, described), (table,))

    @property
    def _counted(self) -> str:
        moving = sum(joint.moves for joint in self.tree.joints.values())
        return f"{many(moving, 'moving joint')}, {len(self.tree.links)} links"

    @property
    def _measured_by(self) -> str:
        """What measures it, in words."""
        try:
            rig = self.rig
        except RigError:
            return "no lasers and screen"
        lasers = [f"{', '.join(rig.lasers)} on {rig.tip}, screen {rig.base}"] if rig.lasers else []
        targets = rig.instruments.targets
        seen = (
            [f"{', '.join(dict.fromkeys(target.placed_by for target in targets))} seen from {rig.instruments.reference}"] if targets else []
        )
        return "; ".join([*lasers, *seen])


def _limits_in_words(joint: UrdfJoint) -> tuple[str, str]:
    unit, size = ("mm", MM) if joint.prismatic else ("deg", DEG)
    return ("none", "none") if joint.type == "continuous" else (f"{joint.lower / size:.1f} {unit}", f"{joint.upper / size:.1f} {unit}")


def with_text(robot: Robot, text: bytes) -> Robot:
    """The robot that another text of the same description is read as, with the same screen, lasers and instruments."""
    again = robot_from(replace(robot.description, text=text), screen=robot.screen, lasers=robot.lasers)
    return replace(again, instruments=robot.instruments)


def load_robot(
    path: str | Path,
    *,
    xacro_args: Mapping[str, str] | None = None,
    package_dirs: Sequence[str | Path] = (),
    screen: str | None = None,
    lasers: Sequence[str] | None = None,
    xacro_limit: XacroLimit = USUAL_LIMIT,
) -> Robot:
    """Load a robot from URDF or xacro; needs neither ROS nor meshes.

    Args:
        path: URDF or xacro file.
        xacro_args: Values for the file's `<xacro:arg>`.
        package_dirs: Folders in which `$(find pkg)` and `package://` look first.
        screen: Screen link; by default the one named `screen`.
        lasers: Laser links in order; by default every link named `laser_<digits>`.
        xacro_limit: Time and memory that the expansion of a xacro file may take.

    Raises:
        RobotError: the file is not a robot that can be loaded; says where and why.
    """
    return robot_from(read_description(path, xacro_args, package_dirs, xacro_limit), screen=screen, lasers=lasers or None)


def require_robot(given: Any, call: str) -> None:
    """Refuse what is given in place of a robot, before it fails somewhere deep.

    Raises:
        UsageError: says what was expected, and of which call.
    """
    if not isinstance(given, Robot):
        raise UsageError(f"{call}: expected a Robot, as load_robot gives it, found {type(given).__name__}")


def robot_from(description: Description, *, screen: str | None = None, lasers: Sequence[str] | None = None) -> Robot:
    """Build a robot from a description that has been read."""
    tree = read_tree(description)
    return Robot(description, tree, pinocchio_model(description), screen, tuple(lasers) if lasers is not None else None)
