"""Which poses to measure: out of candidates those after which the tool is predicted to be known best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from urdfcal.base.errors import ShapeMismatch, UsageError
from urdfcal.base.foreign_text import shown
from urdfcal.base.geometry import MM, Mask, Matrix, Vector
from urdfcal.base.interrupts import enough
from urdfcal.base.notebook import Listing, card
from urdfcal.base.terminal import rounded
from urdfcal.calibration.analysis.prediction import default_tool, tool_jacobian
from urdfcal.model.options import ModelOptions
from urdfcal.planning.approach import back_off
from urdfcal.planning.candidates import Allowed, Candidates, Lookout, drawn, given, require_enough
from urdfcal.planning.change import changing, detected_mm
from urdfcal.planning.criteria import NAMES, Design, Rows
from urdfcal.planning.measuring import Asked, Measuring, ReadWith, measuring, whitened
from urdfcal.planning.selection import exchanged, fewest, greedy, information
from urdfcal.planning.sight import Eyes, Hidden
from urdfcal.planning.typical import typical
from urdfcal.robot.configurations import joint_limits, measured_positions, require_room
from urdfcal.robot.rig import Grid
from urdfcal.robot.robot import Robot, require_robot
from urdfcal.robot.sheet import ScreenArea
from urdfcal.sensors.columns import NONE, Stations
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.sensor import Sight

CANDIDATES = 2000  # random ones, where none are given
CHECK = 8  # poses that tell a later change
_WORKSPACE = 200
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
        random_mm: The same before the first of random candidates and after each, on average, (n + 1,), [mm].
        undetermined: Parameters whose standard deviation these poses leave above half of what it is before any.
        criterion: What they were chosen by, one of `criteria.NAMES`.
        value: What that is of them, as it is defined.
        value_at_random: The same of as many random candidates, on average.
        usable: How many candidates can be measured and why not the others, in a sentence.
        reasons: Of how many candidates each reason was the first why they cannot be measured.
        looked: How many candidates were looked at.
        assumed: What was assumed of instruments of which nothing is said, in sentences.
        detects_mm: For a later check: the tool's RMS change that these poses show in nine of ten cases, [mm]; inf where they show
            none, None where they are no check.
    """

    robot: Robot
    joints: tuple[str, ...]
    q: Matrix
    chosen: npt.NDArray[np.intp]
    tool: str
    tool_sigma_mm: Vector
    random_mm: Vector
    undetermined: tuple[str, ...] = ()
    criterion: str = "I"
    value: float = np.nan
    value_at_random: float = np.nan
    usable: str = ""
    reasons: Mapping[str, int] = field(default_factory=dict)
    looked: int = 0
    assumed: tuple[str, ...] = ()
    detects_mm: float | None = None

    @property
    def at_random_mm(self) -> float:
        """The tool's predicted position error after as many random candidates, on average, [mm]."""
        return float(self.random_mm[-1])

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
        return card(f"{len(self)} poses for {self.robot.name}", (self._told, *self.assumed), (table,))


