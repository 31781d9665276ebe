"""Verdicts on collisions, and legs of a tour, against a second witness: FCL on the meshes as they are, placed link by link.

    python3 -m venv fcl_venv && fcl_venv/bin/pip install trimesh python-fcl pycollada pin
    python -m tests.benchmarks.collisions fcl_venv/bin/python [--states 10000] [--poses 12]

The witness reads the URDF's <collision> elements (<visual> ones of links without) by itself, loads meshes with trimesh and asks FCL, an
older library than coal; it is told which pairs of shapes are to be looked at, and nothing else. *Missed*: called free, and meshes touch.
*Refused for nothing*: not called free, and no meshes touch, over all that are free. The clearance is 0 there; planned poses and legs
keep 5 mm, and are looked at in steps in which no two links come nearer by more than 1 mm.
"""

from __future__ import annotations

import argparse
import itertools
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[2]
FILES = {
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "point:tool0"),
    "panda": ("panda_description/urdf/panda.urdf", "point:panda_link8"),
    "tiago": ("tiago_description/robots/tiago_no_hand.urdf", "point:arm_7_link"),
}


def main() -> None:
    """Parse the command line and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("python", type=Path, help="interpreter of an environment with trimesh, python-fcl, pycollada and pin")
    parser.add_argument("--states", type=int, default=10_000)
    parser.add_argument("--poses", type=int, default=8, help="of the tour")
    parser.add_argument("--only", choices=FILES)
    arguments = parser.parse_args()
    print(
        "| robot | states | touch | missed | refused for nothing | positions of poses and legs | of them touch |\n|" + "---|" * 7,
        flush=True,
    )
    for name in [arguments.only] if arguments.only else FILES:
        print(row(name, arguments.python, arguments.states, arguments.poses), flush=True)


def row(name: str, python: Path, states: int, poses: int) -> str:
    """A robot's figures."""
    import urdfcal
    from urdfcal.cell.collisions import Cell, cell_of
    from urdfcal.cell.ways import Ways
    from urdfcal.planning.plan import plan_poses
    from urdfcal.planning.tour import legs, toured
    from urdfcal.robot.configurations import random_positions
    from urdfcal.robot.packages import find_package

    robots = find_package("example-robot-data") / "robots"
    path, sensor = robots / FILES[name][0], FILES[name][1]
    cells: list[Cell] = []
    known: list[Any] = []

    def allowed(seen: Any, q: Any) -> Any:
        if not cells:
            cells.extend([cell_of(seen), cell_of(seen, clearance=0.0)])
        known.append(q[cells[0].free(q)])
        return cells[0].free(q)

    plan = plan_poses(urdfcal.load_robot(path), candidates=500, n=poses, sensors=[sensor], allowed=allowed)
    ways, model = Ways(cells[0]), plan.robot.model
    reach = ways.reaches.max(axis=0)[[model.joints[model.getJointId(joint)].idx_v for joint in plan.joints]]
    tour = toured(plan.q, plan.robot, np.zeros(plan.q.shape[1]), ways.free_until, np.concatenate(known)[:200])
    driven = [way for leg, stations in enumerate(legs(plan.q, tour)) if leg not in tour.blocked for way in itertools.pairwise(stations)]
    along = np.concatenate([plan.q, *(a + np.linspace(0, 1, steps(np.abs(b - a) @ reach))[:, None] * (b - a) for a, b in driven)])
    drawn = random_positions(plan.robot, states, np.random.default_rng(0))
    free = cells[1].free(drawn)
    touch = witness(python, path, robots, plan.joints, pairs_of(cells[1]), np.concatenate([drawn, along]))
    at_random, on_tour = touch[:states], touch[states:]
    refused = (~free & ~at_random).sum() / max((~at_random).sum(), 1)
    cells_ = [name, states, f"{at_random.mean():.0%}", (free & at_random).sum(), f"{refused:.2%}", len(along), on_tour.sum()]
    return f"| {' | '.join(map(str, cells_))} |"


def steps(moved: float) -> int:
    """How many positions of a leg on which links move so far [m], so that it is no more than 1 mm between two."""
    return 2 + int(moved / 1e-3)


