"""The set of parameters that is estimated: options narrowed by the gauge rule, with a word where the model cannot follow the robot."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from urdfcal.base.errors import RigError, UsageError
from urdfcal.base.geometry import MM, cross
from urdfcal.model.dh import dh_table
from urdfcal.model.earlier import EarlierJoints
from urdfcal.model.error_model import ErrorModel, parameters_of
from urdfcal.model.options import ModelOptions
from urdfcal.model.parameters import DEFAULT_PRIORS, SESSION_KINDS, Kind, Parameter, PriorScale, matching
from urdfcal.model.slots import BEAMS, BEAMS4, Slot, beam_slots, require_screen_slot, slots_of
from urdfcal.model.structure import enter, full_pose_jacobian, independent_columns
from urdfcal.robot.chain import Chain
from urdfcal.robot.rig import SIX, Rig
from urdfcal.robot.robot import Robot

_NOT_THE_ROBOTS = ("reference", "target", "place", "camera", "lens")  # found from nothing, whatever is asked of the robot
_NEAR_AXIS = 10 * MM


def build_error_model(chain: Chain, rig: Rig, options: ModelOptions | None = None, sessions: Sequence[str] = ("",)) -> ErrorModel:
    """Choose the parameters of a robot: error model, gauge, additions, what is fixed, priors.

    That follows from the robot and what is asked of it, before any data: the chain knows what was built of it last.

    Args:
        chain: The way from screen to lasers.
        rig: Screen, module, lasers.
        options: What is to be calibrated.
        sessions: Labels of the sessions; each but the first gets a screen placement of its own.

    Raises:
        UsageError: an option means nothing for this robot.
        RigError: the screen's placement is asked for, and nothing can carry it.
    """
    options, sessions = options or ModelOptions(), tuple(sessions)
    built = next((own for own in chain.built if own.rig is rig and (own.options, own.errors.sessions) == (options, sessions)), None)
    if built is None:
        built = _Built(rig, options, _build(chain, rig, options, sessions))
        chain.built.append(built)
    return built.errors


@dataclass(frozen=True)
class _Built:
    """An error model of a chain, and what it was asked for with."""

    rig: Rig
    options: ModelOptions
    errors: ErrorModel


def _build(chain: Chain, rig: Rig, options: ModelOptions, sessions: tuple[str, ...]) -> ErrorModel:
    _check_joints(chain, options.per_joint)
    priors = DEFAULT_PRIORS | dict(options.priors)
    slots = slots_of(chain, rig, options.error_model, options.per_joint)
    known = {"reference": options.reference_known, "target": options.target_known}
    slots = tuple(_as_known(slot, options.earlier) for slot in slots if not known.get(slot.kind, False))
    if "screen" in options.estimate or (len(sessions) > 1 and rig.lasers):
        require_screen_slot(chain, rig)
    if "beams" in options.estimate or "beams4" in options.estimate:
        slots += beam_slots(chain, BEAMS4 if "beams4" in options.estimate else BEAMS)
    _require_own_names(slots)
    screen_wanted = chain.screen_joint is not None or "screen" in options.estimate
    offered = [parameter for parameter in parameters_of(slots, priors) if parameter.kind != "screen" or screen_wanted]
    if options.earlier is not None:
        offered = [_with_sigma(parameter, options.earlier) for parameter in offered]
    beside = [*_later_sessions(slots, sessions, priors), *_places(rig, priors), *_camera(rig), *lens_parameters(rig)]
    stated, fixed = _stated([*offered, *beside], options)
    free = [parameter for parameter in stated if parameter.name not in fixed]
    if not free:
        raise UsageError("nothing is left to estimate: every parameter is fixed")
    decided = {parameter.name for parameter in free} & set(options.earlier.names if options.earlier is not None else ())
    chosen, carried = enter(chain, rig, slots, free, decided, options.error_model == "auto")
    held = {parameter.name: parameter.mean for parameter in stated if parameter.name in fixed and parameter.mean}
    return ErrorModel(chain, slots, tuple(chosen), held, carried, sessions, earlier=options.earlier, known=_known(stated, options))


def missing_screen_parameters(chain: Chain, rig: Rig, errors: ErrorModel) -> tuple[str, ...]:
    """Screen parameters that are not in the state, cannot be held by a fixed joint, and would raise the rank if they were."""
    first = chain.steps[0]
    if (
        not rig.lasers
        or chain.screen_joint is not None
        or not first.forward
        or any(name.startswith(f"{rig.base}.") for name in errors.names)
    ):
        return ()
    screen = [parameter for parameter in parameters_of(errors.slots, DEFAULT_PRIORS) if parameter.kind == "screen"]
    whole = replace(errors, parameters=(*errors.parameters, *screen), sessions=errors.sessions[:1])
    taken = independent_columns(full_pose_jacobian(chain, whole), range(len(whole.parameters)))
    return tuple(whole.names[column] for column in taken if column >= len(errors.parameters))


def _later_sessions(slots: tuple[Slot, ...], sessions: Sequence[str], priors: Mapping[Kind, PriorScale]) -> list[Parameter]:
    placed = [parameter for parameter in parameters_of(slots, priors) if parameter.kind in SESSION_KINDS]
    return [
        replace(parameter, name="{}:{}.{}".format(*_split_in(parameter.name, session))) for session in sessions[1:] for parameter in placed
    ]


def _places(rig: Rig, priors: Mapping[Kind, PriorScale]) -> list[Parameter]:
    return [
        Parameter(f"{place.name}.{name}", unit, "place", 0.0, priors["place"].sigma(unit))
        for place in rig.instruments.places
        for name, unit in zip(place.names, place.units, strict=True)
    ]


def _camera(rig: Rig) -> list[Parameter]:
    """The errors of the screen's place in front of the camera, where spots were read as pixels."""
    sigmas = rig.instruments.camera_sigma
    return [
        Parameter(f"camera.{name}", unit, "camera", 0.0, sigma)
        for name, unit, sigma in zip(SIX, ("m",) * 3 + ("rad",) * 3, sigmas or (), strict=bool(sigmas))
    ]


