"""What the paper's two sections do: their poses, noise, true errors, cases and estimators."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import DEG, MM, Mask, Matrix, Vector
from urdfcal.calibration.reach import draw_poses
from urdfcal.model.error_model import ErrorModel
from urdfcal.robot.configurations import joint_limits
from urdfcal.robot.robot import Robot
from urdfcal.robot.sheet import ScreenArea
from urdfcal.simulation.published import TABLE_II, TABLE_III, TABLE_V, TABLE_VI, TABLE_VII, After, Before
from urdfcal.simulation.readings import true_spots

HALF = 30  # poses near home, and poses over the whole ranges
NEAR = 10 * DEG
JOINT_NOISE, SPOT_NOISE = 0.1 * DEG, 2.0 * MM
TRUTH = {"m": 10 * MM, "rad": 1 * DEG}
_FAR = 1e3  # [m]; no rig is so large
SCREEN_SIZE = 1.5  # [m]; the published errors leave every spot on a screen of about this size
PROTOCOLS = {"one reading": 1, "mean of 100": 100}
ESTIMATORS = ("LSE", "EKF", "EKF, noise stated")
CASES = (1, 2, 3)


@dataclass(frozen=True)
class Study:
    """What a section of the paper does.

    Attributes:
        section: 4 or 5.
        half: Poses near home, and poses over the whole ranges.
        protocols: How many readings of a pose are averaged, by the protocol's name.
        estimators: Those of ESTIMATORS that take part.
        max_sweeps: Of the EKF.
        before: Published distances before calibration.
        after: Published distances after it.
        truth: The true errors in the order of the parameters, [mm] and [deg]; empty for TRUTH on every joint.
    """

    section: int
    half: int
    protocols: Mapping[str, int]
    estimators: tuple[str, ...]
    max_sweeps: int
    before: Before
    after: After
    truth: tuple[float, ...] = ()

    @property
    def fits(self) -> int:
        """How many fits one draw of poses and noise takes."""
        return len(self.protocols) * len(self.estimators) * len(CASES)

    def true_errors(self, errors: ErrorModel) -> Vector:
        """The truth, (p,), [m] and [rad].

        Raises:
            UsageError: the study is of an arm with another number of errors.
        """
        if not self.truth:
            return paper_truth(errors)
        if len(self.truth) != len(errors.names):
            raise UsageError(
                f"the true errors of section {self.section} are the {len(self.truth)} of its own arm, "
                f"this robot has {len(errors.names)}; leave ROBOT out, or name --section 4"
            )
        return np.array(self.truth) * [MM if unit == "m" else DEG for unit in errors.units]


SECTION_4 = Study(4, HALF, PROTOCOLS, ESTIMATORS, 5000, TABLE_II, TABLE_III)
SECTION_5 = Study(5, 25, {"one reading": 1, "mean of 2": 2}, ("EKF",), 10_000, TABLE_VI, TABLE_VII, TABLE_V[3])
STUDIES = {study.section: study for study in (SECTION_4, SECTION_5)}


def paper_truth(errors: ErrorModel) -> Vector:
    """(10 mm, 10 mm, 1 deg, 1 deg) on every joint, a perfect module."""
    return np.array([TRUTH[parameter.unit] if parameter.kind == "joint" else 0.0 for parameter in errors.parameters])


def paper_poses(robot: Robot, errors: ErrorModel, truth: Vector, rng: np.random.Generator, half: int = HALF) -> Matrix:
    """Half the poses with every joint within +-10 deg and its limits, half over the whole ranges; every spot on the screen."""
    whole = joint_limits(robot)
    near = np.clip(np.array([[-NEAR], [NEAR]]) * np.ones_like(whole), whole[0], whole[1])
    area = ScreenArea(SCREEN_SIZE, _home_centre(robot, errors))
    return np.vstack([draw_poses(robot, errors, truth, half, rng, area=area, limits=limits) for limits in (near, whole)])


def cases(half: int = HALF) -> Iterator[tuple[int, str, Mask]]:
    """Case, set, and the poses that belong to it."""
    number = np.arange(2 * half)
    near = number < half
    first_half = np.where(near, number < (half + 1) // 2, number - half < half // 2)
    yield 1, "fit", near
    yield 1, "test", ~near
    yield 2, "fit", first_half
    yield 2, "test", ~first_half
    yield 3, "fit", number >= 0


def _home_centre(robot: Robot, errors: ErrorModel) -> tuple[float, float]:
    """Between the nominal spots at home, [m].

    Raises:
        UsageError: there are none, since a beam is parallel to the screen.
    """
    home = true_spots(robot, errors, np.zeros(len(errors.names)), np.zeros((1, len(robot.chain.inputs))))[0]
    if not (np.abs(home) < _FAR).all():  # nan is not, either: a beam along the screen meets it at infinity, or nearly
        raise UsageError(
            f"'{robot.name}': with every joint at 0 a beam runs along the screen and meets it nowhere; the paper's studies need a rig that "
            "puts every beam on the screen there: look at it with `urdfcal view`, and turn the module or the screen"
        )
    y, z = home.mean(axis=0)
    return float(y), float(z)
