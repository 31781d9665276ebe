"""What there is to see: what was measured in every pose, beside what the nominal and the calibrated robot make of it.

Marks stand in groups: on the screen in its axes, others in those of the measuring frame, where measured and predicted are compared.
Both robots share the screen, or without lasers the reference link, so the nominal robot is drawn where that one has it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
import pinocchio as pin

from urdfcal.base.geometry import Mask, Matrix, Vector
from urdfcal.model.options import ModelOptions
from urdfcal.output.view.cameras import SeenCamera
from urdfcal.output.view.instruments import SeenInstrument, seen_instruments
from urdfcal.output.view.placed import Mark, Placed, placed_robot
from urdfcal.output.view.screen import Sheet, sheet_of
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.spots import Beams

Frame = Literal["screen", "frame"]

MAGNIFICATIONS = (20.0, 10.0, 5.0, 2.0, 1.0)
_DISC, _LEAST_DISC = 0.0095, 0.0055  # radius of a spot's disc over the width of the bulk of the spots, and over the sheet's size
_BALL = 0.006  # radius of a target's ball over the width of the bulk of the marks
_FEW = 150  # marks, of more they are smaller
_LEAST_WIDTH = 0.3  # [m] of the marks in the measuring frame
_LONGEST: dict[Frame, float] = {"screen": 0.25, "frame": 0.06}  # over the group's size, for nine arrows out of ten
_CHOICES: dict[Frame, tuple[float, ...]] = {"screen": MAGNIFICATIONS, "frame": (500.0, 200.0, 100.0, 50.0, *MAGNIFICATIONS)}
_MOST_OF_A_BOARD = 4  # corners
_MOST_FRAMES = 6  # of links that are drawn


@dataclass(frozen=True)
class MarkGroup:
    """The marks that stand in one frame.

    Attributes:
        frame: The `screen`, or the measuring `frame`.
        phases: The marks of every robot, nominal first; predictions that are not drawn are nan.
        size: How far they extend, [m]: the sheet, or the bulk of the marks.
        radius: Of a mark, [m]: a size that can be seen and leaves room between marks.
        magnify: How many times the arrows of the last robot's errors are to be longer than the errors; None to choose.
    """

    frame: Frame
    phases: tuple[tuple[Mark, ...], ...]
    size: float
    radius: float
    magnify: float | None

    @property
    def marks(self) -> tuple[Mark, ...]:
        """As the robot that is drawn solid has them."""
        return self.phases[-1]

    @property
    def points(self) -> tuple[int, ...]:
        """Which of them have a place of their own."""
        return tuple(index for index, mark in enumerate(self.marks) if mark.is_point)

    @property
    def read(self) -> Matrix:
        """Where readings have all points at all poses, (k, 3), [m]; nan where nothing was read."""
        return np.concatenate([self.marks[index].read for index in self.points] or [np.empty((0, 3))])

    def predicted(self, phase: int) -> Matrix:
        """The same as a robot (0 the nominal one) has them."""
        return np.concatenate([self.shifted(phase, index) for index in self.points] or [np.empty((0, 3))])

    def shifted(self, phase: int, mark: int) -> Matrix:
        """Where a robot has a target, as far from the mark that is drawn as from its own, (n, 3), [m].

        Sockets, planes and wires are not the same places for both robots: what is compared is how far each is from its own.
        """
        own, drawn = self.phases[phase][mark], self.marks[mark]
        return np.where(np.isnan(own.read), own.predicted, drawn.read + (own.predicted - own.read))

    @cached_property
    def errors(self) -> Vector:
        """Lengths of the drawn robot's errors that have an arrow, [m]."""
        apart = self.predicted(len(self.phases) - 1) - self.read
        return np.asarray(np.linalg.norm(apart[~np.isnan(apart[:, 0])], axis=1))

    @cached_property
    def magnification(self) -> float:
        """How many times longer the arrows of the drawn robot's errors are than the errors."""
        if self.magnify is not None:
            return self.magnify
        usual = float(np.quantile(self.errors, 0.9)) if len(self.errors) else 0.0
        return next((times for times in _CHOICES[self.frame] if times * usual < _LONGEST[self.frame] * self.size), 1.0)

    @property
    def most_magnification(self) -> float:
        """From which on the longest arrow is longer than the group is wide."""
        return self.size / float(self.errors.max()) if self.errors.any() else np.inf

    @cached_property
    def moving(self) -> tuple[int, ...]:
        """Which marks are drawn large in the pose shown: all, but of a board's many corners a few."""
        names = [mark.name for mark in self.marks]
        alike = [[index for index, own in enumerate(names) if own == name] for name in dict.fromkeys(names)]
        picked = [np.linspace(0, len(own) - 1, min(len(own), _MOST_OF_A_BOARD)).round().astype(int) for own in alike]
        return tuple(sorted(own[place] for own, places in zip(alike, picked, strict=True) for place in places))


