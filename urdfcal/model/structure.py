"""Which parameters the whole pose of one end against the other can tell apart, and which of the others enter the state beside them.

The rule is structural: it looks at the rank of the full-pose Jacobian at random configurations, before any data and whatever the
sensor. What adds nothing to the rank is carried by what does; but a link between two branches, which neither end sees, shares its
correction out among both, and nobody carries what would turn a shift of millimetres into degrees.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

import numpy as np

from urdfcal.base.geometry import Matrix
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.jacobian import arm_motion
from urdfcal.model.parameters import DEFAULT_PRIORS, FLAT, Kind, Parameter
from urdfcal.model.slots import Slot
from urdfcal.robot.chain import Chain
from urdfcal.robot.rig import SIX, Rig

CONFIGURATIONS = 50
_DEPENDENT = 1e-7  # share of a column that must lie outside the span of those before it, to raise the rank
_COSTLY = 5.0  # standard deviations of others that one of a parameter's may cost them, before it enters the state beside them
_MEETING = 2  # joints of each branch next to the link where they part that keep all six numbers
_CARRIERS: dict[Kind, str] = {
    "screen": "the screen",
    "reference": "the measuring frame",
    "mount": "the mount",
    "target": "the target's offset",
}
_PLACES = "places"
_WITHIN_JOINT = ("d_theta", "d_q", "d_alpha", "d_beta", "d_a", "d_d")


def _several_ends(chain: Chain) -> bool:
    """Whether there is more than one way from what sees to what is seen."""
    return bool(chain.shoots) or len(chain.instrument_frames) > 1


def full_pose_jacobian(
    chain: Chain, errors: ErrorModel, rng: np.random.Generator | None = None, pairs: Sequence[tuple[int, int]] = ()
) -> Matrix:
    """Twists of the module against the screen per parameter at random configurations, (6 CONFIGURATIONS, p).

    Where further branches leave the way, twists of the end of each against what it is seen from, one below the other.

    Joints turn all the way round, whatever their limits: the rule is about structure, not about reach.
    """
    rng = rng or np.random.default_rng(0)
    turn = rng.uniform(-np.pi, np.pi, (CONFIGURATIONS, len(chain.inputs)))
    q = np.where([joint.prismatic for joint in chain.inputs], turn / (2 * np.pi), turn)
    motion = arm_motion(errors, q, np.zeros(len(errors.names)), errors.sessions[0])
    if not _several_ends(chain):
        return motion.jac1.reshape(6 * CONFIGURATIONS, -1)
    moves = errors.moves(errors.sessions[0]).astype(float)
    targets = [index for index, frame in enumerate(chain.frames) if frame.role == "target"]
    ends = [moves[targets[target]] - moves[instrument] for target, instrument in pairs or [(own, 0) for own in range(len(targets))]]
    ends += [moves[laser] for laser in chain.laser_frames[:1]]
    jac1 = motion.jac1.reshape(6 * CONFIGURATIONS, -1)
    return np.concatenate([jac1 * end for end in np.unique(ends, axis=0)])


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


def enter(
    chain: Chain, rig: Rig, slots: tuple[Slot, ...], free: list[Parameter], decided: Collection[str], automatic: bool
) -> tuple[list[Parameter], dict[str, str]]:
    """The free parameters that enter the state, and what carries the others; what is held at its value carries nothing.

    Beams, later sessions, places and targets beside the module move no whole pose of the module, so they always enter.

    Args:
        chain: The way from screen to module, or from reference to target.
        rig: What lies at its ends.
        slots: Everything that may be wrong.
        free: The parameters that are not held.
        decided: Names of those that an earlier calibration decided: they are in the state, and carry nothing either.
        automatic: Whether the gauge rule decides; a model named explicitly keeps its own, and only a screen on top must add something.
    """
    if not automatic and (chain.screen_joint is not None or not rig.lasers):
        return free, {}
    own = {f"{slot.label}.{name}" for slot in slots if _moves_module(chain, rig, slot) for name in slot.names}
    offered = [parameter for parameter in free if parameter.name in own and parameter.name not in decided]
    errors = ErrorModel(chain, slots, tuple(offered))
    resort = {f"{slot.label}.{name}": level for slot in slots for level, names in ((1, slot.spare), (2, slot.last)) for name in names}
    order = sorted(
        range(len(offered)),
        key=lambda column: (resort.get(offered[column].name, 0), *_rank_order(chain, offered[column], screen_first=automatic)),
    )
    jacobian = full_pose_jacobian(chain, errors, pairs=rig.instruments.pairs)
    if automatic and _unplaced(rig, free):  # places that were found from nothing stand for the placement of everything, as a frame does
        anywhere = np.tile(np.eye(6), (len(jacobian) // 6, 1))
        offered = [*offered, *(Parameter(f"{_PLACES}.{name}", "m", "place", 0.0, 1.0) for name in SIX)]
        order, jacobian = [*range(len(offered) - 6, len(offered)), *order], np.hstack([jacobian, anywhere])
    jacobian = np.asarray(np.linalg.qr(jacobian, mode="r"))  # the same columns, in fewer rows
    taken = set(independent_columns(jacobian, order))
    carried = {}
    if automatic:
        taken |= _shared_out(chain, offered, jacobian, sorted(taken))
        left_out = [column for column, parameter in enumerate(offered) if column not in taken and parameter.name not in resort]
        carried = _carriers(rig, offered, jacobian, sorted(taken), left_out)
    else:
        taken |= {column for column, parameter in enumerate(offered) if parameter.kind != "screen"}
    entered = {offered[column].name for column in taken} | ({parameter.name for parameter in free} - set(errors.names))
    return [parameter for parameter in free if parameter.name in entered], carried


def _shared_out(chain: Chain, offered: Sequence[Parameter], jacobian: Matrix, taken: list[int]) -> set[int]:
    """Parameters that enter beside those that could carry them, since the correction would move links that nothing is wrong with.

    A link from which two branches leave is seen from neither end: the joints beside it keep all six numbers, and their priors share
    out what is seen of them together. Anywhere else a parameter enters whose error of one standard deviation costs those that carry
    it many: an axis that is shifted by 3 mm beside a parallel one 40 mm off would otherwise be two zeros, 4 degrees each.
    """
    meeting = chain.meetings(_MEETING)
    rest = [column for column in range(len(offered)) if column not in taken]
    met = {column for column in rest if offered[column].kind == "joint" and offered[column].name.rpartition(".")[0] in meeting}
    sigma = np.array([_usual_size(parameter) for parameter in offered])
    weighted = jacobian * sigma
    costs = np.linalg.norm(np.linalg.lstsq(weighted[:, taken], weighted[:, rest], rcond=None)[0], axis=0) if rest else np.empty(0)
    return met | {column for column, cost in zip(rest, costs.tolist(), strict=True) if cost > _COSTLY}


def _usual_size(parameter: Parameter) -> float:
    """How large a parameter may be, [m] or [rad]: as its prior has it, or as it usually is where nothing is known of it."""
    return parameter.sigma if parameter.sigma < FLAT else DEFAULT_PRIORS[parameter.kind].sigma(parameter.unit)


def _unplaced(rig: Rig, free: Sequence[Parameter]) -> bool:
    """Whether all that targets meet are places of which nothing is known, so that the robot may stand anywhere among them."""
    numbers = sum(len(place.names) for place in rig.instruments.places)
    return not rig.lasers and not rig.instruments.placed and 0 < numbers == sum(parameter.kind == "place" for parameter in free)


def _moves_module(chain: Chain, rig: Rig, slot: Slot) -> bool:
    """Whether a slot lies between the frame that is measured from and the one that is measured: the module, or the farthest target.

    Where further branches leave the way, every target is one that is measured.
    """
    if slot.frame is None or _several_ends(chain):
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
