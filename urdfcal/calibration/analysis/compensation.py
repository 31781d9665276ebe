"""What a URDF cannot carry, for control code: the sag of the joints, beside the calibrated URDF that was fitted together with it.

The calibrated model stands for the unloaded arm. The arm that stands in the room gives way at each joint, so that at readings q it is
where the rigid model is at

    q' = corrected_configuration(q) = q + own(q) + J^+(q) across(q)

`own` are the deflections about the joints' own axes, exactly; `across` is the twist of the module by the deflections about the other
axes, which joints can only make up for as far as they can move the module that way (J^+, damped least squares). A controller that
wants the arm where the rigid model is at q_wanted commands q = command(q_wanted), the inverse. Where the arm itself is, at singular
configurations too, says `placement`, which has every deflection where it happens (`bent_arm.py`); `shortfall` says how far the two are
apart over the workspace.

Two files belong together: the URDF of the joint fit ends in a comment with the hash of the compensation, and the compensation names the
hash of the URDF without that comment. Loading refuses any other pair.

Twists of the module by turns of the joints on the way, from Pinocchio's forward kinematics of the whole robot.

`model.jacobian` has the same for the error model, from a model of the way alone; the tests compare the two. This one costs little
for a single pose, as control code wants it.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import yaml

from urdfcal.base.errors import CalibrationFileError, InputError, ShapeMismatch, UsageError
from urdfcal.base.files import read_yaml
from urdfcal.base.geometry import MM, Array3, Matrix, Vector
from urdfcal.base.reading import DESCRIPTION, YAML, content_of
from urdfcal.base.yaml_kinds import is_not
from urdfcal.calibration.analysis.bent_arm import BentArm
from urdfcal.model.gravity import Gravity, WeighedRobot
from urdfcal.model.softness import Softness, Term, is_known
from urdfcal.robot.configurations import WholeRobot, joint_limits, whole_configurations
from urdfcal.robot.rig import SIX, Instruments, Target
from urdfcal.robot.robot import Robot, load_robot, with_text

_LEVER = 0.2  # [m] a rotation of the last link counts as this lever's end would move
_SCALE = np.array([1.0, 1.0, 1.0, _LEVER, _LEVER, _LEVER])[:, None]
_DAMPED = 0.01**2 * np.eye(6)  # [m^2] near singular configurations joints do not chase what they can hardly move
_ROUNDS, _STILL = 8, 1e-9  # [rad], [m]; deflections are milliradians: each round of the inverse gains about three digits
_DRAWN = 1000  # configurations that a workspace is judged by
Payload = float | Vector | None
_COMMENT = re.compile(rb"\n<!-- urdfcal compensation sha256 ([0-9a-f]{64}) -->\n?$")


@dataclass(frozen=True)
class Shortfall:
    """How far the rigid model at corrected positions is from where the arm is, over configurations within the joints' range.

    Attributes:
        median, p95, worst: Distances of the last link on the way, [m].
        sag: Median distance without any correction, [m].
        link: That link.
    """

    median: float
    p95: float
    worst: float
    sag: float
    link: str

    def in_mm(self) -> dict[str, float]:
        """For files and machines."""
        return {name: getattr(self, name) / MM for name in ("median", "p95", "worst")}

    @property
    def words(self) -> str:
        """One line."""
        median, p95, worst = (f"{value:.3f}" for value in self.in_mm().values())
        return (
            f"corrected joint positions leave {self.link} {median} mm (median), {p95} mm (95 %) and {worst} mm (worst) from where the arm "
            f"is, over the joints' range; uncorrected ones {self.sag / MM:.3f} mm (median), compensation.placement(q, '{self.link}') none"
        )


@dataclass(frozen=True, repr=False)
class Compensation:
    """Deflections of a calibrated robot's joints.

    Attributes:
        robot: The calibrated robot of the joint fit.
        softness: How its joints give way.
        values: Parameter of each of its terms, by name, in the term's unit: [rad], of slides [m], of scales a share.
        sigma: Standard deviation of each of them, by name, in the same unit.
    """

    robot: Robot
    softness: Softness
    values: Mapping[str, float]
    sigma: Mapping[str, float]

    @property
    def model(self) -> Any:
        """The calibrated `pin.Model` that corrected configurations are for."""
        return self.robot.model

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints that configurations are of, in order."""
        return self.softness.chain.input_names

    def __repr__(self) -> str:
        """In a line: the whole of it holds the URDF."""
        return f"<Compensation of {self.robot.name}: {len(self.values)} terms>"

    def corrected_configuration(self, q: Matrix | Vector, payload: Payload = None, approach: Matrix | Vector | None = None) -> Matrix:
        """What to feed the calibrated model so that its forward kinematics is where the arm is.

        Args:
            q: Joint readings, (n, joints) or (joints,), [rad] or [m].
            payload: Further mass at the tool, one or one a pose, [kg].
            approach: Direction of each joint's last move, of q's shape: -1, 0 or 1. Only where it was fitted (`--also approach`); without
                it those terms are 0.

        Returns:
            Of q's shape.

        Raises:
            ShapeMismatch: q or approach has not one number a joint, or the payload not one a pose.
            UsageError: the payload is no number.
        """
        rows = self._checked(q)
        corrected = rows + self._deflection(rows, self._masses(payload, len(rows)), self._directions(approach, rows))
        return np.asarray(corrected[0] if np.ndim(q) == 1 else corrected)

    def placement(self, q: Matrix | Vector, link: str, payload: Payload = None, approach: Matrix | Vector | None = None) -> Any:
        """Where a link is: forward kinematics with every deflection at its own joint, exact at singular configurations, too.

        Args:
            q: Joint readings, (n, joints) or (joints,), [rad] or [m]; joints that were not measured stay at neutral.
            link: Any link of the robot.
            payload: Further mass at the tool, one or one a pose, [kg].
            approach: Direction of each joint's last move, of q's shape: -1, 0 or 1.

        Returns:
            T_root_link, the link's placement in the URDF's root link: (n, 4, 4) with the position in [m], or for one configuration a
            `pin.SE3`.

        Raises:
            ShapeMismatch: q or approach has not one number a joint, or the payload not one a pose.
            UsageError: there is no such link, or the payload is no number.
        """
        rows = self._checked(q)
        placed = self._bent_arm.placements(link, rows, self.deflections(rows, payload, approach))
        return pin.SE3(placed[0]) if np.ndim(q) == 1 else placed

    def shortfall(self, rng: np.random.Generator | None = None) -> Shortfall:
        """How far corrected positions leave the rigid model from where the arm is, without a payload.

        Args:
            rng: Draws configurations within the joints' limits; seeded by default.
        """
        lower, upper = joint_limits(self.robot)
        q = (rng or np.random.default_rng(0)).uniform(lower, upper, (_DRAWN, len(lower)))
        rigid = np.zeros((len(q), len(self.softness.terms)))
        there = self._tips(q, self.deflections(q))
        left = np.linalg.norm(self._tips(self.corrected_configuration(q), rigid) - there, axis=1)
        median, p95, worst = np.quantile(left, [0.5, 0.95, 1.0]).tolist()
        sag = float(np.median(np.linalg.norm(self._tips(q, rigid) - there, axis=1)))
        return Shortfall(median, p95, worst, sag, self.robot.rig.tip)

    def _tips(self, q: Matrix, deflections: Matrix) -> Matrix:
        """The last link on the way as its first one sees it, (n, 3)."""
        base, tip = (self._bent_arm.placements(link, q, deflections) for link in (self.robot.rig.base, self.robot.rig.tip))
        return np.asarray(np.linalg.solve(base, tip)[:, :3, 3])

    @cached_property
    def _bent_arm(self) -> BentArm:
        return BentArm(self.robot, self.softness)

    def whole(self, q: Matrix | Vector) -> Matrix:
        """Configurations of `model` for positions of the calibrated joints; joints that were not measured stay at neutral.

        Args:
            q: (n, joints) or (joints,), as `corrected_configuration` gives them.

        Returns:
            (n, model.nq), or (model.nq,).
        """
        rows = whole_configurations(self.robot, self._checked(q))
        return np.asarray(rows[0] if np.ndim(q) == 1 else rows)

    def command(self, q_wanted: Matrix | Vector, payload: Payload = None, approach: Matrix | Vector | None = None) -> Matrix:
        """What to command so that the arm is where the calibrated model is at q_wanted.

        Args:
            q_wanted: Wanted configurations of the calibrated model, (n, joints) or (joints,), [rad] or [m].
            payload: Further mass at the tool, one or one a pose, [kg].
            approach: Direction of the move that will lead there, as above.

        Returns:
            Of q_wanted's shape.

        Raises:
            ShapeMismatch: as above.
        """
        wanted = self._checked(q_wanted)
        masses, directions = self._masses(payload, len(wanted)), self._directions(approach, wanted)
        q = wanted
        for _ in range(_ROUNDS):
            last, q = q, wanted - self._deflection(q, masses, directions)
            if np.max(np.abs(q - last), initial=0.0) < _STILL:
                break
        return np.asarray(q[0] if np.ndim(q_wanted) == 1 else q)

    def deflections(self, q: Matrix | Vector, payload: Payload = None, approach: Matrix | Vector | None = None) -> Matrix:
        """Angle by which each term turns its joint, or how far it slides it, (n, terms), also for one configuration, [rad] or [m].

        In the order of `softness.terms`.
        """
        rows = self._checked(q)
        return self.softness.basis(rows, self._masses(payload, len(rows)), self._directions(approach, rows)) * self._values

    def _checked(self, q: Matrix | Vector) -> Matrix:
        rows = np.asarray(q, dtype=float)
        rows = rows[None] if rows.ndim == 1 else rows
        if rows.ndim != 2 or rows.shape[1] != len(self.joints):
            raise ShapeMismatch(f"expected positions of the joints {', '.join(self.joints)}, found shape {np.shape(q)}")
        return rows

    def _directions(self, approach: Matrix | Vector | None, rows: Matrix) -> Matrix | None:
        if approach is None:
            return None
        directions = self._checked(approach)
        if directions.shape != rows.shape:
            raise ShapeMismatch(f"expected the last moves of {len(rows)} configurations, found {len(directions)}")
        return np.sign(directions)

    def _masses(self, payload: Payload, n: int) -> Vector | None:
        if payload is None:
            return None
        masses = np.asarray(payload, dtype=float)
        if not np.isfinite(masses).all():
            raise UsageError(f"expected a payload in kg, found {payload}")
        if masses.shape not in ((), (n,)):
            raise ShapeMismatch(f"expected one payload, or {n}; found shape {masses.shape}")
        return np.broadcast_to(masses, (n,))

    def _deflection(self, q: Matrix, payload: Vector | None, approach: Matrix | None) -> Matrix:
        """What has to be added to the readings, (n, joints)."""
        angles = self.softness.basis(q, payload, approach) * self._values
        own = angles @ self._own_joints
        if not self._twisting:
            return own
        columns = len(self.softness.chain.moving)
        twists = self._arm.twists(q + own) * _SCALE
        J = twists[:, :, :columns] @ self.softness.chain.coupling.T
        wanted, Jt = twists[:, :, columns:] @ angles[:, self._twisting, None], J.transpose(0, 2, 1)
        return np.asarray(own + (Jt @ np.linalg.solve(J @ Jt + _DAMPED, wanted))[:, :, 0])

    @cached_property
    def _values(self) -> Vector:
        return np.array([self.values[term.name] for term in self.softness.terms])

    @cached_property
    def _own_joints(self) -> Matrix:
        """Which measured joint each term about a joint's own axis turns, (terms, joints).

        A joint that others follow, and one that follows, cannot be turned alone.
        """
        chain, shares = self.softness.chain, np.zeros((len(self.softness.terms), len(self.joints)))
        alone = np.count_nonzero(chain.coupling, axis=1) == 1
        for number, term in enumerate(self.softness.terms):
            name = chain.moving[term.joint].joint.name
            if term.axis is None and name in self.joints and alone[self.joints.index(name)]:
                shares[number, self.joints.index(name)] = 1.0
        return shares

    @cached_property
    def _twisting(self) -> list[int]:
        """Terms that no measured joint makes up for by itself: about axes across, and of joints that share their measured one."""
        return np.flatnonzero(~self._own_joints.any(axis=1)).tolist()

    @cached_property
    def _arm(self) -> ArmScrews:
        terms = [self.softness.terms[number] for number in self._twisting]
        own = [self.softness.chain.moving[term.joint].joint.axis for term in terms]
        axes = [np.array(axis if term.axis is None else term.axis) for term, axis in zip(terms, own, strict=True)]
        return ArmScrews(self.robot, [term.joint for term in terms], axes)


