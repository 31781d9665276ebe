"""Where measuring frames stand, where targets sit on their links, and where shared places are: found from nothing.

The joints are taken to be nominal; each frame, offset and place then follows from what was measured of it (`closed_form.py`). Targets
that tell most come first, and what needs a frame that another target gives comes after.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from urdfcal.base.closed_form import (
    camera_before,
    nearest_rotation,
    point_and_frame,
    robot_world_hand_eye,
    umeyama,
)
from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import SE3, Array3, Labels, Mask, Matrix
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.jacobian import arm_motion
from urdfcal.model.parameters import DEFAULT_PRIORS, INSTRUMENTS, PriorScale
from urdfcal.model.slots import Slot
from urdfcal.robot.rig import SIX
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.readings import Readings
from urdfcal.sensors.sensor import PlaceFault

Rows = npt.NDArray[np.intp]

_LEAST_POINTS, _LEAST_PIXELS = 3, 4


@dataclass
class _Known:
    """What has been found so far."""

    frames: dict[tuple[int, str], SE3]  # by instrument, as the chain's frame that it is, and session
    offsets: dict[str, SE3]


@dataclass(frozen=True)
class _Seen:
    """A target at the poses of one session: nominal link placements in the reference link, and what was measured.

    Attributes:
        frame: What it is seen from, as the chain's frame that it is.
        R, b: Axes (n, 3, 3) and origin (n, 3) of its link.
        a: Measured points, (n, 3); with axes beside them some or all of the numbers may be nan.
        A: Measured axes, (n, 3, 3); None if only points were seen.
    """

    target: str
    frame: int
    session: str
    R: Array3
    b: Matrix
    a: Matrix
    A: Array3 | None

    @property
    def whole(self) -> bool:
        """Whether all three numbers of every point were read."""
        return not np.isnan(self.a).any()


def instruments_alone(errors: ErrorModel) -> ErrorModel:
    """The error model of a robot that is taken for right: measuring frames, targets and places are free, nothing else."""
    free = tuple(parameter for parameter in errors.parameters if parameter.kind in INSTRUMENTS)
    own = tuple(f"{slot.label}." for slot in errors.slots if slot.frame is not None)
    return replace(errors, parameters=free, held={name: value for name, value in errors.held.items() if name.startswith(own)}, carried={})


def place_instruments(errors: ErrorModel, data: Measurements) -> ErrorModel:
    """The same error model with its measuring frames, targets and places put where the nominal robot has them.

    What is held, or has a prior of its own, stays where it is stated.

    Args:
        errors: Error model of the robot as it was measured.
        data: The measurements.

    Raises:
        UsageError: a plane was touched less than three times, or no socket twice.
    """
    free = {slot.label: slot for slot in errors.slots if slot.frame is not None and _open(errors, slot)}
    known = _Known({}, {target.placed_by: pin.SE3.Identity() for target in data.instruments.targets if target.placed_by not in free})
    references = {slot.frame: slot for slot in errors.slots if slot.kind == "reference"}
    for frame in errors.chain.instrument_frames:
        if frame not in references or references[frame].label not in free:
            known.frames |= {(frame, session): pin.SE3.Identity() for session in errors.sessions}
    seen = sorted(_views(errors, data), key=lambda view: (not view.whole, view.A is None, -len(view.b)))
    for view in [*seen, *seen]:  # the second time for what needed something that was found later
        _place(view, known)
    _place_cameras(errors, data, known)
    _place_by_sensor(errors, data, known)
    slots = tuple(_found(slot, known, errors.sessions) if slot.label in free else slot for slot in errors.slots)
    return with_places(replace(errors, slots=slots), data)


def _open(errors: ErrorModel, slot: Slot) -> bool:
    """Whether all of an instrument's placement is free, and nothing is stated of it."""
    own = {f"{slot.label}.{name}" for name in slot.names}
    usual: PriorScale = DEFAULT_PRIORS[slot.kind]
    free = [parameter for parameter in errors.parameters if parameter.name in own]
    return len(free) == len(own) and all(not parameter.mean and parameter.sigma >= usual.sigma(parameter.unit) for parameter in free)


def _found(slot: Slot, known: _Known, sessions: Sequence[str]) -> Slot:
    """The slot where it was found; a session that says nothing of its own frame begins where another's stands."""
    if slot.kind == "reference":
        own = {session: T for (frame, session), T in known.frames.items() if frame == slot.frame}
        first = next(iter(own.values()), None)
        return replace(slot, found={session: own.get(session, first) for session in sessions if first is not None})
    placement = known.offsets.get(slot.label, pin.SE3.Identity())
    return replace(slot, found=dict.fromkeys(sessions, placement))


