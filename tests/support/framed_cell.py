"""A small cell in which much measures and is measured: fixed and carried instruments, a tool, a board, points, with links of many sorts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from tests.support.small_robot import joint, robot_of, robot_text
from urdfcal.base.geometry import SE3, Vector
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.found_frames import found_frames
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.model.slots import Slot
from urdfcal.robot.frames import FoundFrame
from urdfcal.robot.rig import SIX, Instrument, Instruments, Target
from urdfcal.robot.robot import Robot

TEXT = robot_text(
    joint("stand", "base", "mount", '<origin xyz="0.5 0.2 1" rpy="0 1.2 0.1"/>', kind="fixed"),
    joint("turn", "base", "a", '<origin xyz="0 0 0.3"/><axis xyz="0 0 1"/>'),
    joint("lift", "a", "b", '<origin xyz="0.2 0.1 0" rpy="0.3 0 0"/><axis xyz="0 1 0"/>'),
    joint("slide", "b", "c", '<origin xyz="0.3 0 0.1" rpy="0 0.2 0"/><axis xyz="1 0 0"/>', kind="prismatic"),
    joint("flange", "c", "tool", '<origin xyz="0 0.1 0.1" rpy="0 0 0.5"/>', kind="fixed"),
    joint("grip", "tool", "finger", '<origin xyz="0 0 0.1"/>', kind="fixed"),
    joint("glued", "c", "pad", '<origin rpy="0 1.5707963267948966 0"/>', kind="fixed"),
    joint("neck", "a", "head", '<origin xyz="0 0 0.6" rpy="0 0.1 0"/><axis xyz="0 0 1"/>'),
    joint("lens", "head", "eye", kind="fixed"),
    joint("floor", "base", "table", '<origin xyz="0.7 0 0"/>', kind="fixed"),
    links="base mount a b c tool finger pad head eye table",
)
TARGETS = (
    Target("tool", "tool", SIX),
    Target("pad:1", "pad"),
    Target("pad:2", "pad", SIX),
    Target("head", "head", SIX),
    Target("table:0", "table", SIX, "table"),
    Target("table:7", "table", SIX, "table", (0.1, 0.05, 0.0)),
)
OTHERS = (Instrument("eye", "eye", True), Instrument("leica", "base", True))


@dataclass(frozen=True)
class Cell:
    """A robot with instruments and targets, and a state of all its errors.

    Attributes:
        robot: The nominal robot.
        errors: Six errors a joint, with frames that stand anywhere.
        x: Their state, some millimetres and milliradians.
        P: Its covariance, (p, p).
    """

    robot: Robot
    errors: ErrorModel
    x: Vector
    P: np.ndarray

    def frames(self, determined: Sequence[str] | None = None) -> tuple[FoundFrame, ...]:
        """Where that state has them."""
        decided = self.errors.names if determined is None else determined
        return found_frames(self.robot.tree, self.robot.rig, self.errors, self.x, self.P, decided)

    def frame(self, child: str) -> FoundFrame:
        """The one that is called so."""
        return next(frame for frame in self.frames() if frame.child == child)


def somewhere(rng: np.random.Generator, far: float = 1.0) -> SE3:
    """A placement at random."""
    return pin.SE3(pin.exp3(rng.normal(0, 1.0, 3)), rng.normal(0, far, 3))


def cell(rng: np.random.Generator, sessions: tuple[str, ...] = ("",), text: str = TEXT, known: str = "") -> Cell:
    """The cell with everything off at random; `known` says which of `reference` and `target` are not found."""
    pairs = tuple((target, instrument) for target in range(len(TARGETS)) for instrument in range(3))
    robot = robot_of(text).seen_by(Instruments(TARGETS, "mount", True, others=OTHERS, name="mount", pairs=pairs), ())
    options = ModelOptions(error_model="placement", reference_known=known == "reference", target_known=known == "target")
    errors = build_error_model(robot.chain, robot.rig, options, sessions)
    slots = [slot if slot.frame is None else replace(slot, found=_found(slot, sessions, rng)) for slot in errors.slots]
    half = rng.normal(0, 1e-3, (len(errors.names), 2 * len(errors.names)))
    return Cell(robot, replace(errors, slots=tuple(slots)), rng.normal(0, 0.01, len(errors.names)), half @ half.T / len(half))


def _found(slot: Slot, sessions: Sequence[str], rng: np.random.Generator) -> dict[str, SE3]:
    """Instruments stand elsewhere in each session, targets where they are, points in their link's axes."""
    if slot.kind == "reference":
        return {session: somewhere(rng) for session in sessions}
    there = somewhere(rng)
    return dict.fromkeys(sessions, there if SIX[3] in slot.names else pin.SE3(np.eye(3), there.translation))
