"""MuJoCo's own kinematics as the witness of what was written: the same text, without what needs other files or has a mass."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from lxml import etree

from urdfcal.base.errors import RobotError
from urdfcal.base.geometry import SE3, Matrix, distance_mm_mrad
from urdfcal.deploy.onto.zero import AtZero
from urdfcal.robot.configurations import random_configurations
from urdfcal.robot.robot import Robot, with_text
from urdfcal.robot.urdf_writer import with_origins

CONFIGURATIONS = 20
_COMPILER = ("angle", "eulerseq", "coordinate", "autolimits")
_KEPT = ("compiler", "default", "worldbody", "body", "joint", "freejoint", "site", "frame", "replicate", "include")
_LIGHT = {"boundmass": "1", "boundinertia": "1"}  # a body that moves must weigh something


def mujoco_is_there() -> bool:
    """Whether the package can be imported."""
    return find_spec("mujoco") is not None


def off_in_mujoco(
    texts: tuple[Mapping[Path, bytes], Mapping[Path, bytes]],
    zero: AtZero,
    T_model_base: SE3,
    names: Sequence[str],
    theirs: Sequence[str],
    rng: np.random.Generator,
) -> tuple[tuple[float, float], tuple[float, float]]:
    """How far MuJoCo has bodies from where the nominal URDF, and the calibrated one, have their links: at most, [mm] and [mrad].

    How a body lies on its link is taken from both nominal ones at zero.

    Args:
        texts: The model's files before and after, the main one first.
        zero: The URDF and its calibration.
        T_model_base: Its base in the model.
        names: Of joints that both have, in the URDF.
        theirs: The same joints' in the model.
        rng: For the configurations.

    Raises:
        RobotError: MuJoCo does not read the model.
    """
    robot, links = zero.robot, [zero.robot.tree.joints[name].child for name in names]
    q = random_configurations(robot, rng, CONFIGURATIONS)
    positions = _positions(robot, names, q)
    at_zero = _in_mujoco(texts[0], theirs, np.zeros((1, len(names))))[0]
    held = [(T_model_base * zero.nominal[link]).actInv(body) for link, body in zip(links, at_zero, strict=True)]
    calibrated = with_text(robot, with_origins(robot.description, zero.origins))
    found = []
    for text, own in zip(texts, (robot, calibrated), strict=True):
        meant = _in_pinocchio(own, links, q)
        gaps = [
            distance_mm_mrad(T_model_base * link * offset, body)
            for placed, bodies in zip(meant, _in_mujoco(text, theirs, positions), strict=True)
            for link, offset, body in zip(placed, held, bodies, strict=True)
        ]
        found.append((max(mm for mm, _ in gaps), max(mrad for _, mrad in gaps)))
    return found[0], found[1]


def _positions(robot: Robot, names: Sequence[str], q: Matrix) -> Matrix:
    """What joints read, (n, joints), [rad] or [m]; a continuous one is a point on a circle in Pinocchio's q."""
    model = robot.model
    columns = []
    for name in names:
        joint = model.getJointId(name)
        start = model.idx_qs[joint]
        columns.append(np.arctan2(q[:, start + 1], q[:, start]) if model.nqs[joint] == 2 else q[:, start])
    return np.column_stack(columns)


def _in_pinocchio(robot: Robot, links: Sequence[str], q: Matrix) -> list[list[SE3]]:
    model, data = robot.model, robot.model.createData()
    frames = [model.getFrameId(link, pin.BODY) for link in links]
    found = []
    for configuration in q:
        pin.framesForwardKinematics(model, data, configuration)
        found.append([pin.SE3(data.oMf[frame]) for frame in frames])
    return found


def _in_mujoco(texts: Mapping[Path, bytes], names: Sequence[str], positions: Matrix) -> list[list[SE3]]:
    """Bodies that joints carry, over positions of the joints (n, joints)."""
    import mujoco

    try:
        model: Any = mujoco.MjModel.from_xml_string(kinematics_alone(texts))
    except (ValueError, etree.XMLSyntaxError) as error:
        raise RobotError(f"MuJoCo does not take its bodies, joints and sites: {error}", next(iter(texts))) from None
    data = mujoco.MjData(model)
    joints = [model.joint(name) for name in names]
    addresses, bodies = [int(joint.qposadr[0]) for joint in joints], [int(joint.bodyid[0]) for joint in joints]
    found = []
    for row in positions:
        data.qpos[:] = model.qpos0
        data.qpos[addresses] = row
        mujoco.mj_kinematics(model, data)
        found.append([pin.SE3(data.xmat[body].reshape(3, 3).copy(), data.xpos[body].copy()) for body in bodies])
    return found


def kinematics_alone(texts: Mapping[Path, bytes]) -> str:
    """A model's bodies, joints and sites with its compiler and defaults, included files put in."""
    main = next(iter(texts))
    root = etree.fromstring(texts[main])
    for element in list(root.iter(etree.Element)):
        if element.tag == "include":
            _put_in(element, texts, main.parent)
    for element in list(root.iter()):
        above = element.getparent()
        if above is not None and (not isinstance(element.tag, str) or element.tag not in _KEPT):
            _take_out(element, above)
        elif element.tag == "compiler":
            for name in set(element.attrib) - set(_COMPILER):
                del element.attrib[name]
    root.append(etree.Element("compiler", _LIGHT))
    return etree.tostring(root, encoding="unicode")


def _put_in(element: etree._Element, texts: Mapping[Path, bytes], folder: Path) -> None:
    stated, above = element.get("file", ""), element.getparent()
    path = next(own for own in texts if own == folder / stated or own.name == Path(stated).name)
    content = etree.fromstring(texts[path])
    if above is None:
        return
    for child in content:
        element.addprevious(child)
        for inner in list(child.iter("include")):
            _put_in(inner, texts, folder)
    above.remove(element)


def _take_out(element: etree._Element, above: etree._Element) -> None:
    element.tail = None
    above.remove(element)
