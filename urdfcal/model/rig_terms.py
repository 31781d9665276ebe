"""What the rig does beside standing still: numbers of the measurement, not of the robot, that are estimated with its geometry.

A term moves every reading by its columns, a function of the pose, the reading and the time, times one number of the state. It never
reaches the calibrated robot: what a bowed screen or a tracker that drifts does to the readings is kept out of the joints.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from urdfcal.base.geometry import Vector


@dataclass(frozen=True)
class RigTerm:
    """One number.

    Attributes:
        name: `<what>.<number>`, as `screen_bow.bow_yy` or `drift.screen_trans_x`.
        unit: Of the number.
        sigma: Prior standard deviation, in `unit`.
    """

    name: str
    unit: str
    sigma: float

    @property
    def what(self) -> str:
        """What does it: `screen_bow`, `lens`, `readings_scale`, `drift`, `wander` or `temperature`."""
        return self.name.partition(".")[0]


@dataclass(frozen=True)
class Course:
    """Something that goes on while poses are measured, as a number about zero: (value - midst) / span.

    Attributes:
        midst, span: Of the fitted poses, in the unit of the values: [s], poses or [degC].
        series: Of the poses, if the values count only among those of one; the empty string else.
    """

    midst: float
    span: float
    series: str = ""

    @staticmethod
    def of(values: Vector, series: str = "") -> Course | None:
        """The course that some values take; None where they stand still or are not all known."""
        if not len(values) or not np.isfinite(values).all() or not np.ptp(values) > 0:
            return None
        return Course(float(values.min() + np.ptp(values) / 2), float(np.ptp(values)), series)

    def at(self, values: Vector) -> Vector:
        """From -1/2 to 1/2 over the fitted poses, (n,)."""
        return (values - self.midst) / self.span


@dataclass(frozen=True)
class Rig:
    """What a rig does beside standing still.

    Attributes:
        terms: Each number of it that is estimated.
        courses: Of `time` and `temperature`, as far as terms go with them.
    """

    terms: tuple[RigTerm, ...]
    courses: Mapping[str, Course]
