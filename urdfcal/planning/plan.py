"""Which poses to measure: out of candidates those after which the tool is predicted to be known best."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from urdfcal.base.errors import ShapeMismatch, UsageError
from urdfcal.base.foreign_text import shown
from urdfcal.base.geometry import MM, Array3, Mask, Matrix, Vector
from urdfcal.base.notebook import Listing, card
from urdfcal.base.terminal import rounded
from urdfcal.calibration.analysis.more_poses import covariance, without_lost
from urdfcal.calibration.analysis.prediction import default_tool, tool_jacobian
from urdfcal.calibration.problem import Problem, problem_of
from urdfcal.calibration.reach import draw_poses
from urdfcal.estimation.noise import Noise
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.planning.selection import exchanged, expected, greedy, information
from urdfcal.robot.configurations import random_positions
from urdfcal.robot.robot import Robot, require_robot
from urdfcal.robot.sheet import ScreenArea
from urdfcal.sensors.measurements import Measurements, spot_readings
from urdfcal.sensors.readings import Readings, blank_readings
from urdfcal.sensors.registry import SENSORS
from urdfcal.sensors.stated_noise import joint_sigmas, noise_of, stated_noise
from urdfcal.simulation.setup import SENSOR_KINDS, SimulatedSensor, parse_sensors, seen_with, simulated_setup

CANDIDATES = 2000  # random ones, where none are given
_WORKSPACE = 200
_ROUNDS = 5  # of drawing, where some of what was drawn is in the way
Allowed = Callable[[Robot, Matrix], Mask]
_DRAWS = 10  # of random poses, that the chosen ones are compared with


@dataclass(frozen=True, repr=False)
class PosePlan:
    """Poses that are worth measuring, the most telling first.

    Attributes:
        robot: As the sensors see it.
        joints: Names of the measured joints.
        q: Their positions, (n, joints), [rad] or [m].
        chosen: Which of the candidates they are, (n,).
        tool: The link whose accuracy is predicted.
        tool_sigma_mm: Its predicted position error relative to the base link before the first pose and after each, (n + 1,): RMS over the
            workspace, [mm].
        at_random_mm: The same of as many random candidates, on average, [mm].
        random_mm: The same before the first of random candidates and after each, on average, (n + 1,), [mm].
        undetermined: Parameters whose standard deviation these poses leave above half of what it is before any.
    """

    robot: Robot
    joints: tuple[str, ...]
    q: Matrix
    chosen: npt.NDArray[np.intp]
    tool: str
    tool_sigma_mm: Vector
    at_random_mm: float
    random_mm: Vector = field(default_factory=lambda: np.zeros(0))
    undetermined: tuple[str, ...] = ()

    def __len__(self) -> int:
        """Number of poses."""
        return len(self.q)

    @property
    def _told(self) -> str:
        after, before = rounded(self.tool_sigma_mm[-1], 3), rounded(self.tool_sigma_mm[0], 3)
        return (
            f"{self.tool} predicted to be {after} mm off (RMS) after them, {before} mm before, {rounded(self.at_random_mm, 3)} mm at random"
        )

    def __repr__(self) -> str:
        """In a line."""
        return f"<{type(self).__name__} of {len(self)} poses for {shown(self.robot.name)}: {shown(self._told)}>"

    def _repr_html_(self) -> str:
        rows = [
            (number + 1, *(f"{position:.4f}" for position in q), rounded(after, 3))
            for number, (q, after) in enumerate(zip(self.q, self.tool_sigma_mm[1:], strict=True))
        ]
        table = Listing(("pose", *self.joints, "tool in mm"), rows, title="Poses, in rad or m", folded=True)
        return card(f"{len(self)} poses for {self.robot.name}", (self._told,), (table,))


def plan_poses(
    robot: Robot,
    *,
    candidates: npt.ArrayLike | int = CANDIDATES,
    n: int = 30,
    tool: str | None = None,
    sensors: Sequence[str] = ("laser",),
    options: ModelOptions | None = None,
    spot_sigma: float | None = None,
    sigmas: Mapping[str, float] | None = None,
    joint_sigma: float | Vector = 0.0,
    reference: str | None = None,
    workspace: Matrix | None = None,
    have: Measurements | npt.ArrayLike | None = None,
    allowed: Allowed | None = None,
    until_mm: float | None = None,
    screen_size: float = 3.0,
    seed: int = 0,
    rng: np.random.Generator | None = None,
) -> PosePlan:
    """Choose poses to measure, those that make the tool's predicted position surest over the whole workspace.

    One after the other the one that gains most is taken; then each is exchanged for a better one until none gains (`selection`).

    What is in the way is for `allowed` to know, or for whoever gives the `candidates`. Where measuring frame and targets will be is not
    known yet, and is drawn at random; it matters little to which poses are good ones.

    Args:
        robot: Nominal robot.
        candidates: Joint positions to choose from, (m, inputs), [rad] or [m], in the order of the robot's `chain.input_names` as these
            sensors see it; or how many random ones within the limits, and with every beam on the screen where lasers are read.
        n: How many to choose.
        tool: Link whose position relative to the base is to be known; by default the module, or the target that most joints move.
        sensors: What will read, as for `simulate`: `laser`, `point:LINK`, `pose:LINK`, `distance:LINK`, `inclination:LINK`.
        options: What is to be calibrated, as for `fit`.
        spot_sigma: Noise of a spot coordinate, [m]; as usual by default.
        sigmas: The same of other readings by kind, [m], [rad] or [px].
        joint_sigma: Noise of a joint reading as for `fit`, [rad].
        reference: Link that the measuring frame stands on; by default `tracker`, or the root.
        workspace: Configurations over which the tool must be accurate, (c, inputs), [rad] or [m]; by default random within limits.
        have: Poses that were measured already with these sensors, which the plan is to complete: measurements, or positions (h, inputs).
        allowed: Which of some positions (m, inputs) of the robot, as the sensors see it, it may take, (m,).
        until_mm: As few poses, up to n, as bring the tool's predicted error down to this, [mm].
        screen_size: Side of the screen, [m].
        seed: Of the randomness.
        rng: Source of randomness in place of a seed.

    Raises:
        UsageError: fewer candidates than poses, sensors that touch (which poses reach what is touched is for whoever stands beside the
            robot to say), or the limits leave no room.
        ShapeMismatch: the candidates do not fit the robot.
        RobotError: the tool is not a link that the calibrated joints move.
    """
    rng = np.random.default_rng(seed) if rng is None else rng
    require_robot(robot, "plan_poses")
    named, lasers = parse_sensors(sensors, robot, 0)
    _require_no_touch(named)
    seen = seen_with(robot, named, reference or "", lasers) if named else robot
    errors = build_error_model(seen.chain, seen.rig, options or ModelOptions())
    setup = simulated_setup(seen, errors, errors.mean, named, rng, area=ScreenArea(screen_size))
    errors, x = setup.errors, setup.x
    q = _taken(seen, errors, candidates, setup.area, rng, allowed)
    if not 1 <= n <= len(q):
        raise UsageError(f"plan_poses: expected n from 1 to {len(q)}, the number of candidates, found {n}")

    def told(poses: Matrix) -> Array3:
        data = _read(errors, x, poses, named, setup.area)
        noise = noise_of(data, stated_noise(data, spot_sigma, sigmas), joint_sigmas(seen, joint_sigma))
        return _whitened(errors, x, data, replace(noise, stated=True))

    H = told(q)
    tool = default_tool(seen) if tool is None else tool
    J = tool_jacobian(seen, errors, x, tool, random_positions(seen, _WORKSPACE, rng) if workspace is None else workspace)[:, :3]
    M = information(J) / len(J)
    known = None
    if have is not None:
        known = information(told(_candidates(seen, errors, have.q if isinstance(have, Measurements) else have, setup.area, rng)))
    chosen, left = greedy(H, errors.sigma, M, n, known)
    if until_mm is not None:
        n = min(n, 1 + int(np.argmax(np.append(left[1:-1] <= (until_mm * MM) ** 2, True))))
    chosen, left = exchanged(H, errors.sigma, M, chosen[:n], known)
    draws = [rng.choice(len(q), n, replace=False) for _ in range(_DRAWS)]
    random = np.sqrt(np.mean([_left_after(H, errors.sigma, M, rows, known) for rows in draws], axis=0)) / MM
    joints = seen.chain.input_names
    unknown = _undetermined(errors, information(H[chosen]) + (0.0 if known is None else known))
    return PosePlan(seen, joints, q[chosen], chosen, tool, np.sqrt(left) / MM, float(random[-1]), random, unknown)


def _left_after(H: Array3, sigma: Vector, M: Matrix, rows: npt.NDArray[np.intp], known: Matrix | None) -> Vector:
    """The tool's mean squared error before the first of some candidates and after each, (n + 1,)."""
    return np.array([expected(H, sigma, M, rows[:count], known) for count in range(len(rows) + 1)])


