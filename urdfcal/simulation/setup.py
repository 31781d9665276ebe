"""Where everything stands that measures a simulated robot.

Measuring frames, targets and places are put anywhere, rotations up to half a turn, since a fit finds them from nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pinocchio as pin

from urdfcal.base.errors import UsageError, no_such
from urdfcal.base.geometry import SE3, Array3, Matrix, Vector, xyz_rpy
from urdfcal.calibration.reach import screen_area
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.jacobian import ArmMotion, arm_motion
from urdfcal.model.parameters import INSTRUMENTS
from urdfcal.model.slots import FRAME
from urdfcal.robot.configurations import random_positions
from urdfcal.robot.rig import SIX, Grid
from urdfcal.robot.robot import Robot
from urdfcal.robot.sheet import ScreenArea, stated_sheet
from urdfcal.sensors.columns import NONE, Stations
from urdfcal.sensors.readings import Readings, blank_readings, instruments_of
from urdfcal.sensors.registry import SENSORS
from urdfcal.simulation.pictures import Subject, camera_place

_ASKED = dict.fromkeys(word for sensor in SENSORS.values() for word in sensor.simulated)
SENSOR_KINDS = {word: tuple(name for name, sensor in SENSORS.items() if word in sensor.simulated) for word in _ASKED}
_LOOKED_AT = 600  # random poses by which a camera's place is chosen
_FRAME_FAR, _TARGET_FAR = 1.0, 0.08  # [m] how far instruments stand from what they are on, a standard deviation
_NEAR = 10e-3, np.radians(1.0)  # [m] and [rad] how far lasers and screens are off, a standard deviation
Pair = tuple[str, str]  # names of a target and of what it is seen from


@dataclass(frozen=True)
class SimulatedSensor:
    """Something that reads a target.

    Attributes:
        kind: One of SENSOR_KINDS.
        target: The target's name: its link, with `:<label>` behind it where there are several on one link.
        link: The link that it is on.
        places: How many planes or sockets it touches.
        instrument: What it is read with; the empty string for whatever stands on the reference link.
    """

    kind: str
    target: str
    link: str
    places: int = 0
    instrument: str = ""

    @property
    def pair(self) -> Pair:
        """What is seen, and from what."""
        return self.target, self.instrument

    @property
    def by_camera(self) -> bool:
        """Whether it is read in pictures."""
        return any(SENSORS[kind].by_camera for kind in SENSOR_KINDS[self.kind])

    @property
    def aimed(self) -> bool:
        """Whether it is a laser that is aimed at a screen."""
        return any(SENSORS[kind].aimed for kind in SENSOR_KINDS[self.kind])


@dataclass(frozen=True)
class SimulatedSetup:
    """A robot with known errors, and where everything stands that measures it.

    Attributes:
        robot: The nominal robot, seen by the instruments.
        errors: Error model of the truth, its measuring frames, targets and planes where they are.
        x: The truth, (p,), [m] and [rad].
        sensors: What reads.
        area: The screen, where there are lasers.
        camera: What pixels are read with, a `sensors.camera.Camera`; by instruments that have one of their own, by that.
        boards: Links that are boards, with the grids of their corners.
        stations: Instruments by name: links and cameras.
    """

    robot: Robot
    errors: ErrorModel
    x: Vector
    sensors: tuple[SimulatedSensor, ...]
    area: ScreenArea
    camera: Any = None
    boards: Mapping[str, Grid] = field(default_factory=dict)
    stations: Stations = NONE

    def motion(self, q: Matrix, session: str) -> tuple[ArmMotion, dict[Pair, tuple[Matrix, Array3]]]:
        """Everything and, by pair, the target's origin and axes in the frame that it is seen from, at true positions q."""
        motion, chain = arm_motion(self.errors, q, self.x, session), self.errors.chain
        pairs = dict.fromkeys(sensor.pair for sensor in self.sensors)
        return motion, {
            (target, instrument): motion.seen(chain.frame_index("target", target), chain.seen_from(instrument))
            for target, instrument in pairs
        }

    def twists(self, motion: ArmMotion, pair: Pair) -> Array3:
        """Twists of a target in the frame that it is seen from by the joints, (n, 6, inputs of the way)."""
        chain, n = self.errors.chain, motion.posture.q.shape[1]
        index, frame = chain.frame_index("target", pair[0]), chain.seen_from(pair[1])
        return motion.axis_derivatives(motion.from_base(np.broadcast_to(np.eye(6), (n, 6, 6)), frame), index, frame)

    @property
    def pictured(self) -> tuple[SimulatedSensor, ...]:
        """What cameras read."""
        return tuple(sensor for sensor in self.sensors if sensor.by_camera)

    @property
    def choosy(self) -> bool:
        """Whether some of its sensors read at some poses alone, which have to be looked for."""
        return any(sensor.by_camera or sensor.aimed for sensor in self.sensors)

    def area_of(self, screen: str) -> ScreenArea:
        """The sheet of an instrument that is a screen: as the URDF draws it, else as large as any."""
        link = next(own.link for own in self.robot.rig.instruments.every if own.name == screen)
        return stated_sheet(self.robot, link) or self.area

    @property
    def looking(self) -> tuple[str, ...]:
        """The instruments that are cameras."""
        return tuple(dict.fromkeys(sensor.instrument for sensor in self.pictured))

    def camera_of(self, instrument: str) -> Any:
        """What an instrument reads pixels with."""
        return self.stations.cameras.get(instrument, self.camera)

    def subjects(self, q: Matrix, session: str, instrument: str = "") -> list[Subject]:
        """What a camera looks at, in its own axes, at true positions q."""
        motion, chain = arm_motion(self.errors, q, self.x, session), self.errors.chain
        found: dict[str, Subject] = {}
        for sensor in (sensor for sensor in self.pictured if sensor.instrument == instrument):
            grid = self.boards.get(sensor.link)
            label = sensor.target if grid is None else sensor.link
            if label not in found:
                at = np.zeros((1, 3)) if grid is None else grid.points()
                p, R = motion.seen(chain.frame_index("target", sensor.target), chain.seen_from(instrument))
                first = at[int(sensor.target.partition(":")[2])] if grid is not None else np.zeros(3)
                found[label] = Subject(p - R @ first, R, at, grid is not None)
        return list(found.values())

    def place(self, name: str) -> Vector:
        """The true numbers of a place that several poses share."""
        return np.array([value for own, value in zip(self.errors.names, self.x, strict=True) if own.rpartition(".")[0] == name])

    def entries(self) -> dict[str, Any]:
        """Where everything stands, for a file: measuring frames, targets on their links, places in the measuring frame; SI."""
        links = {sensor.target: sensor.link for sensor in self.sensors}
        links |= {own.name: own.link for own in self.robot.rig.instruments.every if own.name and own.name not in links}
        frames: dict[str, Any] = {}
        for slot in self.errors.slots:
            for session, placement in slot.found.items() if slot.kind == "reference" else list(slot.found.items())[:1]:
                label = slot.label.removesuffix(FRAME)
                name = f"{self._frame_named(label)} {session}".strip() if slot.kind == "reference" else label
                xyz, rpy = xyz_rpy(placement)
                frames[name] = {"link": links.get(label, label), "xyz": xyz.tolist(), "rpy": rpy.tolist()}
        places = {}
        for place in self.robot.instruments.places:
            numbers, axes = self.place(place.name).tolist(), self.errors.planes.get(place.name)
            beside = {name: value for name, value in zip(place.names, numbers, strict=True) if not name.startswith("tilt_")}
            places[place.name] = {"xyz": numbers} if axes is None else {"normal": axes[:, 0].tolist(), **beside}
        return {"frames": frames, "places": places} if places else {"frames": frames}

    def _frame_named(self, label: str) -> str:
        """What a measuring frame is called where it stands in a file."""
        return f"measuring frame of {label}" if any(sensor.instrument for sensor in self.sensors) else "measuring frame"


