"""Two accounts of one robot: calibrations, or descriptions, joint by joint and at the tool.

With A_i the placement of the i-th moving joint behind the one before it (fixed joints on the way included; a last one leads to the
tool), the two differ by the twists d_i = log(A_i^-1 B_i), each in the joint's own axes. Not all of d moves the tool: what commutes with
a joint's motion, a screw s about and along a turning joint's axis or the three translations and the turn along a sliding joint's, may
be booked on the joint or on the one behind,

    A_i exp(s),  exp(-s) A_i+1 = A_i+1 exp(-Ad(A_i+1^-1) s).

With these pairs as the columns of G the difference is told as P d, P = I - G G^+: the least of all that are the same robot. It has
covariance P (S_a + S_b) P', where S are the covariances of either's twists, independent of each other. Placements that neither has
estimated may be anywhere: they are told as they are, and G has all their twists where the others' differences are told.

At n configurations the tool moves by M d. If the two were the same but for what either does not know, the mean squared distance would be
a sum of squares with the weights w = eig(S^(1/2) M'M/n S^(1/2)), which is told from a gamma variable of the same mean and variance:
chi-squared with (sum w)^2 / sum w^2 degrees of freedom, scaled by sum w^2 / sum w (Satterthwaite).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from urdfcal.base.errors import RobotError
from urdfcal.base.geometry import SE3, Array3, Matrix, Vector, rotation_screw, translation_screw
from urdfcal.base.rotations import rotation_vectors, skew
from urdfcal.calibration.analysis.tool_accuracy import without_constants
from urdfcal.model.earlier import EarlierJoints
from urdfcal.robot.configurations import random_configurations
from urdfcal.robot.corrections import same_origin
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_tree import UrdfJoint
from urdfcal.robot.way import Way

CONFIGURATIONS = 1000
CHANCE = 0.05  # what is likelier than that by chance alone is no difference
_NO_VARIANCE = 1e-9  # share of the largest variance under which one is rounding
_ROUNDING = 1e-9  # [m] and [rad]: what two files may differ by for having been written


@dataclass(frozen=True, eq=False)
class Account:
    """What somebody says of a robot.

    Attributes:
        label: Whose it is, for people.
        robot: As it is said to be.
        known: How sure that is; None where it is not said.
    """

    label: str
    robot: Robot
    known: EarlierJoints | None = None


@dataclass(frozen=True)
class JointDifference:
    """How far two accounts have one joint apart, in its own axes; lengths [m], angles [rad].

    Attributes:
        name: The joint, or the tool's link for what comes behind the last.
        distance, angle: Of the placement.
        distance_sigma, angle_sigma: Combined standard deviation along the difference; None where neither account says.
    """

    name: str
    distance: float
    angle: float
    distance_sigma: float | None
    angle_sigma: float | None

    @property
    def sigmas(self) -> float | None:
        """The greater of distance and angle over their combined standard deviations; None where nobody says."""
        rows = ((self.distance, self.distance_sigma), (self.angle, self.angle_sigma))
        return max((size / sigma for size, sigma in rows if sigma), default=None)


@dataclass(frozen=True, eq=False)
class ToolDifference:
    """How far two accounts have the tool apart, over random configurations; lengths [m], angles [rad].

    Attributes:
        distance: In the root's frame, (n,).
        apart: What no constant placement of base and tool explains of it, (n,).
        angle: Of the orientations, (n,).
        worst: Positions by joint name at the greatest distance, [rad] or [m].
    """

    distance: Vector
    apart: Vector
    angle: Vector
    worst: dict[str, float]


@dataclass(frozen=True, eq=False)
class Comparison:
    """Two accounts of one robot.

    Attributes:
        one, other: Whose.
        tool: The link at which they are compared.
        joints: One by one, from the root on.
        sliding: Names of the joints that slide, on any way.
        at_tool: Over the workspace.
        expected: Root mean square that `at_tool.apart` would have if the two differed by what either does not know, [m]; None where
            neither says how sure it is.
        by_chance: Probability of as great a difference then.
        notes: What either says nothing of, in words.
    """

    one: str
    other: str
    tool: str
    joints: tuple[JointDifference, ...]
    sliding: tuple[str, ...]
    at_tool: ToolDifference
    expected: float | None
    by_chance: float | None
    notes: tuple[str, ...] = ()

    @property
    def identical(self) -> bool:
        """Whether the two say the same but for rounding."""
        return bool(max(self.at_tool.distance.max(), self.at_tool.angle.max()) < _ROUNDING)

    @property
    def same(self) -> bool | None:
        """Whether they are the same within what either knows; None where neither says how sure it is."""
        return True if self.identical else None if self.by_chance is None else self.by_chance >= CHANCE


def compare(one: Account, other: Account, tool: str, rng: np.random.Generator, count: int = CONFIGURATIONS) -> Comparison:
    """Compare two accounts of one robot.

    Args:
        one: The first; the difference is told in the axes of its joints.
        other: The second.
        tool: A link of both, behind at least one moving joint.
        rng: Source of randomness, for the configurations.
        count: How many configurations.

    Raises:
        RobotError: no such link, or other joints lead to it.
    """
    way, others = (_Booked(_way_to(account.robot, tool)) for account in (one, other))
    _require_one_robot(one, other, way, others)
    twists = np.concatenate([_log(a.actInv(b)) for a, b in zip(way.placements, others.placements, strict=True)])
    S = _covariance(way, one.known) + _covariance(way, other.known)
    positions = _positions(one.robot, random_configurations(one.robot, rng, count))
    q, theirs = (np.column_stack([positions[name] for name in each.way.names]) for each in (way, others))
    before, placed = way.frames(q)
    at_tool, apart = _at_tool(one.robot, placed, others.way.placements(theirs), positions), _apart(before, placed)
    expected, chance = _by_chance(apart, S, float(np.mean(at_tool.apart**2))) if S.any() else (None, None)
    return Comparison(one.label, other.label, tool, way.rows(twists, S), _sliding(one.robot), at_tool, expected, chance)


def _way_to(robot: Robot, tool: str) -> Way:
    """The way to a link from the root.

    Raises:
        RobotError: no such link, or no joint moves it.
    """
    way = Way(robot, robot.tree.root, robot.tree.require_link(tool))
    if not way.inputs:
        raise RobotError(f"no joint moves the link '{tool}'; name another with --tool", robot.description.label)
    return way


def _apart(before: list[Array3], tool: Array3) -> Array3:
    """Motion of the tool's origin per unit of every twist, without what constants of base and tool explain, (n, 3, 6J).

    Args:
        before: Each placement before its joint's motion, in the root's frame, J times (n, 4, 4).
        tool: The tool there, (n, 4, 4).
    """
    placed, blocks = tool[:, :3, 3], []
    for T in before:
        R, lever = T[:, :3, :3], np.einsum("nji,nj->ni", T[:, :3, :3], placed - T[:, :3, 3])
        blocks += [R, -R @ skew(lever)]
    return _without(np.concatenate(blocks, axis=2), placed, tool[:, :3, :3])


@dataclass(frozen=True, eq=False)
class _Booked:
    """The placements of a way on which a difference can be booked: of its moving joints, and of the tool where it is fixed behind them."""

    way: Way

    @cached_property
    def joints(self) -> tuple[UrdfJoint, ...]:
        """The joints that move."""
        return tuple(joint for joint, _ in self.way.segments if joint is not None)

    @cached_property
    def placements(self) -> tuple[SE3, ...]:
        """One behind the other."""
        return tuple(placement for _, placement in self.way.segments)[: len(self.names)]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """What each placement is called."""
        return (*(joint.name for joint in self.joints), *(() if self.way.path[-1].moves else (self.way.tool,)))

    def projector(self, open_rows: Sequence[int] = ()) -> Matrix:
        """P: what it leaves of the twists (6J,) is the least that is the same robot, wherever the placements of these rows are."""
        size, columns = 6 * len(self.placements), []
        for index, joint in enumerate(self.joints[: len(self.placements) - 1]):
            for screw in _commuting(joint):
                column = np.zeros((len(self.placements), 6))
                column[index], column[index + 1] = screw, -self.placements[index + 1].actInv(pin.Motion(screw)).vector
                columns.append(column.ravel())
        G = np.column_stack([np.zeros((size, 0)), *columns, *(np.eye(size)[:, 6 * row : 6 * row + 6] for row in open_rows)])
        return np.eye(size) - G @ np.linalg.pinv(G)

    def rows(self, twists: Vector, S: Matrix) -> tuple[JointDifference, ...]:
        """The difference joint by joint, from the twists (6J,) and their covariance (6J, 6J)."""
        unknown = [row for row in range(len(self.names)) if not S[6 * row : 6 * row + 6, 6 * row : 6 * row + 6].any()] if S.any() else []
        P = self.projector(unknown)
        covariance, left, plain = P @ S @ P.T, *((each @ twists).reshape(-1, 2, 3) for each in (P, self.projector()))
        left[unknown] = plain[unknown]
        sizes = np.linalg.norm(left, axis=2).tolist()
        return tuple(
            JointDifference(name, distance, angle, *((None, None) if row in unknown else _along(left[row], covariance, row)))
            for row, (name, (distance, angle)) in enumerate(zip(self.names, sizes, strict=True))
        )

    def frames(self, q: Matrix) -> tuple[list[Array3], Array3]:
        """Each placement before its joint's motion, and the tool, in the root's frame, (n, 4, 4) each."""
        before = [frame for frame, _ in self.way.walk(q)]
        return before[: len(self.names)], before[-1]


def _sliding(robot: Robot) -> tuple[str, ...]:
    return tuple(name for name, joint in robot.tree.joints.items() if joint.prismatic)


def _log(placement: SE3) -> Vector:
    return np.asarray(pin.log6(placement).vector)


def _commuting(joint: UrdfJoint) -> Sequence[Vector]:
    """Screws that may as well be put behind a joint's motion as before it."""
    axis = np.array(joint.axis)
    shifts = np.eye(3) if joint.prismatic else axis[None]
    return [*(translation_screw(direction) for direction in shifts), rotation_screw(axis, np.zeros(3))]


