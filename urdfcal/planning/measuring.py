"""What will measure the poses that are planned: which targets, by which instruments, and where all of them stand.

A laser's screen is where the URDF has it. An instrument whose link is named stands on that link, a board is its link. A camera of which
neither is known is taken to stand where it sees most; where any other instrument will stand is drawn at random, and so is where targets
sit on their links, since that matters little to which poses tell much; how much they tell is for `typical.py`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pinocchio as pin

from urdfcal.base.errors import UsageError, no_such
from urdfcal.base.geometry import DEG, Array3, Mask, Matrix, Vector, xyz_rpy
from urdfcal.base.terminal import rounded
from urdfcal.calibration.analysis import next_pose
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.reach import screen_area
from urdfcal.estimation.noise import Noise
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model
from urdfcal.model.jacobian import arm_motion
from urdfcal.model.options import ModelOptions
from urdfcal.robot.configurations import random_positions
from urdfcal.robot.rig import TRACKER, Grid
from urdfcal.robot.robot import Robot
from urdfcal.robot.sheet import ScreenArea
from urdfcal.sensors.columns import NONE, Stations
from urdfcal.sensors.measurements import Measurements, spot_readings
from urdfcal.sensors.readings import Readings, blank_readings, instruments_of
from urdfcal.sensors.registry import SENSORS
from urdfcal.sensors.stated_noise import joint_sigmas, noise_of, stated_noise
from urdfcal.simulation.pictures import Subject, camera_place
from urdfcal.simulation.setup import SENSOR_KINDS, SimulatedSensor, parse_sensors, simulated_setup

_LOOKED_AT = 600  # random poses by which a camera's place is chosen
_AT_ONCE = 500  # poses whose Jacobians are worked on at once
_TOLD = 1e-10  # share of what a pose tells that is rounding


@dataclass(frozen=True)
class Asked:
    """What is to measure, as the user says it.

    Attributes:
        sensors: `laser`, or `point:LINK` and the like; `@INSTRUMENT` behind it where several are told apart.
        reference: Link that the measuring frame stands on; the empty string for `tracker`, or the root.
        camera: What pixels are read with.
        boards: Links that are boards, with the grids of their corners.
        stations: Instruments beside links.
        area: The screen; by default as the URDF has it.
    """

    sensors: Sequence[str] = ("laser",)
    reference: str = ""
    camera: Any = None
    boards: Mapping[str, Grid] = field(default_factory=dict)
    stations: Stations = NONE
    area: ScreenArea | None = None


@dataclass(frozen=True)
class Measuring:
    """What will measure.

    Attributes:
        robot: As the sensors see it.
        errors: What is to be calibrated, with instruments and targets where they are taken to stand.
        sight: The same with targets at their links' origins, where they are looked for.
        blank: What is read of each target, without poses.
        asked: What was asked for.
        area: The screen.
        unknown: Instruments of which nobody said where they stand, and which are no cameras.
        assumed: What was assumed, in sentences.
    """

    robot: Robot
    errors: ErrorModel
    sight: ErrorModel
    blank: tuple[Readings, ...]
    asked: Asked
    area: ScreenArea
    unknown: frozenset[str]
    assumed: tuple[str, ...]

    def blanks(self, q: Matrix, readings: Sequence[Readings] | None = None) -> Measurements:
        """Measurements at some poses in which nothing was read yet."""
        n, asked = len(q), self.asked
        lasers = self.errors.chain.laser_names
        own = self.blank if readings is None else readings
        spots = spot_readings(lasers, np.zeros((n, len(lasers), 2))) if lasers and readings is None else ()
        return Measurements(
            joints=self.robot.chain.input_names,
            q=q,
            readings=(*spots, *(_at(reading, n) for reading in own)),
            poses=np.arange(n).astype(str),
            sets=np.full(n, "fit"),
            sessions=np.full(n, self.errors.sessions[0]),
            reference=self.robot.rig.instruments.reference,
            camera=asked.camera,
            boards=asked.boards,
            stations=asked.stations.links,
            cameras=asked.stations.cameras,
        )

    def read(self, q: Matrix) -> Measurements:
        """What the sensors would read at some poses without noise, wherever it falls."""
        blank = self.blanks(q)
        with np.errstate(invalid="ignore", divide="ignore"):
            values = Problem(self.errors, blank).read(self.errors.mean)
        finite = (np.where(np.all(np.isfinite(read), axis=1, keepdims=True), read, np.nan) for read in values)
        return replace(blank, readings=tuple(replace(own, values=read) for own, read in zip(blank.readings, finite, strict=True)))


@dataclass(frozen=True)
class ReadWith:
    """Noise of what is read: of spots [m], of other kinds by name [m], [rad] or [px], of joints [rad]; as usual where None."""

    spot: float | None = None
    others: Mapping[str, float] | None = None
    joint: float | Vector = 0.0

    def of(self, data: Measurements, robot: Robot) -> Noise:
        """The noise of some measurements, taken for stated."""
        noise = noise_of(data, stated_noise(data, self.spot, self.others), joint_sigmas(robot, self.joint))
        return replace(noise, stated=True)


def measuring(robot: Robot, asked: Asked, options: ModelOptions, rng: np.random.Generator) -> Measuring:
    """What will measure a robot.

    Raises:
        UsageError: no such sensor, link or instrument, sensors that touch, pixels without a camera, or one that sees nothing.
        RigError: a link is not there, or not where it can be.
    """
    sensors, _ = _parsed(robot, asked)
    blank = _blank(sensors)
    seen = seen_with(robot, asked)
    _require_cameras(sensors, asked)
    errors = build_error_model(seen.chain, seen.rig, options)
    area = asked.area or screen_area(seen)
    plain = tuple(own for own, _ in sensors if not own.by_camera)
    drawn = simulated_setup(seen, errors, errors.mean, plain, rng, area=area).errors
    every = list(zip(_names(seen), seen.rig.instruments.every, strict=True))
    stands = {number: options.reference_known or _stands(name, own.link, asked) for number, (name, own) in enumerate(every) if sensors}
    slots = [_placed(slot, stands, asked.boards, options.target_known) for slot in drawn.slots]
    made = Measuring(
        seen,
        replace(drawn, slots=tuple(slots)),
        replace(drawn, slots=tuple(replace(slot, found={}) if slot.kind == "target" else slot for slot in slots)),
        blank,
        asked,
        area,
        frozenset(name for number, (name, own) in enumerate(every) if not stands.get(number, True) and own.placed),
        (),
    )
    return _with_cameras(made, {number for number, known in stands.items() if not known}, rng)


def seen_with(robot: Robot, asked: Asked) -> Robot:
    """The robot as what is asked for sees it.

    Raises:
        UsageError: no such sensor, link or instrument, or sensors that touch.
        RigError: a link is not there, or not where it can be.
    """
    sensors, lasers = _parsed(robot, asked)
    seen = robot
    if sensors:
        instruments = instruments_of(_blank(sensors), asked.reference, boards=asked.boards, stations=asked.stations.links)
        seen = robot.seen_by(instruments, robot.lasers if lasers else ())
    seen.chain  # noqa: B018  # refuse links that no chain leads to now, and not halfway
    return seen


def _blank(sensors: Sequence[tuple[SimulatedSensor, str]]) -> tuple[Readings, ...]:
    return tuple(blank_readings(kind, own.target, own.link, 0, by) for own, by in sensors for kind in SENSOR_KINDS[own.kind])


def _parsed(robot: Robot, asked: Asked) -> tuple[tuple[tuple[SimulatedSensor, str], ...], bool]:
    """The sensors with the instrument that each is read by, and whether the robot's lasers are among them."""
    found: list[tuple[SimulatedSensor, str]] = []
    lasers = False
    for word in [asked.sensors] if isinstance(asked.sensors, str) else asked.sensors:
        plain, _, instrument = word.partition("@")
        if plain.startswith("laser:"):
            raise UsageError(f"--sensor {word}: poses are planned for the robot's own lasers, by laser with --laser and --screen")
        named, laser = parse_sensors([plain], robot, 0, asked.boards)
        known = {*asked.stations.links, *robot.tree.links}
        if instrument and instrument not in known:
            raise UsageError(f"--sensor {word}: {no_such('instrument or link', instrument, known)}")
        lasers = lasers or laser
        found += [(own, instrument) for own in named]
    read = [(kind, own.target, instrument) for own, instrument in found for kind in SENSOR_KINDS[own.kind]]
    if len(set(read)) < len(read):
        raise UsageError("two sensors read the same of one target; tell targets on one link apart by a label, LINK:LABEL")
    for own, _ in found:
        if any(SENSORS[kind].touches for kind in SENSOR_KINDS[own.kind]):
            raise UsageError(f"plan_poses: {own.kind}:{own.target} touches, and which poses reach what it touches is not known here")
    return tuple(found), lasers


