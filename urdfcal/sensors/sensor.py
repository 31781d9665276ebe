"""What a sensor is: one kind of measurement, with its Jac2, its words and its columns; `registry.py` lists them.

A sensor knows nothing of joints. It sees a target's origin p and axes R in a measuring frame, and gives the residual m - h and the
derivative of h by the target's twist [v, w] in that frame's axes, taken at that frame's origin: the point p then moves by v + w x p.
Numbers of a place that several poses share (a socket's point, a plane, the end of a wire) are parameters of the sensor's own.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar, Literal, Protocol

import numpy as np

from urdfcal.base.geometry import DEG, MM, SE3, Array3, Array4, Labels, Mask, Matrix, Vector
from urdfcal.base.rotations import skew
from urdfcal.base.terminal import rounded
from urdfcal.robot.rig import SIX, Place
from urdfcal.robot.sheet import ScreenArea

Quantity = Literal["length", "angle", "pixel", "ratio", "label"]
QUANTITIES: Mapping[Quantity, Mapping[str, float]] = {
    "length": {"m": 1.0, "mm": MM},
    "angle": {"rad": 1.0, "deg": DEG},
    "pixel": {"": 1.0, "px": 1.0},
    "ratio": {"": 1.0},
    "label": {},
}  # units that a header may state, the default first
Change = Callable[[Matrix], Matrix]
Draw = Callable[[tuple[int, ...]], Matrix]
UNITS = {"mm": MM, "deg": DEG, "px": 1.0}
MAIN_UNIT = "mm"  # in which results are told first, where anything was read in it


@dataclass(frozen=True)
class Words:
    """How a kind of noise, and what has it, is called and told.

    Attributes:
        one, several: What a reading is called.
        noise: What its noise is called.
        unit: In which people read it: a key of UNITS.
        start_sigma: Standard deviation of a number of it before any is known, in that unit.
        most: The same that no instrument exceeds, in that unit.
        number: What one of its numbers is called, with an article.
    """

    one: str
    several: str
    noise: str
    unit: str
    start_sigma: float
    most: float
    number: str = "a measured coordinate"

    @property
    def size(self) -> float:
        """The unit in SI, [m], [rad] or [px]."""
        return UNITS[self.unit]

    @property
    def of_angles(self) -> bool:
        """Whether it is an angle, so that it tells nothing of where things are."""
        return self.unit == "deg"

    @property
    def apart(self) -> str:
        """What measured and predicted are apart by, in a word."""
        return "angle" if self.of_angles else "distance"

    def told(self, sigma: float) -> str:
        """A standard deviation in SI as `0.28 mm`."""
        return f"{rounded(sigma / self.size, 3)} {self.unit}"


@dataclass(frozen=True)
class FoundPlace:
    """A place that several poses share, as it was found.

    Attributes:
        numbers: Its numbers, (a,).
        axes: Axes that they are in, as columns (3, 3); None for the measuring frame's own.
    """

    numbers: Vector
    axes: Matrix | None = None


class Draws(Protocol):
    """What a simulated place is drawn with."""

    def point(self, far: float) -> Vector:
        """A point about the origin, (3,), [m]."""

    def axes(self) -> Matrix:
        """Any axes, (3, 3)."""


class PlaceFault(Exception):
    """Readings that tell too little of a place: the row of the first, and what was found and expected."""

    def __init__(self, row: int, message: str) -> None:
        super().__init__(message)
        self.row, self.message = row, message


class CellFault(Exception):
    """Cells that mean nothing together: in which row, of which ending, and what was found and expected.

    Of a cell without a number, beside others that have one (`lone`), the message goes on where it was said what is in it.
    """

    def __init__(self, row: int, ending: str, message: str, lone: bool = False) -> None:
        super().__init__(message)
        self.row, self.ending, self.message, self.lone = row, ending, message, lone


@dataclass(frozen=True)
class View:
    """A target as a measuring frame sees it.

    Attributes:
        p: Its origin, (n, 3), [m].
        R: Its axes, (n, 3, 3).
        place: Numbers of the place that each pose refers to, (n, a).
        axes: For planes: nominal normal and two tangents of each pose's plane as columns, (n, 3, 3).
    """

    p: Matrix
    R: Array3
    place: Matrix
    axes: Array3


@dataclass(frozen=True)
class Look:
    """What a sensor makes of it.

    Attributes:
        residual: m - h, (n, k).
        jac2: Derivative of h by the target's twist, (n, k, 6).
        by_place: Derivative of h by the place's numbers, (n, k, a); None where there are none.
        lost: Where the target is out of the sensor's reach, so that there is no h, (n,); None where that cannot be.
    """

    residual: Matrix
    jac2: Array3
    by_place: Array3 | None = None
    lost: Mask | None = None

    def of(self, rows: slice) -> Look:
        """Of some poses."""
        by_place = None if self.by_place is None else self.by_place[rows]
        return Look(self.residual[rows], self.jac2[rows], by_place, None if self.lost is None else self.lost[rows])


@dataclass(frozen=True)
class Sight:
    """What it takes for a target to be read, as far as the sensor does not know it.

    Attributes:
        area: The part of the screen that is there.
        steepest: Angle between beam and screen normal beyond which a spot is too long to be measured, [rad].
        square: Side of a square of the board that the target is a corner of, [m]; 0 where it is no board's.
        least_square: Least side of such a square in a picture, [px].
        flattest: Angle between a board's normal and the line of sight beyond which its corners are not found, [rad].
        opening: Angle about the target's +z within which it can be seen, as a reflector's, [rad]; None where nothing is said of it.
        nearest, farthest: Between which distances from its instrument a target is seen by a tracker or a mocap system, [m].
        apart: How far readings that could be taken for each other stay apart, [m].
    """

    area: ScreenArea = field(default_factory=ScreenArea)
    steepest: float = 70 * DEG
    square: float = 0.0
    least_square: float = 8.0
    flattest: float = 60 * DEG
    opening: float | None = None
    nearest: float = 0.0
    farthest: float = np.inf
    apart: float = 20 * MM

    @property
    def of_trackers(self) -> bool:
        """Whether anything is said that only trackers and mocap systems heed."""
        return self != self.without_trackers()

    def without_trackers(self) -> Sight:
        """The same without it."""
        return replace(self, opening=None, nearest=0.0, farthest=np.inf)


@dataclass(frozen=True)
class Disturbance:
    """What an instrument may do to all of its readings alike, as far as it is known what: linear in a few numbers.

    Attributes:
        what: `screen_bow`, `lens` or `readings_scale`.
        names: Of the numbers.
        unit: Of the numbers: `1/m`, `1/m^2` or the empty string.
        sigma: How large each of them usually is, a standard deviation.
        columns: What is read more per unit of each, (n, k, numbers).
        slopes: How the columns change with what would be read without, (n, numbers, k, k).
    """

    what: str
    names: tuple[str, ...]
    unit: str
    sigma: tuple[float, ...]
    columns: Array3
    slopes: Array4


class Sensor:
    """One kind of measurement.

    Attributes:
        name: What readings of it are filed under.
        noise: Whose noise it shares: several sensors may have the same.
        words: How that noise is told.
        title: What tables call it behind the target's name.
        stored: How many numbers a reading is kept as; none for a touch, which is a label.
        numbers: How many numbers its residual has, k.
        components: Their names, a letter each; the empty string where they have none.
        drawn: What marks at `drawn_at` are, in words.
        touches: Whether a reading is the touch of a labelled place.
        seen_from: The frame that p and R are in: the `screen`, a measuring frame that is placed itself (`frame`), or that of the
            places that are touched (`places`), which needs no placement.
        offset: Which numbers of the target's offset on its link matter, of SIX.
        anywhere: Whether it can read at any pose, unlike touches and pictures.
        beam: Whether the target is a laser: it leaves its frame's origin along +z.
        on_screen: Whether readings are points of the screen in metres, so that beams can be turned towards them, and what two lasers
            read be exchanged.
        aimed: Whether its target is a laser that is aimed at the instrument that it names, a screen: both stand about where the URDF has
            them, since nothing tells from nothing where they are.
        by_camera: Whether readings are pixels of a camera.
        in_pairs: Whether a touch says nothing without another one of the same place.
        others: What readings at the same poses that tell where one ought to be are called.
        simulated: How `urdfcal simulate` is asked for it, and for whatever else goes by that name; nothing where it cannot be.
        told_more_by: The sensor that would tell more of a target that this one reads; the empty string for none.
        endings: Endings of its columns behind the target's name, with what they are.
        sigma_ending: Of the column that states the noise of each reading; the empty string for none.
        empty: What to do with the cells of a reading that was not made.
        blank: Something harmless to compute with where nothing was read, (stored,).
        mark: What the mark of a reading is called in the view; the empty string for readings that say nothing of a place.
        line: What the line from `looks_from` to it is called there; the empty string where there is none.
    """

    name: ClassVar[str]
    noise: ClassVar[str]
    words: ClassVar[Words]
    title: ClassVar[str] = ""
    stored: ClassVar[int]
    numbers: ClassVar[int]
    components: ClassVar[str] = ""
    drawn: ClassVar[str] = ""
    touches: ClassVar[bool] = False
    seen_from: ClassVar[Literal["screen", "frame", "places"]] = "frame"
    offset: ClassVar[tuple[str, ...]] = SIX[:3]
    anywhere: ClassVar[bool] = False
    beam: ClassVar[bool] = False
    on_screen: ClassVar[bool] = False
    aimed: ClassVar[bool] = False
    by_camera: ClassVar[bool] = False
    in_pairs: ClassVar[bool] = False
    others: ClassVar[str] = "the other readings"
    simulated: ClassVar[tuple[str, ...]] = ()
    told_more_by: ClassVar[str] = ""
    endings: ClassVar[Mapping[str, Quantity]]
    sigma_ending: ClassVar[str] = "sigma"
    empty: ClassVar[str] = "leave the cell empty if it was not read"
    blank: ClassVar[Sequence[float]] = (0.0,)
    mark: ClassVar[str] = ""
    line: ClassVar[str] = ""

    @property
    def role(self) -> Literal["laser", "target"]:
        """What its target is among the chain's frames."""
        return "laser" if self.beam else "target"

    def look(self, view: View, values: Matrix) -> Look:
        """Residual and derivatives at one state."""
        raise NotImplementedError

    def read(self, view: View) -> Matrix:
        """What it reads without noise, as readings keep it, (n, stored)."""
        raise NotImplementedError

    def predicted(self, view: View) -> Matrix:
        """Where the robot has what is read, as a point of the measuring frame, (n, 3), [m]; nan where it has it nowhere."""
        return view.p

    def disturbances(self, view: View) -> tuple[Disturbance, ...]:
        """What an instrument of this kind may do to all of its readings, at some poses."""
        return ()

    def shown(self, view: View, values: Matrix) -> Matrix:
        """Where readings (n, stored) have it, (n, 3), [m]; what they do not say is taken from the prediction."""
        return self.predicted(view)

    def points(self, values: Matrix) -> Matrix | None:
        """The target's origin in the measuring frame as readings have it, (n, 3), [m], nan where they do not; None where they never do."""
        return None

    def rays(self, values: Matrix) -> Matrix | None:
        """Directions from the measuring frame's origin to the target as readings have them, (n, 3); None where they have none."""
        return None

    def axes(self, values: Matrix) -> Array3 | None:
        """The target's axes as readings have them, (n, 3, 3); None where they say nothing of them."""
        return None

    def looks_from(self, view: View) -> Matrix | None:
        """Where the line to the target begins, (n, 3), [m]; None where nothing looks at it."""
        return None

    def unseen(self, view: View, sight: Sight) -> Mapping[str, Mask]:
        """Why there can be no reading at some poses, each reason with the poses (n,) that it holds at; the first that holds is told."""
        return {}

    def sight_lines(self, view: View) -> tuple[Matrix, Matrix] | None:
        """Both ends (n, 3), [m], of what nothing may cross, the target's second; None for no such line, or an unknown one."""
        begin = self.looks_from(view)
        return None if begin is None else (begin, view.p)

    def taken_for_each_other(self, view: View) -> Matrix | None:
        """Where readings are, (n, 3), [m], that must stay apart from those of other targets; None where nobody mixes them up."""
        return None

    def normals(self, view: View) -> Matrix | None:
        """Normals of the planes that the target touches, (n, 3); None where it touches none."""
        return None

    def disturbed(self, values: Matrix, draw: Draw) -> Matrix:
        """What it reads with noise, (n, stored); `draw` gives noise of a shape, each number with the sensor's standard deviation."""
        return values + draw(values.shape) if self.stored else values

    def with_camera(self, camera: Any) -> Sensor:
        """The same sensor with the camera that it reads by, if it reads by one."""
        return self

    def refining(self, lens: str) -> Sensor:
        """The same sensor with a lens that the fit refines, by its name, if it reads by one."""
        return self

    def lacking(self, target: str, given: Collection[str]) -> tuple[str, str] | None:
        """The ending that a header lacks beside those that it has, and why it is needed; None if it lacks none."""
        return None

    def kept(self, columns: Mapping[str, Vector]) -> Matrix:
        """Numbers by ending as readings keep them, (n, stored).

        Raises:
            CellFault: some of them mean nothing together.
        """
        return np.column_stack([columns[ending] for ending in self.endings])

    def written(self, values: Matrix) -> dict[str, Vector]:
        """Readings as numbers by ending."""
        return dict(zip(self.endings, values.T, strict=True))

    def mistakes(self) -> Mapping[str, Change]:
        """Common mistakes in such readings, each as what undoes it: a change of what was kept, (n, stored)."""
        return {}

    def moved(self, values: Matrix, T_new_old: SE3) -> Matrix:
        """The same readings, (n, stored), as they are told in another measuring frame; those that stay where none is concerned."""
        return values

    def inverted(self, values: Matrix, R: Array3) -> Matrix:
        """What was meant, (n, stored), if the measuring frame was told as seen from the target, with axes R as they were told."""
        return values

    def places(self, target: str, labels: Sequence[str]) -> tuple[Place, ...]:
        """What its readings of a target have in common over poses, one for every label that was touched."""
        return ()

    def find_offset(self, R: Array3, b: Matrix, values: Matrix, labels: Labels) -> SE3 | None:
        """The target's offset on its link, from nothing, where this sensor alone tells it.

        Args:
            R: Axes of the link at poses with a reading, (n, 3, 3), in the axes of the reference link.
            b: Its origins, (n, 3), [m].
            values: What was read, (n, stored).
            labels: What was touched, (n,).
        """
        return None

    def find_places(self, target: str, p: Matrix, R: Array3, values: Matrix, labels: Labels) -> Mapping[str, FoundPlace]:
        """The places of its readings by name, from where the placed target has been, p (n, 3) with axes R (n, 3, 3).

        Raises:
            PlaceFault: there are too few readings of a place.
        """
        return {}

    def simulated_places(self, target: str, labels: Sequence[str], points: Matrix, draw: Draws) -> Mapping[str, FoundPlace]:
        """Places for a simulation, by name; `points` (1 + labels, 3) are where the target can be."""
        return {}

    def touched_from(self, place: Vector, axes: Matrix, off: Vector) -> tuple[Vector, Matrix]:
        """For touches in a simulation: a point (3,) [m], and the projection (3, 3) across which a target must come to it.

        Args:
            place: The true numbers of what is touched, (a,).
            axes: The axes that they are in, as columns, (3, 3).
            off: By how much the touch misses it, (3,), [m].
        """
        raise NotImplementedError

    def seen(self, values: Matrix, labels: Labels) -> Mask:
        """At which poses there is a reading, (n,)."""
        return np.asarray(labels != "", dtype=bool) if self.touches else ~np.asarray(np.isnan(values).all(axis=1), dtype=bool)

    def measured(self, values: Matrix, labels: Labels) -> Mask:
        """Which numbers of the residual were read, (n, k)."""
        return np.repeat(self.seen(values, labels)[:, None], self.numbers, axis=1)

    def drawn_at(self, view: View, values: Matrix) -> Matrix | None:
        """Where a map has its readings, along the axes of the residual, (n, k), [m]; None where they say nothing of it."""
        return None


