"""Mistakes in what instruments beside lasers read: each named, and none on healthy data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from tests.support.helpers import with_joint
from tests.support.sensor_cases import CASES, NOISE, SensorCase, setup_of
from urdfcal import FitRejected, fit
from urdfcal.base.geometry import DEG, MM, Array3
from urdfcal.calibration.start.mistakes import mistakes_of_joints, mistakes_of_readings
from urdfcal.calibration.start.reading_hypotheses import best_reading_hypothesis
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.stated_noise import noise_of
from urdfcal.simulation.readings import simulate_readings

Change = Callable[[Measurements], Measurements]
POINT, POSE = CASES["point"], CASES["pose"]


def measured(case: SensorCase, robots: dict[str, Robot], seed: int, poses: int = 50) -> tuple[Robot, Measurements]:
    """A robot with errors of 2 mm and 0.2 deg in the parameters of `auto`, and what its instruments read."""
    rng = np.random.default_rng(seed)
    setup = setup_of(case, robots, rng, model="auto")
    return setup.robot, simulate_readings(setup, poses, rng, NOISE)


def with_values(kind: str, change: Callable[[np.ndarray], np.ndarray]) -> Change:
    """A mistake in all readings of a kind."""
    return lambda data: replace(
        data, readings=tuple(replace(each, values=change(each.values)) if each.sensor == kind else each for each in data.readings)
    )


def inverted(data: Measurements) -> Measurements:
    """Every pose as that of the measuring frame in the target."""
    point, axes = (next(each for each in data.readings if each.sensor == kind) for kind in ("point", "orientation"))
    turn = Rotation.from_quat(axes.values).inv()
    return replace(data, readings=(replace(point, values=-turn.apply(point.values)), replace(axes, values=turn.as_quat())))


def turning(values: np.ndarray) -> np.ndarray:
    """Roll, pitch and yaw about axes that turn along, taken for those about fixed axes."""
    return np.asarray(Rotation.from_euler("xyz", Rotation.from_quat(values).as_euler("XYZ")).as_quat())


def in_degrees(values: np.ndarray) -> np.ndarray:
    """Roll, pitch and yaw in radians, with [deg] in the header."""
    return np.asarray(Rotation.from_euler("xyz", Rotation.from_quat(values).as_euler("xyz") * DEG).as_quat())


def rewritten(convention: str) -> Callable[[np.ndarray], np.ndarray]:
    """Numbers of another convention, taken for roll, pitch and yaw."""

    def change(values: np.ndarray) -> np.ndarray:
        turns = Rotation.from_quat(values)
        numbers = turns.as_rotvec() if convention == "vector" else turns.as_euler(convention)
        return np.asarray(Rotation.from_euler("xyz", numbers).as_quat())

    return change


def counted_from_the_horizontal(data: Measurements) -> Measurements:
    """The third joint read less the second, as Fanuc's controllers do."""
    return replace(data, q=data.q - data.q[:, [1]] * (np.arange(data.q.shape[1]) == 2))


def exchanged(data: Measurements) -> Measurements:
    """The second and the third joint read for each other."""
    return replace(data, q=data.q[:, [0, 2, 1, 3, 4, 5]])


MISTAKES: dict[str, tuple[SensorCase, Change]] = {
    "the points read as millimetres": (POINT, with_values("point", lambda values: values / MM)),
    "the points read as metres in place of millimetres": (POSE, with_values("point", lambda values: values * MM)),
    "a left-handed frame": (POINT, with_values("point", lambda values: values[:, [1, 0, 2]])),
    "the quaternions read as w, x, y, z": (POSE, with_values("orientation", lambda values: values[:, [3, 0, 1, 2]])),
    "about axes that turn along": (POSE, with_values("orientation", turning)),
    "roll, pitch and yaw read as radians in place of degrees": (POSE, with_values("orientation", in_degrees)),
    "read as a rotation vector (Rx, Ry, Rz, as Universal Robots has it)": (POSE, with_values("orientation", rewritten("vector"))),
    "read as A, B, C about z, y', x'' (as KUKA has them)": (POSE, with_values("orientation", rewritten("ZYX"))),
    "shoulder_lift_joint added to elbow_joint": (POINT, counted_from_the_horizontal),
    "the poses inverted": (POSE, inverted),
    "the distances read as millimetres": (CASES["distance"], with_values("distance", lambda values: values / MM)),
    "the sign of elbow_joint flipped": (POINT, with_joint(2, factor=-1.0)),
    "90 deg added to wrist_1_joint": (POSE, with_joint(3, shift=-90 * DEG)),
    "wrist_2_joint read as degrees": (POINT, with_joint(4, factor=1 / DEG)),
    "shoulder_lift_joint and elbow_joint swapped": (CASES["socket"], exchanged),
    "the joints taken from the row behind": (POSE, lambda data: replace(data, q=np.roll(data.q, 1, axis=0))),
}