def _undetermined(errors: ErrorModel, told: Matrix) -> tuple[str, ...]:
    """Names of parameters that stay above half of their prior sigma."""
    sigma = np.sqrt(np.diag(covariance(told, errors.sigma)))
    return tuple(np.array(errors.names)[sigma > errors.sigma / 2].tolist())


def _taken(
    robot: Robot, errors: ErrorModel, candidates: npt.ArrayLike | int, area: ScreenArea, rng: np.random.Generator, allowed: Allowed | None
) -> Matrix:
    """Those of the candidates that the robot may take; of random ones as many as are asked for, if a few rounds give them."""
    q = _candidates(robot, errors, candidates, area, rng)
    if allowed is None:
        return q
    kept = [q[allowed(robot, q)]]
    if isinstance(candidates, int):
        while sum(map(len, kept)) < candidates and len(kept) < _ROUNDS:
            q = _candidates(robot, errors, candidates, area, rng)
            kept.append(q[allowed(robot, q)])
        return np.concatenate(kept)[:candidates]
    return kept[0]


def _require_no_touch(sensors: Sequence[SimulatedSensor]) -> None:
    for sensor in sensors:
        if any(SENSORS[kind].touches for kind in SENSOR_KINDS[sensor.kind]):
            raise UsageError(f"plan_poses: {sensor.kind}:{sensor.target} touches, and which poses reach what it touches is not known here")