def leaning(directions: Matrix, axes: Matrix) -> Vector:
    """Angles between directions and axes, both (n, 3), [rad]; nan for a direction that is none."""
    with np.errstate(invalid="ignore", divide="ignore"):
        cosines = np.sum(directions * axes, axis=1) / (np.linalg.norm(directions, axis=1) * np.linalg.norm(axes, axis=1))
        return np.asarray(np.arccos(np.clip(cosines, -1.0, 1.0)))


def wrong_scale(lengths: Matrix) -> Disturbance:
    """Lengths that are all read too long by the same share, (n, k)."""
    n, k = lengths.shape
    return Disturbance("readings_scale", ("scale",), "", (1e-3,), lengths[:, :, None], np.broadcast_to(np.eye(k), (n, 1, k, k)))


def bent_by_a_lens(places: Matrix, sigma: tuple[float, float], unit: str) -> Disturbance:
    """What is left of a lens's distortion in a picture or a plane: radial, and tangential as of a centre that is elsewhere.

    After Brown: (y, z) r^2 k, and p_1 (2 y z, r^2 + 2 z^2) + p_2 (r^2 + 2 y^2, 2 y z).

    Args:
        places: Where it would be read without, (n, 2) = (y, z).
        sigma: Usual size of k, and of p_1 and p_2.
        unit: Of k.
    """
    y, z = places.T
    square, twice = y**2 + z**2, 2 * y * z
    columns = np.array([[y * square, twice, square + 2 * y**2], [z * square, square + 2 * z**2, twice]]).transpose(2, 0, 1)
    radial = [[square + 2 * y**2, twice], [twice, square + 2 * z**2]]
    slopes = np.array([radial, [[2 * z, 2 * y], [2 * y, 6 * z]], [[6 * y, 2 * z], [2 * z, 2 * y]]]).transpose(3, 0, 1, 2)
    return Disturbance("lens", ("radial", "tangential_1", "tangential_2"), unit, (sigma[0], sigma[1], sigma[1]), columns, slopes)


def point_jacobian(p: Matrix) -> Array3:
    """Motion of points per twist at the origin, [I, -[p]x], (n, 3, 6)."""
    return np.concatenate([np.broadcast_to(np.eye(3), (len(p), 3, 3)), -skew(p)], axis=2)


def require_pair(columns: Mapping[str, Vector], message: str) -> None:
    """Refuse a reading of two numbers of which one was left out.

    Raises:
        CellFault: the first such row.
    """
    (one, first), (other, second) = columns.items()
    lone = np.isnan(first) != np.isnan(second)
    if lone.any():
        row = int(np.argmax(lone))
        raise CellFault(row, one if np.isnan(first[row]) else other, message, lone=True)


def wrong_lengths(what: str) -> dict[str, Change]:
    """Lengths in a unit that was taken for another one."""
    units = {"millimetres": MM, "centimetres": 10 * MM, "inches": 25.4 * MM}
    read_as: dict[str, Change] = {f"the {what} read as {unit}": partial(np.multiply, size) for unit, size in units.items()}
    return read_as | {f"the {what} read as metres in place of {unit}": partial(np.multiply, 1 / size) for unit, size in units.items()}
