"""Two ends of a robot on two branches, ends that are known, and one branch calibrated after the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import pytest

from tests.support.helpers import central_differences
from tests.support.two_ends import HEAD, NOISE, WAIST, arm, measured, robot_of, seen
from urdfcal.api import fit
from urdfcal.base.errors import RobotError
from urdfcal.base.geometry import DEG, MM, SE3, distance_mm_mrad
from urdfcal.calibration.analysis.prediction import tool_jacobian
from urdfcal.calibration.error_table import rms_of
from urdfcal.calibration.known_joints import joints_of
from urdfcal.calibration.result import FitResult
from urdfcal.calibration.start.nominal import evaluate
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.output.stored import corrected_robot
from urdfcal.robot.configurations import whole_configurations
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.simulation.readings import ReadingNoise

STATED = {"evidence": False}


def between(robot: Robot, start: str, end: str, rng: np.random.Generator, count: int = 40) -> list[SE3]:
    """Placements of one link in another at random joint positions, by Pinocchio."""
    model = robot.model
    data, places = model.createData(), []
    for _ in range(count):
        pin.framesForwardKinematics(model, data, rng.uniform(-1, 1, model.nq))
        frames = [data.oMf[model.getFrameId(link, pin.FrameType.BODY)] for link in (start, end)]
        places.append(frames[0].actInv(frames[1]))
    return places


def off(one: Robot, other: Robot, start: str, end: str) -> float:
    """How far apart two robots have a link in another at most, [mm]."""
    pairs = zip(*(between(robot, start, end, np.random.default_rng(3)) for robot in (one, other)), strict=True)
    return max(distance_mm_mrad(a, b)[0] for a, b in pairs)


def written(found: FitResult) -> Robot:
    """The robot that is read from the calibrated URDF."""
    return corrected_robot(found.robot, {name: correction.corrected for name, correction in found.corrections.items()})


def test_a_displaced_foot_is_no_zero_of_two_joints(rng: np.random.Generator) -> None:
    """An arm's foot 5 mm off, 42 mm beside the parallel axis of the head, moves links by millimetres and turns none by degrees."""
    robot = robot_of([*HEAD, *arm("a", "base", "0.05 0.03 0.1")], [("camera", "tilt_link"), ("hand", "a6_link")])
    robot, errors = seen(robot, "hand_link", "camera_link")
    truth = np.zeros(len(errors.names))
    truth[[errors.names.index("a1.trans_x"), errors.names.index("a1.trans_y")]] = 3 * MM, -4 * MM
    setup, data = measured(robot, errors, truth, "hand_link", rng)
    found = fit(robot, data, **STATED)
    true = corrected_robot(robot, setup.errors.corrected_origins(setup.x))
    assert max(abs(value) for name, value in zip(found.errors.names, found.x, strict=True) if name.endswith("d_theta")) < 0.2 * DEG
    assert off(true, written(found), "camera_link", "hand_link") < 0.3
    assert max(off(true, written(found), "base", end) for end in ("hand_link", "camera_link")) < 3.5
    (line,) = found.warnings
    assert "'base', from which both branches leave, is seen from neither end: of 'pan' and 'a1' the measurements tell the sum alone" in line


def test_two_arms_of_parallel_first_axes_are_complete(rng: np.random.Generator) -> None:
    """A foot yawed across first axes that are parallel to each other and across the torso's z is found, not called noise."""
    left, right = arm("l", "base", "0 0.2 0.3", "0 1 0"), arm("r", "base", "0 -0.2 0.3", "0 1 0")
    robot = robot_of([*left, *right], [("left", "l6_link"), ("right", "r6_link")])
    robot, errors = seen(robot, "right_link", "left_link")
    truth = np.zeros(len(errors.names))
    truth[errors.names.index("r1.rot_z")] = 0.5 * DEG
    setup, data = measured(robot, errors, truth, "right_link", rng, poses=80)
    found = fit(robot, data)
    true = corrected_robot(robot, setup.errors.corrected_origins(setup.x))
    assert off(true, written(found), "left_link", "right_link") < 0.3
    assert found.noise_of("point") == pytest.approx(NOISE.length, rel=0.2)
    assert not found.outliers


@pytest.mark.parametrize("joint", ["a4", "a6"])
def test_what_both_ends_held_the_joints_carry(rng: np.random.Generator, joint: str) -> None:
    """Where reference and target are known, an error along any direction of any joint is found in the root's own frame."""
    robot = robot_of(arm("a", "base", "0.05 0.03 0.1"), [("hand", "a6_link")])
    robot, errors = seen(robot, "hand_link", "base", known=True)
    truth = np.zeros(len(errors.names))
    for name in ("trans_x", "trans_y", "trans_z"):
        truth[errors.names.index(f"{joint}.{name}")] = 2 * MM
    setup, data = measured(robot, errors, truth, "hand_link", rng, known=True)
    found = fit(robot, data, options=ModelOptions(reference_known=True, target_known=True))
    assert not any(parameter.kind in ("reference", "target") for parameter in found.errors.parameters)
    true = corrected_robot(robot, setup.errors.corrected_origins(setup.x))
    assert off(true, written(found), "base", "hand_link") < 0.15
    assert found.noise_of("point") == pytest.approx(NOISE.length, rel=0.2)


