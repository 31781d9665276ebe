"""What a rig may do: columns of `disturbances.py`, of all channels at once, part by part of the poses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Array3, Matrix, Vector
from urdfcal.calibration.asking.disturbances import FRAME_SIGMAS, Wave, courses_of, frame_terms, of_frame, progress, terms_of, waves_of
from urdfcal.calibration.asking.questions import Question
from urdfcal.calibration.channel import Channel, Rows
from urdfcal.calibration.problem import Problem
from urdfcal.model.jacobian import ArmMotion
from urdfcal.model.rig_terms import RigTerm
from urdfcal.sensors.sensor import View

Places = npt.NDArray[np.intp]


@dataclass(frozen=True)
class _Own:
    """What is done to one channel.

    Attributes:
        channel: The channel.
        instrument: Of each thing that its instrument may do, the columns of its numbers.
        frame: Columns of what its frame may do, for every wave, (waves, 7).
    """

    channel: Channel
    instrument: list[list[int]]
    frame: Places

    @property
    def count(self) -> int:
        """How many columns there are."""
        return sum(map(len, self.instrument)) + self.frame.size


class RigColumns:
    """Columns of what the rig may do at some state, in units of their usual sizes.

    Attributes:
        terms: What each column is.
    """

    def __init__(self, model: Problem, x: Vector) -> None:
        """Of all channels that read anything."""
        self.model, self.x, self.terms = model, x, list[RigTerm]()
        rows, motion = next(model.motions(x))
        read = [channel for channel in model.channels if channel.readings.measured.any()]
        self._own = [self._of(channel, channel.view(motion, rows, x)) for channel in read]

    def _of(self, channel: Channel, view: View) -> _Own:
        """Of one channel, whose terms are told by a view of any pose."""
        one = View(view.p[:1], view.R[:1], view.place[:1], view.axes[:1])
        instrument = [self._columns(terms_of(own)) for own in channel.sensor.disturbances(one)]
        frame = self._columns(frame_terms(channel.sensor, self._waves))
        return _Own(channel, instrument, np.array(frame, dtype=np.intp).reshape(len(self._waves), -1))

    def _columns(self, terms: Sequence[RigTerm]) -> list[int]:
        """Which columns some terms have; those of a new name get one."""
        known = {term.name: number for number, term in enumerate(self.terms)}
        self.terms += [term for term in terms if term.name not in known]
        return [known.setdefault(term.name, len(known)) for term in terms]

    @cached_property
    def _waves(self) -> list[Wave]:
        return waves_of(progress(self.model.data, courses_of(self.model.data)))

    @cached_property
    def _along(self) -> Matrix:
        """The waves over all poses, beside a drift, (waves, n)."""
        return np.array([wave.along * wave.share for wave in self._waves]).reshape(-1, len(self.model.data))

    def fill(self, out: Array3, motion: ArmMotion, rows: Rows, weights: Matrix) -> None:
        """Columns of some poses times weights, (m, n), (m, 1) or (), into an array of their own, (terms, m, n)."""
        if not self._all_alike:
            out[:] = 0.0
        for own in self._own:
            numbers = own.channel.block.columns
            self._fill(out[:, numbers], own, motion, rows, weights[numbers] if weights.ndim else weights)

    @cached_property
    def _all_alike(self) -> bool:
        """Whether everything may be done to every number."""
        numbers = sum(own.channel.sensor.numbers for own in self._own)
        return numbers == self.model.measured.shape[1] and all(own.count == len(self.terms) for own in self._own)

    def _fill(self, out: Array3, own: _Own, motion: ArmMotion, rows: Rows, weights: Matrix) -> None:
        """The same of one channel's numbers, (terms, k, n)."""
        channel = own.channel
        measured = channel.readings.measured[rows].T * weights
        view = channel.view(motion, rows, self.x)
        for places, does in zip(own.instrument, channel.sensor.disturbances(view), strict=True):
            out[places] = _told(does.columns * does.sigma, measured)
        twists = _told(of_frame(view, channel.sensor.look(view, channel.values[rows])) * FRAME_SIGMAS, measured)
        for columns, along in zip(own.frame, self._along[:, rows], strict=True):
            out[columns] = twists * along


def rig_questions(terms: Sequence[RigTerm], first: int) -> Iterator[Question]:
    """About each thing that a rig may do; what wanders is a drift, too."""
    for what in dict.fromkeys(term.what for term in terms):
        columns = np.array([first + number for number, term in enumerate(terms) if term.what == what], dtype=np.intp)
        yield Question("drift" if what == "wander" else what, "", columns, float(np.log(2)) if what in ("drift", "wander") else 0.0)


def _told(columns: Array3, weights: Matrix) -> Array3:
    """Columns (n, k, c) times weights (k, n), 0 where nothing was measured, as (c, k, n); a beam that meets no screen is moved nowhere."""
    turned = columns.transpose(2, 1, 0)
    return np.where(np.isfinite(turned) & (weights != 0), turned, 0.0) * weights