def parse_sensors(
    words: Sequence[str] | str, robot: Robot, places: int, boards: Mapping[str, Grid] | None = None, stations: Stations = NONE
) -> tuple[tuple[SimulatedSensor, ...], bool]:
    """The sensors that words, or a single one, name, and whether the robot's lasers are among them; a board is read by its corners.

    Raises:
        UsageError: no such kind of sensor, no such link, or no such instrument.
    """
    words = [words] if isinstance(words, str) else words
    named = [parse_sensor(word, robot, places, stations) for word in words if word != "laser"]
    return tuple(own for sensor in named for own in _by_corners(sensor, boards or {})), "laser" in words


def _by_corners(sensor: SimulatedSensor, boards: Mapping[str, Grid]) -> Sequence[SimulatedSensor]:
    grid = boards.get(sensor.target) if sensor.by_camera else None
    return [sensor] if grid is None else [replace(sensor, target=f"{sensor.link}:{corner}") for corner in range(grid.corners)]


def parse_sensor(text: str, robot: Robot, places: int, stations: Stations = NONE) -> SimulatedSensor:
    """A sensor as the command line has it: `point:tool0`, `socket:tool0:ball`, `pose:left_hand@leica`.

    Raises:
        UsageError: no such kind of sensor, no such link, or no such instrument.
    """
    kind, _, pair = text.partition(":")
    target, at, instrument = pair.partition("@")
    links = robot.tree.links
    link = target if target in links else target.rpartition(":")[0] or target
    if kind not in SENSOR_KINDS or not target:
        raise UsageError(f"--sensor {text}: expected laser, or one of {', '.join(f'{known}:LINK' for known in SENSOR_KINDS)}")
    if link not in links:
        raise UsageError(f"--sensor {text}: {no_such('link', link, links)}")
    if at and instrument not in (known := (*stations.links, *links)):
        way_out = f"name it in rig.yaml, instruments: {{{instrument or 'NAME'}: {{link: LINK}}}}"
        raise UsageError(f"--sensor {text}: {no_such('instrument', instrument, known)}; expected a link, or {way_out}")
    if not at and any(SENSORS[name].aimed for name in SENSOR_KINDS[kind]):
        way_out = f"such as {text}@screen, or laser alone for the robot's own"
        raise UsageError(f"--sensor {text}: expected the screen that it beams onto, too, {way_out}")
    touched = places if any(SENSORS[name].touches for name in SENSOR_KINDS[kind]) else 0
    return SimulatedSensor(kind, target, link, touched, instrument)


