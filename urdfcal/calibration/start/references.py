"""A measuring frame that is known, and is another: poses told in a controller's `base`, taken for poses in `base_link`.

Where frames are placed from the data no such mistake can be seen; where the frame is known to be a link's, other links that are fixed to
it are tried, and quarter and half turns. The measurements are right then, and what is said of them is not.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
import pinocchio as pin

from urdfcal.base.geometry import DEG, MM, SE3, Vector
from urdfcal.calibration.start.mistakes import Mistake
from urdfcal.model.error_model import ErrorModel
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_tree import UrdfTree
from urdfcal.sensors.measurements import Measurements

_SAME, _SAME_TURN = 1e-5, 1e-4  # [m] and [rad] frames that differ by less are one
_TURNS = tuple((angle, axis) for axis, angles in (("z", (180, 90, -90)), ("x", (180,)), ("y", (180,))) for angle in angles)


def links_of_reference(robot: Robot) -> dict[str, SE3]:
    """T_reference_link of every other link that is fixed to the link that the measuring frame stands on."""
    tree, reference = robot.tree, robot.rig.instruments.reference
    if not reference:
        return {}
    body, T_body_reference = tree.moving_link(reference), _on_body(tree, reference)
    links = [link for link in tree.links if link != reference and tree.moving_link(link) == body]
    return {link: T_body_reference.actInv(_on_body(tree, link)) for link in links}


def mistakes_of_reference(errors: ErrorModel, links: Mapping[str, SE3]) -> Iterator[Mistake]:
    """Readings that were made in another frame than the one they are told to be in; none where frames are placed from the data.

    Args:
        errors: The error model that is to be fitted.
        links: T_reference_link of the links that it may be, by name.
    """
    if any(parameter.kind == "reference" for parameter in errors.parameters):
        return
    tried = [pin.SE3.Identity()]
    for link, T_reference_link in links.items():
        if not any(_alike(T_reference_link, other) for other in tried):
            tried.append(T_reference_link)
            words = f"the reference {_moved_words(T_reference_link)}, as link {link} is: --reference {link}"
            yield Mistake(words, partial(_told_in, T_reference_link), way_out="")
    for angle, axis in _TURNS:
        turned = pin.SE3(pin.exp3(angle * DEG * np.eye(3)["xyz".index(axis)]), np.zeros(3))
        if not any(_alike(turned, other) for other in tried):
            way_out = "put the frame that was measured in into the URDF and name it with --reference"
            yield Mistake(f"the reference {_moved_words(turned)}", partial(_told_in, turned), way_out)


def _told_in(T_new_old: SE3, data: Measurements) -> Measurements:
    return replace(data, readings=tuple(replace(each, values=each.kind.moved(each.values, T_new_old)) for each in data.readings))


def _on_body(tree: UrdfTree, link: str) -> SE3:
    """The placement of a link on the first one that it is fixed to."""
    placed = pin.SE3.Identity()
    while link in tree.by_child and tree.by_child[link].rigid:
        placed, link = tree.by_child[link].origin * placed, tree.by_child[link].parent
    return placed


def _alike(one: SE3, other: SE3) -> bool:
    apart = one.actInv(other)
    return bool(np.linalg.norm(apart.translation) < _SAME and np.linalg.norm(pin.log3(apart.rotation)) < _SAME_TURN)


def _moved_words(T: SE3) -> str:
    """`moved by (0, 0, 80) mm and turned by 180 deg about z`."""
    turn = np.asarray(pin.log3(T.rotation))
    angle, words = float(np.linalg.norm(turn)), []
    if np.linalg.norm(T.translation) >= _SAME:
        words.append(f"moved by ({', '.join(f'{number:.4g}' for number in (T.translation / MM).round(3) + 0.0)}) mm")
    if angle >= _SAME_TURN:
        words.append(f"turned by {_turn_words(turn / angle, angle / DEG)}")
    return " and ".join(words)


def _turn_words(axis: Vector, degrees: float) -> str:
    main = int(np.argmax(np.abs(axis)))
    if abs(axis[main]) < np.cos(_SAME_TURN):
        return f"{degrees:.4g} deg about ({', '.join(f'{number:.3g}' for number in axis)})"
    signed = degrees if axis[main] > 0 or degrees > 180 - _SAME_TURN / DEG else -degrees
    return f"{signed:.4g} deg about {'xyz'[main]}"