@dataclass(frozen=True)
class Compared:
    """One row of the table of errors: a laser or a target.

    Attributes:
        name: Of the laser, or as tables name the reading.
        unit: mm, deg or px.
        phases: Errors of every robot that is drawn, nominal first, (n,) each; of a board the mean over corners; nan where nothing was read.
        means: Mean of all, of every robot; nan where nothing was measured at all.
    """

    name: str
    unit: str
    phases: tuple[Vector, ...]
    means: tuple[float, ...]


@dataclass(frozen=True)
class Scene:
    """A nominal robot, perhaps a calibrated one, and measurements (readings of nan where there are none).

    Attributes:
        robot: As the URDF has it.
        calibrated: As it was found to be, or None.
        data: Joint positions and readings.
        magnify: How many times the arrows of the last robot's errors are longer than the errors; None to choose.
        options: What is said of the instruments.
        bent: Joint positions at which the calibrated robot stands where the arm does, with what it gives way, (n, inputs), [rad] or [m];
            None where it is as stiff as its URDF.
        planned: Of poses that were planned and not measured the positions (k, inputs), [rad] or [m], that the way to the next one goes by,
            by their row, where it is not straight; None where they were measured.
    """

    robot: Robot
    calibrated: Robot | None
    data: Measurements
    magnify: float | None = None
    options: ModelOptions | None = None
    bent: Matrix | None = None
    planned: Mapping[int, Matrix] | None = None

    @property
    def solid(self) -> Robot:
        """The robot that is drawn solid: the calibrated one, else the nominal."""
        return self.calibrated or self.robot

    @cached_property
    def placed(self) -> tuple[Placed, ...]:
        """The nominal robot with its instruments placed, then the calibrated one."""
        robots = [(self.robot, self.data)] if self.calibrated is None else [(self.robot, self.data), (self.calibrated, self.bent_data)]
        return tuple(placed_robot(robot, data, self.options) for robot, data in robots)

    @property
    def bent_data(self) -> Measurements:
        """What was measured at the joint positions of the robot that is drawn solid."""
        return self.data if self.bent is None else replace(self.data, q=self.bent)

    @cached_property
    def frames(self) -> tuple[str, ...]:
        """Links whose frames are drawn: the root's and, where nothing else shows them, those of the module or the targets."""
        rig = self.solid.rig
        ends = (rig.tip,) if rig.lasers else ()
        targets = tuple(target.link for target in rig.instruments.targets)
        return tuple(dict.fromkeys((self.solid.tree.root, *ends, *targets)))[:_MOST_FRAMES]

    @cached_property
    def camera(self) -> SeenCamera | None:
        """The camera that readings were made with: it is the measuring frame, or knows where the screen is."""
        camera = self.data.camera
        if camera is None or self.instruments:
            return None
        if any(reading.kind.by_camera and not reading.kind.beam for reading in self.data.readings) and "frame" in self.groups:
            return SeenCamera(camera, "frame", pin.SE3.Identity())
        there = camera.T_camera_screen is not None and "screen" in self.groups
        return SeenCamera(camera, "screen", camera.T_camera_screen.inverse()) if there else None

    @cached_property
    def instruments(self) -> tuple[SeenInstrument, ...]:
        """Everything that targets are seen from, where that is more than one."""
        return seen_instruments(self.placed[-1], self.data)

    @cached_property
    def groups(self) -> dict[Frame, MarkGroup]:
        """The marks on the screen and those in the measuring frame, as far as there are any."""
        found: dict[Frame, MarkGroup] = {}
        if any(mark.on_screen for mark in self.placed[0].marks):
            found["screen"] = self._group_on_screen()
        if not all(mark.on_screen for mark in self.placed[0].marks):
            found["frame"] = self._group_in_frame()
        return found

    def _group_on_screen(self) -> MarkGroup:
        phases = [[_if_held(mark, self.sheet) for mark in phase] for phase in self._phases(on_screen=True)]
        spots, size = _read(phases[-1])[:, 1:], self.sheet.size
        width = 2 * float(np.quantile(np.abs(spots - np.median(spots, axis=0)), 0.9)) if len(spots) else size
        radius = _crowd(spots) * float(np.clip(_DISC * width, _LEAST_DISC * size, _DISC * size))
        return MarkGroup("screen", tuple(map(tuple, phases)), size, radius, self.magnify)

    def _group_in_frame(self) -> MarkGroup:
        phases = [[_if_read(mark) for mark in phase] for phase in self._phases(on_screen=False)]
        points = _read([mark for mark in phases[-1] if mark.is_point] or phases[-1])  # orientations stand at points, where there are any
        far = np.abs(points - np.median(points, axis=0))
        size = max(_LEAST_WIDTH, 2 * float(np.quantile(far, 0.9, axis=0).max()))
        return MarkGroup("frame", tuple(map(tuple, phases)), size, _crowd(points) * _BALL * size, self.magnify)

    def _phases(self, on_screen: bool) -> list[list[Mark]]:
        """The marks of every robot on the screen, or those in the measuring frame."""
        drawn = _alone if self.planned is not None and self.calibrated is None else _as_it_is
        return [[drawn(mark) for mark in placed.marks if mark.on_screen == on_screen] for placed in self.placed]

    @cached_property
    def sheet(self) -> Sheet:
        """Holds every measured spot, and predicted ones that are not too far off."""
        phases = self._phases(on_screen=True)
        predicted = [np.concatenate([mark.predicted for mark in phase]) for phase in phases]
        return sheet_of(_read(phases[0])[:, 1:], [spots[~np.isnan(spots[:, 0]), 1:] for spots in predicted])

    @cached_property
    def before(self) -> Beams:
        """The beams of the nominal robot at every pose."""
        return self.placed[0].beams(self.data.q)

    @cached_property
    def after(self) -> Beams | None:
        """Those of the calibrated robot."""
        return None if self.calibrated is None else self.placed[1].beams(self.bent_data.q)

    @property
    def shown(self) -> Beams:
        """Those of the robot that is drawn solid."""
        return self.after or self.before

    @cached_property
    def side(self) -> float:
        """The side of the screen on which the lasers stand: -1 or 1 along its x."""
        return 1.0 if float(np.median(self.shown.source[..., 0])) > 0 else -1.0

    def lands(self, beams: Beams) -> Mask:
        """Which beams end on the sheet, (n, lasers)."""
        return beams.meets_plainly & self.sheet.holds(beams.spots)

    @cached_property
    def extent(self) -> float:
        """How large all is about the screen: the sheet, or a usual beam, [m]."""
        lengths = self.shown.length[self.lands(self.shown)]
        return max(self.sheet.size, float(np.median(lengths)) if len(lengths) else 0.0)

    @property
    def most_magnification(self) -> float:
        """From which on the longest arrow is longer than the screen, or than the targets' marks are apart."""
        return min((group.most_magnification for group in self.groups.values()), default=np.inf)

    @cached_property
    def compared(self) -> tuple[Compared, ...]:
        """The rows of the table of errors: lasers, then targets."""
        rows = dict.fromkeys((mark.name, mark.unit, mark.on_screen) for group in self.groups.values() for mark in group.marks)
        return tuple(_compared(row, [placed.marks for placed in self.placed]) for row in rows)