def plan_poses(
    robot: Robot,
    *,
    candidates: npt.ArrayLike | int = CANDIDATES,
    n: int | None = None,
    tool: str | None = None,
    sensors: Sequence[str] = ("laser",),
    options: ModelOptions | None = None,
    spot_sigma: float | None = None,
    sigmas: Mapping[str, float] | None = None,
    joint_sigma: float | Vector = 0.0,
    reference: str | None = None,
    camera: Any = None,
    boards: Mapping[str, Grid] | None = None,
    stations: Stations = NONE,
    workspace: Matrix | None = None,
    have: Measurements | npt.ArrayLike | None = None,
    allowed: Allowed | None = None,
    hidden: Hidden | None = None,
    sight: Sight | None = None,
    limits: npt.ArrayLike | None = None,
    criterion: str = "I",
    until_mm: float | None = None,
    check: bool = False,
    both_sides: bool = False,
    screen_size: float | tuple[float, float] | None = None,
    seed: int = 0,
    rng: np.random.Generator | None = None,
) -> PosePlan:
    """Choose poses to measure, those that make the tool's predicted position surest over the whole workspace, or serve another criterion.

    One after the other the one that gains most is taken; then each is exchanged for a better one until none gains (`selection`). Candidates
    are poses that the sensors see: every beam on the screen and under 70 deg, boards in the picture, targets turned to their instrument.

    What is in the way is for `allowed` and `hidden` to know, or for whoever gives the `candidates`. Where an instrument will be of which
    nothing is said, and where targets will sit on their links, is drawn at random: of many draws the one in the middle of what they promise
    of the tool (`typical`). It matters little to which poses are good ones; how much they tell is less for targets near the last axis.

    Args:
        robot: Nominal robot.
        candidates: Joint positions to choose from, (m, inputs), [rad] or [m], in the order of the robot's `chain.input_names` as these
            sensors see it; or how many random ones within the limits that can be measured.
        n: How many to choose; 30 by default, 8 for a check.
        tool: Link whose position relative to the base is to be known; by default the module, or the target that most joints move.
        sensors: What will read, as for `simulate`: `laser`, `point:LINK`, `pose:LINK`, `distance:LINK`, `inclination:LINK`, `pixels:LINK`;
            with `@INSTRUMENT` behind it where there are several.
        options: What is to be calibrated, as for `fit`.
        spot_sigma: Noise of a spot coordinate, [m]; as usual by default.
        sigmas: The same of other readings by kind, [m], [rad] or [px].
        joint_sigma: Noise of a joint reading as for `fit`, [rad].
        reference: Link that the measuring frame stands on, and where the instrument is taken to be; by default `tracker`, or the root, and
            then somewhere.
        camera: What pixels are read with, a `Camera`.
        boards: Links that are boards, with the grids of their corners.
        stations: Instruments beside links, as for `read_measurements`.
        workspace: Configurations over which the tool must be accurate, (c, inputs), [rad] or [m]; by default random within limits.
        have: Poses that were measured already with these sensors, which the plan is to complete: measurements, or positions (h, inputs).
        allowed: Which of some positions (m, inputs) of the robot, as the sensors see it, it may take, (m,).
        hidden: At which of some positions (m, inputs) something stands between two points each, (m, 3) in the axes of the chain's base.
        sight: What it takes to be seen: angles, sizes and how far spots stay apart.
        limits: Narrower limits, (2, inputs), [rad] or [m]; by default the robot's.
        criterion: `I` for the tool over the workspace; `D`, `A`, `E` or `O1` to `O5` for the parameters (`criteria`).
        until_mm: As few poses, up to n, as bring the tool's predicted error down to this, [mm].
        check: Choose poses that tell best whether the joints have changed since, by a tenth of their priors.
        both_sides: Each pose will be visited from both sides, so it keeps away from limits, and what is beside it must be allowed, too.
        screen_size: Side of the screen, or its width and height, [m]; by default as the URDF draws it, else 3.
        seed: Of the randomness.
        rng: Source of randomness in place of a seed.

    Raises:
        UsageError: fewer candidates than poses, sensors that touch (which poses reach what is touched is for whoever stands beside the
            robot to say), no such criterion, acceptance or range where no tracker reads whose place is known, or the limits leave no room.
        ShapeMismatch: the candidates do not fit the robot.
        RobotError: the tool is not a link that the calibrated joints move.
    """
    rng = np.random.default_rng(seed) if rng is None else rng
    require_robot(robot, "plan_poses")
    _require_criterion(criterion, until_mm, check)
    area = None if screen_size is None else ScreenArea(screen_size)
    made = measuring(robot, Asked(sensors, reference or "", camera, boards or {}, stations, area), options or ModelOptions(), rng)
    require_room(made.robot)
    room = _room(made.robot, limits, both_sides)
    noise = ReadWith(spot_sigma, sigmas, joint_sigma)
    eyes = Eyes(made, replace(sight or Sight(), area=made.area))
    eyes.require_heeded()
    lookout = Lookout(made.robot, eyes, _beside(allowed, made.robot) if both_sides and allowed is not None else allowed, hidden)
    found = drawn(lookout, room, candidates, rng) if isinstance(candidates, int) else given(lookout, candidates)
    n = (CHECK if check else 30) if n is None else n
    if enough() and len(found.q) < n:
        raise KeyboardInterrupt  # before there was anything to choose from
    require_enough(found, n, not isinstance(candidates, int))
    tool = default_tool(made.robot) if tool is None else tool
    over = _uniform(_room(made.robot, limits, False), rng) if workspace is None else workspace
    J = tool_jacobian(made.robot, made.errors, made.errors.mean, tool, over)[:, :3]
    M = information(J) / len(J)
    made = typical(made, found, n, noise, M, rng)
    known = np.zeros_like(M) if have is None else _told_by(made, have, eyes, noise)
    sigma = changing(made.errors) if check else made.errors.sigma
    design = Design(whitened(made, found.q, noise, found.read), sigma, M, known)
    chosen = _chosen(design, criterion, n, until_mm)
    return _plan(design, found, chosen, criterion, made, tool, rng, check, isinstance(candidates, int))


def _require_criterion(criterion: str, until_mm: float | None, check: bool) -> None:
    if criterion not in NAMES:
        raise UsageError(f"no criterion '{criterion}'; there are {', '.join(NAMES)}")
    if check and (criterion != "I" or until_mm is not None):
        raise UsageError("a check has a criterion of its own, how much of a change it tells, and no accuracy to reach")


def _room(robot: Robot, limits: npt.ArrayLike | None, both_sides: bool) -> Matrix:
    """Between which positions poses are, (2, inputs).

    Raises:
        ShapeMismatch: the limits are none.
        UsageError: they leave no room.
    """
    room = joint_limits(robot) if limits is None else measured_positions(robot, limits, "plan_poses: limits")
    if len(room) != 2:
        raise ShapeMismatch(f"plan_poses: limits have shape {room.shape}, expected (2, {room.shape[1]}), the lower ones first")
    for name, lower, upper in zip(robot.chain.input_names, *room, strict=True):
        if lower > upper:
            raise UsageError(f"plan_poses: limits of {name}: {lower:.4g} to {upper:.4g} leave no room")
    return room if not both_sides else _narrower(room, back_off(robot), robot.chain.input_names)