def compensation_files(
    urdf: bytes, name: str, robot: Robot, softness: Softness, gravity: Gravity, values: Mapping[str, tuple[float, float]]
) -> tuple[bytes, bytes]:
    """The URDF of a joint fit and its compensation, each with the hash of the other.

    Args:
        urdf: Text of the calibrated URDF.
        name: The file that it will be written to, beside the compensation.
        robot: The robot that was measured.
        softness: How its joints give way.
        gravity: Where down is, and what is carried.
        values: Value and standard deviation of every term, by name.
    """
    instruments = robot.rig.instruments
    content = {
        "urdfcal": "compensation",
        "urdf": {"file": name, "sha256": hashlib.sha256(urdf).hexdigest()},
        "gravity": {"direction": list(gravity.direction), "payloads_kg": dict(gravity.payloads)},
        "masses": "generic" if softness.weighed.generic else "urdf",
        "rig": {"screen": robot.rig.base, "lasers": list(robot.rig.lasers)}
        if robot.rig.lasers
        else {"reference": instruments.reference, "targets": sorted({target.link for target in instruments.targets})},
        "joint_positions_fall_short_mm": in_memory(robot, urdf, softness, values).shortfall().in_mm(),
        "terms": [_term_entry(softness, term, *values[term.name]) for term in softness.terms],
    }
    head = (
        "# Deflections of the joints, fitted together with the URDF named below; in rad unless a unit is given, at each joint's `largest`\n"
        "# moment in N m.\n"
        "# Load with urdfcal.load_compensation; a URDF that was fitted without it is another robot.\n"
    )
    text = (head + yaml.safe_dump(content, sort_keys=False, width=120)).encode()
    return urdf + f"\n<!-- urdfcal compensation sha256 {hashlib.sha256(text).hexdigest()} -->\n".encode(), text


