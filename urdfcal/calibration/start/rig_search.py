"""Where the iterated fit starts when screen and module are placed only roughly.

If the nominal robot explains the spots within what the priors allow, the start is the prior mean. Else beams are turned towards
spots (`aim.py`): first under the priors as they stand; if that will not do, with screen and module free to move by half a metre
and 30 degrees, from the nominal placement and, if need be, from tilted ones. What was found far outside its prior has its prior
widened to where it was found, and that is said.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import DEG, MM, Matrix, Vector
from urdfcal.base.progress import each
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.start.aim import AimFit, Wanted, aim_fit
from urdfcal.estimation.noise import Noise
from urdfcal.model.error_model import ErrorModel, parameters_of
from urdfcal.model.parameters import DEFAULT_PRIORS, PriorScale
from urdfcal.model.structure import full_pose_jacobian, independent_columns

Columns = npt.NDArray[np.intp]

_ROUGH = PriorScale(500 * MM, 30 * DEG)  # how roughly a rig may be placed
_EXPLAINED = 0.7  # share of what the priors allow that the nominal residual may have
_PLAUSIBLE, _NOISES = 5 * MM, 5.0  # what may be left over: this, or so many times the spot noise
_BETTER = 0.2  # a rig that is elsewhere must leave less than this share of what was left before
_FAR = 4.0  # [sigmas] beyond this a rig is not where its prior has it
_TILT = 60 * DEG
_MOST_TURN, MOST_JOINT_TURN = 75 * DEG, 20 * DEG  # beyond these a rig is not placed roughly, and a joint not made badly
INCREDIBLE = 6.0  # [sigmas of the prior] a fit that moved a parameter farther is not taken for granted
_TILTED_ITERATIONS = 12
_SHARE = 1e-6


@dataclass(frozen=True)
class Start:
    """Where to start.

    Attributes:
        x: State to linearise at first, (p,), [m] and [rad].
        errors: The error model, with the priors of the rig widened where it was found far outside them.
        message: What was widened, in words; the empty string if nothing was.
        scale: Robust standard deviation of a spot coordinate that is left at x, [m]; nan if nothing had to be sought.
        plausible: Whether little is left, and no angle is off by more than carelessness explains; if not, `hypotheses.py` may know why.
    """

    x: Vector
    errors: ErrorModel
    message: str = ""
    scale: float = np.nan
    plausible: bool = True


def find_start(model: Problem, noise: Noise) -> Start:
    """Find a state from which the iterated fit converges.

    Args:
        model: Beams and spots, with the error model that is to be fitted.
        noise: Of the spots.
    """
    errors, limit = model.errors, plausible_scale(noise)
    if _explained(model, noise):
        return Start(errors.mean, errors)
    near, groups = aim_fit(model, near_wanted(errors, noise), errors.mean), _rig_groups(errors)
    plausible, far = near.scale < limit and credible(errors, near.x), any(group.far(errors, near.x) for group in groups)
    if plausible and not far:
        return Start(near.x, errors, "", near.scale)
    found = _roughly_placed(model, groups, noise, limit)
    if found.scale > max(limit, _BETTER * (_untouched(model, noise) if far else near.scale)):  # a rig that is elsewhere explains nothing
        return Start(near.x, errors, "", near.scale, plausible)
    moved = [group for group in groups if group.far(errors, found.x)]
    words = "; ".join(group.words(errors, found.x) for group in moved)
    return Start(found.x, _widened(errors, moved, found.x), words, found.scale, found.scale < limit and credible(errors, found.x))


def plausible_scale(noise: Noise) -> float:
    """The robust standard deviation of a spot coordinate [m] above which a fit is not worth believing."""
    return max(_PLAUSIBLE, _NOISES * noise.spot_sigma)


def near_wanted(errors: ErrorModel, noise: Noise) -> Wanted:
    """The priors as they stand, but for those that are wider than any rig is wrong."""
    rough = np.array([_ROUGH.sigma(unit) for unit in errors.units])
    return Wanted(errors.mean, np.minimum(errors.sigma, rough), noise.spot_sigma)


def far_wanted(errors: ErrorModel, noise: Noise) -> Wanted:
    """The same with screen and module placed only roughly."""
    return _far_wanted(errors, _rig_groups(errors), noise)


def credible(errors: ErrorModel, x: Vector) -> bool:
    """Whether no angle at x is more than a rig may be placed wrongly by, or a joint be made wrongly by."""
    of_joints = np.array([unit == "rad" for unit in errors.units])
    for columns in rig_columns(errors):
        of_joints[columns] = False
    return not turned_round(errors, x) and not np.any(np.abs(x - errors.mean)[of_joints] > MOST_JOINT_TURN)


def turned_round(errors: ErrorModel, x: Vector) -> str:
    """What stands at an angle that no carelessness explains: `'slm' turned by 180 deg`, or the empty string."""
    angles = {group.name: group.offset(errors, x)[1] for group in _rig_groups(errors)}
    return " and ".join(f"'{name}' turned by {angle / DEG:.0f} deg" for name, angle in angles.items() if angle > _MOST_TURN)


def tilted(errors: ErrorModel, angle: float) -> Iterator[Vector]:
    """The prior mean with screen or module turned by an angle [rad] about one of the axes that they can turn about."""
    for group in _rig_groups(errors):
        for column in group.parts(errors)[1]:
            x = errors.mean.copy()
            x[column] += angle
            yield x


def rig_columns(errors: ErrorModel) -> list[Columns]:
    """Columns of x that place each screen and the module; those of joints where they must stand for the screen."""
    return [group.columns for group in _rig_groups(errors)]


@dataclass(frozen=True)
class _Group:
    """Parameters that place the screen of one session, or the module."""

    name: str
    columns: Columns
    stand_in: bool = False

    def parts(self, errors: ErrorModel) -> list[Columns]:
        """Columns of the translations, columns of the rotations."""
        lengths = np.array([errors.units[column] == "m" for column in self.columns], dtype=bool)
        return [self.columns[lengths], self.columns[~lengths]]

    def offset(self, errors: ErrorModel, x: Vector) -> tuple[float, float]:
        """How far from the prior's mean, [m] and [rad]."""
        length, angle = (float(np.linalg.norm((x - errors.mean)[part])) for part in self.parts(errors))
        return length, angle

    def far_parts(self, errors: ErrorModel, x: Vector) -> list[tuple[Columns, float]]:
        """Columns that are far outside their priors, and how far from the mean they are."""
        parts = zip(self.parts(errors), self.offset(errors, x), strict=True)
        return [(part, offset) for part, offset in parts if len(part) and offset > _FAR * errors.sigma[part].max()]

    def far(self, errors: ErrorModel, x: Vector) -> bool:
        """Whether anything is far outside its prior."""
        return bool(self.far_parts(errors, x))

    def words(self, errors: ErrorModel, x: Vector) -> str:
        """What was found, and what follows."""
        length, angle = self.offset(errors, x)
        found = f"{length / MM:.0f} mm and {angle / DEG:.1f} deg from where the URDF has it"
        far = [(errors.units[part[0]], offset) for part, offset in self.far_parts(errors, x)]
        widened = " and ".join(f"{offset / MM:.0f} mm" if unit == "m" else f"{offset / DEG:.1f} deg" for unit, offset in far)
        if not self.stand_in:
            return f"'{self.name}' was found {found}; its prior was widened to {widened}"
        names = ", ".join(errors.names[column] for column in self.columns)
        return f"'{self.name}' was found {found} as far as {names} can stand for its placement; their priors were widened to {widened}"


