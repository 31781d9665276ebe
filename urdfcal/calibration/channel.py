"""The readings that one sensor made of one target, put to the robot: what it sees, and how that goes with the arm."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Array3, Mask, Matrix, Vector
from urdfcal.calibration.asking.disturbances import disturbed
from urdfcal.estimation.normal import Summing
from urdfcal.estimation.residual import Block
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.jacobian import ArmMotion
from urdfcal.robot.rig import Place
from urdfcal.sensors.readings import Readings
from urdfcal.sensors.sensor import Look, Sensor, View

Rows = slice | npt.NDArray[np.intp]
_UNIT = np.eye(3)


@dataclass(frozen=True)
class Channel:
    """The readings that one sensor made of one target, put to the robot.

    Attributes:
        readings: What was read.
        sensor: How it is read.
        target: Index of the target among the chain's frames.
        frame: Index of the frame that it is seen from; None for the chain's base.
        errors: The error model.
        block: What tables and gates take it for, with its numbers among those of a pose.
        at: Progress of each of the rig's courses, (n,).
    """

    readings: Readings
    sensor: Sensor
    target: int
    frame: int | None
    errors: ErrorModel
    block: Block
    at: Mapping[str, Vector] = field(default_factory=dict)

    @cached_property
    def values(self) -> Matrix:
        """The readings with something harmless where nothing was read."""
        return np.where(np.isnan(self.readings.values), np.asarray(self.sensor.blank), self.readings.values)

    @cached_property
    def _places(self) -> tuple[Place, ...]:
        return self.sensor.places(self.readings.target, self.readings.touched)

    @cached_property
    def _place_columns(self) -> npt.NDArray[np.intp]:
        """Columns of x that each pose's place has, (n, a); those of the first place where the pose touches none; -1 if they are held."""
        if not self._places:
            return np.empty((len(self.readings.labels), 0), dtype=int)
        column = self.errors.column
        table = np.array([[column.get(f"{place.name}.{name}", -1) for name in place.names] for place in self._places])
        return np.asarray(table[self._place_of_pose])

    @cached_property
    def _place_of_pose(self) -> npt.NDArray[np.intp]:
        index = {label: number for number, label in enumerate(self.readings.touched)}
        return np.array([index.get(str(label), 0) for label in self.readings.labels], dtype=int)

    @cached_property
    def _held(self) -> Matrix:
        """Values of a place's numbers that are not estimated, (n, a)."""
        table = np.array([[self.errors.held.get(f"{place.name}.{name}", 0.0) for name in place.names] for place in self._places])
        return np.asarray(table[self._place_of_pose]) if len(table) else np.empty((len(self.readings.labels), 0))

    @cached_property
    def _axes(self) -> Array3:
        """Axes that the numbers of each pose's place are in, (n, 3, 3): of a plane its normal and two tangents."""
        if not self._places:
            return np.broadcast_to(_UNIT, (len(self.readings.labels), 3, 3))
        axes = np.array([self.errors.planes.get(place.name, _UNIT) for place in self._places])
        return np.asarray(axes[self._place_of_pose])

    @property
    def places_of_poses(self) -> tuple[npt.NDArray[np.intp], Matrix, Array3]:
        """Of each pose's place: columns of x of its numbers, -1 where they are held, and those held, (n, a); its axes, (n, 3, 3)."""
        return self._place_columns, self._held, self._axes

    def view(self, motion: ArmMotion, rows: Rows, x: Vector) -> View:
        """The target as the measuring frame sees it at some poses."""
        p, R = motion.seen(self.target, self.frame)
        if not self._places:
            return View(p, R, self._held[rows], self._axes[rows])
        columns = self._place_columns[rows]
        place = np.where(columns >= 0, np.append(x, 0.0)[columns], self._held[rows])
        return View(p, R, place, self._axes[rows])

    def take(self, swept: Swept, g: Array3, look: Look, of_rig: Array3, motion: ArmMotion, rows: Rows) -> Callable[[Array3], None] | None:
        """Residual of some poses into the arrays of all of them, and its derivatives by twists in the base into g (n, m, 6).

        Returns:
            What adds derivatives by parameters that are none of the arm's, once the arm's are there; None if there are no such.
        """
        measured, own = self.readings.measured[rows], self.block.columns
        whole = bool(measured.all())
        swept.residual[rows, own] = look.residual if whole else np.where(measured, look.residual, 0.0)
        g[:, own] = motion.from_base(look.jac2 if whole else np.where(measured[..., None], look.jac2, 0.0), self.frame)
        if look.lost is not None:
            swept.lost[rows, swept.blocks.index(self.block)] = look.lost if whole else look.lost & measured.any(axis=1)
        if look.by_place is None and not of_rig.shape[2]:
            return None
        return lambda columns: self._put_beside(columns[:, own], look, of_rig, rows)

    def _put_beside(self, columns: Array3, look: Look, of_rig: Array3, rows: Rows) -> None:
        """Derivatives of some poses by places that they share, and by what the rig does, into those by all parameters, (p, m, n)."""
        measured, of_place = self.readings.measured[rows], self._place_columns[rows]
        if look.by_place is not None and (of_place >= 0).any():
            pose, number = np.arange(len(measured))[:, None, None], np.arange(measured.shape[1])[None, :, None]
            by_place = np.where(measured[..., None], look.by_place, 0.0) * (of_place >= 0)[:, None]
            columns[of_place[:, None], number, pose] += by_place  # a held number's -1 gets zeros
        columns[self._rig_columns] += np.where(measured[..., None], of_rig, 0.0).transpose(2, 1, 0)

    @cached_property
    def _rig_columns(self) -> list[int]:
        """Columns of x that are the rig's."""
        return [self.errors.column[term.name] for term in self.errors.rig.terms] if self.errors.rig is not None else []

    @cached_property
    def alike(self) -> tuple[object, ...]:
        """What channels have in common that one look does for."""
        return self.readings.sensor, self.readings.instrument, self._place_columns.shape[1]

    def with_rig(self, view: View, look: Look, rows: Rows, x: Vector) -> tuple[Look, Array3]:
        """What the sensor makes of its target with what the rig does, and by how much more it reads per unit of the rig's parameters."""
        if self.errors.rig is None:
            return look, np.empty((*look.residual.shape, 0))
        at = {name: course[rows] for name, course in self.at.items()}
        return disturbed(self.errors.rig, x[self._rig_columns], self.sensor, view, look, at)