def lens_parameters(rig: Rig) -> list[Parameter]:
    """What the lenses of cameras are off by, along the axes of their calibrations' covariances, in standard deviations of these."""
    numbers = [(name, number) for name, count in rig.instruments.lenses for number in range(1, count + 1)]
    return [Parameter(f"{name}.lens_{number}", "", "lens", 0.0, 1.0) for name, number in numbers]


def _split_in(name: str, session: str) -> tuple[str, str, str]:
    label, last = name.rsplit(".", 1)
    return label, session, last


def _stated(parameters: list[Parameter], options: ModelOptions) -> tuple[list[Parameter], set[str]]:
    """The parameters with what a rig.yaml says of them, and the names of those that rig.yaml, `--fix` and `--only` hold."""
    named, fixed = {parameter.name: parameter for parameter in parameters}, set()
    for pattern, said in options.single.items():
        for name in matching(parameters, pattern):
            old = named[name]
            mean, sigma = (old.mean if said.mean is None else said.mean), (old.sigma if said.sigma is None else said.sigma)
            named[name] = replace(old, mean=mean, sigma=sigma)
            fixed |= {name} if said.fixed else set()
    for pattern in options.fix:
        fixed |= matching(parameters, pattern)
    if options.only:
        robots = {parameter.name for parameter in parameters if parameter.kind not in _NOT_THE_ROBOTS}
        fixed |= robots - set().union(*(matching(parameters, pattern) for pattern in options.only))
    return list(named.values()), fixed


def _known(parameters: Sequence[Parameter], options: ModelOptions) -> frozenset[str]:
    """Names that rig.yaml and `--fix` hold, since they are known; what `--only` leaves aside may be wrong all the same."""
    patterns = [*options.fix, *(pattern for pattern, said in options.single.items() if said.fixed)]
    return frozenset().union(*(matching(parameters, pattern) for pattern in patterns))


def _require_own_names(slots: Sequence[Slot]) -> None:
    """Refuse two placements whose parameters would have the same names, so that one would stand for both.

    Raises:
        RigError: naming the target or the reference, and the way out.
    """
    taken: dict[str, Slot] = {}
    for slot in sorted((slot for slot in slots if slot.names), key=lambda slot: slot.frame is not None):
        other = taken.setdefault(slot.label, slot)
        if other is not slot:
            way_out = f"give the target a label, '{slot.label}:NAME'" if slot.kind == "target" else "choose another link with --reference"
            raise RigError(
                f"'{slot.label}' is the name of a {other.kind} and of a {slot.kind}, whose parameters could not be told apart; {way_out}"
            )


