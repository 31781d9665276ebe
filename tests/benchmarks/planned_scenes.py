"""What `planned.py` measures: robots with their instruments, the poses that there are, robots with errors, and what is read of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np
import pinocchio as pin

import urdfcal
from urdfcal.base.geometry import DEG, MM, SE3, Mask, Matrix
from urdfcal.calibration.analysis.next_pose import read_at
from urdfcal.cell.collisions import Cell, cell_of
from urdfcal.cell.hiding import hidden
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.planning.candidates import Lookout, drawn
from urdfcal.planning.measuring import Asked, Measuring, measuring
from urdfcal.planning.plan import PosePlan, plan_poses
from urdfcal.planning.sight import Eyes
from urdfcal.robot.added_rig import Stand, board_on, with_pieces
from urdfcal.robot.configurations import joint_limits
from urdfcal.robot.rig import Grid
from urdfcal.robot.robot import Robot, robot_from
from urdfcal.sensors.camera import Camera
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.pixels import out_of_picture
from urdfcal.sensors.sensor import Sight
from urdfcal.simulation.setup import SimulatedSetup, parse_sensors, simulated_setup

ROBOTS = Path(__file__).parents[2] / "robots"
ARMS = {"ur5": "tool0", "panda": "panda_link8", "tiago": "arm_7_link"}  # with the links that points are measured of
SENSORS = ("laser", "point", "pixels")
NOISE = {"spot": 0.5 * MM, "point": 0.1 * MM, "pixel": 0.3}
POOL = 1500
LENS = Camera((1280, 960), np.array([[1000.0, 0, 640], [0, 1000, 480], [0, 0, 1]]), np.zeros(5))
GRID = Grid(6, 4, 0.04)
BEFORE_SCREEN = Stand("screen", np.array([-0.3, 0, 0]), np.array([0, -np.pi / 2, 0]))  # the middle of the board, its front to the robot


@dataclass(frozen=True)
class Scene:
    """A robot and what measures it.

    Attributes:
        robot: Nominal, with all that stands around it.
        asked: What measures.
    """

    robot: Robot
    asked: Asked

    @cached_property
    def made(self) -> Measuring:
        """What measures, and where."""
        return measuring(self.robot, self.asked, ModelOptions(), np.random.default_rng(0))

    @property
    def sigmas(self) -> dict[str, float]:
        """Noise of what is read."""
        return {kind: NOISE[kind] for kind in self.made.blanks(np.zeros((1, len(self.made.robot.chain.inputs)))).kinds}

    @cached_property
    def pool(self) -> Matrix:
        """Random poses that can be measured, (POOL, inputs): free of collisions, and all is seen."""
        robot, cell = self.made.robot, cell_of(self.made.robot)
        lookout = Lookout(robot, Eyes(self.made, Sight(area=self.made.area)), partial(_free, cell), partial(_hidden, cell))
        return drawn(lookout, joint_limits(robot), POOL, np.random.default_rng(0)).q

    def planned(self, n: int) -> PosePlan:
        """So many poses of the pool."""
        seen = {name: getattr(self.asked, name) for name in ("sensors", "reference", "camera", "boards")}
        return plan_poses(self.robot, candidates=self.pool, n=n, sigmas=self.sigmas, **seen)

    def truth(self, kind: str, seed: int, frames: list[np.ndarray]) -> SimulatedSetup:
        """A robot with errors, and instruments near the links that they stand on, or somewhere."""
        rng = np.random.default_rng([seed, kind == "factory"])
        seen = self.made.robot
        errors = build_error_model(seen.chain, seen.rig, ModelOptions(error_model="auto" if kind == "Gaussian" else "placement"))
        metres = np.array(errors.units) == "m"
        joints = np.array([parameter.kind == "joint" for parameter in errors.parameters])
        x = rng.normal(size=len(metres)) * np.where(metres, 5 * MM, 0.5 * DEG)
        if kind == "Gaussian":
            x[joints] *= np.where(metres, 0.2, 2e-3 / (0.5 * DEG))[joints]
        else:
            x[joints] = _of_makers(int(joints.sum()) // 6, seed, frames, rng)
        named, _ = parse_sensors(self.asked.sensors, self.robot, 0, self.asked.boards)
        known = {"reference_known": bool(self.asked.reference), "target_known": bool(self.asked.boards)}
        setup = simulated_setup(seen, errors, x, named, rng, camera=self.asked.camera, boards=self.asked.boards, **known)
        slots = [replace(slot, found={"": _near(rng)}) if known.get(f"{slot.kind}_known") else slot for slot in setup.errors.slots]
        return replace(setup, errors=replace(setup.errors, slots=tuple(slots)))

    def read(self, setup: SimulatedSetup, q: Matrix, seed: int) -> Measurements:
        """What is read at some poses; corners that the errors move out of the picture are not."""
        rng = np.random.default_rng([seed, len(q)])
        exact = read_at(setup.robot, setup.errors, setup.x, self.made.blanks(q[:1]), q)
        noisy = [replace(own, values=own.values + rng.normal(size=own.values.shape) * NOISE[own.noise]) for own in exact.readings]
        kept = [own.without(out_of_picture(LENS, own.values)) if own.kind.by_camera else own for own in noisy]
        return replace(exact, readings=tuple(kept), poses=np.arange(len(q)).astype(str), order=np.arange(float(len(q))))


def scene_of(name: str, sensor: str) -> Scene:
    """A robot with its lasers; with an instrument somewhere that reads points; or with a camera where the lasers are, and a board."""
    robot = urdfcal.load_robot(ROBOTS / name / f"{name}.urdf.xacro")
    if sensor == "laser":
        return Scene(robot, Asked())
    if sensor == "point":
        return Scene(robot, Asked((f"point:{ARMS[name]}",)))
    board = board_on(robot.tree, BEFORE_SCREEN, GRID)
    return Scene(robot_from(with_pieces(robot, [board], "", "a board")), Asked(("pixels:board",), "slm", LENS, {"board": GRID}))


def _free(cell: Cell, robot: Robot, q: Matrix) -> Mask:
    return cell.free(q)


def _hidden(cell: Cell, robot: Robot, q: Matrix, begin: Matrix, end: Matrix) -> Mask:
    return hidden(cell, q, begin, end)


def _of_makers(count: int, seed: int, arms: list[np.ndarray], rng: np.random.Generator) -> np.ndarray:
    """Errors of so many joints' frames, as an arm has them, or drawn from all arms where that has not as many joints."""
    if count == 6:
        return np.asarray(arms[seed % len(arms)] * (-1.0) ** (seed // len(arms)))
    every = np.concatenate(arms).reshape(-1, 6)
    return np.asarray(every[rng.integers(len(every), size=count)] * rng.choice([-1.0, 1.0], (count, 1))).ravel()


def _near(rng: np.random.Generator) -> SE3:
    return pin.exp6(rng.normal(size=6) * np.repeat([5 * MM, 0.5 * DEG], 3))
