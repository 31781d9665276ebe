"""Inverse kinematics with the nominal and with the calibrated model: how far from its targets does the true robot end?

    python examples/inverse_kinematics.py robots/panda/panda.urdf.xacro [--sag-mrad 1]

No robot is measured here: the true robot is the URDF with random errors in six directions of every joint, of the module's mount and
of the screen, and so are its laser spots. It is calibrated from them; then a controller is given poses of the module in the frame of
the screen, solves for the joints with each model in turn, and the joints are put on the true robot.

With `--sag-mrad` the true robot also sags under gravity. Then there is a third way: the model of the joint fit of geometry and sag, whose
joints go through `compensation.command` before they are put on the robot.

The solver is the closed loop of Pinocchio's own example (CLIK); `--solver pink` takes pink, if it is installed.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

import urdfcal
from urdfcal.base.geometry import product
from urdfcal.calibration.analysis.compensation import Compensation
from urdfcal.calibration.analysis.sag import fit_sag
from urdfcal.calibration.reach import draw_poses
from urdfcal.model.error_model import ErrorModel
from urdfcal.robot.corrections import OriginCorrection, corrected_model
from urdfcal.simulation.readings import noise_from, simulate
from urdfcal.simulation.truth import SagScales, random_truth, soft_truth

Vector = npt.NDArray[np.float64]
MM, MRAD = 1e-3, 1e-3
CLOSE, STEPS, RESTARTS = 1e-9, 100, 30
IN_FRONT = -0.05  # [m]; the screen is the plane x = 0, and the robot is on the side of negative x
MARGIN = 0.05  # share of each joint's range that targets keep away from its limits


@dataclass(frozen=True)
class Arm:
    """A model for a controller: the joints between screen and tool are free, all others are locked.

    Attributes:
        model: Pinocchio model.
        base, tool: Indices of the frames between which poses are meant; the base does not move.
    """

    model: Any
    base: int
    tool: int

    def T_base_tool(self, q: Vector) -> Any:
        """Where the tool stands at q."""
        data = self.model.createData()
        pin.framesForwardKinematics(self.model, data, q)
        return data.oMf[self.base].actInv(data.oMf[self.tool])

    def T_world_base(self) -> Any:
        """Where the base stands."""
        data = self.model.createData()
        pin.framesForwardKinematics(self.model, data, pin.neutral(self.model))
        return data.oMf[self.base]

    def readings(self, robot: urdfcal.Robot, q: Vector) -> Vector:
        """Positions of the measured joints in their order on the way, (inputs,)."""
        return np.array([q[self.model.joints[self.model.getJointId(name)].idx_q] for name in robot.chain.input_names])

    def inside(self, q: Vector) -> Vector:
        """The nearest joint positions within the limits."""
        return np.clip(q, self.model.lowerPositionLimit, self.model.upperPositionLimit)

    def draw(self, rng: np.random.Generator) -> Vector:
        """Random joint positions, a little within the limits."""
        lower, upper = self.model.lowerPositionLimit, self.model.upperPositionLimit
        return rng.uniform(lower + MARGIN * (upper - lower), upper - MARGIN * (upper - lower))


class SoftArm:
    """The true robot where it sags: its joints give way, each about its own axis and across, at the end of its motion."""

    def __init__(self, robot: urdfcal.Robot, rigid: Arm, errors: ErrorModel, x: Vector) -> None:
        """Build the way from the screen to the module, with a joint for every axis that bends."""
        assert errors.soft is not None
        self.robot, self.rigid, self.softness = robot, rigid, errors.soft
        self.values = np.array([x[errors.names.index(term.name)] for term in errors.soft.terms])
        self.model, self.layout = robot.chain.new_model(errors.soft.bends)
        placed = errors.placements(x)
        for joint, placement in zip(self.layout.first, placed.joints, strict=True):
            self.model.jointPlacements[joint] = pin.SE3(placement)
        T_module_laser = product([joint.origin for joint in robot.chain.laser_joints[0]])
        self.module = pin.SE3(placed.frames[robot.chain.laser_frames[0]]) * T_module_laser.inverse()

    def T_screen_module(self, q: Vector) -> Any:
        """Where the module stands at joint readings q."""
        chain, positions = self.robot.chain, np.zeros(self.model.nq)
        positions[np.array(self.layout.motion) - 1] = q @ chain.coupling + chain.offset
        angles = self.softness.basis(q[None])[0] * self.values
        for term, bend, angle in zip(self.softness.terms, self.softness.bend_of, angles, strict=True):
            joint = self.layout.motion[term.joint] if bend < 0 else self.layout.bends[bend]
            positions[joint - 1] += angle if chain.moving[term.joint].forward else -angle
        data = self.model.createData()
        pin.forwardKinematics(self.model, data, positions)
        return data.oMi[self.layout.last[-1]] * self.module

    def T_base_tool(self, q: Vector) -> Any:
        """Where a tool that is fixed to the module stands."""
        rigid = Arm(self.rigid.model, self.rigid.base, self.rigid.model.getFrameId(self.robot.rig.tip, pin.BODY))
        T_module_tool = rigid.T_base_tool(q).actInv(self.rigid.T_base_tool(q))
        return self.T_screen_module(self.rigid.readings(self.robot, q)) * T_module_tool


Solver = Callable[[Arm, Any, Vector], Vector | None]


def arm_of(robot: urdfcal.Robot, model: Any, tool: str) -> Arm:
    """Lock every joint of a model, corrected or not, that is not on the way from the screen to the module."""
    wanted = [step.joint.name for step in robot.chain.moving]
    locked = [model.getJointId(name) for name in model.names[1:] if name not in wanted]
    reduced = pin.buildReducedModel(model, locked, pin.neutral(model))
    return Arm(reduced, reduced.getFrameId(robot.rig.base, pin.BODY), reduced.getFrameId(tool, pin.BODY))


def clik(arm: Arm, T_world_target: Any, q: Vector) -> Vector | None:
    """Closed-loop inverse kinematics by damped steps, within the joint limits; None where it does not arrive."""
    model, data = arm.model, arm.model.createData()
    for _ in range(STEPS):
        pin.framesForwardKinematics(model, data, q)
        T_tool_target = data.oMf[arm.tool].actInv(T_world_target)
        error = pin.log6(T_tool_target).vector
        if np.linalg.norm(error) < CLOSE:
            return q
        J = -pin.Jlog6(T_tool_target.inverse()) @ pin.computeFrameJacobian(model, data, q, arm.tool, pin.LOCAL)
        damping = 1e-2 * float(error @ error) + 1e-12
        q = arm.inside(pin.integrate(model, q, -J.T @ np.linalg.solve(J @ J.T + damping * np.eye(6), error)))
    return None


def with_pink(arm: Arm, T_world_target: Any, q: Vector) -> Vector | None:
    """The same by pink: a quadratic programme a step, with joint limits; None where it does not arrive."""
    import pink
    import qpsolvers

    task = pink.tasks.FrameTask(arm.model.frames[arm.tool].name, position_cost=1.0, orientation_cost=1.0, lm_damping=1e-2)
    task.set_target(T_world_target)
    configuration = pink.Configuration(arm.model, arm.model.createData(), q)
    for _ in range(2 * STEPS):
        if np.linalg.norm(task.compute_error(configuration)) < CLOSE:
            return np.asarray(configuration.q)
        try:
            velocity = pink.solve_ik(configuration, [task], 1.0, qpsolvers.available_solvers[0], limits=[arm.model.configuration_limit])
        except pink.exceptions.NoSolutionFound:
            return None
        configuration.integrate_inplace(velocity, 1.0)
    return None


SOLVERS: dict[str, Solver] = {"clik": clik, "pink": with_pink}


def reach(arm: Arm, T_base_target: Any, starts: list[Vector], solver: Solver) -> Vector | None:
    """Joint positions at which the arm's model has its tool on the target, from the first start that leads there."""
    T_world_target = arm.T_world_base() * T_base_target
    found = (solver(arm, T_world_target, start) for start in starts)
    return next((q for q in found if q is not None), None)


