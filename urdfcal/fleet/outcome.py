"""What came of each robot: a row of figures for people and tables, and what its data say of its joints."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from urdfcal.base.geometry import MM, Vector
from urdfcal.estimation.evidence import LEAST_POSES
from urdfcal.fleet.prior import Likelihood
from urdfcal.model.parameters import Parameter

_FAR = 4.0  # robust standard deviations from the fleet's median by which a robot stands out
_OF_ESTIMATED = 1e-5  # from 1 is chi-squared per degree of freedom where noise was estimated
_LEAST_SPREAD = 0.1  # of the logarithm of an error after calibration
_LEAST = 5  # robots below which nobody can stand out


@dataclass(frozen=True)
class Outcome:
    """A robot's calibration.

    Attributes:
        name: The robot.
        code: Exit code of its fit.
        message: What the fit said where it gave none.
        seconds: What it took, of processor time.
        kept: Whether it was there from an earlier run.
        result: As `fit --json` has it; empty where there is none.
        joints: Names, units, values, covariance and prior standard deviations of the joints' parameters, as the record has them.
    """

    name: str
    code: int
    message: str = ""
    seconds: float = 0.0
    kept: bool = False
    result: Mapping[str, Any] = field(default_factory=dict)
    joints: Mapping[str, Any] = field(default_factory=dict)

    @property
    def use(self) -> str:
        """`yes`, `reservations`, `no`, or `failed`."""
        return str(self.result["verdict"]["use"]) if self.result else "no" if self.code == 3 else "failed"

    def mean_mm(self, when: str) -> float:
        """Mean distance `before`, `after` or, of poses that were not fitted, `test`, over all readings, [mm]; nan where there is none."""
        told = self.result.get(when)
        if when == "test" and isinstance(told, dict):
            told = told.get("after", told)
        parts = [part for part in (told or {}).values() if isinstance(part, dict) and part.get("n")]
        count = sum(part["n"] for part in parts)
        return sum(part["mean_mm"] * part["n"] for part in parts) / count if count else float("nan")

    @property
    def noise_known(self) -> bool:
        """Whether how far off readings are was stated, or told by enough of them: else it comes out too small, and the data too sure."""
        stated = abs(self.result.get("chi_squared_per_degree_of_freedom", 1.0) - 1) > _OF_ESTIMATED
        return bool(stated or self.result.get("poses", {}).get("count", 0) >= LEAST_POSES)

    @property
    def likelihood(self) -> Likelihood | None:
        """What its data say of its joints; None where that cannot be told."""
        told = self.joints
        if not told.get("names") or not self.noise_known:
            return None
        x, P, sigma = (np.array(told[key], dtype=float) for key in ("values", "covariance", "prior_sigma"))
        return Likelihood.of(told["names"], told["units"], x, P, sigma)

    def row(self) -> dict[str, Any]:
        """One row of the summary."""
        poses = self.result.get("poses", {})
        return {
            "name": self.name,
            "use": self.use,
            "exit_code": self.code,
            "poses": poses.get("count", 0),
            "before_mm": self.mean_mm("before"),
            "after_mm": self.mean_mm("after"),
            "test_mm": self.mean_mm("test"),
            "chi_squared": self.result.get("chi_squared_per_degree_of_freedom", float("nan")),
            "rank": self.result.get("rank", 0),
            "outliers": len(self.result.get("outliers", ())),
            "seconds": round(self.seconds, 3),
            "said": self.said,
        }

    @property
    def said(self) -> str:
        """Why it failed, or what is held against it."""
        return self.message or "; ".join(self.result.get("verdict", {}).get("reasons", ()))


def parameter_rows(outcomes: Sequence[Outcome]) -> list[dict[str, Any]]:
    """A row for every parameter of every robot; SI."""
    return [
        {"robot": own.name, **{key: parameter[key] for key in ("name", "value", "sigma", "unit", "determined", "prior_sigma")}}
        for own in outcomes
        for parameter in own.result.get("parameters", ())
    ]


@dataclass(frozen=True)
class StandsOut:
    """Something of a robot that is unlike the fleet's.

    Attributes:
        robot: Its name.
        what: A parameter, or `error after calibration`.
        value: Its own, [m] or [rad].
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
    """Who is unlike the others, the farthest first: of a parameter the fleet's spread is its own, and no less than usual in its group."""
    fitted = [own for own in outcomes if own.result]
    if len(fitted) < _LEAST:
        return []
    after = MM * np.array([own.mean_mm("after") for own in fitted])
    found = _Over(tuple(own.name for own in fitted), "error after calibration", "m", after).apart(_LEAST_SPREAD)
    over = list(_over_the_fleet(fitted))
    for each in over:
        alike = [other.spread for other in over if other.group == each.group]
        found += each.apart(float(np.median(alike)))
    return sorted(found, key=lambda each: -abs(each.times))


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
