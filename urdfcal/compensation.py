"""What a URDF cannot carry, for control code: the sag of the joints, beside the calibrated URDF that was fitted together with it.

The calibrated model stands for the unloaded arm. The arm that stands in the room gives way at each joint, so that at readings q it is
where the rigid model is at

    q' = corrected_configuration(q) = q + own(q) + J^+(q) across(q)

`own` are the deflections about the joints' own axes, exactly; `across` is the twist of the last link by the deflections about the other
axes, which joints can only make up for as far as they can move the last link that way (J^+, damped least squares). A controller that
wants the arm where the rigid model is at q_wanted commands q = command(q_wanted), the inverse.

Two files belong together: the URDF of the joint fit ends in a comment with the hash of the compensation, and the compensation names the
hash of the URDF without that comment. Loading refuses any other pair.
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
import yaml

from urdfcal.description import Description
from urdfcal.error_model import ErrorModel, Parameter, Placements
from urdfcal.errors import CalibrationFileError, ShapeMismatch
from urdfcal.files import read_yaml
from urdfcal.frame_jacobian import ArmKinematics, motion_at
from urdfcal.geometry import Array3, Matrix, Vector
from urdfcal.gravity import Gravity, WeighedRobot
from urdfcal.instruments import Instruments, Target
from urdfcal.robot import Robot, load_robot, robot_from
from urdfcal.softness import Softness, Term, Yielding
from urdfcal.target_sensors import skew

_LEVER = 0.2  # [m] a rotation of the last link counts as this lever's end would move
_SCALE = np.array([1.0, 1.0, 1.0, _LEVER, _LEVER, _LEVER])[:, None]
_DAMPING = 0.01  # [m] near singular configurations joints do not chase what they can hardly move
_ROUNDS = 4  # deflections are milliradians: each round of the inverse gains three digits
_COMMENT = re.compile(rb"\n<!-- urdfcal compensation sha256 ([0-9a-f]{64}) -->\n?$")


@dataclass(frozen=True)
class Compensation:
    """Deflections of a calibrated robot's joints.

    Attributes:
        robot: The calibrated robot of the joint fit.
        errors: An error model with nothing in it but the joints' softness, held at what was fitted.
        sigma: Standard deviation of each of its terms, by name, [rad].
    """

    robot: Robot
    errors: ErrorModel
    sigma: Mapping[str, float]

    @property
    def model(self) -> Any:
        """The calibrated `pin.Model` that corrected configurations are for."""
        return self.robot.model

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints that configurations are of, in order."""
        return self.robot.chain.input_names

    def corrected_configuration(self, q: Matrix | Vector, payload: float | Vector | None = None) -> Matrix:
        """What to feed the calibrated model so that its forward kinematics is where the arm is.

        Args:
            q: Joint readings, (n, joints) or (joints,), [rad] or [m].
            payload: Further mass at the tool, one or one a pose, [kg].

        Returns:
            Of q's shape.

        Raises:
            ShapeMismatch: q has not one number a joint.
        """
        single, rows = np.ndim(q) == 1, self._checked(q)
        masses = None if payload is None else np.broadcast_to(np.asarray(payload, dtype=float), (len(rows),))
        corrected = rows + self._deflection(rows, masses)
        return np.asarray(corrected[0] if single else corrected)

    def command(self, q_wanted: Matrix | Vector, payload: float | Vector | None = None) -> Matrix:
        """What to command so that the arm is where the calibrated model is at q_wanted.

        Args:
            q_wanted: Wanted configurations of the calibrated model, (n, joints) or (joints,), [rad] or [m].
            payload: Further mass at the tool, one or one a pose, [kg].

        Returns:
            Of q_wanted's shape.
        """
        wanted = np.asarray(q_wanted, dtype=float)
        q = wanted
        for _ in range(_ROUNDS):
            q = wanted - (self.corrected_configuration(q, payload) - q)
        return q

    def deflections(self, q: Matrix, payload: Vector | None = None) -> Matrix:
        """Angle by which each term turns its joint, (n, terms), [rad], in the order of `softness.terms`."""
        return self._softness.basis(self._checked(q), payload) * self._values

    def _checked(self, q: Matrix | Vector) -> Matrix:
        rows = np.atleast_2d(np.asarray(q, dtype=float))
        if rows.shape[1:] != (len(self.joints),):
            raise ShapeMismatch(f"expected positions of the joints {', '.join(self.joints)}, found shape {np.shape(q)}")
        return rows

    @property
    def _softness(self) -> Softness:
        assert self.errors.soft is not None
        return self.errors.soft

    @cached_property
    def _values(self) -> Vector:
        return np.array([self.errors.held[term.name] for term in self._softness.terms])

    @cached_property
    def _arm(self) -> ArmKinematics:
        return ArmKinematics(self.errors.chain, self._softness.bends)

    def _deflection(self, q: Matrix, payload: Vector | None) -> Matrix:
        """What has to be added to the readings, (n, joints)."""
        softness, arm = self._softness, self._arm
        basis = softness.basis(q, payload)
        own = (basis * self._values) @ self._own_joints
        if not self._across:
            return own
        x = self._values[self._across]
        yielding = Yielding(np.arange(len(x)), self._joints_across, tuple(range(len(x))), basis[:, self._across], np.zeros(len(x)))
        motion = motion_at(arm, self._placed, arm.chain_positions(q + own), joints=True, yielding=yielding)
        point = motion.frames[-1][:, :, 3] if len(motion.frames) else motion.source[:, 0]
        J, wanted = _at(point, motion.joint_jacobian) * _SCALE, _at(point, (motion.jac1 @ x)[..., None]) * _SCALE
        inverse = J.transpose(0, 2, 1) @ np.linalg.inv(J @ J.transpose(0, 2, 1) + _DAMPING**2 * np.eye(6))
        return np.asarray(own + (inverse @ wanted)[..., 0])

    @cached_property
    def _across(self) -> list[int]:
        """Terms about axes across their joint's own."""
        return [number for number, term in enumerate(self._softness.terms) if term.axis is not None]

    @cached_property
    def _joints_across(self) -> tuple[int, ...]:
        return tuple(self._softness.terms[number].joint for number in self._across)

    @cached_property
    def _own_joints(self) -> Matrix:
        """Which measured joint each term about a joint's own axis turns, (terms, joints)."""
        chain, shares = self._softness.chain, np.zeros((len(self._softness.terms), len(self.joints)))
        for number, term in enumerate(self._softness.terms):
            name = chain.moving[term.joint].joint.name
            if term.axis is None and name in self.joints:
                shares[number, self.joints.index(name)] = 1.0
        return shares

    @cached_property
    def _placed(self) -> Placements:
        """The chain's constants, with a column for every term across."""
        terms = [self._softness.terms[number] for number in self._across]
        free = replace(self.errors, parameters=tuple(Parameter(term.name, "rad", "soft", 0.0, 1.0) for term in terms), held={})
        return free.placements(np.zeros(len(terms)), free.sessions[0])


