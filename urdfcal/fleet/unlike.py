"""Who of a fleet is unlike the others: in what is left after calibration, or in an error of a joint."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from urdfcal.base.geometry import DEG, MM, Vector
from urdfcal.fleet.outcome import Outcome, by_model, units_of
from urdfcal.model.parameters import Parameter

_FAR = 4.0  # robust standard deviations from the fleet's median by which a robot stands out
_LEAST_SPREAD = 0.1  # of the logarithm of an error after calibration
_LEAST = 5  # robots below which nobody can stand out
_SI = {"mm": ("m", MM), "deg": ("rad", DEG)}


@dataclass(frozen=True)
class StandsOut:
    """Something of a robot that is unlike the fleet's.

    Attributes:
        robot: Its name.
        what: A parameter, or `error after calibration`.
        value: Its own, [m], [rad] or [px].
        median: The fleet's.
        times: How many robust standard deviations it is off, its own uncertainty included.
        unit: Of value and median.
    """

    robot: str
    what: str
    value: float
    median: float
    times: float
    unit: str


def standing_out(outcomes: Sequence[Outcome]) -> list[StandsOut]:
    """Who is unlike the others of its model, the farthest first.

    Of a parameter the fleet's spread is its own, and no less than usual in its group.
    """
    found = [each for own in by_model(outcomes).values() if len(own) >= _LEAST for each in _among(own)]
    return sorted(found, key=lambda each: -abs(each.times))


def _among(fitted: Sequence[Outcome]) -> list[StandsOut]:
    """The same among robots of one model."""
    found = []
    for unit in units_of(fitted):
        si, size = _SI.get(unit, (unit, 1.0))
        after = size * np.array([own.mean("after", unit) for own in fitted])
        found += _Over(tuple(own.name for own in fitted), "error after calibration", si, after).apart(_LEAST_SPREAD)
    over = list(_over_the_fleet(fitted))
    for each in over:
        alike = [other.spread for other in over if other.group == each.group]
        found += each.apart(float(np.median(alike)))
    return found


def _over_the_fleet(fitted: Sequence[Outcome]) -> Iterator[_Over]:
    """Every joint parameter of the robots that determine it."""
    told: dict[str, list[tuple[str, Mapping[str, Any]]]] = {}
    for own in fitted:
        joints = set(own.joints.get("names", ()))
        for parameter in own.result["parameters"]:
            if parameter["name"] in joints and parameter["determined"]:
                told.setdefault(parameter["name"], []).append((own.name, parameter))
    for name, known in told.items():
        if len(known) >= _LEAST:
            values, sigmas = (np.array([parameter[key] for _, parameter in known]) for key in ("value", "sigma"))
            yield _Over(tuple(robot for robot, _ in known), name, known[0][1]["unit"], values, sigmas)


@dataclass(frozen=True, eq=False)
class _Over:
    """Something of some robots; lengths [m], angles [rad]; errors, which have no sigmas, differ by factors."""

    robots: tuple[str, ...]
    what: str
    unit: str
    values: Vector
    sigmas: Vector | None = None

    @property
    def group(self) -> str:
        """Parameters of which are alike."""
        return Parameter(self.what, self.unit, "joint", 0.0, 1.0).scale_group

    @property
    def _shown(self) -> Vector:
        return self.values if self.sigmas is not None else np.log(np.maximum(self.values, 1e-12))

    @cached_property
    def spread(self) -> float:
        """Robust standard deviation."""
        return 1.4826 * float(np.nanmedian(np.abs(self._shown - np.nanmedian(self._shown))))

    def apart(self, least: float) -> list[StandsOut]:
        """Whose is far from the median."""
        if np.isfinite(self.values).sum() < _LEAST:
            return []
        off = (self._shown - np.nanmedian(self._shown)) / np.hypot(
            max(self.spread, least, 1e-12), 0.0 if self.sigmas is None else self.sigmas
        )
        middle = float(np.nanmedian(self.values))
        return [
            StandsOut(robot, self.what, float(value), middle, float(times), self.unit)
            for robot, value, times in zip(self.robots, self.values, off, strict=True)
            if abs(times) > _FAR
        ]
