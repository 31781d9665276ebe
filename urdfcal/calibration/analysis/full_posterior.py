"""What the data leave open of *every* placement of the robot, those included that the fit leaves out.

A fit estimates what some measurement could tell, and puts it where its error model has room: the gauge leaves parameters out because
others carry them, `offset` knows zeros alone. The robot is wrong in all six directions of every joint all the same. So the data are
put once more, linearised at the estimate, to a model in which every joint has six errors with the joints' priors,

    z ~ N(0, D^2),    y = H z + noise    =>    z | y ~ N(mean, P),

while the calibrated robot stands at x, the fit's own corrections in the same coordinates. With A the motion of anything by z, the
calibrated robot is off by A (z - x) there, and the nominal one by A z.

How large the joints' errors usually are decides what the data's blind side may hold, and priors that are wide enough for any robot
say little of this one. Unless it was stated, the scale of each group g of errors is what makes the data most probable (MacKay's fixed
point, as in `evidence.py`),

    scale_g^2 = (sum of mean_i^2 + nu c prior_g^2) / (gamma_g + nu),    gamma_g = sum of (1 - P_ii / scale_g^2)

where c says how much smaller than their priors all of them are together, found in the same way. So a group that the data do not see
is as small as those that they see, and data that see nothing leave the priors.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from urdfcal.base.geometry import SE3, Matrix, Vector, exponentials, product
from urdfcal.calibration.analysis.more_poses import covariance, information_of_a_pose
from urdfcal.calibration.asking.lacking import Lacking
from urdfcal.calibration.problem import problem_of
from urdfcal.calibration.result import FitResult
from urdfcal.estimation.chi_squared import quantile
from urdfcal.estimation.ekf import Belief, told
from urdfcal.estimation.noise import LEAST_FREEDOM, Noise
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.parameters import DEFAULT_PRIORS, FLAT, Parameter
from urdfcal.model.slots import Slot, slots_of
from urdfcal.robot.rig import SIX

_SCALED = ("translation", "rotation", "zero")
_NU, _NU_ALL = 0.3, 0.01  # how many errors' worth count: for a group what all of them are like, for all of them the prior
_ROUNDS = 40
_TOO_LOW = 0.1  # how often the noise may be larger than is assumed of a few readings
_ALONG = 0.8  # cosine from which a rotation is one about the joint's axis


@dataclass(frozen=True)
class FullPosterior:
    """Every error of the robot, as the data leave it.

    Attributes:
        errors: Six parameters a joint; mount, screen, beams and instruments as in the fit.
        x: Where the calibrated robot stands, (p,), [m] and [rad].
        mean: The posterior's mean, (p,).
        P: Its covariance, (p, p).
        whitened: Whitened Jacobian of the data at x, (m, p).
        a_pose: Information that a further pose of the same kind would add on average, (p, p).
        q: Joint positions at which the robot was measured, (n, inputs), [rad] or [m].
        lacking: What stands out in the residuals and is not in the fit; None where nothing does.
    """

    errors: ErrorModel
    x: Vector
    mean: Vector
    P: Matrix
    whitened: Matrix
    a_pose: Matrix
    q: Matrix
    lacking: Lacking | None = None

    def with_further(self, poses: int) -> Matrix:
        """Covariance after so many further poses of the same kind, (p, p)."""
        return covariance(self.whitened.T @ self.whitened + poses * self.a_pose, self.errors.sigma)


def full_posterior(found: FitResult) -> FullPosterior:
    """The data of a fit put to a robot that may be wrong everywhere."""
    errors, x = _widened(found)
    noise = _careful_noise(found)
    linearisation = problem_of(errors, found.data, noise).linearise(x)
    weights = noise.weights(linearisation)
    H, residual = weights.jacobian(linearisation), weights.residual(linearisation)
    errors = _with_likely_scales(errors, H, residual + H @ (x - errors.mean), found)
    belief = told(Belief.independent(errors.mean, errors.sigma), H, residual + H @ (x - errors.mean))
    a_pose = information_of_a_pose(errors, found.data, noise, x, np.random.default_rng(0))
    return FullPosterior(errors, x, belief.x, belief.P, H, a_pose, found.data.q, found.lacking)


def _careful_noise(found: FitResult) -> Noise:
    """The fit's noise; of a kind that had to be assumed, since too few readings tell it, as large as what they scatter by may yet mean."""
    factors = []
    for kind, stated in zip(found.kinds, found.estimate.noise.stated.tolist(), strict=True):
        own = found.misfits[kind]
        assumed = not stated and kind not in found.stating and 1 <= own.freedom < LEAST_FREEDOM
        bound = own.chi_squared * own.freedom / quantile(_TOO_LOW, round(own.freedom)) if assumed else 1.0
        factors.append(max(1.0, float(np.sqrt(bound))))
    return found.estimate.noise.times(np.array(factors))