@pytest.mark.parametrize("words", MISTAKES)
def test_a_mistake_is_named(robots: dict[str, Robot], words: str) -> None:
    """Each mistake is named in one line, also where frame and target stand anywhere."""
    case, change = MISTAKES[words]
    robot, data = measured(case, robots, seed=1)
    with pytest.raises(FitRejected) as refused:
        fit(robot, change(data))
    assert words in str(refused.value)
    assert str(refused.value).startswith("the data fit ")
    assert "\n" not in str(refused.value)


def test_a_mistake_is_fitted_on_request(robots: dict[str, Robot]) -> None:
    """`--no-sanity` fits what is there, and the result is not to be trusted."""
    robot, data = measured(POSE, robots, seed=2)
    found = fit(robot, with_values("orientation", lambda values: values[:, [3, 0, 1, 2]])(data), sane=False)
    assert found.rejection.startswith("the orientations scatter by ")


def test_a_mistake_in_a_few_poses_is_named(robots: dict[str, Robot]) -> None:
    """Joints moved one at a time: the poses that move the second joint are a sixth, and are not taken for outliers."""
    robot, data = one_joint_at_a_time(robots)
    with pytest.raises(FitRejected, match=r"^\d+ of 48 poses fit \d+ times better with shoulder_lift_joint added to elbow_joint"):
        fit(robot, counted_from_the_horizontal(data))


def test_a_few_wild_readings_are_no_mistake(robots: dict[str, Robot]) -> None:
    """The same motion read rightly, with every seventh point far off: those are outliers, whatever would shrink them."""
    robot, data = one_joint_at_a_time(robots)
    bad = (np.arange(48) % 7 == 3)[:, None] * np.random.default_rng(1).uniform(-0.2, 0.2, (48, 3))
    found = fit(robot, with_values("point", lambda values: values + bad)(data))
    assert len(found.outliers) >= 6