def pairs_of(cell: Any) -> list[tuple[str, str]]:
    """Pairs of shapes that are looked at, by `<link>_<number among its own>`."""
    shapes = cell.model.geometryObjects
    return [(shapes[pair.first].name, shapes[pair.second].name) for pair in cell.model.collisionPairs]


def witness(python: Path, path: Path, robots: Path, joints: Any, pairs: Any, q: np.ndarray) -> np.ndarray:
    """What FCL says of positions, in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        np.save(f"{folder}/q.npy", q)
        asked = {"path": str(path), "robots": str(robots), "joints": list(joints), "pairs": pairs}
        subprocess.run([str(python), __file__, "--witness", folder], input=json.dumps(asked), text=True, check=True)
        return np.asarray(np.load(f"{folder}/touch.npy"))


def testify(folder: str) -> None:
    """In the other process: which positions have links that touch."""
    import pinocchio as pin

    asked = json.load(sys.stdin)
    model = pin.buildModelFromUrdf(asked["path"])
    data, q = model.createData(), np.load(f"{folder}/q.npy")
    shapes = shapes_of(asked["path"], Path(asked["robots"]), model)
    touch = np.zeros(len(q), dtype=bool)
    for row, positions in enumerate(q):
        whole = pin.neutral(model)
        for name, value in zip(asked["joints"], positions, strict=True):
            joint = model.joints[model.getJointId(name)]
            whole[joint.idx_q : joint.idx_q + joint.nq] = [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
        pin.framesForwardKinematics(model, data, whole)
        touch[row] = touching(shapes, asked["pairs"], data)
    np.save(f"{folder}/touch.npy", touch)


def touching(shapes: dict[str, tuple[Any, ...]], pairs: list[list[str]], data: Any) -> bool:
    """Whether any of the pairs touch where the data has them."""
    import fcl

    for frame, T_link_shape, body in shapes.values():
        T = data.oMf[frame] * T_link_shape
        body.setTransform(fcl.Transform(T.rotation, T.translation))
    request = fcl.CollisionRequest()
    return any(fcl.collide(shapes[one][2], shapes[other][2], request, fcl.CollisionResult()) for one, other in pairs)


def shapes_of(path: str, robots: Path, model: Any) -> dict[str, tuple[Any, ...]]:
    """Shapes by link and number: the link's frame, where they are on it, and FCL's object."""
    import xml.etree.ElementTree as ET

    import fcl
    import pinocchio as pin

    found: dict[str, tuple[Any, ...]] = {}
    for link in ET.parse(path).getroot().findall("link"):
        for number, shape in enumerate(link.findall("collision") or link.findall("visual")):
            origin = shape.find("origin")
            numbers = {} if origin is None else origin.attrib
            xyz, rpy = ([float(word) for word in numbers.get(key, "0 0 0").split()] for key in ("xyz", "rpy"))
            placement = pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(xyz))
            form = form_of(shape.find("geometry")[0], robots)
            name = link.get("name", "")
            found[f"{name}_{number}"] = model.getFrameId(name), placement, fcl.CollisionObject(form)
    return found


def form_of(geometry: Any, robots: Path) -> Any:
    """A shape of the URDF as FCL's."""
    import fcl
    import trimesh

    if geometry.tag == "box":
        return fcl.Box(*map(float, geometry.get("size").split()))
    if geometry.tag == "sphere":
        return fcl.Sphere(float(geometry.get("radius")))
    if geometry.tag == "cylinder":
        return fcl.Cylinder(float(geometry.get("radius")), float(geometry.get("length")))
    file = geometry.get("filename").removeprefix("package://").removeprefix("example-robot-data/robots/")
    scale = [float(word) for word in (geometry.get("scale") or "1 1 1").split()]
    mesh = trimesh.load(robots / file, force="mesh")
    form = fcl.BVHModel()
    form.beginModel(len(mesh.vertices), len(mesh.faces))
    form.addSubModel(np.asarray(mesh.vertices) * scale, np.asarray(mesh.faces))
    form.endModel()
    return form


if __name__ == "__main__":
    if sys.argv[1:2] == ["--witness"]:
        testify(sys.argv[2])
    else:
        main()