def _at(point: Matrix, twists: Array3) -> Array3:
    """Twists at the common origin as they move a point (n, 3): [v + w x p, w]."""
    v, w = twists[:, :3], twists[:, 3:]
    return np.concatenate([v - skew(point) @ w, w], axis=1)


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
        "rig": {"screen": robot.rig.screen, "lasers": list(robot.rig.lasers)}
        if robot.rig.lasers
        else {"reference": instruments.reference, "targets": sorted({target.link for target in instruments.targets})},
        "terms": [_term_entry(softness, term, *values[term.name]) for term in softness.terms],
    }
    head = (
        "# Deflections of the joints, fitted together with the URDF named below; in rad, at each joint's `largest` moment in N m.\n"
        "# Load with urdfcal.load_compensation; a URDF that was fitted without it is another robot.\n"
    )
    text = (head + yaml.safe_dump(content, sort_keys=False, width=120)).encode()
    return urdf + f"\n<!-- urdfcal compensation sha256 {hashlib.sha256(text).hexdigest()} -->\n".encode(), text


def _term_entry(softness: Softness, term: Term, value: float, sigma: float) -> dict[str, Any]:
    entry: dict[str, Any] = {"name": term.name, "joint": softness.chain.moving[term.joint].joint.name, "value": value, "sigma": sigma}
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
        raise CalibrationFileError("is no compensation; expected a file written by `urdfcal fit --compensation`", path)
    try:
        urdf = path.parent / str(content["urdf"]["file"])
        expected = str(content["urdf"]["sha256"])
        rig, gravity = content["rig"], content["gravity"]
        direction = tuple(float(part) for part in gravity["direction"])
        payloads = {str(link): float(mass) for link, mass in gravity["payloads_kg"].items()}
        terms = [_read_term(entry) for entry in content["terms"]]
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise CalibrationFileError(f"an entry is missing or not readable: {error}; write the file anew", path) from None
    if len(direction) != 3:
        raise CalibrationFileError("gravity.direction: expected three numbers", path)
    _require_pair(path, urdf, expected)
    robot = _robot_of(urdf, rig, path, package_dirs)
    weighed = WeighedRobot(robot, Gravity(direction, payloads))
    return _compensation(robot, weighed, terms, path)


