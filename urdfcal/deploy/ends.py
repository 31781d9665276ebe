"""The two links that a controller's own numbers are about, by ROS-Industrial's names: `tool0`, its flange, and `base`, its own base.

A description's root is often neither: a UR's `base` is turned half round in `base_link`, a Fanuc's stands on the height of its second axis.
"""

from __future__ import annotations

from urdfcal.robot.urdf_tree import UrdfTree

FLANGE, BASE = "tool0", "base"


def flange_of(tree: UrdfTree, link: str) -> str:
    """The flange that a link is fixed to, or is; the empty string where the description names none, or several."""
    found = [name for name in tree.links if name.endswith(FLANGE) and tree.moving_link(name) == tree.moving_link(link)]
    return found[0] if len(found) == 1 else ""


def base_of(tree: UrdfTree, flange: str) -> str:
    """The base of the controller that moves a flange, which has the flange's prefix; the empty string where there is none."""
    name = flange.removesuffix(FLANGE) + BASE
    links = {tree.root, *(joint.child for joint in tree.path_from_root(flange))}
    return name if flange.endswith(FLANGE) and name in tree.links and tree.moving_link(name) in links else ""