def _candidates(robot: Robot, errors: ErrorModel, candidates: npt.ArrayLike | int, area: ScreenArea, rng: np.random.Generator) -> Matrix:
    """Positions to choose from, (m, inputs).

    Raises:
        ShapeMismatch: they do not fit the robot.
    """
    if isinstance(candidates, int):
        if not robot.rig.lasers:
            return random_positions(robot, candidates, rng)
        return draw_poses(robot, errors, errors.mean, candidates, rng, area=area)
    q, names = np.asarray(candidates, dtype=float), robot.chain.input_names
    if q.ndim != 2 or q.shape[1] != len(names) or not np.isfinite(q).all():
        raise ShapeMismatch(f"plan_poses: candidates have shape {q.shape}, expected finite (m, {len(names)}), for {', '.join(names)}")
    return q


def _read(errors: ErrorModel, x: Vector, q: Matrix, sensors: Sequence[SimulatedSensor], area: ScreenArea) -> Measurements:
    """What the sensors would read at some poses without noise."""
    n, lasers = len(q), errors.chain.laser_names
    targets = [blank_readings(kind, own.target, own.link, n) for own in sensors for kind in SENSOR_KINDS[own.kind]]
    blank = Measurements(
        joints=errors.chain.input_names,
        q=q,
        readings=(*spot_readings(lasers, np.zeros((n, len(lasers), 2))), *targets),
        poses=np.arange(n).astype(str),
        sets=np.full(n, "fit"),
        sessions=np.full(n, errors.sessions[0]),
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        values = Problem(errors, blank).read(x)
    return replace(blank, readings=tuple(_seen(own, read, area) for own, read in zip(blank.readings, values, strict=True)))


def _seen(own: Readings, read: Matrix, area: ScreenArea) -> Readings:
    """Readings that can be made: finite ones, and of spots those on the screen."""
    good: Mask = np.asarray(np.isfinite(read).all(axis=1))
    if own.kind.on_screen:
        good = good & area.holds(read)
    return replace(own, values=np.where(good[:, None], read, np.nan))


def _whitened(errors: ErrorModel, x: Vector, data: Measurements, noise: Noise) -> Array3:
    """Jacobian of every pose in units of its noise, (m, k, p)."""
    linearisation = replace(without_lost(problem_of(errors, data, noise).linearise(x)).of_poses(len(data)), poses=None)
    return noise.weights(linearisation).jacobian(linearisation).reshape(len(data), -1, len(errors.names))