def _covariance(way: _Booked, known: EarlierJoints | None) -> Matrix:
    """Of the twists of a way's placements, (6J, 6J); what is not known of is taken for certain."""
    size = 6 * len(way.placements)
    if known is None:
        return np.zeros((size, size))
    names = [joint.name for joint in way.joints]
    own = [index for index, joint in enumerate(known.joints) if joint in names]
    S = np.zeros((size, len(own)))
    for column, index in enumerate(own):
        row = 6 * names.index(known.joints[index])
        S[row : row + 6, column] = known.screws[:, index]
    return np.asarray(S @ known.covariance[np.ix_(own, own)] @ S.T)


def _along(left: Matrix, covariance: Matrix, row: int) -> tuple[float | None, float | None]:
    """Standard deviations of one placement's shift and turn along themselves, (2, 3); None for what nobody estimated."""
    blocks = (covariance[6 * row + start :, 6 * row + start :][:3, :3] for start in (0, 3))
    least = _NO_VARIANCE * float(np.diag(covariance).max())
    shift, turn = (_sigma_along(vector, block, least) for vector, block in zip(left, blocks, strict=True))
    return shift, turn


def _sigma_along(vector: Vector, covariance: Matrix, least: float) -> float | None:
    """Standard deviation along a vector, or of any direction in the mean where it is none; None where the variance is rounding."""
    size = np.linalg.norm(vector)
    variance = vector @ covariance @ vector / size**2 if size > _ROUNDING else np.trace(covariance) / 3
    return float(np.sqrt(variance)) if variance > least else None