def targets(true: Arm, rng: np.random.Generator) -> Iterator[Any]:
    """Poses of the tool before the screen that the true robot can take, without end."""
    while True:
        pose = true.T_base_tool(true.draw(rng))
        if pose.translation[0] < IN_FRONT:
            yield pose


@dataclass(frozen=True)
class Study:
    """How far the true robot ends from its targets.

    Attributes:
        calibration: The fit that the calibrated model comes of.
        errors: By model: (targets, 2) distance [mm] and angle [mrad].
        passed_over: Targets that one of the models cannot reach within the joints' limits, beside those above.
    """

    calibration: urdfcal.Calibration
    errors: dict[str, Vector]
    passed_over: int

    def rows(self) -> Iterator[str]:
        """A table of means and maxima."""
        yield f"{'model':<12}{'mean mm':>10}{'max mm':>10}{'mean mrad':>12}{'max mrad':>11}"
        for name, error in self.errors.items():
            (mm, mrad), (most_mm, most_mrad) = error.mean(axis=0), error.max(axis=0)
            yield f"{name:<12}{mm:>10.3f}{most_mm:>10.3f}{mrad:>12.3f}{most_mrad:>11.3f}"


def study(
    robot: urdfcal.Robot,
    rng: np.random.Generator,
    *,
    poses: int = 60,
    count: int = 50,
    errors_mm: float = 2.0,
    errors_deg: float = 0.2,
    noise_mm: float = 0.5,
    sag_mrad: float = 0.0,
    tool: str | None = None,
    solver: Solver = clik,
) -> Study:
    """Make a true robot, measure and calibrate it, and drive it to targets with each model."""
    tool = tool or robot.rig.tip
    model, x = random_truth(robot, rng, errors_mm * MM, np.radians(errors_deg))
    if sag_mrad:
        model, x = soft_truth(robot, model, x, SagScales(sag_mrad * MRAD, sag_mrad * MRAD / 2), rng)
    data = simulate(robot, model, x, draw_poses(robot, model, x, poses, rng), rng, noise_from(noise_mm, 0.0, "gaussian"))
    complete = () if robot.chain.screen_joint else ("screen",)  # an arm that stands on the screen itself lacks its yaw by default
    calibration = urdfcal.fit(robot, data, estimate=complete)

    joints = robot.tree.joints
    truth = {name: OriginCorrection(joints[name].origin, origin, joints[name].moves) for name, origin in model.corrected_origins(x).items()}
    true = arm_of(robot, corrected_model(robot.model, truth), tool)
    stands = SoftArm(robot, true, model, x).T_base_tool if sag_mrad else true.T_base_tool
    arms = {"nominal": arm_of(robot, robot.model, tool), "calibrated": arm_of(robot, calibration.apply_to(robot.model), tool)}
    compensation = joint_fit(calibration) if sag_mrad else None
    if compensation is not None:
        arms["with sag"] = arm_of(robot, compensation.model, tool)
    found: dict[str, list[Vector]] = {name: [] for name in arms}
    passed_over = 0
    for T_screen_target in targets(true, rng):
        starts = [true.inside(pin.neutral(true.model)), *(true.draw(rng) for _ in range(RESTARTS))]
        solved = [reach(arm, T_screen_target, starts, solver) for arm in arms.values()]
        if any(q is None for q in solved):
            passed_over += 1
            continue
        for name, q in zip(arms, solved, strict=True):
            if name == "with sag" and compensation is not None:
                q = commanded(compensation, arms[name], q)
            off = T_screen_target.actInv(stands(q))
            found[name].append(np.array([np.linalg.norm(off.translation) / MM, np.linalg.norm(pin.log3(off.rotation)) / MRAD]))
        if len(found["nominal"]) == count:
            break
    return Study(calibration, {name: np.array(errors) for name, errors in found.items()}, passed_over)