def _as_known(slot: Slot, earlier: EarlierJoints | None) -> Slot:
    """The slot of a joint that an earlier calibration decided, in its parameters; any other as it is."""
    own = earlier.of(slot.label) if earlier is not None and slot.kind == "joint" else {}
    return replace(slot, names=tuple(own), screws=np.column_stack(list(own.values())), spare=(), last=()) if own else slot


def _with_sigma(parameter: Parameter, earlier: EarlierJoints) -> Parameter:
    return replace(parameter, sigma=earlier.sigma_of(parameter.name)) if parameter.name in earlier.names else parameter


def _check_joints(chain: Chain, per_joint: Mapping[str, str]) -> None:
    known = [step.joint.name for step in chain.moving]
    for name in per_joint:
        if name not in known:
            raise RigError(f"error_models: no joint '{name}' that is calibrated; there are: {', '.join(known)}")


def of_these_poses(chain: Chain, rig: Rig, options: ModelOptions, sessions: Sequence[str]) -> ModelOptions:
    """Options without what they say of parameters that some poses do not have: of other sessions, and of other instruments."""
    every = build_error_model(chain, rig, replace(options, fix=(), only=(), single={}), sessions)
    names = [*every.names, *(f"{slot.label}.{name}" for slot in every.slots for name in slot.names)]

    def known(patterns: Iterable[str]) -> tuple[str, ...]:
        return tuple(pattern for pattern in patterns if fnmatch.filter(names, pattern))

    single = {pattern: options.single[pattern] for pattern in known(options.single)}
    return replace(options, fix=known(options.fix), only=known(options.only), single=single)


def model_warnings(robot: Robot, options: ModelOptions) -> tuple[str, ...]:
    """What the chosen error model cannot follow on this robot."""
    of_lasers = bool(robot.rig.lasers)  # without them there is neither a module nor a screen
    if options.error_model == "dh":
        return (*(_mount_warning(robot) if of_lasers else ()), *_parallel_warning(robot))
    return (*(_screen_warning(robot) if of_lasers else ()), *_parting_warning(robot))


def _screen_warning(robot: Robot) -> tuple[str, ...]:
    """No origin stands for the placement of a screen on the very link that a joint moves."""
    first = robot.chain.steps[0]
    if not first.joint.moves or first.forward:
        return ()
    return (
        f"the screen '{robot.rig.base}' is the very link that '{first.joint.name}' moves, so its placement cannot be estimated; "
        "hang it on a fixed joint",
    )


def _parting_warning(robot: Robot) -> tuple[str, ...]:
    """What lies between two branches is seen from neither end."""
    branches = robot.chain.branches()
    if len(branches) < 2:
        return ()
    parting, (back, forth) = branches[0][0].parent, (branch[0].name for branch in branches)
    return (
        f"'{parting}', from which both branches leave, is seen from neither end: of '{back}' and '{forth}' the measurements tell the sum "
        f"alone, and their priors share it out; measure one end against '{parting}', too, where it matters how each stands on it",
    )


def _mount_warning(robot: Robot) -> tuple[str, ...]:
    """The paper's mount has no translation along y; on the last axis that one is visible, and another not."""
    last = robot.chain.moving[-1]
    off = float(np.linalg.norm(cross(np.array(last.joint.axis), robot.chain.T_last_module.translation)))
    if last.joint.prismatic or not last.forward or off >= _NEAR_AXIS:
        return ()
    return (
        f"the module '{robot.rig.tip}' lies {off / MM:.1f} mm from the axis of '{last.joint.name}': the five mount parameters of "
        "the dh model leave out trans_y, which such a mount shows; use --error-model auto or hayati",
    )


def _parallel_warning(robot: Robot) -> tuple[str, ...]:
    """Denavit and Hartenberg's parameters cannot tilt an axis that is parallel to the one before it in both directions."""
    joints = [row.name for row in dh_table(robot.chain) if row.parallel and row.name in robot.tree.joints]
    if not joints:
        return ()
    return (
        f"the axis of {', '.join(joints)} is nearly parallel to the one before it: the dh model cannot tilt it both ways; "
        "use --error-model auto or hayati unless the paper's parameters are the point",
    )