def seen_with(
    robot: Robot,
    sensors: Sequence[SimulatedSensor],
    reference: str = "",
    lasers: bool = False,
    boards: Mapping[str, Grid] | None = None,
    stations: Stations = NONE,
) -> Robot:
    """The robot as these sensors see it; with its lasers if they are wanted.

    Raises:
        RigError: a link is not there, or not where it can be.
        UsageError: two sensors of one kind read the same target from the same instrument.
    """
    read = [(kind, sensor.pair) for sensor in sensors for kind in SENSOR_KINDS[sensor.kind]]
    if len(set(read)) < len(read):
        raise UsageError("two sensors read the same of one target; tell targets on one link apart by a label, LINK:LABEL")
    blank = [
        _blank(sensor, kind, labels)
        for sensor, labels in zip(sensors, place_labels(sensors), strict=True)
        for kind in SENSOR_KINDS[sensor.kind]
    ]
    seen = robot.seen_by(instruments_of(blank, reference, boards=boards, stations=stations.links), robot.lasers if lasers else ())
    seen.chain  # noqa: B018  # refuse links that no chain leads to now, and not halfway
    return seen


def simulated_setup(
    robot: Robot,
    errors: ErrorModel,
    x: Vector,
    sensors: Sequence[SimulatedSensor],
    rng: np.random.Generator,
    *,
    sessions: Sequence[str] = ("",),
    reference_known: bool = False,
    target_known: bool = False,
    area: ScreenArea | None = None,
    camera: Any = None,
    boards: Mapping[str, Grid] | None = None,
    stations: Stations = NONE,
) -> SimulatedSetup:
    """Put measuring frames, targets and places somewhere; what the truth said of them is left out.

    Args:
        robot: Nominal robot, as the sensors see it.
        errors: Error model of the truth, built for it.
        x: Errors of joints, mount and screen, (p,).
        sensors: What reads.
        rng: Source of randomness.
        sessions: Each has a measuring frame of its own.
        reference_known: The measuring frame is the reference link's own.
        target_known: What is measured is the targets' links themselves.
        area: The screen; by default as the URDF has it.
        camera: What pixels are read with; it stands where it sees its target at many poses.
        boards: Links that are boards, with the grids of their corners.
        stations: Instruments by name: links and cameras.

    Raises:
        UsageError: pixels are to be read without a camera, or by one that sees nothing.
    """
    slots, aimed = [], _aimed(errors, sensors)
    for slot in errors.slots:
        near = slot.frame in aimed
        if slot.kind == "reference" and not reference_known:
            slot = replace(slot, found={session: _nearby(rng) if near else _somewhere(rng, _FRAME_FAR) for session in sessions})
        elif slot.kind == "target" and not target_known:
            placement = _nearby(rng) if near else _somewhere(rng, _TARGET_FAR, turned=SIX[3] in slot.names)
            slot = replace(slot, found=dict.fromkeys(sessions, placement))
        slots.append(slot)
    beside = [parameter.kind in INSTRUMENTS for parameter in errors.parameters]
    truth = np.where(beside, 0.0, errors.check(x))
    errors = replace(errors, slots=tuple(slots), sessions=tuple(sessions))
    setup = SimulatedSetup(robot, errors, truth, tuple(sensors), area or screen_area(robot), camera, boards or {}, stations)
    for instrument in setup.looking:
        setup = _with_camera(setup, instrument, reference_known, rng)
    return _with_places(setup, rng)