def joint_fit(calibration: urdfcal.Calibration) -> Compensation:
    """Geometry and sag together; `urdfcal fit --compensation FILE.yaml` writes the same, `urdfcal.load_compensation` reads it."""
    sag = fit_sag(calibration, folds=0)
    assert sag is not None, "gravity bends every one of these arms"
    return sag.compensation()


def commanded(compensation: Compensation, arm: Arm, q: Vector) -> Vector:
    """What to command for a solution of the calibrated model, joints in the model's order."""
    command, commands = q.copy(), compensation.command(arm.readings(compensation.robot, q))
    for name, position in zip(compensation.joints, commands, strict=True):
        command[arm.model.joints[arm.model.getJointId(name)].idx_q] = position
    return command


def main() -> None:
    """Parse the command line and run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    here = Path(__file__).parents[1] / "robots"
    parser.add_argument("robot", nargs="*", type=Path, help="URDF or xacro (default: arm7 and panda)")
    parser.add_argument("--poses", type=int, default=60, help="poses that are measured (default 60)")
    parser.add_argument("--targets", type=int, default=50, help="targets (default 50)")
    parser.add_argument("--errors-mm", type=float, default=2.0, help="sigma of the true errors in mm (default 2)")
    parser.add_argument("--errors-deg", type=float, default=0.2, help="sigma of the true errors in deg (default 0.2)")
    parser.add_argument("--noise-mm", type=float, default=0.5, help="sigma of a spot coordinate in mm (default 0.5)")
    parser.add_argument("--sag-mrad", type=float, default=0.0, help="sigma of each joint's sag at its largest moment in mrad (default 0)")
    parser.add_argument("--tool", help="link that is driven to the targets (default: the laser module)")
    parser.add_argument("--solver", choices=SOLVERS, default="clik", help="inverse kinematics (default clik)")
    parser.add_argument("--seed", type=int, default=0, help="seed of everything random (default 0)")
    given = parser.parse_args()
    for path in given.robot or [here / name / f"{name}.urdf.xacro" for name in ("arm7", "panda")]:
        robot = urdfcal.load_robot(path)
        found = study(
            robot,
            np.random.default_rng(given.seed),
            poses=given.poses,
            count=given.targets,
            errors_mm=given.errors_mm,
            errors_deg=given.errors_deg,
            noise_mm=given.noise_mm,
            sag_mrad=given.sag_mrad,
            tool=given.tool,
            solver=SOLVERS[given.solver],
        )
        about = f"errors {given.errors_mm:g} mm and {given.errors_deg:g} deg, {given.poses} poses, spot noise {given.noise_mm:g} mm"
        about += f", sag {given.sag_mrad:g} mrad" if given.sag_mrad else ""
        print(f"{robot.name}, simulated ({about}): the true robot at {given.targets} targets")
        print("\n".join(found.rows()))
        print(f"{found.passed_over} more targets were passed over: one of the models cannot reach them within the joints' limits\n")


if __name__ == "__main__":
    main()