def _compensation(robot: Robot, weighed: WeighedRobot, terms: Sequence[tuple[str, Term, float, float]], path: Path) -> Compensation:
    names = [step.joint.name for step in robot.chain.moving]
    unknown = [joint for joint, _, _, _ in terms if joint not in names]
    if unknown:
        raise CalibrationFileError(f"joint '{unknown[0]}' is not between the links of its rig; there are: {', '.join(names)}", path)
    placed = tuple(replace(term, joint=names.index(joint)) for joint, term, _, _ in terms)
    softness = Softness(robot.chain, placed, weighed, robot.rig.module)
    held = {term.name: value for _, term, value, _ in terms}
    return Compensation(robot, ErrorModel(robot.chain, (), (), held=held, soft=softness), {term.name: sigma for _, term, _, sigma in terms})


def _read_term(entry: Any) -> tuple[str, Term, float, float]:
    axis = entry.get("axis")
    x, y, z = (float(part) for part in axis) if axis is not None else (0.0, 0.0, 0.0)
    term = Term(str(entry["name"]), -1, None if axis is None else (x, y, z), float(entry["prior_sigma"]), float(entry.get("largest", 0.0)))
    return str(entry["joint"]), term, float(entry["value"]), float(entry["sigma"])


def _require_pair(path: Path, urdf: Path, expected: str) -> None:
    try:
        text, own = urdf.read_bytes(), path.read_bytes()
    except OSError as error:
        found = f"its URDF {urdf} cannot be read: {error.strerror or error}"
        raise CalibrationFileError(f"{found}; keep the two files together", path) from None
    found = _COMMENT.search(text)
    bare = text[: found.start()] if found else text
    if hashlib.sha256(bare).hexdigest() != expected:
        raise CalibrationFileError(f"{urdf} is not the URDF that it was fitted with; write both anew with --compensation", path)
    if found is None or found[1].decode() != hashlib.sha256(own).hexdigest():
        raise CalibrationFileError(f"{urdf} belongs to another compensation; write both anew with --compensation", path)


def _robot_of(urdf: Path, rig: Mapping[str, Any], path: Path, package_dirs: Sequence[str | Path]) -> Robot:
    if "lasers" in rig:
        return load_robot(urdf, package_dirs=package_dirs, screen=str(rig["screen"]), lasers=[str(laser) for laser in rig["lasers"]])
    targets = tuple(Target(str(link), str(link), True) for link in rig.get("targets", ()))
    if not targets:
        raise CalibrationFileError("rig: expected lasers, or a reference and targets", path)
    bare = load_robot(urdf, package_dirs=package_dirs)
    return bare.seen_by(Instruments(targets, str(rig["reference"]), True), ())


def in_memory(robot: Robot, urdf: bytes, softness: Softness, values: Mapping[str, tuple[float, float]]) -> Compensation:
    """The same without files: of the joint fit of a robot, with its calibrated URDF."""
    description: Description = replace(robot.description, text=urdf)
    calibrated = replace(robot_from(description, screen=robot.screen, lasers=robot.lasers), instruments=robot.instruments)
    weighed = WeighedRobot(calibrated, softness.weighed.gravity)
    terms = [(softness.chain.moving[term.joint].joint.name, term, *values[term.name]) for term in softness.terms]
    return _compensation(calibrated, weighed, terms, robot.description.path)
