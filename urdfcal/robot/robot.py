"""A robot: its text, its kinematic tree, and its Pinocchio model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from urdfcal.robot.chain import Chain, build_chain
from urdfcal.robot.description import Description, read_description
from urdfcal.robot.pinocchio_model import pinocchio_model
from urdfcal.robot.rig import NONE, Instruments, Rig, find_rig
from urdfcal.robot.urdf_tree import UrdfTree, read_tree
from urdfcal.robot.xacro_child import USUAL_LIMIT, XacroLimit


@dataclass(frozen=True)
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


def robot_from(description: Description, *, screen: str | None = None, lasers: Sequence[str] | None = None) -> Robot:
    """Build a robot from a description that has been read."""
    tree = read_tree(description)
    return Robot(description, tree, pinocchio_model(description), screen, tuple(lasers) if lasers is not None else None)