def _compared(row: tuple[str, str, bool], phases: Sequence[Sequence[Mark]]) -> Compared:
    """One row of the table, of the marks that belong to it."""
    marks = [[mark.errors for mark in phase if (mark.name, mark.unit, mark.on_screen) == row] for phase in phases]
    errors = [np.array(own) for own in marks]  # (k, n)
    count = [np.maximum((~np.isnan(own)).sum(axis=0), 1e-9) for own in errors]
    mean = [np.where(np.isnan(own).all(axis=0), np.nan, np.nansum(own, axis=0) / number) for own, number in zip(errors, count, strict=True)]
    return Compared(row[0], row[1], tuple(mean), tuple(float(np.nanmean(own)) if np.isfinite(own).any() else np.nan for own in errors))


def _read(marks: Sequence[Mark]) -> Matrix:
    """Every place that was read, (k, 3), [m]."""
    return np.concatenate([mark.read[mark.was_read] for mark in marks] or [np.empty((0, 3))])


def _crowd(places: Matrix) -> float:
    """How much smaller marks are where there are many."""
    return float(min(1.0, (_FEW / max(len(places), 1)) ** 0.35))


def _as_it_is(mark: Mark) -> Mark:
    return mark


def _alone(mark: Mark) -> Mark:
    """The same without predictions: of what is planned they are where it is planned."""
    return replace(mark, predicted=np.full_like(mark.predicted, np.nan))


def _if_held(mark: Mark, sheet: Sheet) -> Mark:
    """The same without predictions off the sheet."""
    return replace(mark, predicted=np.where(sheet.holds(mark.predicted[:, 1:])[:, None], mark.predicted, np.nan))


def _if_read(mark: Mark) -> Mark:
    """The same without predictions where nothing was read."""
    return replace(mark, predicted=np.where(mark.was_read[:, None], mark.predicted, np.nan))