def one_joint_at_a_time(robots: dict[str, Robot]) -> tuple[Robot, Measurements]:
    """Eight poses of each joint about one home, of a robot with errors of 1 mm and 0.1 deg, by Pinocchio."""
    rng = np.random.default_rng(2)
    robot, data = measured(POSE, robots, seed=1, poses=48)
    true = robot.model.copy()
    for index in range(1, true.njoints):
        true.jointPlacements[index] *= pin.exp6(rng.normal(0, [1e-3] * 3 + [2e-3] * 3))
    q = np.tile([0.1, -1.2, 1.4, 0.2, 0.8, 0.1], (48, 1))
    q[np.arange(48), np.arange(48) // 8] += rng.uniform(-1, 1, 48)
    frame, state, poses = true.getFrameId("tool0"), true.createData(), []
    for configuration in q:
        pin.framesForwardKinematics(true, state, configuration)
        poses.append(state.oMf[frame].copy())
    points = np.array([T.translation for T in poses]) + rng.normal(0, 5e-5, (48, 3))
    axes = np.array([pin.Quaternion(T.rotation).coeffs() for T in poses])
    readings = tuple(replace(each, values={"point": points, "orientation": axes}[each.sensor]) for each in data.readings)
    return robot, replace(data, q=q, readings=readings)


def test_two_targets_read_for_each_other_are_named(robots: dict[str, Robot]) -> None:
    """Points on two links, in each other's columns."""
    robot, data = measured(SensorCase("ur5", ("point:tool0", "point:forearm_link")), robots, seed=3)
    one, other = data.readings
    wrong = replace(data, readings=(replace(one, values=other.values), replace(other, values=one.values)))
    with pytest.raises(FitRejected, match="tool0 and forearm_link swapped"):
        fit(robot, wrong)


@pytest.mark.parametrize("name", CASES)
def test_healthy_readings_are_left_alone(robots: dict[str, Robot], name: str) -> None:
    """Every arrangement of instruments, with honest errors, passes without a word."""
    robot, data = measured(CASES[name], robots, seed=4, poses=60)
    assert not fit(robot, data, options=ModelOptions(reference_known=CASES[name].known)).rejection


def test_large_honest_errors_and_outliers_are_no_mistake(robots: dict[str, Robot]) -> None:
    """Errors of 10 mm and 1 deg, and every tenth point far off."""
    rng = np.random.default_rng(5)
    setup = setup_of(POINT, robots, rng, model="auto", translation=10 * MM, rotation=1 * DEG)
    data = simulate_readings(setup, 60, rng, NOISE)
    bad = (rng.random(60) < 0.1)[:, None] * rng.uniform(-0.2, 0.2, (60, 3))
    found = fit(setup.robot, with_values("point", lambda values: values + bad)(data))
    assert not found.rejection
    assert len(found.outliers) >= 3


def test_a_zero_that_a_free_frame_stands_for_is_no_mistake(robots: dict[str, Robot]) -> None:
    """The first joint's zero turns the measuring frame, which stands anywhere."""
    robot, data = measured(POINT, robots, seed=6)
    assert not fit(robot, with_joint(0, shift=90 * DEG)(data)).rejection


def test_no_two_hypotheses_do_the_same(robots: dict[str, Robot]) -> None:
    """Each changes the measurements, no two alike, and the measurements themselves stay."""
    robot, data = measured(CASES["every kind"], robots, seed=7, poses=24)
    before = data.q.copy()
    mistakes = (*mistakes_of_readings(data, beams=False), *mistakes_of_joints(data, robot.chain.inputs))
    prints = {_print(mistake.change(data)) for mistake in mistakes} | {_print(data)}
    assert len(prints) == len(mistakes) + 1
    np.testing.assert_array_equal(data.q, before)


def _print(data: Measurements) -> tuple[bytes, ...]:
    values: list[Array3] = [np.round(each.values, 12) for each in data.readings]
    return (np.round(data.q, 9).tobytes(), *(each.tobytes() for each in values))


@pytest.mark.parametrize("factor", [100.0, 1 / 0.0254])
def test_points_in_other_units_are_named_as_such(robots: dict[str, Robot], factor: float) -> None:
    """Centimetres and inches taken for metres are not called millimetres."""
    robot, data = measured(POINT, robots, seed=4)
    with pytest.raises(FitRejected, match="the points read as " + ("centimetres" if factor == 100 else "inches")):
        fit(robot, with_values("point", lambda values: values * factor)(data))


def test_what_no_mistake_explains_is_given_no_name(robots: dict[str, Robot]) -> None:
    """Numbers that shrink under a hypothesis, and so leave less over, make it no better: ten times too large is no known unit."""
    robot, data = measured(POINT, robots, seed=5)
    found = fit(robot, with_values("point", lambda values: values * 10)(data))
    assert "points scatter by" in found.rejection


def test_an_arm_that_stands_still_explains_no_touches(robots: dict[str, Robot]) -> None:
    """Read as degrees, joints hardly turn, and any plane suits a point that hardly moves; large errors are not taken for that."""
    rng = np.random.default_rng(3)
    setup = setup_of(CASES["plane"], robots, rng, model="auto", translation=10 * MM, rotation=3 * DEG)
    data = simulate_readings(setup, 40, rng, NOISE)
    assert fit(setup.robot, data).converged


def test_few_poses_tell_no_mistake_from_another(robots: dict[str, Robot]) -> None:
    """With hardly more numbers than parameters nothing is named."""
    robot, data = measured(POINT, robots, seed=6, poses=11)
    wrong = with_joint(2, factor=-1.0)(data)
    errors = build_error_model(robot.chain, robot.rig)
    noise = noise_of(wrong, {}, np.zeros(len(robot.chain.inputs)))
    assert best_reading_hypothesis(errors, wrong, noise) is None