def _at_tool(robot: Robot, one: Array3, other: Array3, positions: Mapping[str, Vector]) -> ToolDifference:
    placed, axes = one[:, :3, 3], one[:, :3, :3]
    off = other[:, :3, 3] - placed
    turned = np.linalg.norm(rotation_vectors(axes.transpose(0, 2, 1) @ other[:, :3, :3]), axis=1)
    distance = np.linalg.norm(off, axis=1)
    apart, worst = np.linalg.norm(_without(off[:, :, None], placed, axes)[:, :, 0], axis=1), int(np.argmax(distance))
    leading = (name for name in positions if robot.tree.joints[name].mimic is None)
    return ToolDifference(distance, apart, turned, {name: float(positions[name][worst]) for name in leading})


def _positions(robot: Robot, q: Matrix) -> dict[str, Vector]:
    """Positions (n,) by joint name of whole configurations (n, nq), [rad] or [m]; a continuous joint has its cosine and sine in them."""
    model, found = robot.model, {}
    for joint in (joint for joint in robot.tree.joints.values() if joint.moves):
        index = model.getJointId(joint.name)
        at, size = model.idx_qs[index], model.nqs[index]
        found[joint.name] = q[:, at] if size == 1 else np.arctan2(q[:, at + 1], q[:, at])
    return found


