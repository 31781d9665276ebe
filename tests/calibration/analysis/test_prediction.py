"""How sure a fit is of what a user sees, against draws from the covariance and differences of Pinocchio's forward kinematics."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from tests.support.helpers import central_differences, poses_in_view, tool_sigma
from tests.support.small_robot import LASERS, joint, robot_of, robot_text
from urdfcal.api import fit
from urdfcal.base.errors import RobotError, ShapeMismatch
from urdfcal.calibration.analysis import prediction
from urdfcal.calibration.analysis.prediction import base_link, default_tool, spot_jacobians, spot_sigma, tool_jacobian
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.reach import draw_poses
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.robot.configurations import joint_limits
from urdfcal.robot.corrections import OriginCorrection, corrected_model
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import spots_measured
from urdfcal.sensors.spots import beams_at
from urdfcal.simulation.readings import SimulatedNoise, simulate

EVERYTHING = ModelOptions(error_model="placement", estimate=("beams4",))
BARE_MODULE = robot_text(  # the moving link carries the lasers itself
    joint("j0", "screen", "a", '<origin xyz="-1 0 0.2"/>', kind="fixed"),
    joint("j1", "a", "b", '<origin xyz="0.1 0 0.3" rpy="0.2 0 0"/>', '<axis xyz="0 1 0"/>'),
    joint("j2", "b", "c", '<origin xyz="0.3 0.1 0" rpy="0 1.4 0.1"/>', '<axis xyz="0 0 1"/>'),
    LASERS,
)


def tool_poses(robot: Robot, errors: ErrorModel, x: np.ndarray, link: str, q: np.ndarray) -> list[object]:
    """T_base_link at each q by Pinocchio, on the whole robot's model with the origins of x in it."""
    joints = robot.tree.joints
    model = corrected_model(
        robot.model,
        {name: OriginCorrection(joints[name].origin, origin, joints[name].moves) for name, origin in errors.corrected_origins(x).items()},
    )
    data, base, tool = model.createData(), model.getFrameId(base_link(robot, link)), model.getFrameId(link)
    poses = []
    for row in q:
        full = pin.neutral(model)
        for name, value in zip(robot.chain.input_names, row, strict=True):
            moving = model.joints[model.getJointId(name)]
            full[moving.idx_q : moving.idx_q + moving.nq] = [value] if moving.nq == 1 else [np.cos(value), np.sin(value)]
        pin.framesForwardKinematics(model, data, full)
        poses.append(data.oMf[base].actInv(data.oMf[tool]))
    return poses