@dataclass(frozen=True)
class Branches:
    """A waist with two arms: the true robot, a fit of the left one, and of the right one with and without what the first decided."""

    true: Robot
    first: FitResult
    second: FitResult
    blind: FitResult
    left: Measurements

    def misplaced(self, found: FitResult, hand: str) -> float:
        """RMS of a hand in the base as a tracker would see it, that stands anywhere, as its target does, [mm]."""
        true, errors = seen(self.true, hand, "base")
        exact = measured(
            true, errors, np.zeros(len(errors.names)), hand, np.random.default_rng(8), 100, noise=ReadingNoise(length=1e-9, angle=1e-9)
        )
        return rms_of(evaluate(seen(written(found), hand, "base")[0], exact[1]))


@pytest.fixture(scope="module")
def branches() -> Branches:
    """Errors of 2 mm and 0.2 deg in every joint; the waist's own are the same for both arms."""
    rng, sizes = np.random.default_rng(5), {"m": 2 * MM, "rad": 0.2 * DEG}
    arms = [*arm("l", "pitch_link", "0 0.2 0.3", "0 1 0"), *arm("r", "pitch_link", "0 -0.2 0.3", "0 1 0")]
    robot = robot_of([*WAIST, *arms], [("left", "l6_link"), ("right", "r6_link")])
    drawn: dict[str, float] = {}
    origins: dict[str, SE3] = {}
    data = []
    for hand in ("left_link", "right_link"):
        own, errors = seen(robot, hand, "base")
        drawn = {parameter.name: rng.normal(0, sizes[parameter.unit]) for parameter in errors.parameters} | drawn
        setup, readings = measured(own, errors, np.array([drawn[name] for name in errors.names]), hand, rng)
        origins |= setup.errors.corrected_origins(setup.x)
        data.append(readings)
    first = fit(seen(robot, "left_link", "base")[0], data[0])
    again = seen(written(first), "right_link", "base")[0]
    return Branches(corrected_robot(robot, origins), first, fit(again, data[1], after=first), fit(again, data[1]), data[0])


def test_the_first_arm_keeps_what_it_was_given(branches: Branches) -> None:
    """With what the first fit decided the second spoils the first arm hardly, and calibrates its own as well as without."""
    left = {name: branches.misplaced(getattr(branches, name), "left_link") for name in ("first", "second", "blind")}
    assert left["second"] < 1.3 * left["first"]
    assert left["blind"] > 3 * left["first"]
    assert branches.misplaced(branches.second, "right_link") < 1.3 * branches.misplaced(branches.blind, "right_link")


def test_both_arms_are_written_and_a_third_may_follow(branches: Branches) -> None:
    """The second calibration holds the joints of both arms, none of them less sure than before."""
    assert {"l1", "r1", "pitch"} <= set(branches.second.corrections)
    before, after = joints_of(branches.first), joints_of(branches.second)
    assert np.linalg.eigvalsh(after.covariance).min() > 0
    variances = dict(zip(after.names, np.diag(after.covariance), strict=True))
    for name, variance in zip(before.names, np.diag(before.covariance), strict=True):
        assert variances[name] < 1.05 * variance


def test_another_robot_is_refused(branches: Branches) -> None:
    """What was decided is about the origins that were written: the nominal robot is refused by the name of a joint."""
    with pytest.raises(RobotError, match=r"joint '\w+' of robot.urdf is .* mm and .* mrad from where the earlier calibration has it"):
        fit(branches.first.robot, branches.left, after=branches.first)


def test_how_one_end_moves_against_the_other_is_a_derivative(rng: np.random.Generator) -> None:
    """The motion of a hand against the other hand, by every parameter of both branches, is what differences of the URDFs give."""
    arms = [*arm("l", "base", "0 0.2 0.3", "0 1 0"), *arm("r", "base", "0 -0.2 0.3", "0 1 0")]
    robot, _ = seen(robot_of(arms, [("left", "l6_link"), ("right", "r6_link")]), "right_link", "left_link")
    errors = build_error_model(robot.chain, robot.rig)
    x = rng.normal(0, 0.01, len(errors.names))
    q = rng.uniform(-1, 1, (3, len(robot.chain.inputs)))

    def origins(x: np.ndarray) -> np.ndarray:
        moved = corrected_robot(robot, errors.corrected_origins(x))
        data, places = moved.model.createData(), []
        for configuration in whole_configurations(moved, q):
            pin.framesForwardKinematics(moved.model, data, configuration)
            left, right = (data.oMf[moved.model.getFrameId(link, pin.FrameType.BODY)] for link in ("left_link", "right_link"))
            places.append(left.actInv(right).translation)
        return np.array(places)

    jacobian = tool_jacobian(robot, errors, x, "right_link", q, far=True)[:, :3]
    np.testing.assert_allclose(jacobian, central_differences(origins, x), atol=1e-8)
    joints = [column for column, parameter in enumerate(errors.parameters) if parameter.kind == "joint"]
    assert np.abs(jacobian[..., joints]).max(axis=(0, 1)).min() > 0
