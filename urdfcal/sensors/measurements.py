"""Laser spots and the joint positions they were seen at: `measurements.csv`, in and out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from urdfcal.base.errors import ShapeMismatch, UsageError
from urdfcal.base.geometry import Array3, Labels, Mask, Matrix, Vector
from urdfcal.robot.rig import Grid, Instruments
from urdfcal.robot.robot import Robot
from urdfcal.sensors.readings import KnownLength, Readings, instruments_of
from urdfcal.sensors.sensor import noun, start_sigma_of


@dataclass(frozen=True)
class Measurements:
    """Spots on the screen at known joint positions; SI units.

    Attributes:
        joints: Names of the measured joints.
        lasers: Names of the laser links.
        q: Joint positions, (n, joints), [rad] or [m].
        spots: (y, z) on the screen, (n, lasers, 2), [m]; nan where a beam was not seen.
        sigma: Stated standard deviation of each spot, (n, lasers), [m]; nan where nothing is stated.
        poses: Label of each pose, (n,).
        sets: `fit` or `test`, (n,).
        sessions: Session of each pose, (n,); the empty string where there is only one.
        source: Where the measurements come from, for messages.
        sha256: Hash of that file; the empty string where there is none.
        lines: Line of each pose in the file, (n,); 0 where there is none.
        warnings: What was odd but could be read.
        readings: What instruments beside lasers read.
        reference: Link that the measuring frame stands on; the empty string for the default.
        lengths: Known distances between sockets.
        payload: Mass that the arm carried at each pose, (n,), [kg]; None where nothing is said.
        boards: Links that are boards, with the grids of their corners.
        camera: What pixels were read with: a `vision.camera_model.Camera`.
        approach: Direction of each joint's last move before the pose, (n, joints): -1, 0 or 1; None where the order is not known.
    """

    joints: tuple[str, ...]
    lasers: tuple[str, ...]
    q: Matrix
    spots: Array3
    sigma: Matrix
    poses: Labels
    sets: Labels
    sessions: Labels
    source: str = ""
    sha256: str = ""
    lines: npt.NDArray[np.int_] | None = None
    warnings: tuple[str, ...] = ()
    readings: tuple[Readings, ...] = ()
    reference: str = ""
    lengths: tuple[KnownLength, ...] = ()
    payload: Vector | None = None
    approach: Matrix | None = None
    camera: Any = None
    boards: Mapping[str, Grid] = field(default_factory=dict)

    def of_laser(self, readings: Readings) -> bool:
        """Whether readings are the pixels of a laser's spots."""
        return readings.kind == "pixel" and readings.link in self.lasers

    def __post_init__(self) -> None:
        n = len(self.q)
        expected = {
            "q": (n, len(self.joints)),
            "spots": (n, len(self.lasers), 2),
            "sigma": (n, len(self.lasers)),
            "poses": (n,),
            "sets": (n,),
            "sessions": (n,),
        }
        for name, shape in expected.items():
            if getattr(self, name).shape != shape:
                raise ShapeMismatch(f"measurements: {name} has shape {getattr(self, name).shape}, expected {shape}")
        if not np.isfinite(self.q).all():
            raise ShapeMismatch("measurements: joint positions must be finite")
        if (np.isnan(self.spots[..., 0]) != np.isnan(self.spots[..., 1])).any() or np.isinf(self.spots).any():
            raise ShapeMismatch("measurements: a spot is two finite numbers, or two nan where it was not seen")
        if (self.sigma <= 0).any() or np.isinf(self.sigma).any():
            raise ShapeMismatch("measurements: a stated standard deviation is finite and above zero, or nan where nothing is stated")
        if not np.isin(self.sets, ("fit", "test")).all():
            raise ShapeMismatch("measurements: each pose belongs to the set 'fit' or 'test'")

    def __len__(self) -> int:
        """Number of poses."""
        return len(self.q)

    @property
    def seen(self) -> Mask:
        """Which beams were seen, (n, lasers)."""
        return ~np.isnan(self.spots[..., 0])

    @property
    def observed(self) -> Mask:
        """At which poses anything was seen, (n,)."""
        masks = [self.seen.any(axis=1), *(each.seen for each in self.readings)]
        return np.asarray(np.any(masks, axis=0))

    @property
    def empty(self) -> bool:
        """Whether nothing was seen at all."""
        return not self.observed.any()

    @property
    def numbers(self) -> int:
        """How many numbers were measured."""
        return 2 * int(self.seen.sum()) + sum(each.numbers for each in self.readings)

    @property
    def summary(self) -> str:
        """What was measured, in words: `120 spots`, `500 points and 500 orientations`."""
        counts = {"spot": int(self.seen.sum())} if self.seen.any() or not self.readings else {}
        for each in self.readings:
            counts[each.kind] = counts.get(each.kind, 0) + int(each.seen.sum())
        words = [f"{count} {noun(kind, count)}" for kind, count in counts.items()]
        return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)

    @cached_property
    def instruments(self) -> Instruments:
        """What the readings were made with."""
        return instruments_of(self.readings, self.reference, self.lasers, self.camera, self.boards)

    @property
    def session_names(self) -> tuple[str, ...]:
        """The sessions in order of their first pose."""
        return tuple(dict.fromkeys(str(session) for session in self.sessions))

    def subset(self, rows: npt.ArrayLike) -> Measurements:
        """Some of the poses, by mask or index."""
        index = np.asarray(rows)
        per_pose = {name: getattr(self, name)[index] for name in ("q", "spots", "sigma", "poses", "sets", "sessions")}
        readings = tuple(each.subset(index) for each in self.readings)
        left = {place.name for each in readings for place in each.places}
        lengths = tuple(known for known in self.lengths if {known.one, known.other} <= left)
        per_pose |= {name: None if (own := getattr(self, name)) is None else own[index] for name in ("payload", "approach")}
        return replace(
            self, **per_pose, readings=readings, lengths=lengths, lines=None if self.lines is None else self.lines[index], warnings=()
        )

    def split(self) -> tuple[Measurements, Measurements]:
        """The poses to fit and the poses to test, by the `set` column."""
        return self.subset(self.sets == "fit"), self.subset(self.sets == "test")

    def where(self, pose: int) -> str:
        """How a message names a pose: `arm7.csv:17`, or its label."""
        if self.lines is not None and self.lines[pose]:
            return f"{self.source}:{self.lines[pose]}"
        return f"pose {self.poses[pose]}"