def _with_likely_scales(errors: ErrorModel, H: Matrix, y: Vector, found: FitResult) -> ErrorModel:
    """The same with the joints' errors as large as whitened data y = H z + noise make likely, where the priors are not stated."""
    groups = np.array([_group(each, found) if each.kind == "joint" else "" for each in errors.parameters])
    usual = DEFAULT_PRIORS["joint"]
    free = [(groups == group, usual.sigma("m" if group == "translation" else "rad")) for group in _SCALED if group in groups]
    if not _scales_are_free(found):
        return errors
    information, gradient, sigma = H.T @ H, y @ H, errors.sigma.copy()
    for _ in range(_ROUNDS):
        P = covariance(information, sigma)
        mean, variances = P @ gradient, np.diag(P)
        gamma = [float(np.sum(1 - variances[own] / sigma[own] ** 2)) for own, _ in free]
        size = sum(float(np.sum(mean[own] ** 2)) / prior**2 for own, prior in free)
        common = (size + _NU_ALL) / (max(sum(gamma), 0.0) + _NU_ALL)
        for (own, prior), known in zip(free, gamma, strict=True):
            sigma[own] = min(np.sqrt((np.sum(mean[own] ** 2) + _NU * common * prior**2) / (max(known, 0.0) + _NU)), FLAT)
    return errors.with_prior(replace(errors.prior(), sigma=sigma))


def _scales_are_free(found: FitResult) -> bool:
    """Whether the joints' priors were chosen by the data, or are those that every robot gets."""
    usual, joints = DEFAULT_PRIORS["joint"], [each for each in found.errors.parameters if each.kind == "joint"]
    return found.evidence is not None or all(each.sigma == usual.sigma(each.unit) for each in joints)


def _group(parameter: Parameter, found: FitResult) -> str:
    """`translation`, `rotation`, or `zero` for the rotation that lies along the joint's axis."""
    joint, _, name = parameter.name.rpartition(".")
    if parameter.unit == "m" or name not in SIX:
        return parameter.scale_group
    return "zero" if abs(found.robot.tree.joints[joint].axis["xyz".index(name[-1])]) > _ALONG else "rotation"


def _widened(found: FitResult) -> tuple[ErrorModel, Vector]:
    """The fit's error model with all six errors of every joint of which nothing is fixed, and its estimate in those."""
    errors = found.errors
    free = [slot.label for slot in errors.slots if slot.kind == "joint" and not _has_fixed(slot, errors)]
    six = {slot.label: slot for slot in slots_of(errors.chain, found.robot.rig, "placement") if slot.kind == "joint" and slot.label in free}
    values = [
        (parameter, value)
        for parameter, value in zip(errors.parameters, found.x.tolist(), strict=True)
        if parameter.kind != "joint" or parameter.name.rpartition(".")[0] not in six
    ]
    values += [(parameter, 0.0) for parameter in _carried(errors)]
    for slot, state in zip(errors.slots, errors.slot_values(found.x, errors.sessions[0]), strict=True):
        if slot.label in six and slot.kind == "joint":
            coordinates = _coordinates(product(exponentials(slot.screws, state)))
            values += list(zip(_six_of(six[slot.label], found), coordinates.tolist(), strict=True))
    slots = tuple(six.get(slot.label, slot) if slot.kind == "joint" else slot for slot in errors.slots)
    held = {name: value for name, value in errors.held.items() if name.rpartition(".")[0] not in six}
    known = errors.earlier.in_six(six) if errors.earlier is not None else None
    wide = replace(errors, slots=slots, parameters=tuple(each for each, _ in values), held=held, carried={}, held_sum={}, earlier=known)
    return wide, np.array([value for _, value in values])


def _has_fixed(slot: Slot, errors: ErrorModel) -> bool:
    """Whether the user said that some of a joint's errors are known."""
    return any(f"{slot.label}.{name}" in errors.known for name in slot.names)


def _carried(errors: ErrorModel) -> Iterator[Parameter]:
    """Of mount and targets, what something else carries."""
    for slot in errors.slots:
        for name, unit in zip(slot.names, slot.units(), strict=True):
            if slot.kind in ("mount", "target") and f"{slot.label}.{name}" in errors.carried:
                yield Parameter(f"{slot.label}.{name}", unit, slot.kind, 0.0, DEFAULT_PRIORS[slot.kind].sigma(unit))


def _six_of(slot: Slot, found: FitResult) -> list[Parameter]:
    """The six errors of a joint, as large as the fit takes the joints' errors to be."""
    scales = _joint_scales(found)
    axis = np.array(found.robot.tree.joints[slot.label].axis)
    zero, across = scales["zero"], scales["rotation"]
    turning = np.sqrt(across**2 + (zero**2 - across**2) * axis**2)
    sigma = [*np.full(3, scales["translation"]), *turning]
    return [
        Parameter(f"{slot.label}.{name}", unit, "joint", 0.0, float(own))
        for name, unit, own in zip(slot.names, slot.units(), sigma, strict=True)
    ]


def _joint_scales(found: FitResult) -> dict[str, float]:
    """Usual size of the joints' errors by group, [m] and [rad]: the largest prior that any has, where it has one at all."""
    usual = DEFAULT_PRIORS["joint"]
    scales = {}
    for group, unit in (("translation", "m"), ("rotation", "rad"), ("zero", "rad")):
        own = [each.sigma for each in found.errors.parameters if each.scale_group == group and each.sigma < FLAT]
        scales[group] = max(own, default=usual.sigma(unit))
    return scales


def _coordinates(delta: SE3) -> Vector:
    """Coordinates of a placement in exp(trans_x) exp(trans_y) exp(trans_z) exp(rot_x) exp(rot_y) exp(rot_z), (6,)."""
    R = delta.rotation
    angles = np.arctan2(-R[1, 2], R[2, 2]), np.arcsin(np.clip(R[0, 2], -1.0, 1.0)), np.arctan2(-R[0, 1], R[0, 0])
    return np.concatenate([delta.translation, angles])