def _views(errors: ErrorModel, data: Measurements) -> Iterator[_Seen]:
    by_pair: dict[tuple[str, int], list[Readings]] = {}
    for reading in (reading for reading in data.readings if not reading.kind.beam):
        by_pair.setdefault((reading.target, errors.chain.seen_from(reading.instrument)), []).append(reading)
    yield from _boards(errors, data)
    for (target, frame), readings in by_pair.items():
        points = next((found for own in readings if (found := own.kind.points(own.values)) is not None), np.full((len(data), 3), np.nan))
        axes = next((found for own in readings if (found := own.kind.axes(own.values)) is not None), None)
        whole = ~np.isnan(points).any(axis=1)
        turned = ~np.isnan(axes).any(axis=(1, 2)) if axes is not None else np.zeros(len(data), dtype=bool)
        if (whole & turned).sum() >= _LEAST_POINTS:
            whole &= turned
        elif axes is not None and whole.sum() < _LEAST_POINTS:
            whole = turned
        else:
            axes = None
        for session in errors.sessions:
            rows = np.flatnonzero(whole & (_of_session(errors, data.sessions, session)))
            if len(rows) >= _LEAST_POINTS:
                R, b = _nominal(errors, data.q[rows], target, frame, session)
                yield _Seen(target, frame, session, R, b, points[rows], None if axes is None else axes[rows])


def _boards(errors: ErrorModel, data: Measurements) -> Iterator[_Seen]:
    """Boards in pictures, each picture with enough corners as a whole pose of the board in the camera."""
    if not data.boards:
        return
    import cv2

    pictured = [reading for reading in data.readings if reading.kind.by_camera and not reading.kind.beam]
    for board, instrument in dict.fromkeys((own.link, own.instrument) for own in pictured if own.link in data.boards):
        grid, frame = data.boards[board], errors.chain.seen_from(instrument)
        camera = data.cameras.get(instrument, data.camera)
        corners = [reading for reading in pictured if (reading.link, reading.instrument) == (board, instrument)]
        seen = np.array([corner.seen for corner in corners]).reshape(len(corners), len(data))
        grid_points = np.array([grid.at(int(corner.target.partition(":")[2])) for corner in corners])
        for session in errors.sessions:
            own = _of_session(errors, data.sessions, session)
            rows, placements = [], []
            for pose in np.flatnonzero(own & (seen.sum(axis=0) >= _LEAST_PIXELS)):
                rays = camera.rays(np.array([each.values[pose] for each, there in zip(corners, seen[:, pose], strict=True) if there]))
                found, turn, shift = cv2.solvePnP(
                    grid_points[seen[:, pose]], np.ascontiguousarray(rays[:, :2] / rays[:, 2:]), np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
                )
                if found and np.isfinite(turn).all() and np.isfinite(shift).all():
                    rows.append(pose)
                    placements.append(pin.SE3(pin.exp3(turn.ravel()), shift.ravel()))
            if len(rows) >= _LEAST_POINTS:
                R, b = _nominal(errors, data.q[rows], corners[0].target, frame, session)
                b = b - R @ grid_points[0]  # of the link, not of the corner
                a, A = np.array([each.translation for each in placements]), np.array([each.rotation for each in placements])
                yield _Seen(board, frame, session, R, b, a, A)


def _of_session(errors: ErrorModel, sessions: Labels, session: str) -> Mask:
    """Which poses belong to a session; all of them where there is only one."""
    return np.asarray((sessions == session) | (len(errors.sessions) == 1))


def _nominal(errors: ErrorModel, q: Matrix, target: str, frame: int, session: str) -> tuple[Array3, Matrix]:
    """Axes and origin of a target in its measuring frame as the error model has them at its mean; offsets that are not found are none."""
    motion = arm_motion(errors, q, errors.mean, session)
    origin, axes = motion.seen(errors.chain.frame_index("target", target), frame)
    return axes, origin


def _place(view: _Seen, known: _Known) -> None:
    """Find whatever this view can tell: frame and offset, or one where the other is known."""
    at = view.frame, view.session
    Y, X = known.frames.get(at), known.offsets.get(view.target)
    if Y is not None and X is not None:
        return
    if view.A is not None and X is None and Y is None:
        known.frames[at], known.offsets[view.target] = robot_world_hand_eye(view.R, view.b, view.A, view.a)
    elif X is None and Y is None:
        known.frames[at], offset = point_and_frame(view.R, view.b, view.a)
        known.offsets[view.target] = pin.SE3(np.eye(3), offset)
    elif X is None:
        known.offsets[view.target] = _offset(view, Y)
    else:
        known.frames[at] = _frame(view, X)


def _offset(view: _Seen, Y: SE3) -> SE3:
    """X for a known Y: R_Y' R_i x = a_i - R_Y' (b_i - y) of what was read of a_i, and the mean of R_i' R_Y A_i."""
    read = ~np.isnan(view.a).ravel()
    left, right = (Y.rotation.T @ view.R).reshape(-1, 3), (view.a - (view.b - Y.translation) @ Y.rotation).ravel()
    offset = np.linalg.lstsq(left[read], right[read], rcond=1e-9)[0]
    back = view.R.transpose(0, 2, 1)
    rotation = np.eye(3) if view.A is None else nearest_rotation((back @ (Y.rotation @ view.A)).mean(axis=0))
    return pin.SE3(rotation, offset)