def measurements_from(
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
    labels = [str(number) for number in range(1, n + 1)] if poses is None else poses
    return Measurements(
        joints=robot.chain.input_names,
        lasers=robot.rig.lasers,
        q=positions,
        spots=places,
        sigma=stated,
        poses=np.array(labels, dtype=str),
        sets=np.array(["fit"] * n if sets is None else sets, dtype="<U4"),
        sessions=np.array([""] * n if sessions is None else sessions, dtype=str),
    )


def kinds_of(data: Measurements) -> tuple[str, ...]:
    """What was measured, in the order of the noise: spots first, then the readings' kinds as they come."""
    spots = ("spot",) if data.lasers else ()
    return (*spots, *dict.fromkeys(each.kind for each in data.readings))


def start_sigma(data: Measurements) -> Vector:
    """Noise of every kind before any is known, (kinds,)."""
    return np.array([start_sigma_of(kind) for kind in kinds_of(data)])


def as_measured(robot: Robot, data: Measurements) -> Robot:
    """The robot with the instruments that some measurements were made with."""
    return robot.seen_by(data.instruments, robot.lasers if data.lasers else ()) if data.readings else robot


def fit_and_test(data: Measurements, test: Measurements | None = None) -> tuple[Measurements, Measurements | None]:
    """The poses to fit, and those to test: marked in the data, or given apart.

    Raises:
        UsageError: nothing is left to fit, or test poses come from both.
    """
    fit_set, marked = data.split()
    if fit_set.empty:
        raise UsageError("no pose is left to fit: every row with a measurement is marked as test")
    if test is not None and len(marked):
        raise UsageError("the measurements mark test poses in their 'set' column, and other test poses were given; use one of the two")
    return fit_set, test if test is not None else marked if len(marked) else None


def in_pixels(data: Measurements) -> bool:
    """Whether spots were read as pixels."""
    return any(data.of_laser(each) for each in data.readings)


def require_screen_of_camera(data: Measurements) -> None:
    """Refuse spots in pixels of a camera that does not know where the screen is.

    Raises:
        UsageError: says how to add it.
    """
    if in_pixels(data) and getattr(data.camera, "T_camera_screen", None) is None:
        raise UsageError("the camera knows no screen; add it with `urdfcal camera --lens CAMERA.yaml --screen IMAGE --markers screen.yaml`")


def as_spots(data: Measurements) -> Measurements:
    """Measurements with spots in pixels turned into spots on the screen, where the camera's calibration has it; nothing else is kept."""
    spots, sigma = data.spots.copy(), data.sigma.copy()
    for each in (each for each in data.readings if data.of_laser(each)):
        laser = data.lasers.index(each.link)
        rows = np.flatnonzero(each.seen)
        spots[rows, laser] = data.camera.spots_of_pixels(each.values[rows])
        sigma[rows, laser] = np.nan
    return replace(data, spots=spots, sigma=sigma, readings=(), lengths=())
