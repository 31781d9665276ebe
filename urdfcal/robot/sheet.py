"""How large the screen is, as the URDF draws it: a flat box in the plane x = 0 of its link."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from lxml import etree

from urdfcal.base.geometry import Array3, Mask, Vector, pose
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_xml import finite_number, read_xml

_THIN = 0.2  # thickness over the shorter side; what is thicker is no sheet but a display, or a robot's face
_SQUARE = 1e-3  # how far the box may be turned against the axes of the link


@dataclass(frozen=True)
class ScreenArea:
    """The part of the screen's plane that is there.

    Attributes:
        size: Along y and z, or the side of a square, [m].
        centre: (y, z) of its middle, [m].
    """

    size: float | tuple[float, float] = 3.0
    centre: tuple[float, float] = (0.0, 0.0)

    def __str__(self) -> str:
        width, height = np.broadcast_to(self.size, 2)
        return f"{width:g} x {height:g} m"

    def holds(self, spots: Array3, margin: float = 0.0) -> Mask:
        """Which spots (..., 2) lie on it, or no farther beside it than a margin [m]."""
        return np.asarray((np.abs(spots - np.array(self.centre)) <= np.array(self.size) / 2 + margin).all(axis=-1))


def stated_sheet(robot: Robot, screen: str = "") -> ScreenArea | None:
    """The sheet of a screen, by default the robot's; None where its link has no flat box in that plane, or there is no screen.

    Raises:
        RigError: the robot's rig is not in the URDF.
    """
    if not screen and not robot.rig.lasers:
        return None
    root = read_xml(robot.description.text)
    links = [link for link in root.findall("link") if link.get("name") == (screen or robot.rig.base)]
    drawn = [element for link in links for tag in ("visual", "collision") for element in link.findall(tag)]
    sheets = [sheet for element in drawn if (sheet := _sheet(element)) is not None]
    return max(sheets, key=lambda sheet: float(np.prod(sheet.size)), default=None)


def _sheet(drawn: etree._Element) -> ScreenArea | None:
    box, origin = drawn.find("geometry/box"), drawn.find("origin")
    size = None if box is None else _three(box.get("size"))
    xyz, rpy = (_three("0 0 0" if origin is None else origin.get(name, "0 0 0")) for name in ("xyz", "rpy"))
    if size is None or xyz is None or rpy is None:
        return None
    turned = np.abs(pose(xyz, rpy).rotation)
    thick, width, height = (float(side) for side in turned @ size)
    if np.abs(turned - np.round(turned)).max() > _SQUARE or not 0 <= thick < _THIN * min(width, height):
        return None
    return ScreenArea((width, height), (float(xyz[1]), float(xyz[2])))


def _three(text: str | None) -> Vector | None:
    numbers = [finite_number(word) for word in (text or "").split()]
    return np.array(numbers, dtype=float) if len(numbers) == 3 and None not in numbers else None