def _without(moved: Array3, placed: Matrix, axes: Array3) -> Array3:
    """Motion of the tool's origin (n, 3, k) without what constant placements of base and tool explain."""
    still = np.broadcast_to(np.eye(3), axes.shape)
    return without_constants(moved, np.concatenate([still, -skew(placed), axes], axis=2))[0]


def _by_chance(apart: Array3, S: Matrix, squared: float) -> tuple[float, float]:
    """Root mean square that is expected of what S leaves open, and the probability of a mean square as great as this."""
    from scipy.stats import chi2

    values, vectors = np.linalg.eigh(S)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    moved = (apart @ root).reshape(-1, root.shape[1])
    w = np.maximum(np.linalg.eigvalsh(moved.T @ moved / len(apart)), 0.0)
    mean, squares = float(w.sum()), float(w @ w)
    return float(np.sqrt(mean)), float(chi2.sf(squared * mean / squares, mean**2 / squares))


def default_tool(one: Account, other: Account) -> str:
    """The link at which two accounts are best compared: behind as many of the joints that differ as can be, and behind no others.

    Of links that are equal in this the one with the longest way counts, so that what is fixed to the last joint is compared, too.

    Raises:
        RobotError: no link that a joint moves is in both.
    """
    tree, ours, theirs = one.robot.tree, one.robot.tree.joints, other.robot.tree.joints
    differ = {name for name in ours if name in theirs and not same_origin(ours[name].origin, theirs[name].origin)}
    differ = differ or {name for name in ours if ours[name].moves}

    def rank(link: str) -> tuple[int, int, int]:
        path = tree.path_from_root(link)
        return sum(joint.name in differ for joint in path), -sum(joint.moves and joint.name not in differ for joint in path), len(path)

    moved = (link for link in tree.links if link in other.robot.tree.links and any(joint.moves for joint in tree.path_from_root(link)))
    found = max(moved, key=rank, default=None)
    if found is None:
        raise RobotError(f"{one.label} and {other.label} are not one robot: no link that a joint moves is in both")
    return found


def _require_one_robot(one: Account, other: Account, way: _Booked, others: _Booked) -> None:
    """Refuse to compare two robots.

    Raises:
        RobotError: names the first joint that only one has on its way.
    """
    names, theirs = (tuple((joint.name, joint.prismatic) for joint in each.joints) for each in (way, others))
    if names == theirs and len(way.placements) == len(others.placements):
        return
    pairs = [*zip(names, theirs, strict=False), *(((own, False), None) for own, _ in names[len(theirs) :])]
    differs = next((own[0] for own, its in pairs if own != its), way.way.tool)
    raise RobotError(
        f"{one.label} and {other.label} are not one robot: '{differs}' on the way to '{way.way.tool}' is not the same joint in both; "
        "expected two accounts of the same joints"
    )