def _term_entry(softness: Softness, term: Term, value: float, sigma: float) -> dict[str, Any]:
    joint = softness.chain.moving[term.joint].joint.name
    entry: dict[str, Any] = {"name": term.name, "joint": joint, "value": value, "sigma": sigma}
    entry |= {} if term.unit == "rad" else {"unit": term.unit or "1"}
    return (
        entry
        | ({"axis": list(term.axis)} if term.axis is not None else {})
        | ({"largest": term.largest, "prior_sigma": term.sigma} if term.largest else {"prior_sigma": term.sigma})
    )


def load_compensation(path: str | Path, package_dirs: Sequence[str | Path] = ()) -> Compensation:
    """Read a compensation and the calibrated URDF that belongs to it, which stands beside it.

    Args:
        path: The compensation, written by `urdfcal fit --compensation`.
        package_dirs: Folders in which the URDF's packages are looked for first.

    Raises:
        CalibrationFileError: the file is no compensation, or the URDF beside it is not the one that it was fitted with.
        RobotError: the URDF cannot be loaded.
    """
    path = Path(path)
    file = read_yaml(path, CalibrationFileError)
    content = file.content
    if not isinstance(content, dict) or content.get("urdfcal") != "compensation":
        raise CalibrationFileError(is_not("compensation", content, "urdfcal", "fit --compensation"), path)
    try:
        urdf = path.parent / str(content["urdf"]["file"])
        expected = str(content["urdf"]["sha256"])
        rig, gravity = dict(content["rig"]), content["gravity"]
        _ = (rig["screen"], list(rig["lasers"])) if "lasers" in rig else (rig["reference"], list(rig["targets"]))
        x, y, z = (_finite(part) for part in gravity["direction"])
        payloads = {str(link): _finite(mass) for link, mass in gravity["payloads_kg"].items()}
        terms = [_read_term(entry) for entry in content["terms"]]
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise CalibrationFileError(f"an entry is missing or not readable: {error}; write the file anew", path) from None
    _require_pair(path, urdf, expected)
    robot = _robot_of(urdf, rig, path, package_dirs)
    weighed = WeighedRobot(robot, Gravity((x, y, z), payloads))
    return _compensation(robot, weighed, terms, path)