def _with_camera(setup: SimulatedSetup, instrument: str, reference_known: bool, rng: np.random.Generator) -> SimulatedSetup:
    """A camera where it sees its targets, one place a session; on its link where that is known."""
    camera = setup.camera_of(instrument)
    if camera is None:
        sensor = next(own for own in setup.pictured if own.instrument == instrument)
        label = "@".join(filter(None, sensor.pair))
        raise UsageError(f"{label} is to be read in pictures: name the camera's lens with --camera CAMERA.yaml")
    if reference_known:
        return setup
    frame = setup.errors.chain.seen_from(instrument)

    def stand(found: Mapping[str, SE3]) -> SimulatedSetup:
        slots = [replace(slot, found=dict(found)) if slot.frame == frame else slot for slot in setup.errors.slots]
        return replace(setup, errors=replace(setup.errors, slots=tuple(slots)))

    at_link = stand(dict.fromkeys(setup.errors.sessions, pin.SE3.Identity()))
    q = random_positions(setup.robot, _LOOKED_AT, rng)
    sessions = setup.errors.sessions
    return stand({session: camera_place(camera, at_link.subjects(q, session, instrument), rng) for session in sessions})


def place_labels(sensors: Sequence[SimulatedSensor]) -> list[tuple[str, ...]]:
    """Labels of each sensor's places, counted on over those of one kind."""
    counts, labels = dict.fromkeys(SENSOR_KINDS, 0), []
    for sensor in sensors:
        first = counts[sensor.kind] + 1
        labels.append(tuple(str(number) for number in range(first, first + sensor.places)))
        counts[sensor.kind] += sensor.places
    return labels


def _blank(sensor: SimulatedSensor, kind: str, labels: Sequence[str]) -> Readings:
    blank = blank_readings(kind, sensor.target, sensor.link, len(labels), sensor.instrument)
    return replace(blank, labels=np.array(labels, dtype=str))


def _somewhere(rng: np.random.Generator, far: float, turned: bool = True) -> SE3:
    quaternion = rng.normal(0, 1, 4)
    rotation = pin.Quaternion(quaternion / np.linalg.norm(quaternion)).toRotationMatrix() if turned else np.eye(3)
    return pin.SE3(rotation, rng.normal(0, far, 3))


def _aimed(errors: ErrorModel, sensors: Sequence[SimulatedSensor]) -> set[int]:
    """The chain's frames of lasers that are aimed at screens, and of these."""
    chain = errors.chain
    lasers = [sensor for sensor in sensors if sensor.aimed]
    return {frame for own in lasers for frame in (chain.frame_index("target", own.target), chain.seen_from(own.instrument))}


def _nearby(rng: np.random.Generator) -> SE3:
    """A placement about where the URDF has it."""
    return pin.exp6(np.concatenate([rng.normal(0, _NEAR[0], 3), rng.normal(0, _NEAR[1], 3)]))


def _with_places(setup: SimulatedSetup, rng: np.random.Generator) -> SimulatedSetup:
    """Sockets and planes where the target is at a random pose, ends of wires beside one."""
    values, draw = dict(zip(setup.errors.names, setup.x.tolist(), strict=True)), _Draws(rng)
    axes: dict[str, Matrix] = {}
    for sensor, labels in zip(setup.sensors, place_labels(setup.sensors), strict=True):
        points = setup.motion(random_positions(setup.robot, 1 + len(labels), rng), setup.errors.sessions[0])[1][sensor.pair][0]
        for how in (SENSORS[kind] for kind in SENSOR_KINDS[sensor.kind]):
            names = {place.name: place.names for place in how.places(sensor.target, labels)}
            for name, found in how.simulated_places(sensor.target, labels, points, draw).items():
                values |= {f"{name}.{own}": float(value) for own, value in zip(names[name], found.numbers, strict=True)}
                axes |= {} if found.axes is None else {name: found.axes}
    x = np.array([values[name] for name in setup.errors.names])
    return replace(setup, x=x, errors=replace(setup.errors, planes=axes))


@dataclass(frozen=True)
class _Draws:
    """Points and axes at random."""

    rng: np.random.Generator

    def point(self, far: float) -> Vector:
        return self.rng.normal(0, far, 3)

    def axes(self) -> Matrix:
        return np.asarray(_somewhere(self.rng, 0.0).rotation)