def _require_cameras(sensors: Sequence[tuple[SimulatedSensor, str]], asked: Asked) -> None:
    for own, instrument in sensors:
        if own.by_camera and asked.stations.cameras.get(instrument, asked.camera) is None:
            entry = f", or instruments: {{{instrument}: {{camera: CAMERA.yaml}}}} in rig.yaml" if instrument else ""
            raise UsageError(f"{own.target} is to be read in pictures: name the camera's lens with --camera CAMERA.yaml{entry}")


def _at(reading: Readings, n: int) -> Readings:
    """The same for some poses, with something that counts as read."""
    kind = reading.kind
    return replace(reading, values=np.zeros((n, kind.stored)), labels=np.full(n, ""), sigma=np.full(n, np.nan))


def _names(robot: Robot) -> tuple[str, ...]:
    """What readings call the instruments, in order; the empty string for the one that needs no name."""
    seen = robot.rig.instruments
    return (seen.name, *(other.name for other in seen.others))


def _stands(name: str, link: str, asked: Asked) -> bool:
    """Whether it is said on which link an instrument stands, so that it is taken to be that link."""
    return link in {TRACKER, name or asked.reference, asked.stations.links.get(name, "")} - {""}


def _placed(slot: Any, stands: Mapping[int, bool], boards: Mapping[str, Grid], targets_known: bool) -> Any:
    """A slot as it is known: instruments on their links, boards as their links."""
    known = (slot.kind == "reference" and stands[slot.frame]) or (slot.kind == "target" and (targets_known or slot.label in boards))
    return replace(slot, found={}) if known else slot