def _compensation(robot: Robot, weighed: WeighedRobot, terms: Sequence[tuple[str, Term, float, float]], path: Path) -> Compensation:
    names = [step.joint.name for step in robot.chain.moving]
    unknown = [joint for joint, _, _, _ in terms if joint not in names]
    if unknown:
        raise CalibrationFileError(f"joint '{unknown[0]}' is not between the links of its rig; there are: {', '.join(names)}", path)
    twice = [term.name for number, (_, term, _, _) in enumerate(terms) if term.name in [each.name for _, each, _, _ in terms[:number]]]
    if twice:
        raise CalibrationFileError(f"the term '{twice[0]}' is there twice", path)
    placed = tuple(replace(term, joint=names.index(joint)) for joint, term, _, _ in terms)
    softness = Softness(robot.chain, placed, weighed, robot.rig.tip)
    values = {term.name: value for _, term, value, _ in terms}
    return Compensation(robot, softness, values, {term.name: sigma for _, term, _, sigma in terms})


def _read_term(entry: Any) -> tuple[str, Term, float, float]:
    axis = entry.get("axis")
    x, y, z = (_finite(part) for part in axis) if axis is not None else (0.0, 0.0, 0.0)
    prior_sigma, largest, name = _finite(entry["prior_sigma"]), _finite(entry.get("largest", 0.0)), str(entry["name"])
    unit = str(entry.get("unit", "1" if name.endswith(".scale") else "rad"))
    term = Term(name, -1, None if axis is None else (x, y, z), prior_sigma, largest, "" if unit == "1" else unit)
    if not is_known(term):
        raise ValueError(f"'{term.name}' is no term that this version knows")
    return str(entry["joint"]), term, _finite(entry["value"]), _finite(entry["sigma"])


