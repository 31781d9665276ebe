"""The frames that a state of an error model holds beside the joints: where instruments and targets are, and how surely.

A frame's placement and the joints' corrections are known together: the one is right with the others, and not on the nominal robot.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Sequence

import numpy as np
import pinocchio as pin

from urdfcal.base.geometry import SE3, Matrix, Vector, product
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.parameters import SESSION_KINDS
from urdfcal.model.slots import Slot
from urdfcal.robot.chain import Chain
from urdfcal.robot.corrections import OriginCorrection
from urdfcal.robot.frames import FoundFrame, FrameSite, with_place
from urdfcal.robot.rig import SIX, Rig
from urdfcal.robot.urdf_tree import UrdfTree


def frame_sites(tree: UrdfTree, chain: Chain, rig: Rig, slots: Sequence[Slot], sessions: Sequence[str]) -> list[tuple[int, FrameSite]]:
    """Number of the slot, and place, of every frame that is found, one a session where an instrument was moved.

    Args:
        tree: All links and joints.
        chain: The way.
        rig: What measures.
        slots: Placements that may be wrong.
        sessions: Labels of the sessions.
    """
    bare = [(number, site) for number, slot in enumerate(slots) if slot.frame is not None for site in _bare(rig, slot, sessions)]
    on, found = _known_on(chain, rig, [site for _, site in bare]), list[tuple[int, FrameSite]]()
    for number, site in bare:
        found.append((number, with_place(site, tree, on, [other.child for _, other in found])))
    return found


def _bare(rig: Rig, slot: Slot, sessions: Sequence[str]) -> Iterator[FrameSite]:
    """What a slot's frames are of."""
    seen, index = rig.instruments, slot.frame or 0
    if slot.kind == "target":
        yield FrameSite(slot.label, slot.label, "target", "", seen.targets[index - len(seen.every)].link, slot.label)
        return
    own = seen.every[index]
    name = f"frame of {slot.label}" if seen.others else "measuring frame"
    child = own.name if seen.others or own.name != own.link else "measuring_frame"
    for session in sessions:
        yield FrameSite(
            own.name,
            f"{name} of session {session}" if session else name,
            "instrument",
            session,
            own.link,
            f"{child}_{session}" if session != sessions[0] else child,
        )


def _known_on(chain: Chain, rig: Rig, sites: Sequence[FrameSite]) -> Counter[str]:
    """How many frames, known ones included, are on every link that the fit knows; 0 on those that are only moved by a joint of the way."""
    seen, found = rig.instruments, {(site.link, site.name) for site in sites}
    labels = {site.label for site in sites}
    held = [(own.link, own.name) for own in seen.every if own.link and own.name not in labels]
    held += [(target.link, target.placed_by) for target in seen.targets if target.placed_by not in labels]
    held += [(link, link) for link in ((rig.base, rig.tip, *rig.lasers) if rig.lasers else ())]
    on = Counter(link for link, _ in {*found, *held})
    on.update(dict.fromkeys((step.joint.child for step in chain.moving), 0))
    return on


def found_frames(tree: UrdfTree, rig: Rig, errors: ErrorModel, x: Vector, P: Matrix, determined: Collection[str]) -> tuple[FoundFrame, ...]:
    """Where a fit found the frames beside the joints.

    Args:
        tree: All links and joints.
        rig: What measures.
        errors: The error model.
        x: The state, (p,), [m] and [rad].
        P: Its covariance, (p, p).
        determined: Names of the parameters that the data decided.
    """
    origins = {**{name: joint.origin for name, joint in tree.joints.items()}, **errors.corrected_origins(x)}
    found = []
    for number, site in frame_sites(tree, errors.chain, rig, errors.slots, errors.sessions):
        slot = errors.slots[number]
        on_link, J = _of_what_is_known(slot, *errors.frame_placement(number, x, _session(errors, slot, site)))
        covariance = J @ P @ J.T
        unknown = [name not in slot.names for name in SIX]
        covariance[unknown, :], covariance[:, unknown] = np.nan, np.nan
        parent = tree.moving_link(site.link)
        between = [joint.name for joint in tree.path_from_root(site.link)[len(tree.path_from_root(parent)) :]]
        joint = tree.joints.get(site.joint)
        found.append(
            FoundFrame(
                **vars(site),
                parent=parent,
                placement=product([*(origins[name] for name in between), on_link]),
                on_link=on_link,
                covariance=covariance,
                found=slot.names,
                undetermined=_undetermined(errors, slot, site, determined),
                origin=None if joint is None else OriginCorrection(joint.origin, origins[joint.name] * on_link, False),
            )
        )
    return tuple(found)


def _of_what_is_known(slot: Slot, on_link: SE3, J: Matrix) -> tuple[SE3, Matrix]:
    """A point keeps its link's axes, and axes alone its origin."""
    if SIX[3] not in slot.names:
        J = np.vstack([on_link.rotation @ J[:3], J[3:]])
        on_link = pin.SE3(np.eye(3), on_link.translation)
    return (on_link if SIX[0] in slot.names else pin.SE3(on_link.rotation, np.zeros(3))), J


def _session(errors: ErrorModel, slot: Slot, site: FrameSite) -> str:
    """The session in which a slot is at a frame; targets are alike in all."""
    return site.session if slot.kind in SESSION_KINDS else errors.sessions[0]


def _undetermined(errors: ErrorModel, slot: Slot, site: FrameSite, determined: Collection[str]) -> tuple[str, ...]:
    """Which of a frame's six the data did not decide, those included that something else carries."""
    session = _session(errors, slot, site)
    label = slot.label if session == errors.sessions[0] else f"{slot.label}:{session}"
    left = {*errors.names, *errors.carried} - {*determined}
    return tuple(name for name in slot.names if f"{label}.{name}" in left)
