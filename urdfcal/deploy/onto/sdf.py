"""Gazebo's SDF: links, joints and frames, each with a <pose> relative to another, all joints at zero.

A pose is told in the frame that `relative_to` names; without it a link's is in the model, a joint's in its child link, a frame's in what
it is attached to. With motions G of what each joint carries, T_model_own' = G_own T_model_own, and

    P' = T_model_other'^-1 G_own T_model_own

What stands inside a link without a `relative_to` of its own (shapes, inertias, sensors) is told in its frame and goes with it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from urdfcal.base.errors import no_such
from urdfcal.base.geometry import DEG, SE3, Vector, pose, xyz_rpy
from urdfcal.deploy.onto.model import Called, MovingJoint, OtherModel, Placed, same_name
from urdfcal.deploy.onto.text import Document, Edit, Element
from urdfcal.deploy.onto.zero import Axis

_MOVING = ("revolute", "continuous", "prismatic")
_MODEL = "__model__"
_STAYS = 1e-13
_NEWEST_OLD = 5  # up to 1.5, <pose frame> and axes mean other things


@dataclass(eq=False)
class _Own:
    """A thing with a pose.

    Attributes:
        frame: The thing that the pose is told in; empty for the model.
        link: The link that it is fixed to; empty for the model.
    """

    element: Element
    pose: Element | None
    placement: SE3
    frame: str
    link: str


def _named_once(model: Element) -> dict[str, Element]:
    """The things that poses may be relative to; in SDF each has a name of its own."""
    found: dict[str, Element] = {}
    for own in model.all("link", "frame", "joint", "model"):
        if own.name in found:
            raise own.fail(f"<{own.tag} {own.name}>: a <{found[own.name].tag}> is called so, too; in SDF every name stands once")
        if own.name:
            found[own.name] = own
    return found


class Sdf(OtherModel):
    """An SDF model that was read."""

    kind = "sdf"

    def __init__(self, document: Document, called: Called = same_name) -> None:
        self.document, self.called = document, called
        self.model = _only_model(document)
        _refuse_old(document.root)
        self.by_name = _named_once(self.model)
        self.things = {name: self._thing(element) for name, element in self.by_name.items()}
        self.inner = [self._inside(element, link) for link in self.model.all("link") for element in _placed_elsewhere(link)]
        self.holders = {self._link(_said(joint, "child"), joint): joint for joint in self.model.all("joint")}
        moving = [joint for joint in self.model.all("joint") if joint.attributes.get("type") in _MOVING]
        self.joints = {called(joint.name): self._moving(joint) for joint in moving}

    def texts(self) -> Mapping[Path, bytes]:
        """The file."""
        return {self.document.path: self.document.text}

    def placed(self) -> Iterable[Placed]:
        """Links that no moving joint carries, with the joint that holds them, and frames."""
        for name, thing in self.things.items():
            holder = self.holders.get(name) if thing.element.tag == "link" else None
            if thing.element.tag in ("link", "frame") and (holder is None or self.called(holder.name) not in self.joints):
                above = tuple(joint for joint in self._moved_by(thing.link) if joint)
                names = [name, *([holder.name] if holder is not None else [])]
                yield Placed(thing.element, (*map(self.called, names), *names), above, self.at_zero(name))

    def edits(self, follows: Mapping[str, SE3], named: Mapping[Element, SE3]) -> list[Edit]:
        """Numbers that move everything."""

        def motion(name: str, element: Element | None = None) -> SE3:
            if element is not None and element in named:
                return named[element]
            while name:
                holder = self.holders.get(name)
                own = follows.get(self.called(holder.name)) if holder is not None else None
                own = named.get(self.by_name[name]) if own is None else own
                if own is not None:
                    return own
                name = self._link(_said(holder, "parent"), holder) if holder is not None else ""
            return pin.SE3.Identity()

        edits: list[Edit] = []
        after = {name: motion(own.link, own.element) * self.at_zero(name) for name, own in self.things.items()}
        after[""] = pin.SE3.Identity()
        for thing in (*self.things.values(), *self.inner):
            new = after[thing.frame].actInv(motion(thing.link, thing.element) * self.at_zero(thing.frame) * thing.placement)
            edits += self._place(thing, new)
        for joint in self.model.all("joint"):
            for axis in joint.all("axis") if self.called(joint.name) in self.joints else ():
                expressed = self._expressed_in(joint, axis)
                turned = motion(self.things[joint.name].link).rotation @ self.joints[self.called(joint.name)].axis.direction
                edits += self._direct(axis, after[expressed].rotation.T @ turned, self._direction(axis))
        return edits

    def at_zero(self, name: str, seen: tuple[str, ...] = ()) -> SE3:
        """Where a thing is in the model.

        Raises:
            RobotError: it is placed relative to itself.
        """
        if not name:
            return pin.SE3.Identity()
        if name in seen:
            raise self.by_name[name].fail(f"<{self.by_name[name].tag} {name}>: its pose is relative to itself")
        return self.at_zero(self.things[name].frame, (*seen, name)) * self.things[name].placement

    def _thing(self, element: Element) -> _Own:
        stated = element.find("pose")
        usual = _said(element, "child") if element.tag == "joint" else element.attributes.get("attached_to", "")
        frame = (stated.attributes.get("relative_to", "") if stated is not None else "") or usual
        link = self._link(element.name, element) if element.tag != "model" else ""
        return _Own(element, stated, _placement(stated), self._known(frame, element), link)

    def _inside(self, element: Element, link: Element) -> _Own:
        return _Own(element, element, _placement(element), self._known(element.attributes["relative_to"], element), link.name)

    def _known(self, name: str, element: Element) -> str:
        if name in ("", _MODEL):
            return ""
        if name not in self.by_name:
            inside = "; names inside nested or included models are not followed" if "::" in name else ""
            raise element.fail(f"<{element.tag} {element.name}>: {no_such('link, joint or frame', name, self.by_name)}{inside}")
        return name

    def _link(self, name: str, element: Element, depth: int = 0) -> str:
        """The link that something is fixed to; empty for the model and the world."""
        if name in ("", _MODEL, "world"):
            return ""
        own = self.by_name[self._known(name, element)]
        if own.tag == "link":
            return own.name
        if depth > len(self.by_name):
            raise own.fail(f"<{own.tag} {own.name}>: is attached to itself")
        following = _said(own, "child") if own.tag == "joint" else own.attributes.get("attached_to", "")
        return self._link(following, own, depth + 1)

    def _moved_by(self, link: str) -> tuple[str, ...]:
        """Names of the moving joints before a link, root first; of those that are of other kinds, an empty string."""
        found: list[str] = []
        seen: set[str] = set()
        while (holder := self.holders.get(link)) is not None and link not in seen:
            seen.add(link)
            kind = holder.attributes.get("type", "")
            found += [] if kind == "fixed" else [self.called(holder.name) if kind in _MOVING else ""]
            link = self._link(_said(holder, "parent"), holder)
        return tuple(found[::-1])

    def _moving(self, joint: Element) -> MovingJoint:
        axis, child = joint.find("axis"), self._link(_said(joint, "child"), joint)
        if axis is None or not child:
            raise joint.fail(f"joint '{joint.name}': has no <{'child' if axis is not None else 'axis'}>")
        own = self.at_zero(joint.name)
        direction = self.at_zero(self._expressed_in(joint, axis)).rotation @ self._direction(axis)
        slides = joint.attributes.get("type") == "prismatic"
        return MovingJoint(
            self.called(joint.name),
            Axis(np.array(own.translation), np.asarray(direction), slides),
            self.at_zero(child),
            joint,
            self._moved_by(child)[:-1],
        )

    def _expressed_in(self, joint: Element, axis: Element) -> str:
        told = axis.find("xyz")
        if (axis.find("use_parent_model_frame") or joint).text.strip() in ("1", "true"):
            return ""
        name = told.attributes.get("expressed_in", "") if told is not None else ""
        return self._known(name, joint) if name else joint.name

    def _direction(self, axis: Element) -> Vector:
        told = axis.find("xyz")
        direction = axis.numbers(told.text if told is not None else "0 0 1", (3,), "xyz")
        length = float(np.linalg.norm(direction))
        if length < 1e-10:
            raise axis.fail("<axis>: xyz: has no length")
        return direction / length

    def _place(self, thing: _Own, new: SE3) -> list[Edit]:
        moved = np.abs(new.translation - thing.placement.translation).max() > _STAYS
        if not moved and np.abs(new.rotation - thing.placement.rotation).max() <= _STAYS:
            return []
        if thing.pose is None:
            return self.document.with_child(thing.element, "pose", np.concatenate(xyz_rpy(new)))
        return self.document.with_text(thing.pose, _numbers(thing.pose, new))

    def _direct(self, axis: Element, new: Vector, old: Vector) -> list[Edit]:
        if np.abs(new - old).max() <= _STAYS:
            return []
        told = axis.find("xyz")
        return self.document.with_text(told, new) if told is not None else self.document.with_child(axis, "xyz", new)


def _only_model(document: Document) -> Element:
    """The model, right under the root or in a world, that has joints."""
    models = [element for element in document.root.walk() if element.tag == "model" and element.find("joint") is not None]
    if len(models) != 1:
        names = ", ".join(f"'{model.name}'" for model in models)
        raise document.root.fail(f"has {len(models)} models with joints{f' ({names})' if names else ''}, expected one")
    return models[0]


def _refuse_old(root: Element) -> None:
    words = root.attributes.get("version", "").split(".")
    if len(words) > 1 and words[0] == "1" and words[1].isdigit() and int(words[1]) <= _NEWEST_OLD:
        raise root.fail(f"is SDF {'.'.join(words)}, where frames mean other things; save it as 1.7 or newer, as gz sdf -p does")
    for element in root.walk():
        if element.tag == "pose" and element.attributes.get("frame"):
            raise element.fail("<pose>: frame= is of SDF before 1.7; expected relative_to")


def _placed_elsewhere(link: Element) -> list[Element]:
    """Poses inside a link that are told in another frame than the link's."""
    poses = (element for element in link.walk() if element.tag == "pose" and element.above is not link)
    return [element for element in poses if element.attributes.get("relative_to")]


def _said(element: Element | None, tag: str) -> str:
    own = element.find(tag) if element is not None else None
    return own.text.strip() if own is not None else ""


def _placement(stated: Element | None) -> SE3:
    if stated is None or not stated.text.strip():
        return pin.SE3.Identity()
    quaternion = stated.attributes.get("rotation_format") == "quat_xyzw"
    values = stated.numbers(stated.text, (7,) if quaternion else (6,), "pose")
    if not quaternion:
        return pose(values[:3], values[3:] * _unit(stated))
    if np.linalg.norm(values[3:]) < 1e-10:
        raise stated.fail("<pose>: its quaternion has no length")
    return pin.SE3(pin.Quaternion(values[3:] / np.linalg.norm(values[3:])), values[:3])


def _numbers(stated: Element, placement: SE3) -> Vector:
    if stated.attributes.get("rotation_format") == "quat_xyzw":
        return np.concatenate([placement.translation, pin.Quaternion(placement.rotation).normalized().coeffs()])
    xyz, rpy = xyz_rpy(placement)
    return np.concatenate([xyz, rpy / _unit(stated)])


def _unit(stated: Element) -> float:
    return DEG if stated.attributes.get("degrees", "").strip() in ("1", "true") else 1.0