def _finite(value: Any) -> float:
    if isinstance(value, bool) or not np.isfinite(float(value)):
        raise ValueError(f"{value} is no number")
    return float(value)


def _require_pair(path: Path, urdf: Path, expected: str) -> None:
    try:
        text, own = content_of(urdf, DESCRIPTION), content_of(path, YAML)
    except InputError as error:
        raise CalibrationFileError(f"its URDF {error}; keep the two files together", path) from None
    comment = _COMMENT.search(text)
    bare = text[: comment.start()] if comment else text
    if hashlib.sha256(bare).hexdigest() != expected:
        raise CalibrationFileError(f"{urdf} is not the URDF that it was fitted with; write both anew with --compensation", path)
    if comment is None or comment[1].decode() != hashlib.sha256(own).hexdigest():
        raise CalibrationFileError(f"{urdf} belongs to another compensation; write both anew with --compensation", path)


def _robot_of(urdf: Path, rig: Mapping[str, Any], path: Path, package_dirs: Sequence[str | Path]) -> Robot:
    if "lasers" in rig:
        return load_robot(urdf, package_dirs=package_dirs, screen=str(rig["screen"]), lasers=[str(laser) for laser in rig["lasers"]])
    targets = tuple(Target(str(link), str(link), SIX) for link in rig["targets"])
    if not targets:
        raise CalibrationFileError("rig: expected at least one target", path)
    bare = load_robot(urdf, package_dirs=package_dirs)
    return bare.seen_by(Instruments(targets, str(rig["reference"]), True), ())


