"""The set of parameters that is estimated: options narrowed by the gauge rule, with a word where the model cannot follow the robot.

What no measurement of the module's whole pose could tell apart is not put into the state. The rule is structural: it looks at the
rank of the full-pose Jacobian at random configurations, before any data and whatever the sensor.
"""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from urdfcal.base.errors import RigError, UsageError
from urdfcal.base.geometry import MM, Matrix, cross
from urdfcal.model.dh import dh_table
from urdfcal.model.error_model import ErrorModel, parameters_of
from urdfcal.model.jacobian import ArmKinematics, arm_motion
from urdfcal.model.options import ModelOptions
from urdfcal.model.parameters import DEFAULT_PRIORS, SESSION_KINDS, Kind, Parameter, PriorScale, matching
from urdfcal.model.slots import BEAMS, BEAMS4, Slot, beam_slots, require_screen_slot, slots_of
from urdfcal.robot.chain import Chain
from urdfcal.robot.rig import SIX, Rig
from urdfcal.robot.robot import Robot

CONFIGURATIONS = 50
_DEPENDENT = 1e-7  # share of a column that must lie outside the span of those before it, to raise the rank
_CARRIERS: dict[Kind, str] = {
    "screen": "the screen",
    "reference": "the measuring frame",
    "mount": "the mount",
    "target": "the target's offset",
}
_PLACES = "places"
_NOT_THE_ROBOTS = ("reference", "target", "place", "camera")  # found from nothing, whatever is asked of the robot
_WITHIN_JOINT = ("d_theta", "d_q", "d_alpha", "d_beta", "d_a", "d_d")

_NEAR_AXIS = 10 * MM


def build_error_model(chain: Chain, rig: Rig, options: ModelOptions | None = None, sessions: Sequence[str] = ("",)) -> ErrorModel:
    """Choose the parameters of a robot: error model, gauge, additions, what is fixed, priors.

    Args:
        chain: The way from screen to lasers.
        rig: Screen, module, lasers.
        options: What is to be calibrated.
        sessions: Labels of the sessions; each but the first gets a screen placement of its own.

    Raises:
        UsageError: an option means nothing for this robot.
        RigError: the screen's placement is asked for, and nothing can carry it.
    """
    options = options or ModelOptions()
    _check_joints(chain, options.per_joint)
    priors = DEFAULT_PRIORS | dict(options.priors)
    slots = slots_of(chain, rig, options.error_model, options.per_joint)
    if options.reference_known:
        slots = tuple(slot for slot in slots if slot.kind != "reference")
    if "screen" in options.estimate or (len(sessions) > 1 and rig.lasers):
        require_screen_slot(chain, rig)
    if "beams" in options.estimate or "beams4" in options.estimate:
        slots += beam_slots(chain, BEAMS4 if "beams4" in options.estimate else BEAMS)
    _require_own_names(slots)
    screen_wanted = chain.screen_joint is not None or "screen" in options.estimate
    offered = [parameter for parameter in parameters_of(slots, priors) if parameter.kind != "screen" or screen_wanted]
    stated, fixed = _stated([*offered, *_later_sessions(slots, sessions, priors), *_places(rig, priors), *_camera(rig)], options)
    free = [parameter for parameter in stated if parameter.name not in fixed]
    if not free:
        raise UsageError("nothing is left to estimate: every parameter is fixed")
    chosen, carried = _gauge(chain, rig, slots, free, options)
    held = {parameter.name: parameter.mean for parameter in stated if parameter.name in fixed and parameter.mean}
    return ErrorModel(chain, slots, tuple(chosen), held, carried, tuple(sessions))


def full_pose_jacobian(chain: Chain, errors: ErrorModel, rng: np.random.Generator | None = None) -> Matrix:
    """Twists of the module against the screen per parameter at random configurations, (6 CONFIGURATIONS, p).

    Joints turn all the way round, whatever their limits: the rule is about structure, not about reach.
    """
    rng = rng or np.random.default_rng(0)
    turn = rng.uniform(-np.pi, np.pi, (CONFIGURATIONS, len(chain.inputs)))
    q = np.where([joint.prismatic for joint in chain.inputs], turn / (2 * np.pi), turn)
    motion = arm_motion(ArmKinematics(chain), errors, q, np.zeros(len(errors.names)), errors.sessions[0])
    return motion.jac1.reshape(6 * CONFIGURATIONS, -1)


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


def independent_columns(jacobian: Matrix, order: Iterable[int]) -> list[int]:
    """Take columns in order, each only if it raises the rank of those taken before it."""
    basis = np.empty((len(jacobian), 0))
    taken = []
    for column in order:
        vector = jacobian[:, column]
        length = np.linalg.norm(vector)
        for _ in range(2):  # twice is enough for Gram-Schmidt
            vector = vector - basis @ (basis.T @ vector)
        if length > 0 and np.linalg.norm(vector) > _DEPENDENT * length:
            basis = np.column_stack([basis, vector / np.linalg.norm(vector)])
            taken.append(column)
    return taken