def _explained(model: Problem, noise: Noise) -> bool:
    """Whether the nominal residual of each laser, in y and in z, is small against what the priors allow."""
    errors = model.errors
    linearisation = model.linearise(errors.mean)
    if not linearisation.usable:
        return False
    usual = np.array([DEFAULT_PRIORS[parameter.kind].sigma(parameter.unit) for parameter in errors.parameters])
    variance = np.sum((linearisation.jacobian * np.minimum(errors.sigma, usual)) ** 2, axis=-1) + noise.spot_sigma**2
    share = np.abs(linearisation.residual) / np.sqrt(variance)
    beams = [channel for channel in model.channels if channel.sensor.on_screen and channel.readings.seen.any()]
    return all(np.median(share[: len(model.data), own.block.columns].max(axis=1)[own.readings.seen]) < _EXPLAINED for own in beams)


def _untouched(model: Problem, noise: Noise) -> float:
    """Robust standard deviation of a spot coordinate in the nominal robot, [m]."""
    return aim_fit(model, near_wanted(model.errors, noise), model.errors.mean, iterations=0).scale


def _roughly_placed(model: Problem, groups: Sequence[_Group], noise: Noise, limit: float) -> AimFit:
    """The best fit with the rig free to be elsewhere; from tilted placements if the nominal one leads nowhere."""
    errors = model.errors
    wanted = _far_wanted(errors, groups, noise)
    found = aim_fit(model, wanted, errors.mean)
    if found.scale < limit or not groups:
        return found
    rig = replace(wanted, only=np.concatenate([group.columns for group in groups]).astype(int))
    starts = [x for angle in (_TILT, -_TILT) for x in tilted(errors, angle)]
    fits = [aim_fit(model, rig, x, _TILTED_ITERATIONS) for x in each(starts, "tilted start", len(starts))]
    best = min(fits, key=lambda fit: fit.scale, default=found)
    return min(found, aim_fit(model, wanted, best.x), key=lambda fit: fit.scale)


