"""Do MJCF and SDF models of a robot move as the calibrated robot, with a calibration put onto them?

    python -m tests.benchmarks.onto [--seed N]

For each robot: its model as MuJoCo itself converts its URDF (six digits); MJCF written by us, each body's orientation in a way
drawn at random (quat, euler in the compiler's eulerseq, axisangle, xyaxes), in degrees, with axes in default classes, `ref`, frames,
sites, inertials and `fromto`; and SDF with poses relative to parents, joints or the model, in radians, degrees or quaternions. Every moving
joint and every fixed one that has a name there is off by 2 mm and 2 mrad. *before*, *after*: the farthest that a link's placement in the
root is off, at 20 configurations, before and after `apply --onto`: in MJCF by MuJoCo's kinematics, in SDF by products of what stands there.
"""

from __future__ import annotations

import argparse
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from tests.support.other_models import converted
from urdfcal.base.geometry import DEG, MM
from urdfcal.deploy.onto.orientations import WAYS, Angles, written
from urdfcal.deploy.onto.patched import patched
from urdfcal.output.stored import corrected_robot
from urdfcal.robot.packages import find_package
from urdfcal.robot.robot import Robot, load_robot
from urdfcal.robot.urdf_tree import UrdfJoint

ROBOTS = {
    "UR5": "ur_description/urdf/ur5_robot.urdf",
    "Panda": "panda_description/urdf/panda.urdf",
    "TIAGo": "tiago_description/robots/tiago.urdf",
    "TALOS": "talos_data/robots/talos_reduced.urdf",
    "Kinova": "kinova_description/robots/kinova.urdf",
    "Baxter": "baxter_description/urdf/baxter.urdf",
    "Z1": "z1_description/urdf/z1.urdf",
    "xArm 7": "xarm_description/urdf/xarm7.urdf",
}


ROOT = "the_root"


def text_of(numbers: Any) -> str:
    """Numbers as they stand in a file."""
    return " ".join(repr(float(number)) for number in np.atleast_1d(numbers))


def motion(joint: UrdfJoint, by: float) -> pin.SE3:
    """A joint's motion."""
    axis = np.array(joint.axis)
    return pin.SE3(np.eye(3), by * axis) if joint.prismatic else pin.SE3(pin.exp3(by * axis), np.zeros(3))


def children(robot: Robot, link: str) -> list[UrdfJoint]:
    """The joints that a link carries."""
    return [joint for joint in robot.tree.joints.values() if joint.parent == link]


def mjcf_of(robot: Robot, rng: np.random.Generator) -> str:
    """A robot as MJCF, in awkward ways."""
    seq = str(rng.choice(["xyz", "ZYX", "zxz"]))
    angles = Angles(eulerseq=seq)
    root = ET.Element("mujoco", model="m")
    ET.SubElement(root, "compiler", angle="degree", eulerseq=seq, autolimits="true")
    default = ET.SubElement(root, "default")
    for name, axis in (("x", "1 0 0"), ("y", "0 3 0"), ("z", "0 0 1")):
        ET.SubElement(ET.SubElement(default, "default", {"class": name}), "joint", axis=axis)
    world = ET.SubElement(ET.SubElement(root, "worldbody"), "frame", pos="0 0.5 1", euler="0 0 30")

    def placed(tag: Any, placement: pin.SE3) -> None:
        name, values = written(str(rng.choice(list(WAYS))), placement.rotation, angles)
        tag.set("pos", text_of(placement.translation))
        tag.set(name, text_of(values))

    def body(above: Any, link: str, placement: pin.SE3, joint: UrdfJoint | None) -> None:
        tag = ET.SubElement(above, "body", name=ROOT if joint is None else link)  # "world" is MuJoCo's own
        if joint is not None and joint.moves:
            ref = float(rng.choice([0.0, 0.25]))
            own = ET.SubElement(tag, "joint", name=joint.name, type="slide" if joint.prismatic else "hinge")
            axis = np.array(joint.axis)
            plain = {tuple(np.eye(3)[index]): name for index, name in enumerate("xyz")}.get(tuple(axis))
            if plain:
                own.set("class", plain)
            else:
                own.set("axis", text_of(2.5 * axis))
            own.set("ref", text_of(ref if joint.prismatic else ref / DEG))
            placement = placement * motion(joint, ref)
        placed(tag, placement)
        ET.SubElement(tag, "inertial", pos="0 0 0.01", mass="1", diaginertia="1 1 1")
        ET.SubElement(tag, "geom", type="capsule", size="0.01", fromto="0 0 0 0 0 0.1")
        for each in children(robot, link):
            if each.rigid and not children(robot, each.child):
                placed(ET.SubElement(tag, "site", name=each.child), each.origin)
            else:
                body(tag, each.child, each.origin, each)

    body(world, robot.tree.root, pin.SE3.Identity(), None)
    return ET.tostring(root, encoding="unicode")