def _gauge(
    chain: Chain, rig: Rig, slots: tuple[Slot, ...], free: list[Parameter], options: ModelOptions
) -> tuple[list[Parameter], dict[str, str]]:
    """The free parameters that enter the state, and what carries the others; what is held at its value carries nothing.

    Beams, later sessions, places and targets beside the module move no whole pose of the module, so they always enter.
    """
    automatic = options.error_model == "auto"
    if not automatic and (chain.screen_joint is not None or not rig.lasers):
        return free, {}
    own = {f"{slot.label}.{name}" for slot in slots if _moves_module(rig, slot) for name in slot.names}
    offered = [parameter for parameter in free if parameter.name in own]
    errors = ErrorModel(chain, slots, tuple(offered))
    spare = {f"{slot.label}.{name}" for slot in slots for name in slot.spare}
    order = sorted(
        range(len(offered)),
        key=lambda column: (offered[column].name in spare, *_rank_order(chain, offered[column], screen_first=automatic)),
    )
    jacobian = full_pose_jacobian(chain, errors)
    if automatic and _unplaced(rig, free):  # places that were found from nothing stand for the placement of everything, as a frame does
        anywhere = np.tile(np.eye(6), (CONFIGURATIONS, 1))
        offered = [*offered, *(Parameter(f"{_PLACES}.{name}", "m", "place", 0.0, 1.0) for name in SIX)]
        order, jacobian = [*range(len(offered) - 6, len(offered)), *order], np.hstack([jacobian, anywhere])
    taken = set(independent_columns(jacobian, order))
    if not automatic:  # a model named explicitly keeps what is its own; only a screen asked for on top must add something
        taken |= {column for column, parameter in enumerate(offered) if parameter.kind != "screen"}
    left_out = [column for column, parameter in enumerate(offered) if column not in taken and parameter.name not in spare]
    carried = _carriers(rig, offered, jacobian, sorted(taken), left_out) if automatic else {}
    entered = {offered[column].name for column in taken} | ({parameter.name for parameter in free} - set(errors.names))
    return [parameter for parameter in free if parameter.name in entered], carried


def _unplaced(rig: Rig, free: Sequence[Parameter]) -> bool:
    """Whether all that targets meet are places of which nothing is known, so that the robot may stand anywhere among them."""
    numbers = sum(len(place.names) for place in rig.instruments.places)
    return not rig.lasers and not rig.instruments.placed and 0 < numbers == sum(parameter.kind == "place" for parameter in free)


def _moves_module(rig: Rig, slot: Slot) -> bool:
    """Whether a slot lies between the frame that is measured from and the one that is measured: the module, or the farthest target."""
    if slot.frame is None:
        return slot.kind != "beam"
    farthest = next((target.placed_by for target in rig.instruments.targets if target.link == rig.tip), "")
    return not rig.lasers and (slot.kind == "reference" or slot.label == farthest)


def _rank_order(chain: Chain, parameter: Parameter, screen_first: bool) -> tuple[int, int, int]:
    """Screen, mount, then the joints from the tool to the base; within a joint theta, alpha, beta, a, d."""
    label, name = parameter.name.rsplit(".", 1)
    if parameter.kind != "joint":
        group = {"screen": 0, "reference": 0, "mount": 1, "target": 1}[parameter.kind]
        return group if group or screen_first else 3, 0, 0
    place = [step.joint.name for step in chain.moving].index(label)
    return 2, -place, _WITHIN_JOINT.index(name) if name in _WITHIN_JOINT else 0


def _carriers(rig: Rig, offered: list[Parameter], jacobian: Matrix, taken: list[int], left_out: list[int]) -> dict[str, str]:
    """What carries each parameter that was left out: the screen, the mount, or other joints.

    A left-out column is a combination of those that were taken; the groups with a share in it are named.
    """
    if not left_out:
        return {}
    shares = np.linalg.lstsq(jacobian[:, taken], jacobian[:, left_out], rcond=None)[0]
    carried = {}
    for column, share in zip(left_out, shares.T, strict=True):
        kinds = {offered[taken[index]].kind for index in np.flatnonzero(np.abs(share) > 1e-6)}
        words = [_CARRIERS[kind] for kind in _CARRIERS if kind in kinds]
        words += list(dict.fromkeys(place.words for place in rig.instruments.places)) if "place" in kinds else []
        carried[offered[column].name] = " and ".join(words) or "other joints"
    return carried


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


def model_warnings(robot: Robot, errors: ErrorModel, options: ModelOptions) -> tuple[str, ...]:
    """What the chosen error model cannot follow on this robot."""
    if options.error_model == "dh":
        return (*(_mount_warning(robot) if robot.rig.lasers else ()), *_parallel_warning(robot))
    if not robot.rig.lasers:  # nor a screen
        return ()
    first = robot.chain.steps[0]
    if first.joint.moves and not first.forward:
        return (
            f"the screen '{robot.rig.base}' is the very link that '{first.joint.name}' moves, so its placement cannot be estimated; "
            "hang it on a fixed joint",
        )
    missing = missing_screen_parameters(robot.chain, robot.rig, errors) if options.error_model == "auto" else ()
    if not missing:
        return ()
    return (
        f"the screen '{robot.rig.base}' has no fixed joint of its own, so its placement is not estimated; "
        f"--estimate screen adds {', '.join(missing)}, which no other parameter can stand for",
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