def tool_errors(
    robot: Robot, errors: ErrorModel, x: np.ndarray, others: np.ndarray, link: str, q: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Squared distances [m^2] and angles [rad^2] between the tool at x and at other states, (draws, n)."""
    mean = tool_poses(robot, errors, x, link, q)
    pairs = [list(zip(mean, tool_poses(robot, errors, other, link, q), strict=True)) for other in others]
    distance = [[np.sum((a.translation - b.translation) ** 2) for a, b in poses] for poses in pairs]
    angle = [[np.sum(pin.log3(a.rotation.T @ b.rotation) ** 2) for a, b in poses] for poses in pairs]
    return np.array(distance), np.array(angle)


def beams_of(robot: Robot, errors: ErrorModel, x: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Spots (n, lasers, 2) and lengths (n, lasers) of the beams by Pinocchio, on the whole robot's model with the origins of x in it."""
    joints = robot.tree.joints
    origins = {
        name: OriginCorrection(joints[name].origin, origin, joints[name].moves) for name, origin in errors.corrected_origins(x).items()
    }
    model = corrected_model(robot.model, origins)
    data, screen = model.createData(), model.getFrameId(robot.rig.base)
    spots, lengths = np.empty((len(q), 2, 2)), np.empty((len(q), 2))
    for pose, row in enumerate(q):
        full = pin.neutral(model)
        for name, value in zip(robot.chain.input_names, row, strict=True):
            full[model.joints[model.getJointId(name)].idx_q] = value
        pin.framesForwardKinematics(model, data, full)
        for laser, link in enumerate(robot.rig.lasers):
            T_screen_laser = data.oMf[screen].actInv(data.oMf[model.getFrameId(link)])
            lengths[pose, laser] = -T_screen_laser.translation[0] / T_screen_laser.rotation[0, 2]
            spots[pose, laser] = (T_screen_laser.translation + lengths[pose, laser] * T_screen_laser.rotation[:, 2])[1:]
    return spots, lengths


def some_covariance(errors: ErrorModel, rng: np.random.Generator, scale: float = 1e-4) -> np.ndarray:
    """A covariance with correlations, (p, p)."""
    p = len(errors.names)
    root = rng.normal(0, scale / np.sqrt(p), (p, p))
    return root @ root.T


def some_state(errors: ErrorModel, rng: np.random.Generator) -> np.ndarray:
    """A state away from zero."""
    return rng.normal(0, 1e-2, len(errors.names))


@pytest.mark.parametrize(
    ("name", "link"),
    [
        ("arm7", "slm"),
        ("panda", "panda_hand"),
        ("ur5", "forearm_link"),
        ("tiago", "slm"),
        ("ur5", "laser_1"),
        ("bare", "c"),
        ("bare", "laser_1"),
    ],
)
def test_the_tool_moves_as_forward_kinematics_says(robots: dict[str, Robot], name: str, link: str, rng: np.random.Generator) -> None:
    """Every parameter between base and tool moves it as differences of Pinocchio's kinematics of the corrected robot do; no other does."""
    robot = robot_of(BARE_MODULE) if name == "bare" else robots[name]
    errors = build_error_model(robot.chain, robot.rig, EVERYTHING)
    x, q = some_state(errors, rng), rng.uniform(*joint_limits(robot), (2, len(robot.chain.inputs)))
    found = tool_jacobian(robot, errors, x, link, q)
    middle = tool_poses(robot, errors, x, link, q)

    def motion(state: np.ndarray) -> np.ndarray:
        poses = tool_poses(robot, errors, state, link, q)
        return np.array(
            [[*(b.translation - a.translation), *pin.log3(b.rotation @ a.rotation.T)] for a, b in zip(middle, poses, strict=True)]
        )

    expected = central_differences(motion, x)  # in base axes; lengths and products are the same in the screen's
    for part in (slice(0, 3), slice(3, 6)):
        np.testing.assert_allclose(*(np.einsum("nkp,nkr->npr", J[:, part], J[:, part]) for J in (found, expected)), atol=1e-8)


def test_tool_sigma_is_the_scatter_of_corrected_robots(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """The predicted position and rotation sigma are the RMS errors of robots drawn from the belief."""
    robot = robots["panda"]
    errors = build_error_model(robot.chain, robot.rig)
    x, P = some_state(errors, rng), some_covariance(errors, rng)
    q = rng.uniform(*joint_limits(robot), (40, len(robot.chain.inputs)))
    distance, angle = tool_errors(robot, errors, x, rng.multivariate_normal(x, P, 300), "slm", q)
    predicted = tool_sigma(robot, errors, P, x, "slm", q)
    np.testing.assert_allclose(
        np.sqrt(np.stack([distance.mean(axis=0), angle.mean(axis=0)], axis=-1)), predicted, rtol=4 / np.sqrt(2 * 300)
    )


@pytest.mark.parametrize("name", ["arm7", "panda"])
def test_spot_sigma_is_the_scatter_of_spots(robots: dict[str, Robot], name: str, rng: np.random.Generator) -> None:
    """The predicted sigma of a spot is the RMS distance of the spots of robots drawn from the belief."""
    robot = robots[name]
    errors = build_error_model(robot.chain, robot.rig, ModelOptions(estimate=("beams",)))
    x, P = some_state(errors, rng), some_covariance(errors, rng)
    q = poses_in_view(robot, errors, x, 20, rng, least_zx=0.5)
    model = Problem(errors, spots_measured(robot, q, np.zeros((20, 2, 2))))
    middle = np.stack(model.read(x), axis=1)
    squares = [np.sum((np.stack(model.read(draw), axis=1) - middle) ** 2, axis=-1) for draw in rng.multivariate_normal(x, P, 400)]
    np.testing.assert_allclose(np.sqrt(np.mean(squares, axis=0)), spot_sigma(errors, P, x, q), rtol=5 / np.sqrt(2 * 400))


@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_spot_accuracy_is_that_of_robots_drawn_from_the_posterior(robots: dict[str, Robot], name: str, rng: np.random.Generator) -> None:
    """Median, 95 % and worst predicted error over workspace and measured poses are those of draws from a fit's posterior, by laser."""
    robot = robots[name]
    errors = build_error_model(robot.chain, robot.rig)
    truth = rng.normal(0, np.where(np.array(errors.units) == "m", 3e-3, np.radians(0.3)))
    data = simulate(robot, errors, truth, draw_poses(robot, errors, truth, 40, rng), rng, SimulatedNoise(1e-3))
    found = fit(robot, data)
    draws = rng.multivariate_normal(found.x, found.covariance, 400)
    for q in (prediction.poses_in_view(robot, found.errors, found.x, data, rng, 100), data.q):
        model = Problem(found.errors, spots_measured(robot, q, np.zeros((len(q), 2, 2))))
        middle = np.stack(model.read(found.x), axis=1)
        rms = np.sqrt(np.mean([np.sum((np.stack(model.read(draw), axis=1) - middle) ** 2, axis=-1) for draw in draws], axis=0))
        predicted = prediction.spot_accuracy(found.errors, found.covariance, found.x, q)
        assert predicted.lasers == data.lasers
        assert predicted.poses == (len(q), len(q))
        for level, quantile in ((predicted.median, 0.5), (predicted.most, 0.95), (predicted.worst, 1.0)):
            np.testing.assert_allclose(np.quantile(rms, quantile, axis=0), level, rtol=0.1)
        assert (predicted.median < predicted.most).all()
        assert (predicted.most < predicted.worst).all()


def test_poses_in_view_put_every_beam_where_spots_were_seen(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Positions are within the joints' limits, and their spots by Pinocchio's frames within the rectangle of the measured ones."""
    robot = robots["panda"]
    errors = build_error_model(robot.chain, robot.rig)
    x = some_state(errors, rng)
    box = np.array([[-0.4, -0.3], [0.5, 0.6]])
    seen = spots_measured(robot, np.zeros((2, 7)), np.stack([box, box], axis=1))
    q = prediction.poses_in_view(robot, errors, x, seen, rng, 200)
    lower, upper = joint_limits(robot)
    assert q.shape == (200, 7)
    assert ((q > lower) & (q < upper)).all()
    spots, lengths = beams_of(robot, errors, x, q)
    assert (lengths > 0).all()
    assert ((spots > box[0]) & (spots < box[1])).all()


def test_a_view_that_is_never_met_has_no_poses(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Where no random position puts its beams between the spots, none is returned, and the accuracy of none is nan."""
    robot = robots["panda"]
    errors = build_error_model(robot.chain, robot.rig)
    seen = spots_measured(robot, np.zeros((1, 7)), np.full((1, 2, 2), 0.1))
    q = prediction.poses_in_view(robot, errors, errors.mean, seen, rng)
    assert q.shape == (0, 7)
    found = prediction.spot_accuracy(errors, np.eye(len(errors.names)), errors.mean, q)
    assert found.poses == (0, 0)
    assert np.isnan([found.median, found.most, found.worst]).all()


def test_instruments_do_not_enter_the_tools_error(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """An uncertain screen, mount or beam says nothing of the hand, and the mount alone of what it carries."""
    robot = robots["panda"]
    errors = build_error_model(robot.chain, robot.rig, EVERYTHING)
    q = rng.uniform(*joint_limits(robot), (3, len(robot.chain.inputs)))
    for kind, of_hand, of_module in (("screen", False, False), ("beam", False, False), ("mount", False, True), ("joint", True, True)):
        P = np.diag([1e-6 * (parameter.kind == kind) for parameter in errors.parameters])
        for link, moves in (("panda_hand", of_hand), ("slm", of_module)):
            assert (tool_sigma(robot, errors, P, errors.mean, link, q) > 0).all() == moves, (kind, link)


def test_a_screen_that_carries_the_arm_does_not_enter(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Where the first joint hangs on the screen link itself, the screen's placement is still no error of the tool."""
    robot = robots["arm7"]
    errors = build_error_model(robot.chain, robot.rig, ModelOptions(estimate=("screen",)))
    P = np.diag([float(parameter.kind == "screen") for parameter in errors.parameters])
    assert P.any()
    assert not tool_sigma(robot, errors, P, some_state(errors, rng), "slm", rng.uniform(-1, 1, (3, 7))).any()


def test_a_carried_screen_is_the_tool(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Where the arm holds the screen and the lasers stand still, the screen is the tool, and moves as forward kinematics says."""
    text = robots["ur5"].description.text.decode().replace('link name="slm"', 'link name="held"').replace('"slm"', '"held"')
    text = text.replace('link name="screen"', 'link name="slm"').replace('"screen"', '"slm"').replace('"held"', '"screen"')
    robot = robot_of(text.replace('<parent link="screen"/>\n    <child link="laser_', '<parent link="slm"/>\n    <child link="laser_'))
    errors = build_error_model(robot.chain, robot.rig)
    x, q = some_state(errors, rng), rng.uniform(*joint_limits(robot), (10, 6))
    assert default_tool(robot) == "screen"
    assert base_link(robot, "screen") == base_link(robots["ur5"], "slm")
    for link in ("screen", "forearm_link"):
        P = some_covariance(errors, rng)
        distance, angle = tool_errors(robot, errors, x, rng.multivariate_normal(x, P, 300), link, q)
        predicted = tool_sigma(robot, errors, P, x, link, q)
        np.testing.assert_allclose(
            np.sqrt(np.stack([distance.mean(axis=0), angle.mean(axis=0)], axis=-1)), predicted, rtol=4 / np.sqrt(2 * 300)
        )


def test_links_that_are_not_calibrated_are_refused(robots: dict[str, Robot]) -> None:
    """A link that no calibrated joint moves, or that is misspelt, is one line with the way out."""
    robot = robots["panda"]
    errors = build_error_model(robot.chain, robot.rig)
    P, q = np.eye(len(errors.names)), np.zeros((1, 7))
    with pytest.raises(RobotError, match=r"none of the calibrated joints \(panda_joint1, .*\) moves link 'panda_link0'"):
        tool_sigma(robot, errors, P, errors.mean, "panda_link0", q)
    with pytest.raises(RobotError, match=r"no link named 'panda_hnd' .* did you mean 'panda_hand'"):
        tool_sigma(robot, errors, P, errors.mean, "panda_hnd", q)


def test_shapes_that_do_not_fit_are_refused(robots: dict[str, Robot]) -> None:
    """A covariance, state or position of another size is refused."""
    robot = robots["panda"]
    errors = build_error_model(robot.chain, robot.rig)
    P, q = np.eye(len(errors.names)), np.zeros((1, 7))
    with pytest.raises(ShapeMismatch, match="covariance has shape"):
        spot_sigma(errors, P[1:, 1:], errors.mean, q)
    with pytest.raises(ShapeMismatch, match="x has shape"):
        tool_sigma(robot, errors, P, errors.mean[1:], "slm", q)
    with pytest.raises(ShapeMismatch):
        spot_sigma(errors, P, errors.mean, q[:, 1:])


def test_a_beam_that_misses_has_no_sigma(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Where the screen lies behind a laser there is no spot, and its sigma is nan."""
    robot = robots["panda"]
    errors = build_error_model(robot.chain, robot.rig)
    q = rng.uniform(*joint_limits(robot), (60, 7))
    lengths = beams_at(errors, errors.mean, q).length
    sigma = spot_sigma(errors, np.eye(len(errors.names)), errors.mean, q)
    assert 0 < np.isnan(sigma).sum() < sigma.size
    np.testing.assert_array_equal(np.isnan(sigma), lengths < 0)
    assert spot_jacobians(errors, errors.mean, q).shape == (60, 2, 2, len(errors.names))
