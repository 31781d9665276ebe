"""What was measured at which joint positions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any
from uuid import uuid4

import numpy as np
import numpy.typing as npt

from urdfcal.base.errors import ShapeMismatch, UsageError
from urdfcal.base.foreign_text import shown
from urdfcal.base.geometry import Array3, Labels, Mask, Matrix, Vector
from urdfcal.base.terminal import many
from urdfcal.robot.rig import Grid, Instruments
from urdfcal.robot.robot import Robot, require_robot
from urdfcal.sensors.readings import KnownLength, Readings, instruments_of
from urdfcal.sensors.registry import noun, start_sigma_of
from urdfcal.sensors.repeats import codes, distinct, repeated, same_poses
from urdfcal.sensors.sensor import Sensor

_CAMERA = "camera"  # what parameters of a camera are called that nobody named
OF_A_POSE = ("payload", "approach", "time", "temperature", "order")  # what may be known of each pose beside its readings


@dataclass(frozen=True, repr=False)
class Measurements:
    """Readings at known joint positions; SI units.

    Attributes:
        joints: Names of the measured joints.
        q: Joint positions, (n, joints), [rad] or [m].
        readings: What every sensor read of every target: lasers first.
        poses: Label of each pose, (n,).
        sets: `fit` or `test`, (n,).
        sessions: Session of each pose, (n,); the empty string where there is only one.
        source: Where the measurements come from, for messages.
        sha256: Hash of that file; the empty string where there is none.
        lines: Line of each pose in the file, (n,); 0 where there is none.
        warnings: What was odd but could be read.
        reference: Link that the measuring frame stands on; the empty string for the default.
        lengths: Known distances between sockets.
        payload: Mass that the arm carried at each pose, (n,), [kg]; None where nothing is said.
        boards: Links that are boards, with the grids of their corners.
        camera: What pixels were read with: a `sensors.camera.Camera`; by instruments that have one of their own, by that.
        approach: Direction of each joint's last move before the pose, (n, joints): -1, 0 or 1; None where the order is not known.
        time: When each pose was measured, (n,), [s]; None where nothing is said.
        temperature: Of the arm at each pose, (n,), [degC]; None where nothing is said.
        stations: Links of the instruments that readings name; a link's own name may be left out.
        cameras: Cameras of instruments, by name.
        refines: Whether the lenses of cameras that see targets are to be refined.
        order: Which of the poses was measured first, second ..., (n,); as they stand by default.
        series: What they were measured with in one go, of which alone the order says anything; parts of measurements keep it.
    """

    joints: tuple[str, ...]
    q: Matrix
    readings: tuple[Readings, ...]
    poses: Labels
    sets: Labels
    sessions: Labels
    source: str = ""
    sha256: str = ""
    lines: npt.NDArray[np.int_] | None = None
    warnings: tuple[str, ...] = ()
    reference: str = ""
    lengths: tuple[KnownLength, ...] = ()
    payload: Vector | None = None
    approach: Matrix | None = None
    camera: Any = None
    boards: Mapping[str, Grid] = field(default_factory=dict)
    time: Vector | None = None
    temperature: Vector | None = None
    order: Vector | None = None
    stations: Mapping[str, str] = field(default_factory=dict)
    cameras: Mapping[str, Any] = field(default_factory=dict)
    refines: bool = False
    series: str = field(default_factory=lambda: uuid4().hex)

    def __post_init__(self) -> None:
        n = len(self.q)
        if self.order is None:
            object.__setattr__(self, "order", np.arange(n, dtype=float))
        expected = {"q": (n, len(self.joints)), "poses": (n,), "sets": (n,), "sessions": (n,)}
        for name, shape in expected.items():
            if getattr(self, name).shape != shape:
                raise ShapeMismatch(f"measurements: {name} has shape {getattr(self, name).shape}, expected {shape}")
        for reading in self.readings:
            if len(reading.labels) != n:
                raise ShapeMismatch(f"measurements: {len(reading.labels)} {noun(reading.noise)} of {reading.target} for {n} poses")
            if reading.kind.beam and (np.isnan(reading.values[:, 0]) != np.isnan(reading.values[:, 1])).any():
                raise ShapeMismatch("measurements: a spot is two finite numbers, or two nan where it was not seen")
        if not np.isfinite(self.q).all():
            raise ShapeMismatch("measurements: joint positions must be finite")
        if not np.isin(self.sets, ("fit", "test")).all():
            raise ShapeMismatch("measurements: each pose belongs to the set 'fit' or 'test'")

    def __len__(self) -> int:
        """Number of poses."""
        return len(self.q)

    def __repr__(self) -> str:
        """In a line: the whole of it is every number."""
        source = f" from {self.source}" if self.source else ""
        return f"<{type(self).__name__}{shown(source)}: {self.counted} with {self.summary}{self._marked}>"

    def _repr_html_(self) -> str:
        from urdfcal.base.notebook import Listing, card

        spans = zip(self.q.min(axis=0, initial=np.inf), self.q.max(axis=0, initial=-np.inf), strict=True) if len(self) else ()
        joints = [(name, f"{low:.4f}", f"{high:.4f}") for name, (low, high) in zip(self.joints, spans, strict=False)]
        readings = [(own.target, noun(own.noise), own.link, int(own.seen.sum())) for own in self.readings]
        lines = (self.source or "from memory", f"{len(self)} rows{self._marked}", *self.warnings)
        tables = (
            Listing(("target", "read", "on link", "readings"), readings, words=3, title="Readings", folded=len(readings) > 12),
            Listing(("joint", "from", "to"), joints, title="Joints, in rad or m", folded=len(joints) > 12),
        )
        return card(f"{self.counted} with {self.summary}", lines, tables)

    @property
    def _marked(self) -> str:
        """How many are for testing, and in how many sessions they were made."""
        test, sessions = int(np.count_nonzero(self.sets == "test")), len(self.session_names)
        return (f"; {test} of them marked test" if test else "") + (f"; {sessions} sessions" if sessions > 1 else "")

    @cached_property
    def pose_of(self) -> npt.NDArray[np.intp]:
        """Index of the pose that each row is a reading of, (n,): joints, session, payload, approach and what was touched agree."""
        payload = np.zeros(len(self)) if self.payload is None else np.nan_to_num(self.payload)
        return same_poses(self.q, codes(self.sessions, payload, *(own.labels for own in self.readings if own.touched)), self.approach)

    @property
    def timed(self) -> bool:
        """Whether it is said when each pose was measured; a clock that stands still says nothing."""
        return self.time is not None and len(self) > 0 and bool(np.ptp(self.time) > 0)

    @property
    def clock(self) -> Vector:
        """When each pose was measured, (n,): [s] where it is said, else counted in poses."""
        clock = self.time if self.timed else self.order
        assert clock is not None
        return clock

    @cached_property
    def configuration_of(self) -> npt.NDArray[np.intp]:
        """Index of the joint configuration that each row was read at, (n,), which is what splits into fitted and tested ones draw."""
        return same_poses(self.q, codes(self.sessions))

    @property
    def pose_count(self) -> int:
        """How many different poses there are."""
        return int(self.pose_of.max(initial=-1)) + 1

    def without_copies(self) -> Measurements:
        """The same without rows that are copies of others to the last bit, since no reading comes twice so."""
        payload = np.zeros(len(self)) if self.payload is None else self.payload
        read = [column for reading in self.readings for column in (reading.values, reading.labels, reading.sigma)]
        rows = distinct(self.q, self.sets, self.sessions, payload, *read) if len(self) else np.arange(0)
        return self if len(rows) == len(self) else self.subset(rows)

    @cached_property
    def again(self) -> bool:
        """Whether any pose was read several times."""
        return repeated(self.pose_of)

    @property
    def counted(self) -> str:
        """How many poses of how many readings, in words: `60 poses`, or `60 poses (read 180 times)`."""
        poses = many(self.pose_count, "pose")
        return f"{poses} (read {len(self)} times)" if self.again else poses

    @cached_property
    def observed(self) -> Mask:
        """At which poses anything was seen, (n,)."""
        return np.asarray(np.any([np.zeros(len(self), dtype=bool), *(reading.seen for reading in self.readings)], axis=0))

    @property
    def empty(self) -> bool:
        """Whether nothing was seen at all."""
        return not self.observed.any()

    @property
    def numbers(self) -> int:
        """How many numbers were measured; several readings of one pose are one."""
        if not self.again:
            return sum(reading.numbers for reading in self.readings)
        seen = [np.unique(np.column_stack([self.pose_of[rows], numbers]), axis=0) for rows, numbers in map(np.nonzero, self._measured)]
        return sum(len(own) for own in seen)

    @property
    def _measured(self) -> list[Mask]:
        return [reading.measured for reading in self.readings]

    @cached_property
    def kinds(self) -> tuple[str, ...]:
        """The kinds of noise there are, in the order in which the noise has them: spots first, the others as they come."""
        found = dict.fromkeys(reading.noise for reading in self.readings)
        return tuple(sorted(found, key=lambda kind: kind != "spot"))

    @property
    def only_spots(self) -> bool:
        """Whether nothing but laser spots on the screen was measured, so that tables and words can speak of spots."""
        return all(reading.kind.on_screen for reading in self.readings)

    @property
    def summary(self) -> str:
        """What was measured, in words: `120 spots`, `500 points and 500 orientations`."""
        counts = {kind: sum(int(reading.seen.sum()) for reading in self.readings if reading.noise == kind) for kind in self.kinds}
        words = [f"{count} {noun(kind, count)}" for kind, count in counts.items() if count or len(counts) == 1]
        return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)

    @cached_property
    def instruments(self) -> Instruments:
        """What the readings were made with."""
        lenses = {name: len(camera.intrinsics) for name, camera in self.seeing.items()} if self.refines else {}
        return instruments_of(self.readings, self.reference, self.camera, self.boards, self.stations, lenses)

    @property
    def seeing(self) -> dict[str, Any]:
        """The cameras that see targets, each a `sensors.camera.Camera`, by the name that parameters of its lens have."""
        by = dict.fromkeys(own.instrument for own in self.readings if own.kind.by_camera and not own.kind.beam)
        return {instrument or _CAMERA: self.camera_of(instrument) for instrument in by}

    def camera_of(self, instrument: str) -> Any:
        """What an instrument reads pixels with."""
        return self.cameras.get(instrument, self.camera)

    def sensor_of(self, reading: Readings) -> Sensor:
        """How readings were made, with the camera if it was by one."""
        sensor = reading.kind.with_camera(self.camera_of(reading.instrument))
        return sensor.refining(reading.instrument or _CAMERA) if self.refines and not reading.kind.beam else sensor

    @property
    def has_spots(self) -> bool:
        """Whether beams were seen on the screen in metres, so that they can be turned towards their spots."""
        return any(reading.kind.on_screen and reading.seen.any() for reading in self.readings)

    @property
    def corrects_camera(self) -> bool:
        """Whether spots were read by a camera whose place before the screen is estimated with the rest."""
        return bool(self.instruments.camera_sigma)

    @property
    def only_angles(self) -> bool:
        """Whether nothing was measured that tells where things are, but how they are turned alone."""
        return all(reading.kind.words.of_angles for reading in self.readings)

    @property
    def session_names(self) -> tuple[str, ...]:
        """The sessions in order of their first pose."""
        return tuple(dict.fromkeys(self.sessions.tolist()))

    def subset(self, rows: npt.ArrayLike) -> Measurements:
        """Some of the poses, by mask or index."""
        index = np.asarray(rows)
        per_pose = {name: getattr(self, name)[index] for name in ("q", "poses", "sets", "sessions")}
        readings = tuple(reading.subset(index) for reading in self.readings)
        left = {place.name for reading in readings for place in reading.places}
        lengths = tuple(known for known in self.lengths if {known.one, known.other} <= left)
        per_pose |= {name: None if (own := getattr(self, name)) is None else own[index] for name in OF_A_POSE}
        return replace(
            self, **per_pose, readings=readings, lengths=lengths, lines=None if self.lines is None else self.lines[index], warnings=()
        )

    def without(self, out: Mask) -> Measurements:
        """The same as if some readings, (n, readings), had not been made."""
        return replace(self, readings=tuple(each.without(poses) for each, poses in zip(self.readings, out.T, strict=True)))

    def split(self) -> tuple[Measurements, Measurements]:
        """The poses to fit and the poses to test, by the `set` column."""
        return self.subset(self.sets == "fit"), self.subset(self.sets == "test")

    @cached_property
    def lasers(self) -> tuple[str, ...]:
        """The laser links whose spots were read, in metres or in pixels."""
        return tuple(dict.fromkeys(reading.target for reading in self.readings if reading.kind.beam))

    @cached_property
    def spots(self) -> Array3:
        """Their spots (y, z) on the screen, (n, lasers, 2), [m]; nan where a beam was not seen, or was read in pixels."""
        return self._of_lasers(2, [(reading.target, reading.values) for reading in self.readings if reading.kind.on_screen])

    @cached_property
    def sigma(self) -> Matrix:
        """The standard deviation stated with each of these spots, (n, lasers), [m]; nan where nothing is stated."""
        return self._of_lasers(1, [(reading.target, reading.sigma[:, None]) for reading in self.readings if reading.kind.on_screen])[..., 0]

    @cached_property
    def seen(self) -> Mask:
        """Which of these spots were seen, (n, lasers)."""
        return ~np.isnan(self.spots[..., 0])

    def with_spots(self, spots: npt.ArrayLike, sigma: npt.ArrayLike | None = None) -> Measurements:
        """The same with other spots on the screen, (n, lasers, 2), [m], and other noise stated with them, (n, lasers), if given."""
        values = dict(zip(self.lasers, np.moveaxis(np.asarray(spots, dtype=float), 1, 0), strict=True))
        stated = dict(zip(self.lasers, np.asarray(self.sigma if sigma is None else sigma, dtype=float).T, strict=True))
        return replace(
            self,
            readings=tuple(
                replace(reading, values=values[reading.target], sigma=stated[reading.target]) if reading.kind.on_screen else reading
                for reading in self.readings
            ),
        )

    def _of_lasers(self, width: int, own: Sequence[tuple[str, Matrix]]) -> Array3:
        """What there is of some lasers, beside nan for the others, (n, lasers, width)."""
        found = np.full((len(self), len(self.lasers), width), np.nan)
        for laser, values in own:
            found[:, self.lasers.index(laser)] = values
        found.flags.writeable = False  # a view: `with_spots` gives other ones
        return found

    def where(self, pose: int) -> str:
        """How a message names a pose: `arm7.csv:17`, or its label."""
        if self.lines is not None and self.lines[pose]:
            return f"{self.source}:{self.lines[pose]}"
        return f"pose {self.poses[pose]}"


def spots_measured(
    robot: Robot,
    q: npt.ArrayLike,
    spots: npt.ArrayLike,
    *,
    sigma: npt.ArrayLike | None = None,
    poses: Sequence[str] | None = None,
    sets: Sequence[str] | None = None,
    sessions: Sequence[str] | None = None,
) -> Measurements:
    """Measurements from arrays.

    Args:
        robot: Whose joints and lasers they belong to, in the order of `robot.chain.input_names` and `robot.rig.lasers`.
        q: (n, joints), [rad] or [m].
        spots: (n, lasers, 2), [m]; nan where a beam was not seen.
        sigma: (n, lasers), [m]; nan where nothing is stated.
        poses: Labels; by default the numbers from 1.
        sets: `fit` or `test`; by default all `fit`.
        sessions: Session labels; by default one session.

    Raises:
        ShapeMismatch: the arrays do not fit the robot or each other.
    """
    positions, places = np.asarray(q, dtype=float), np.asarray(spots, dtype=float)
    n = len(positions)
    stated = np.full((n, len(robot.rig.lasers)), np.nan) if sigma is None else np.asarray(sigma, dtype=float)
    for name, own, shape in (("spots", places, (n, len(robot.rig.lasers), 2)), ("sigma", stated, (n, len(robot.rig.lasers)))):
        if own.shape != shape:
            raise ShapeMismatch(f"measurements: {name} has shape {own.shape}, expected {shape}")
    labels = [str(number) for number in range(1, n + 1)] if poses is None else poses
    return Measurements(
        joints=robot.chain.input_names,
        q=positions,
        readings=spot_readings(robot.rig.lasers, places, stated),
        poses=np.array(labels, dtype=str),
        sets=np.array(["fit"] * n if sets is None else sets, dtype="<U4"),
        sessions=np.array([""] * n if sessions is None else sessions, dtype=str),
    )


def spot_readings(lasers: Sequence[str], spots: Array3, sigma: Matrix | None = None) -> tuple[Readings, ...]:
    """Spots (n, lasers, 2) of some lasers as readings, with their stated noise (n, lasers) if there is any, [m]."""
    none = np.full(len(spots), "")
    stated = np.full(spots.shape[:2], np.nan) if sigma is None else sigma
    return tuple(Readings("spot", laser, laser, spots[:, index], none, stated[:, index]) for index, laser in enumerate(lasers))


def start_sigma(data: Measurements) -> Vector:
    """Noise of every kind before any is known, (kinds,)."""
    return np.array([start_sigma_of(kind) for kind in data.kinds])


def as_measured(robot: Robot, data: Measurements) -> Robot:
    """The robot with the instruments that some measurements were made with."""
    seen = data.instruments
    return robot.seen_by(seen, robot.lasers if data.lasers else ()) if seen.needed else robot


def refining(data: Measurements, lens: bool) -> Measurements:
    """The same with the lenses of their cameras refined, if they are to be.

    Raises:
        UsageError: they are, and no camera sees a target.
    """
    if lens and not data.seeing:
        raise UsageError("estimate lens: no camera sees a target in these measurements, such as corners of a board (.u .v)")
    return replace(data, refines=True) if lens else data


def require_measured(robot: Any, data: Any, call: str) -> None:
    """Refuse what is given in place of a robot and its measurements, as the two the other way round.

    Raises:
        UsageError: says what was expected, and of which call.
    """
    require_robot(robot, call)
    if not isinstance(data, Measurements):
        raise UsageError(f"{call}: expected Measurements, as read_measurements gives them, found {type(data).__name__}")


def fit_and_test(data: Measurements, test: Measurements | None = None) -> tuple[Measurements, Measurements | None]:
    """The poses to fit, without copies of rows, and those to test: marked in the data, or given apart.

    Raises:
        UsageError: nothing is left to fit, or test poses come from both.
    """
    fit_set, marked = data.split()
    if fit_set.empty:
        raise UsageError("no pose is left to fit: every row with a measurement is marked as test")
    if test is not None and len(marked):
        raise UsageError("the measurements mark test poses in their 'set' column, and other test poses were given; use one of the two")
    return fit_set.without_copies(), test if test is not None else marked if len(marked) else None


def copies_warning(data: Measurements, fitted: Measurements) -> tuple[str, ...]:
    """Says how many rows to fit are copies of others."""
    copies = int(np.count_nonzero(data.sets == "fit")) - len(fitted)
    rows = f"{copies} rows are copies of others" if copies > 1 else "a row is a copy of another"
    return (f"{rows}, joints and readings alike; copies add nothing to what is known and were left out",) if copies else ()


def fitted_poses_warning(fitted: Measurements, test: Measurements) -> tuple[str, ...]:
    """Says how many readings that are only tested were made at joint positions that are fitted, too."""
    q, sessions = np.vstack([fitted.q, test.q]), np.concatenate([fitted.sessions, test.sessions])
    poses = same_poses(q, codes(sessions))
    known = int(np.count_nonzero(np.isin(poses[len(fitted) :], poses[: len(fitted)])))
    rows = f"{known} of {len(test)} test readings were"
    return (f"{rows} made at joint positions that were fitted, too; they say little of other poses",) if known else ()


def placed_by_session(data: Measurements) -> str:
    """What stands elsewhere in each session, in words."""
    words = (["screen"] if data.lasers else []) + (["measuring frame"] if data.instruments.placed else [])
    return " or ".join(words) or "measuring frame"


def in_pixels(data: Measurements) -> bool:
    """Whether spots were read as pixels."""
    return data.corrects_camera


def require_screen_of_camera(data: Measurements) -> None:
    """Refuse spots in pixels of a camera that does not know where the screen is.

    Raises:
        UsageError: says how to add it.
    """
    if data.corrects_camera and getattr(data.camera, "T_camera_screen", None) is None:
        raise UsageError("the camera knows no screen; add it with `urdfcal camera --lens CAMERA.yaml --screen IMAGE --markers screen.yaml`")


def unreached_words(data: Measurements, lost: Mask, targets: Sequence[str], where: str) -> str:
    """`arm7.csv:17: laser_1 was seen, but in this robot its beam does not meet the screen (3 such spots)`; empty if none is lost.

    Args:
        data: The measurements.
        lost: Which beams that were seen do not meet the screen, (n, targets).
        targets: Their lasers.
        where: In which robot, in words.
    """
    if not lost.any():
        return ""
    pose, target = np.argwhere(lost)[0].tolist()
    count = f" ({np.count_nonzero(lost)} such spots)" if np.count_nonzero(lost) > 1 else ""
    return f"{data.where(pose)}: {targets[target]} was seen, but in {where} its beam does not meet the screen{count}"


def as_spots(data: Measurements) -> Measurements:
    """Measurements with spots in pixels turned into spots on the screen, where the camera's calibration has it; nothing else is kept."""
    return replace(data, readings=tuple(_on_screen(reading, data.camera) for reading in data.readings if reading.kind.beam), lengths=())


def _on_screen(own: Readings, camera: Any) -> Readings:
    if own.kind.on_screen:
        return own
    spots = np.full((len(own.values), 2), np.nan)
    spots[own.seen] = camera.spots_of_pixels(own.values[own.seen])
    return Readings("spot", own.target, own.link, spots, own.labels, np.full(len(spots), np.nan))