def _frame(view: _Seen, X: SE3) -> SE3:
    """Y for a known X: from the points or, where numbers of theirs are missing, with the mean of R_i R_X A_i'."""
    there = view.b + view.R @ X.translation
    if view.A is None or view.whole:
        return umeyama(view.a, there)
    R_Y = nearest_rotation((view.R @ X.rotation @ view.A.transpose(0, 2, 1)).mean(axis=0))
    left = there @ R_Y - view.a  # R_Y' y, as far as it was read
    read = ~np.isnan(left)
    return pin.SE3(R_Y, R_Y @ (np.where(read, left, 0.0).sum(axis=0) / np.maximum(read.sum(axis=0), 1)))


def _place_cameras(errors: ErrorModel, data: Measurements, known: _Known) -> None:
    """Cameras that see targets as pixels, where nothing else told where their frame is."""
    for reading in (reading for reading in data.readings if reading.link not in data.boards):
        frame = errors.chain.seen_from(reading.instrument)
        for session in errors.sessions:
            rows = np.flatnonzero(reading.seen & (_of_session(errors, data.sessions, session)))
            if (frame, session) in known.frames or len(rows) < _LEAST_PIXELS:
                continue
            rays = data.sensor_of(reading).rays(reading.values[rows])
            if rays is None:
                break
            R, b = _nominal(errors, data.q[rows], reading.target, frame, session)
            offset = known.offsets.get(reading.target, pin.SE3.Identity()).translation
            known.frames[frame, session] = camera_before(b + R @ offset, rays)


def _place_by_sensor(errors: ErrorModel, data: Measurements, known: _Known) -> None:
    """Offsets of targets, or how they are turned, where only one sensor tells it by itself."""
    turned = {reading.target for reading in data.readings if reading.kind.axes(reading.values) is not None}
    for reading in (reading for reading in data.readings if reading.seen.any()):
        if reading.target in known.offsets and (reading.kind.offset != SIX[3:] or reading.target in turned):
            continue
        rows = np.flatnonzero(reading.seen)
        if reading.kind.touches:
            _require_a_return(data)
        if reading.kind.beam or reading.link in data.boards:
            continue
        R, b = _per_session(errors, data, reading, rows)
        found = reading.kind.find_offset(R, b, reading.values[rows], reading.labels[rows])
        if found is not None:
            before = known.offsets.get(reading.target)
            known.offsets[reading.target] = found if before is None else pin.SE3(found.rotation, before.translation)


def _require_a_return(data: Measurements) -> None:
    """Refuse measurements that say nothing: touches of sockets alone, and no socket is touched at two poses.

    Raises:
        UsageError: naming the first pose and its socket.
    """
    if not all(reading.kind.in_pairs for reading in data.readings):
        return
    touches = [(pose, str(reading.labels[pose])) for reading in data.readings for pose in np.flatnonzero(reading.seen)]
    if touches and len({label for _, label in touches}) == len(touches):
        pose, label = touches[0]
        raise UsageError(
            f"{data.where(int(pose))}: socket '{label}' is touched once, and so is every other; "
            "poses that touch the same socket have the same label"
        )


def _per_session(errors: ErrorModel, data: Measurements, reading: Readings, rows: Rows) -> tuple[Array3, Matrix]:
    R, b = np.empty((len(rows), 3, 3)), np.empty((len(rows), 3))
    for session in errors.sessions:
        own: Mask = _of_session(errors, data.sessions[rows], session)
        if own.any():
            R[own], b[own] = _nominal(errors, data.q[rows[own]], reading.target, errors.chain.seen_from(reading.instrument), session)
    return R, b


def with_places(errors: ErrorModel, data: Measurements) -> ErrorModel:
    """Prior means of places that poses share, and the axes that they are in, from where the placed targets have them."""
    means: dict[str, float] = {}
    axes: dict[str, Matrix] = {}
    for reading in (reading for reading in data.readings if reading.places):
        known = [label for label, place in zip(reading.touched, reading.places, strict=False) if place.name in errors.planes]
        rows = np.flatnonzero(reading.seen & ~np.isin(reading.labels, known))  # what is held refers to axes that are known already
        if not len(rows) or (not reading.kind.touches and reading.places[0].name in errors.planes):
            continue
        R, p = _per_session(errors, data, reading, rows)
        try:
            found = reading.kind.find_places(reading.target, p, R, reading.values[rows], reading.labels[rows])
        except PlaceFault as fault:
            raise UsageError(f"{data.where(int(rows[fault.row]))}: {fault.message}") from None
        names = {place.name: place.names for place in reading.places}
        for name, place in found.items():
            means |= {f"{name}.{own}": float(value) for own, value in zip(names[name], place.numbers, strict=True)}
        axes |= {name: place.axes for name, place in found.items() if place.axes is not None}
    stated = [
        replace(parameter, mean=means[parameter.name]) if means.get(parameter.name) and not parameter.mean else parameter
        for parameter in errors.parameters
    ]
    return replace(errors, parameters=tuple(stated), planes={**errors.planes, **axes})
