"""Corrected origins put onto another description of the same robot: matched by joints' names, and proved by reading it back."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from urdfcal.base.errors import RobotError, no_such
from urdfcal.base.geometry import SE3, distance_mm_mrad
from urdfcal.deploy.onto.alignment import LEAST_MM, LEAST_MRAD, Fit, aligned, off
from urdfcal.deploy.onto.model import Called, OtherModel, same_name
from urdfcal.deploy.onto.text import Element, edited, read_document
from urdfcal.deploy.onto.zero import AtZero
from urdfcal.robot.robot import Robot

_PROVED = 1e-6  # [mm] and [mrad]: what is read back is where it was put


@dataclass(frozen=True)
class Patched:
    """Another description with the calibration in it.

    Attributes:
        kind: `mjcf` or `sdf`.
        original: The description's files before, the one that was named first.
        whole: The same after.
        zero: The URDF and what corrects it.
        joints: Names of the moving joints that both have, as the URDF has them.
        theirs: The same as the description has them.
        before: The nominal URDF's axes against those of the description.
        after: The axes that are read back against those that were meant.
        lost: Calibrated joints that nothing in the description carries.
        other_frames: Links that have another frame there, before any correction, and by how much at most, [mm] and [mrad].
    """

    kind: str
    original: Mapping[Path, bytes]
    whole: Mapping[Path, bytes]
    zero: AtZero
    joints: tuple[str, ...]
    theirs: tuple[str, ...]
    before: Fit
    after: Fit
    lost: tuple[str, ...]
    other_frames: Mapping[str, tuple[float, float]]

    @property
    def files(self) -> dict[Path, bytes]:
        """The file that was named, and others that changed."""
        named = next(iter(self.original))
        return {path: text for path, text in self.whole.items() if path == named or text != self.original[path]}

    @property
    def nominal_off(self) -> tuple[float, float]:
        """How far the nominal axes are from each other, at most: [mm] and [mrad]."""
        gaps = self.before.off.values()
        return max(mm for mm, _ in gaps), max(mrad for _, mrad in gaps)


def read_model(path: Path, texts: Mapping[Path, bytes] | None = None, called: Called = same_name) -> OtherModel:
    """Read an MJCF or SDF file.

    Args:
        path: The file.
        texts: What files hold, in place of the files themselves.
        called: From its names to those of the URDF.

    Raises:
        RobotError: it is neither, or cannot be read.
    """
    from urdfcal.deploy.onto.mjcf import Mjcf
    from urdfcal.deploy.onto.mjcf_files import read_mjcf_files
    from urdfcal.deploy.onto.sdf import Sdf

    given = dict(texts or {})
    document = read_document(path, given.get(path))
    if document.root.tag == "mujoco":
        return Mjcf(read_mjcf_files(path, given.get(path), given), called)
    if document.root.tag == "sdf":
        return Sdf(document, called)
    hint = "; that is a URDF: leave --onto out" if document.root.tag == "robot" else ""
    raise document.root.fail(f"found <{document.root.tag}>, expected <mujoco> (MJCF) or <sdf>{hint}")


def patched(robot: Robot, origins: Mapping[str, SE3], path: Path, force: bool = False) -> Patched:
    """Put corrected origins onto another description.

    Args:
        robot: The URDF that the origins belong to.
        origins: Corrected placement by joint name.
        path: MJCF or SDF.
        force: Whether the correction goes on top where the two differ by more than rounding.

    Raises:
        RobotError: it cannot be read, lacks a joint, has other kinematics, or is calibrated already.
    """
    called = _renamed(read_model(path), robot)
    model, zero = read_model(path, called=called), AtZero(robot, origins)
    names = _matched(model, robot, origins)
    before = _fit(model, zero, names)
    _require_nominal(model, zero, names, before, path, force)
    W, joints = before.T_model_base, robot.tree.joints
    links = _named(model, robot, names)
    moved = {link: W * zero.motions[link] * W.inverse() for link in {*links.values(), *(joints[name].child for name in names)}}
    edits = model.edits({name: moved[joints[name].child] for name in names}, {own: moved[link] for own, link in links.items()})
    texts = {
        own: edited(text, [edit for edit in edits if edit.path == own]) if any(edit.path == own for edit in edits) else text
        for own, text in model.texts().items()
    }
    after = _proved(read_model(path, texts, called), model, moved, names, robot, before)
    reached = {joint.name for link in moved for joint in robot.tree.path_from_root(link)}
    lost = tuple(name for name in origins if name not in reached)
    theirs = tuple(model.joints[name].element.name for name in names)
    others = _other_frames(model, zero, W, names, links)
    return Patched(model.kind, model.texts(), texts, zero, tuple(names), theirs, before, after, lost, others)


def _renamed(model: OtherModel, robot: Robot) -> Called:
    """Where no joint is called alike: the prefix that all moving joints of one have and the other has not, taken off or put on."""
    ours = [name for name, joint in robot.tree.joints.items() if joint.moves]
    if any(name in model.joints for name in ours):
        return same_name
    added = Counter(our.removesuffix(their) for our in ours for their in model.joints if their and our.endswith(their))
    gone = Counter(their.removesuffix(our) for our in ours for their in model.joints if their.endswith(our))
    for prefix, count in added.most_common(1):
        if count >= max(gone.values(), default=0):
            return lambda name: prefix + name
    for prefix, _ in gone.most_common(1):
        return lambda name: name.removeprefix(prefix)
    return same_name


def _matched(model: OtherModel, robot: Robot, origins: Mapping[str, SE3]) -> list[str]:
    """Moving joints that both have, in the order of the URDF.

    Raises:
        RobotError: the description lacks one that was calibrated or stands between others, or has them in another order.
    """
    joints, where = robot.tree.joints, next(iter(model.texts()))
    names = [name for name, joint in joints.items() if joint.moves and name in model.joints]
    for name in origins:
        if joints[name].moves and name not in names:
            raise RobotError(f"{no_such('joint', name, model.joints)}; joints are matched by the names that the URDF has", where)
    if not names:
        raise RobotError(f"has none of the joints of {robot.description.label}", where)
    for name in names:
        way = [joint.name for joint in robot.tree.path_from_root(joints[name].parent) if joint.moves]
        first = next((index for index, each in enumerate(way) if each in names), len(way))
        theirs = list(model.joints[name].above)
        begun = next((index for index, each in enumerate(theirs) if each in names), len(theirs))
        if way[first:] != theirs[begun:]:
            raise model.joints[name].element.fail(
                f"joint '{name}' hangs behind {_told(theirs[begun:])} here, and behind {_told(way[first:])} in {robot.description.label}"
            )
        if model.joints[name].axis.slides != joints[name].prismatic:
            raise model.joints[name].element.fail(f"joint '{name}' {'slides' if model.joints[name].axis.slides else 'turns'} here alone")
    return names


def _told(names: list[str]) -> str:
    return ", ".join(name or "a joint without a name" for name in names) or "none of the robot's"


def _fit(model: OtherModel, zero: AtZero, names: list[str]) -> Fit:
    joints = zero.robot.tree.joints
    frames = [model.joints[name].T_model_body * zero.nominal[joints[name].child].inverse() for name in names[:1]]
    return aligned({name: zero.axes[name] for name in names}, {name: model.joints[name].axis for name in names}, frames)


def _require_nominal(model: OtherModel, zero: AtZero, names: list[str], fit: Fit, path: Path, force: bool) -> None:
    """Refuse a description that is not of the nominal robot.

    Raises:
        RobotError: names the first joint that is elsewhere, and how far.
    """
    joints = zero.robot.tree.joints
    calibrated = {name: zero.axes[name].moved(zero.motions[joints[name].child]) for name in names}
    moved = [name for name in names if max(off(calibrated[name], zero.axes[name])) > 1e-3]
    theirs = {name: model.joints[name].axis for name in names}
    frames = [model.joints[name].T_model_body * zero.corrected[joints[name].child].inverse() for name in names[:1]]
    if moved and aligned(calibrated, theirs, frames).worst < min(fit.worst, 1.0) / 2:
        raise RobotError("is calibrated already: its joints are where the calibration has them", path)
    if fit.first is None or force:
        return
    mm, mrad = (round(gap, 6) for gap in fit.off[fit.first])
    raise model.joints[fit.first].element.fail(
        f"joint '{fit.first}': its axis is {mm:.4g} mm and {mrad:.4g} mrad from where {zero.robot.description.label} has it, all joints at "
        f"zero, where at most {LEAST_MM:g} mm and {LEAST_MRAD:g} mrad pass for rounding; expected a model of the same nominal robot, with "
        "the same zero positions and signs; --force puts the correction on top"
    )


def _named(model: OtherModel, robot: Robot, names: list[str]) -> dict[Element, str]:
    """Things without a joint of their own that are called like a link, or like the fixed joint that holds it, and the link."""
    tree = robot.tree
    held = {joint.name: joint.child for joint in tree.joints.values() if not joint.moves}
    found: dict[Element, str] = {}
    for thing in model.placed():
        for name in filter(None, thing.names):
            link = name if name in tree.links else held.get(name)
            moved_by = [] if link is None else [joint.name for joint in tree.path_from_root(link) if joint.name in names]
            if link is not None and moved_by == [each for each in thing.above if each in names]:
                found[thing.element] = link
    return found


def _other_frames(
    model: OtherModel, zero: AtZero, W: SE3, names: list[str], links: Mapping[Element, str]
) -> dict[str, tuple[float, float]]:
    """Links whose frames are not those of the URDF: there, axes are all that was compared."""
    joints = zero.robot.tree.joints
    there = {joints[name].child: model.joints[name].T_model_body for name in names}
    there |= {links[thing.element]: thing.T_model_own for thing in model.placed() if thing.element in links}
    gaps = {link: distance_mm_mrad(W * zero.nominal[link], own) for link, own in there.items()}
    return {link: gap for link, gap in gaps.items() if gap[0] > LEAST_MM or gap[1] > LEAST_MRAD}


def _proved(again: OtherModel, model: OtherModel, moved: Mapping[str, SE3], names: list[str], robot: Robot, before: Fit) -> Fit:
    """How far the axes that are read back are from those that were meant.

    Raises:
        AssertionError: a number is not where it was put.
    """
    joints = robot.tree.joints
    meant = {name: model.joints[name].axis.moved(moved[joints[name].child]) for name in names}
    gaps = {name: off(axis, again.joints[name].axis) for name, axis in meant.items()}
    size = max(float(np.abs(axis.point).max()) for axis in meant.values())
    if max(map(max, gaps.values())) > _PROVED * max(1.0, size):
        raise AssertionError(f"read back, axes are elsewhere than they were put: {gaps}")
    return Fit(before.T_model_base, gaps)