def _far_wanted(errors: ErrorModel, groups: Sequence[_Group], noise: Noise) -> Wanted:
    near = near_wanted(errors, noise)
    sigma = near.sigma.copy()
    for group in groups:
        sigma[group.columns] = [_ROUGH.sigma(errors.units[column]) for column in group.columns]
    return replace(near, sigma=sigma)


def _widened(errors: ErrorModel, groups: Sequence[_Group], x: Vector) -> ErrorModel:
    """Priors as wide as the rig is off; a parameter with a narrower prior than its neighbours was known better, and keeps it."""
    parameters = list(errors.parameters)
    for part, offset in (found for group in groups for found in group.far_parts(errors, x)):
        widest = errors.sigma[part].max()
        for column in part:
            if parameters[column].sigma == widest:
                parameters[column] = replace(parameters[column], sigma=offset)
    return replace(errors, parameters=tuple(parameters))


def _rig_groups(errors: ErrorModel) -> list[_Group]:
    """Screen placements and module, each with its parameters; joint parameters where they must stand for the screen."""
    columns: dict[str, list[int]] = {}
    for column, parameter in enumerate(errors.parameters):
        if parameter.kind in ("screen", "mount"):
            columns.setdefault(parameter.name.rsplit(".", 1)[0], []).append(column)
    groups = [_Group(name, np.array(own)) for name, own in columns.items()]
    stand_ins = _screen_stand_ins(errors)
    return [_Group(errors.slots[0].label, stand_ins, stand_in=True), *groups] if len(stand_ins) else groups


def _screen_stand_ins(errors: ErrorModel) -> Columns:
    """Columns of the joint parameters nearest to the screen that move it, where the screen has no placement of its own."""
    first = errors.chain.steps[0]
    if errors.chain.screen_joint is not None or not first.forward or any(parameter.kind == "screen" for parameter in errors.parameters):
        return np.empty(0, dtype=int)
    screen = [parameter for parameter in parameters_of(errors.slots, DEFAULT_PRIORS) if parameter.kind == "screen"]
    joints = [column for column, parameter in enumerate(errors.parameters) if parameter.kind == "joint"]
    whole = replace(errors, parameters=(*errors.parameters, *screen), sessions=errors.sessions[:1])
    jacobian = np.linalg.qr(full_pose_jacobian(errors.chain, whole))[1]
    own, of_screen = independent_columns(jacobian, joints), jacobian[:, len(errors.parameters) :]
    most = _shared(jacobian[:, own], of_screen).shape[1]
    prefixes = (_shared(jacobian[:, own[:count]], of_screen) for count in range(len(own) + 1))
    shares = np.abs(next(prefix for prefix in prefixes if prefix.shape[1] == most)).max(axis=1, initial=0.0)
    return np.array([column for column, share in zip(own, shares, strict=False) if share > _SHARE], dtype=int)


def _shared(columns: Matrix, others: Matrix) -> Matrix:
    """Weights of the columns in each direction that lies in both spans, (k, directions)."""
    both = np.hstack([columns, others])
    _, singular, right = np.linalg.svd(both / np.linalg.norm(both, axis=0), full_matrices=False)
    return np.asarray(right[singular < _SHARE, : columns.shape[1]].T)