def _uniform(room: Matrix, rng: np.random.Generator) -> Matrix:
    """The workspace: positions anywhere between limits, (c, inputs)."""
    return rng.uniform(room[0], room[1], (_WORKSPACE, room.shape[1]))


def _narrower(room: Matrix, back: Vector, names: Sequence[str]) -> Matrix:
    narrower = np.array([room[0] + back, room[1] - back])
    for name, lower, upper in zip(names, *narrower, strict=True):
        if lower > upper:
            raise UsageError(f"the limits of {name} are too near to each other to visit a pose from both sides")
    return narrower


def _beside(allowed: Allowed, robot: Robot) -> Allowed:
    """Whether what lies to both sides of a pose is allowed, too."""
    back = back_off(robot)

    def all_three(seen: Robot, q: Matrix) -> Mask:
        good = allowed(seen, q)
        for beside in (q - back, q + back):
            good[good] = allowed(seen, beside[good])
        return good

    return all_three


def _told_by(made: Measuring, have: Measurements | npt.ArrayLike, eyes: Eyes, noise: ReadWith) -> Matrix:
    """What was measured before tells, its H'H: of what was read then where it is said, else of what can be seen.

    Raises:
        UsageError: nothing that is to be read now was read then.
    """
    if not isinstance(have, Measurements):
        q = measured_positions(made.robot, have, "plan_poses: what was measured")
        return information(whitened(made, q, noise, eyes.geometry(q).read))
    names = made.robot.chain.input_names
    if missing := [name for name in names if name not in have.joints]:
        raise UsageError(f"what was measured has no column for {', '.join(missing)}, which now moves what is read")
    q = have.q[:, [have.joints.index(name) for name in names]]
    before = {(own.sensor, own.target, own.instrument): own.seen for own in have.readings}
    now = made.blanks(q).readings
    read = np.array([before.get((own.sensor, own.target, own.instrument), np.zeros(len(q), dtype=bool)) for own in now]).T
    if not read.any():
        ours, theirs = (sorted({f"{own.kind.noise} of {own.label}" for own in readings}) for readings in (now, have.readings))
        raise UsageError(
            f"what was measured is {', '.join(theirs[:4])}, and planned is {', '.join(ours[:4])}: there is nothing to complete"
        )
    return information(whitened(made, q, noise, read))


def _chosen(design: Design, criterion: str, n: int, until_mm: float | None) -> Rows:
    by = design.by(criterion)
    if until_mm is None:
        return exchanged(design.H, by, greedy(design.H, by, n, design.known)[0], design.known)[0]
    if criterion == "I":
        return fewest(design.H, by, *greedy(design.H, by, n, design.known), (until_mm * MM) ** 2, design.known)[0]
    chosen = greedy(design.H, by, n, design.known)[0]
    enough = _tool_mm(design, chosen)[1:-1] <= until_mm
    return exchanged(design.H, by, chosen[: int(np.argmax(np.append(enough, True))) + 1], design.known)[0]


def _tool_mm(design: Design, chosen: Rows) -> Vector:
    """The tool's predicted error before the first of some poses and after each, (n + 1,), [mm]."""
    by, told = design.by("I"), design.known
    found = [by.left(told)]
    for row in chosen:
        told = told + information(design.H[row])
        found.append(by.left(told))
    return np.sqrt(found) / MM


def _plan(
    design: Design,
    found: Candidates,
    chosen: Rows,
    criterion: str,
    made: Measuring,
    tool: str,
    rng: np.random.Generator,
    check: bool,
    drawn_ones: bool,
) -> PosePlan:
    n, now = len(chosen), _told(design, chosen)
    draws = [rng.choice(len(found.q), n, replace=False) for _ in range(_DRAWS)]
    return PosePlan(
        made.robot,
        made.robot.chain.input_names,
        found.q[chosen],
        found.rows[chosen],
        tool,
        _tool_mm(design, chosen),
        random_mm=np.sqrt(np.mean([_tool_mm(design, rows) ** 2 for rows in draws], axis=0)),
        undetermined=tuple(np.array(made.errors.names)[design.undetermined(now)].tolist()),
        criterion=criterion,
        value=design.value(criterion, now, n),
        value_at_random=float(np.mean([design.value(criterion, _told(design, rows), n) for rows in draws])),
        usable=found.told(drawn_ones),
        reasons=found.reasons,
        looked=found.looked,
        assumed=made.assumed,
        detects_mm=detected_mm(made.errors, design.H[chosen], design.M, rng) if check else None,
    )


def _told(design: Design, rows: Rows) -> Matrix:
    """Information of some candidates and of what was measured before, (p, p)."""
    return design.known + information(design.H[rows])
