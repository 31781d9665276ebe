"""What becomes of the frames that were found beside the joints, in words: what a URDF with them would have, or has, elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from urdfcal.base.geometry import DEG, MM
from urdfcal.base.terminal import many, rounded
from urdfcal.calibration.analysis.clusters import listed
from urdfcal.robot.frames import FoundFrame, joint_of
from urdfcal.robot.placed_frames import FramesWish

if TYPE_CHECKING:
    from urdfcal.calibration.result import FitResult

_FAR, _FAR_TURNED = 30 * MM, 10 * DEG  # from a link as its URDF has it, beyond which a frame is hardly that link's own
_NAMED = 3  # links that move along with another, by name


def frame_lines(calibration: FitResult, wish: FramesWish, record: Path | None) -> list[str]:
    """A line a frame: what was done with it, or which option would do it; `record` is the file that has all of them."""
    frames, chosen = calibration.frames, wish.chosen(calibration.frames, calibration.robot.tree)
    if not frames:
        return []
    done = [written(frame) for frame in chosen.written] + [added(frame) for frame in chosen.added]
    names = {(frame.label, frame.session) for frame in (*chosen.written, *chosen.added)}
    left = [offered(frame) for frame in frames if (frame.label, frame.session) not in names]
    kept = "" if record is None else f" ({record} has their poses, covariances and static transforms)"
    lines = ["", "The calibrated robot has these frames now:", *(f"  {line}" for line in done)] if done else []
    without = "It is without these" if done else "The calibrated robot is without these frames"
    return [*lines, *([] if done else [""]), *([f"{without}{kept}:", *(f"  {line}" for line in left)] if left else [])]


def offered(frame: FoundFrame) -> str:
    """`camera_optical_frame would move 3.2 mm, 0.4 deg: --write-frames`."""
    if frame.why_not:
        return f"{frame.name}: --add-frames adds it to '{frame.link}' as the link '{frame.child}' ('{frame.link}' {frame.why_not})"
    if _far(frame):  # most likely something that sits on the link, and not the link itself
        return (
            f"{frame.name}, {moved_in_words(frame)} off '{frame.link}': --add-frames adds it as the link '{frame.child}'; "
            f"--write-frames would move '{frame.link}' there{_along(frame)}"
        )
    return f"{frame.link} would move {moved_in_words(frame)} (± {_sigmas(frame)}){_along(frame)}: --write-frames"


def written(frame: FoundFrame) -> str:
    """What was done to a frame's link."""
    return f"{frame.link} moved {moved_in_words(frame)}{_along(frame)}, by its joint '{frame.joint}'"


def added(frame: FoundFrame) -> str:
    """What was done for a frame that has no link."""
    return f"{frame.child} is a new link on '{frame.link}', by the joint '{joint_of(frame.child)}'"


def moved_in_words(frame: FoundFrame) -> str:
    """`3.2 mm, 0.4 deg`, and what of that is not known."""
    length, angle = frame.moved
    if not frame.turned:
        return f"{_size(length / MM)} mm (of a point: its axes stay)"
    if not frame.placed:
        return f"{_size(angle / DEG)} deg (of axes alone: its origin stays)"
    return f"{_size(length / MM)} mm, {_size(angle / DEG)} deg"


def _sigmas(frame: FoundFrame) -> str:
    """`0.11 mm, 0.01 deg`: what single numbers of it are unsure by."""
    halves = ((frame.placed, slice(3), MM, "mm"), (frame.turned, slice(3, 6), DEG, "deg"))
    return ", ".join(f"{rounded(frame.sigma(half) / size, 2)} {unit}" for known, half, size, unit in halves if known)


def undetermined(frames: Sequence[FoundFrame]) -> list[str]:
    """A warning of every frame that goes into a URDF without that the data decided all of it."""
    return [
        f"{frame.child if frame.why_not else frame.link}: {listed(frame.undetermined)} of this frame "
        f"{'is' if len(frame.undetermined) == 1 else 'are'} not determined by the data; the URDF has what its prior left"
        for frame in frames
        if frame.undetermined
    ]


def _far(frame: FoundFrame) -> bool:
    length, angle = frame.moved
    return length > _FAR or angle > _FAR_TURNED


def _along(frame: FoundFrame) -> str:
    """The links that hang on it."""
    others = frame.along
    if not others:
        return ""
    return f", with {listed(others) if len(others) <= _NAMED else many(len(others), 'link') + ' on it'}"


def _size(value: float) -> str:
    return f"{value:.0f}" if value >= 99.5 else rounded(value, 2)
