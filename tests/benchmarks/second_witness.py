"""Kinematics that share no code with urdfcal: the studies beside this file hold its answers against these.

`moved_urdf` writes a URDF whose joint origins are wrong, yourdfpy says where its links then stand, `observations_of` meets its beams with
the screen. `UrdfWay` is forward kinematics in plain numpy for many poses at once, where yourdfpy would take too long.
Transforms are 4 x 4 matrices; `T_a_b` takes coordinates in b to coordinates in a.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
import yourdfpy
from lxml import etree
from scipy.spatial.transform import Rotation

Array = npt.NDArray[np.float64]

MM, DEG = 1e-3, np.pi / 180


def transform(translation: npt.ArrayLike, rotation: Rotation) -> Array:
    """A 4 x 4 matrix."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation.as_matrix(), translation
    return matrix


def random_delta(rng: np.random.Generator, translation: float, rotation: float) -> Array:
    """A Gaussian error in all six directions, [m] and [rad]."""
    return transform(rng.normal(0, translation, 3), Rotation.from_rotvec(rng.normal(0, rotation, 3)))


def origin_of(joint: etree._Element) -> Array:
    """The origin of a URDF joint."""
    origin = joint.find("origin")
    xyz, rpy = ("0 0 0" if origin is None else origin.get(name, "0 0 0") for name in ("xyz", "rpy"))
    return transform(np.array(xyz.split(), float), Rotation.from_euler("xyz", np.array(rpy.split(), float)))


def moved_urdf(text: bytes, deltas: Mapping[str, Array]) -> bytes:
    """The URDF with `origin * delta` on the named joints."""
    root = etree.fromstring(text)
    joints = {joint.get("name"): joint for joint in root.findall("joint")}
    for name, delta in deltas.items():
        moved = origin_of(joints[name]) @ delta
        for old in joints[name].findall("origin"):
            joints[name].remove(old)
        rpy = Rotation.from_matrix(moved[:3, :3]).as_euler("xyz")
        etree.SubElement(joints[name], "origin", xyz=" ".join(map(repr, moved[:3, 3].tolist())), rpy=" ".join(map(repr, rpy.tolist())))
    return etree.tostring(root)


def link_poses(text: bytes, joints: Sequence[str], q: Array, screen: str, links: Sequence[str]) -> Array:
    """T_screen_link of every pose and link by yourdfpy, (n, links, 4, 4)."""
    urdf = yourdfpy.URDF.load(io.BytesIO(text), load_meshes=False, build_scene_graph=True)
    poses = np.empty((len(q), len(links), 4, 4))
    for pose, positions in enumerate(q):
        urdf.update_cfg(dict(zip(joints, positions, strict=True)))
        poses[pose] = [urdf.get_transform(link, screen) for link in links]
    return poses


def observations_of(T_screen_laser: Array) -> tuple[Array, Array]:
    """(y, z) where each beam, +z of its laser, meets the plane x = 0; and how far it went, negative if it points away."""
    source, direction = T_screen_laser[..., :3, 3], T_screen_laser[..., :3, 2]
    length = -source[..., 0] / direction[..., 0]
    return (source + length[..., None] * direction)[..., 1:], length


class UrdfWay:
    """Forward kinematics from one link to others, for many poses at once."""

    def __init__(self, text: bytes) -> None:
        self.by_child = {joint.find("child").get("link"): joint for joint in etree.fromstring(text).findall("joint")}
        self.origins = {joint.get("name"): origin_of(joint) for joint in self.by_child.values()}

    def poses(self, origins: Mapping[str, Array], q: Mapping[str, Array], screen: str, links: Sequence[str]) -> Array:
        """T_screen_link, (n, links, 4, 4), with some of the joints' origins replaced."""
        T_screen_root = np.linalg.inv(self._from_root(screen, origins, q))
        return np.stack(np.broadcast_arrays(*(T_screen_root @ self._from_root(link, origins, q) for link in links)), axis=1)

    def _from_root(self, link: str, origins: Mapping[str, Array], q: Mapping[str, Array]) -> Array:
        joint = self.by_child.get(link)
        if joint is None:
            return np.eye(4)
        name, parent = joint.get("name"), joint.find("parent").get("link")
        T_root_joint = self._from_root(parent, origins, q) @ origins.get(name, self.origins[name])
        return T_root_joint @ motion_of(joint, q[name]) if name in q else T_root_joint


def motion_of(joint: etree._Element, q: Array) -> Array:
    """The motion of a joint at many positions, (n, 4, 4)."""
    element = joint.find("axis")
    axis = np.array("1 0 0".split() if element is None else element.get("xyz").split(), float)
    steps = q[:, None] * axis / np.linalg.norm(axis)
    motion = np.tile(np.eye(4), (len(q), 1, 1))
    if joint.get("type") == "prismatic":
        motion[:, :3, 3] = steps
    else:
        motion[:, :3, :3] = Rotation.from_rotvec(steps).as_matrix()
    return motion