def sdf_of(robot: Robot, rng: np.random.Generator) -> str:
    """A robot as SDF, in awkward ways."""
    root = ET.Element("sdf", version="1.9")
    model = ET.SubElement(root, "model", name="m")

    def pose(tag: Any, placement: pin.SE3, about: str = "") -> None:
        said = ET.SubElement(tag, "pose", {"relative_to": about} if about else {})
        way = rng.integers(3)
        rpy = pin.rpy.matrixToRpy(placement.rotation)
        if way == 0:
            said.set("rotation_format", "quat_xyzw")
            said.text = text_of([*placement.translation, *pin.Quaternion(placement.rotation).coeffs()])
        elif way == 1:
            said.set("degrees", "true")
            said.text = text_of([*placement.translation, *(rpy / DEG)])
        else:
            said.text = text_of([*placement.translation, *rpy])

    def link(name: str, placement: pin.SE3, joint: UrdfJoint | None) -> None:
        """A link, `placement` in the model."""
        own = ET.SubElement(model, "link", name=name)
        if joint is None:
            pose(own, placement)
        else:
            kind = "fixed" if joint.rigid else "prismatic" if joint.prismatic else "revolute"
            hinge = ET.SubElement(model, "joint", name=joint.name, type=kind)
            ET.SubElement(hinge, "parent").text, ET.SubElement(hinge, "child").text = joint.parent, joint.child
            if rng.integers(2):
                pose(own, pin.SE3.Identity(), joint.name)
                pose(hinge, joint.origin, joint.parent)
            elif rng.integers(2):
                pose(own, joint.origin, joint.parent)
            else:
                pose(own, placement)
            if joint.moves:
                ET.SubElement(ET.SubElement(hinge, "axis"), "xyz").text = text_of(joint.axis)
        for each in children(robot, name):
            link(each.child, placement * each.origin, each)

    link(robot.tree.root, pin.SE3.Identity(), None)
    return ET.tostring(root, encoding="unicode")


def in_urdf(robot: Robot, q: dict[str, float], links: list[str]) -> list[pin.SE3]:
    """Links in the root, by products of joints' origins and motions."""
    found = []
    for name in links:
        placed = pin.SE3.Identity()
        for joint in robot.tree.path_from_root(name):
            placed = placed * joint.origin * (motion(joint, q[joint.name]) if joint.moves else pin.SE3.Identity())
        found.append(placed)
    return found