@dataclass
class Swept:
    """What a linearisation is made of, to be filled by the channels.

    Attributes:
        residual, joint_jacobian, lost, blocks: As of a `Linearisation`.
        jacobian: The same; None where it is not kept.
        summing: Takes sums; None where there are none to be taken.
        last: Columns [J r] of the only part, (p + 1, m, n), if there is no other.
    """

    residual: Matrix
    joint_jacobian: Array3
    lost: Mask
    blocks: tuple[Block, ...]
    jacobian: Array3 | None
    summing: Summing | None
    last: Array3 | None = None

    @property
    def whole(self) -> Array3 | None:
        """The Jacobian, where there is only one part of it."""
        return None if self.last is None else np.ascontiguousarray(self.last[:-1].transpose(2, 1, 0))


def looked(channels: Sequence[Channel], views: Sequence[View], rows: Rows) -> list[Look]:
    """What a sensor makes of each of its targets."""
    sensor = channels[0].sensor
    if len(channels) == 1:
        return [sensor.look(views[0], channels[0].values[rows])]
    n, view = len(views[0].p), View(*(np.concatenate([getattr(own, what) for own in views]) for what in ("p", "R", "place", "axes")))
    every = sensor.look(view, np.concatenate([channel.values[rows] for channel in channels]))
    return [every.of(slice(first, first + n)) for first in range(0, n * len(channels), n)]