def _with_cameras(made: Measuring, free: set[int], rng: np.random.Generator) -> Measuring:
    """Cameras of which nobody said where they stand, where each sees what it reads at most poses."""
    assumed = []
    for number, (name, instrument) in enumerate(zip(_names(made.robot), made.robot.rig.instruments.every, strict=True)):
        pictured = [own for own in made.blank if own.kind.by_camera and own.instrument == name]
        if number not in free or not pictured:
            continue
        camera = made.asked.stations.cameras.get(name, made.asked.camera)
        place = camera_place(camera, _subjects(made, number, pictured, rng), rng)
        made = replace(made, errors=_with_frame(made.errors, number, place), sight=_with_frame(made.sight, number, place))
        made = replace(made, unknown=made.unknown - {name})
        xyz, rpy = xyz_rpy(place)
        told = f"{','.join(rounded(each, 3) for each in xyz)} m, rpy {','.join(rounded(each / DEG, 3) for each in rpy)} deg"
        assumed.append(
            f"nobody said where the camera{f' {name}' if name else ''} stands: it is taken to be where it sees "
            f"much, at xyz {told} of {instrument.link} (z ahead); name its link with --reference if it is elsewhere"
        )
    for name in sorted(made.unknown):
        assumed.append(
            f"nobody said where the instrument{f' {name}' if name else ''} stands, so nothing is known of its lines of sight; "
            "name its link with --reference"
        )
    return replace(made, assumed=tuple(assumed))


def _with_frame(errors: ErrorModel, number: int, place: Any) -> ErrorModel:
    found = dict.fromkeys(errors.sessions, place)
    slots = (replace(slot, found=found) if slot.kind == "reference" and slot.frame == number else slot for slot in errors.slots)
    return replace(errors, slots=tuple(slots))


def _subjects(made: Measuring, number: int, pictured: Sequence[Readings], rng: np.random.Generator) -> list[Subject]:
    """What a camera looks at, in the axes of the link that it stands on."""
    errors = _with_frame(made.sight, number, pin.SE3.Identity())
    motion = arm_motion(errors, random_positions(made.robot, _LOOKED_AT, rng), errors.mean, errors.sessions[0])
    found: dict[str, Subject] = {}
    for own in pictured:
        grid = made.asked.boards.get(own.link)
        label = own.target if grid is None else own.link
        if label not in found:
            at = np.zeros((1, 3)) if grid is None else grid.points()
            p, R = motion.seen(errors.chain.frame_index("target", own.target), number)
            first = at[int(own.target.partition(":")[2])] if grid is not None else np.zeros(3)
            found[label] = Subject(p - R @ first, R, at, grid is not None)
    return list(found.values())


def whitened(made: Measuring, q: Matrix, noise: ReadWith, read: Mask | None = None) -> Array3:
    """Jacobian of every pose in units of its noise, (m, k, p), with no more rows than a pose tells numbers.

    Args:
        made: What measures.
        q: Positions, (m, inputs).
        noise: Of the readings.
        read: Which readings are made, (m, readings); None for all that can be.
    """
    parts = [slice(start, start + _AT_ONCE) for start in range(0, max(len(q), 1), _AT_ONCE)]
    found = [_compressed(_rows(made, q[part], noise, None if read is None else read[part])) for part in parts]
    most = max(part.shape[1] for part in found)
    return np.concatenate([np.pad(part, ((0, 0), (0, most - part.shape[1]), (0, 0))) for part in found])


def _rows(made: Measuring, q: Matrix, noise: ReadWith, read: Mask | None) -> Array3:
    data = made.read(q)
    if read is not None:
        data = replace(data, readings=tuple(own.without(~read[:, column]) for column, own in enumerate(data.readings)))
    return next_pose.whitened(made.errors, made.errors.mean, data, noise.of(data, made.robot))


def _compressed(H: Array3) -> Array3:
    """Rows that tell the same, H'H, as few as there can be: all the corners of a board tell no more than where it is, six numbers."""
    m, k, p = H.shape
    if k <= 6 or not m:
        return H
    values, vectors = np.linalg.eigh(H @ H.transpose(0, 2, 1)) if k <= p else np.linalg.eigh(H.transpose(0, 2, 1) @ H)
    kept = int((values > _TOLD * values[:, -1:]).sum(axis=1).max(initial=1))
    vectors = vectors[:, :, -kept:]
    if k <= p:
        return np.asarray(vectors.transpose(0, 2, 1) @ H)
    return np.asarray(np.sqrt(np.maximum(values[:, -kept:], 0.0))[:, :, None] * vectors.transpose(0, 2, 1))