def in_mujoco(text: bytes, q: dict[str, float], links: list[str], root: str) -> list[pin.SE3]:
    """Bodies and sites in the root, by MuJoCo."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(text.decode())
    data = mujoco.MjData(model)
    for name, value in q.items():
        data.joint(name).qpos = value
    mujoco.mj_kinematics(model, data)
    sites = {model.site(index).name for index in range(model.nsite)}
    found = [data.site(name) if name in sites else data.body(name) for name in [root, *links]]
    first, *others = (pin.SE3(np.array(own.xmat).reshape(3, 3), np.array(own.xpos)) for own in found)
    return [first.actInv(own) for own in others]


def in_sdf(text: bytes, q: dict[str, float], links: list[str], root: str) -> list[pin.SE3]:
    """Links in the root, by products of what stands in an SDF, and motions about its axes."""
    model = ET.fromstring(text).find("model")
    assert model is not None
    things = {own.get("name", ""): own for own in model if own.tag in ("link", "joint")}
    joints = {own.findtext("child"): own for own in things.values() if own.tag == "joint"}

    def at_zero(name: str) -> pin.SE3:
        if not name:
            return pin.SE3.Identity()
        own, said = things[name], things[name].find("pose")
        words = [float(word) for word in ((said.text or "") if said is not None else "").split()] or [0.0] * 6
        about = (said.get("relative_to") if said is not None else None) or (own.findtext("child") if own.tag == "joint" else "") or ""
        unit = DEG if said is not None and said.get("degrees") else 1.0
        turned = pin.Quaternion(np.array(words[3:])).matrix() if len(words) == 7 else pin.rpy.rpyToMatrix(*(unit * np.array(words[3:])))
        return at_zero(about) * pin.SE3(turned, np.array(words[:3]))

    def placed(name: str) -> pin.SE3:
        own = joints.get(name)
        if own is None:
            return at_zero(name)
        hinge, parent = at_zero(own.get("name", "")), own.findtext("parent") or ""
        behind = hinge.actInv(at_zero(name))
        moved = pin.SE3.Identity()
        if own.get("type") != "fixed":
            axis = np.array([float(word) for word in (own.findtext("axis/xyz") or "").split()])
            by = q[own.get("name", "")] * axis / np.linalg.norm(axis)
            moved = pin.SE3(np.eye(3), by) if own.get("type") == "prismatic" else pin.SE3(pin.exp3(by), np.zeros(3))
        return placed(parent) * at_zero(parent).actInv(hinge) * moved * behind

    first = placed(root)
    return [first.actInv(placed(name)) for name in links]


def farthest(one: list[pin.SE3], other: list[pin.SE3]) -> float:
    """[m], and of the rotation matrix."""
    return max(float(np.abs(a.homogeneous - b.homogeneous).max()) for a, b in zip(one, other, strict=True))


def rewritten(robot: Robot, urdf: Path, folder: Path, rng: np.random.Generator) -> dict[str, Path]:
    """Models of a robot, by what they are."""
    made = {"MJCF": folder / "ours.xml", "SDF": folder / "ours.sdf"}
    made["MJCF"].write_text(mjcf_of(robot, rng))
    made["SDF"].write_text(sdf_of(robot, rng))
    if set(robot.tree.joints) & set(robot.tree.links):
        del made["SDF"]  # where joints are called as links are, which SDF does not have
    try:
        return {"converted": converted(urdf, folder / "converted.xml"), **made}
    except ValueError as error:
        print(f"MuJoCo does not convert {urdf.name}: {' '.join(str(error).split())}")
        return made


def main() -> None:
    """Print a line a model."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    rng, robots = np.random.default_rng(parser.parse_args().seed), find_package("example-robot-data") / "robots"
    print(f"{'robot':8}{'joints':>7}{'model':>11}{'before':>11}{'after':>11}   mm")
    for name, way in ROBOTS.items():
        robot = load_robot(robots / way)
        moving = [joint.name for joint in robot.tree.joints.values() if joint.moves]
        with tempfile.TemporaryDirectory() as folder:
            for kind, place in rewritten(robot, robots / way, Path(folder), rng).items():
                wrong = moving if kind == "converted" else list(robot.tree.joints)
                errors = {each: rng.normal(0, [2 * MM] * 3 + [2e-3] * 3) for each in wrong}
                origins = {each: robot.tree.joints[each].origin * pin.exp6(error) for each, error in errors.items()}
                found = patched(robot, origins, place)
                real, root = corrected_robot(robot, origins), robot.tree.root
                links = [robot.tree.joints[each].child for each in moving]
                there, worst = in_sdf if kind == "SDF" else in_mujoco, [0.0, 0.0]
                begin = root
                if kind == "converted":  # whose root is merged into the world
                    begin = links[0]
                for _ in range(20):
                    q = {each: float(rng.uniform(-0.9, 0.9)) for each in moving}
                    first, *wanted = in_urdf(real, q, [begin, *links])
                    wanted = [first.actInv(each) for each in wanted]
                    for index, text in enumerate((found.original[place], found.whole[place])):
                        worst[index] = max(worst[index], farthest(there(text, q, links, ROOT if kind == "MJCF" else begin), wanted))
                print(f"{name:8}{len(moving):7}{kind:>11}{worst[0] / MM:11.3g}{worst[1] / MM:11.2g}", flush=True)


if __name__ == "__main__":
    main()