def in_memory(robot: Robot, urdf: bytes, softness: Softness, values: Mapping[str, tuple[float, float]]) -> Compensation:
    """The same without files: of the joint fit of a robot, with its calibrated URDF."""
    calibrated = with_text(robot, urdf)
    weighed = WeighedRobot(calibrated, softness.weighed.gravity)
    terms = [(softness.chain.moving[term.joint].joint.name, term, *values[term.name]) for term in softness.terms]
    return _compensation(calibrated, weighed, terms, robot.description.path)


class ArmScrews:
    """The joints on the way, and further axes in their frames; holds data of its own and leaves the model as it is."""

    def __init__(self, robot: Robot, joints: Sequence[int], axes: Sequence[Vector]) -> None:
        """Prepare.

        Args:
            robot: The robot.
            joints: Index of the moving joint on the way that carries each further axis.
            axes: Unit vectors of the further axes, in the joints' own frames.
        """
        model, steps = robot.model, robot.chain.moving
        self.model, self.data, self.whole = model, model.createData(), WholeRobot(robot, robot.chain.input_names)
        module = model.frames[model.getFrameId(robot.rig.tip, pin.BODY)]
        self.carrier, self.module = module.parentJoint, np.append(module.placement.translation, 1.0)
        self.ids = [model.getJointId(step.joint.name) for step in steps]
        self.owners = np.array([*range(len(steps)), *joints])
        self.axes = np.array([step.joint.axis for step in steps] + [list(axis) for axis in axes])[..., None]
        self.slides = np.array([step.joint.prismatic for step in steps] + [False] * len(joints))
        signs = [1.0 if step.forward else -1.0 for step in steps]
        turns = np.array([signs[joint] for joint in joints])  # the module's motion as the screen sees it
        self.signs = np.append(np.ones(len(steps)), turns)[:, None]  # chain positions have their sign already

    def twists(self, q: Matrix) -> Array3:
        """Twists [v, w] of the module against the screen at the module's origin, in world axes, (n, 6, moving + further axes).

        Per unit of the chain's positions, and per turn of the joint itself about each further axis.

        Args:
            q: Positions of the measured joints, (n, inputs), [rad] or [m].
        """
        placed = np.empty((len(q), len(self.ids) + 1, 4, 4))
        model, data = self.model, self.data
        for pose, configuration in enumerate(self.whole.configurations(q)):
            pin.forwardKinematics(model, data, configuration)
            placed[pose] = [data.oMi[joint].homogeneous for joint in (*self.ids, self.carrier)]
        tool, owners = (placed[:, -1] @ self.module)[:, None, :3], placed[:, self.owners]
        axes = (owners[:, :, :3, :3] @ self.axes)[..., 0] * self.signs
        lever = tool - owners[:, :, :3, 3]
        v = axes[..., _NEXT] * lever[..., _LAST] - axes[..., _LAST] * lever[..., _NEXT]
        twists = np.concatenate([v, axes], axis=2)
        if self.slides.any():
            twists[:, self.slides, :3], twists[:, self.slides, 3:] = axes[:, self.slides], 0.0
        return twists.transpose(0, 2, 1)


_NEXT, _LAST = [1, 2, 0], [2, 0, 1]
