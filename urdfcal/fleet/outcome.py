"""What came of each robot: a row of figures for people and tables, and what its data say of its joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from urdfcal.estimation.evidence import LEAST_POSES
from urdfcal.fleet.likelihood import Likelihood

USES = {"yes": "can be used", "reservations": "with reservations", "no": "do not use", "failed": "failed"}
WHEN = ("before", "after", "test")
_FIRST, _MEAN = ("mm", "px", "deg"), "mean_"
_OF_ESTIMATED = 1e-5  # from 1 is chi-squared per degree of freedom where noise was estimated


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
        joints: The robot's `model`; names, units, values, covariance and priors of the joints' parameters, as the record has them.
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

    def means(self, when: str) -> dict[str, float]:
        """Mean distances from measured to predicted `before`, `after` or, of poses that were not fitted, `test`.

        Over all readings of a unit as people read it (mm, px, deg), by unit; empty where there are none.
        """
        told = self.result.get(when)
        if when == "test" and isinstance(told, dict):
            told = told.get("after", told)
        parts: dict[str, list[tuple[float, int]]] = {}
        for part in (told or {}).values():
            if isinstance(part, dict) and part.get("n"):
                unit = next(key.removeprefix(_MEAN) for key in part if key.startswith(_MEAN))
                parts.setdefault(unit, []).append((part[_MEAN + unit], part["n"]))
        return {unit: sum(mean * n for mean, n in own) / sum(n for _, n in own) for unit, own in parts.items()}

    def mean(self, when: str, unit: str) -> float:
        """One of them; nan where nothing is read in that unit."""
        return self.means(when).get(unit, float("nan"))

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
        x, P, sigma, mean = (np.array(told.get(key, 0.0), dtype=float) for key in ("values", "covariance", "prior_sigma", "prior_mean"))
        return Likelihood.of(told["names"], told["units"], x, P, sigma, mean)

    @property
    def model(self) -> str:
        """The robot's name in its description; robots of one name are of one model."""
        return str(self.joints.get("model", ""))

    def row(self, units: Sequence[str]) -> dict[str, Any]:
        """One row of the summary, with distances in these units."""
        poses = self.result.get("poses", {})
        return {
            "name": self.name,
            "use": self.use,
            "verdict": USES[self.use],
            "exit_code": self.code,
            "poses": poses.get("count", 0),
            **{f"{when}_{unit}": self.mean(when, unit) for unit in units for when in WHEN},
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


def by_model(outcomes: Sequence[Outcome]) -> dict[str, list[Outcome]]:
    """Robots that were fitted, by their model."""
    found: dict[str, list[Outcome]] = {}
    for own in outcomes:
        if own.result:
            found.setdefault(own.model, []).append(own)
    return found


def units_of(outcomes: Sequence[Outcome]) -> list[str]:
    """Units in which anything was read of any robot; mm where nothing was."""
    found = {unit for own in outcomes for unit in own.means("before")}
    return sorted(found, key=lambda unit: (_FIRST.index(unit) if unit in _FIRST else len(_FIRST), unit)) or ["mm"]


def summary_rows(outcomes: Sequence[Outcome]) -> list[dict[str, Any]]:
    """A row a robot, all with the same columns."""
    units = units_of(outcomes)
    return [own.row(units) for own in outcomes]


def parameter_rows(outcomes: Sequence[Outcome]) -> list[dict[str, Any]]:
    """A row for every parameter of every robot; SI."""
    return [
        {"robot": own.name, **{key: parameter[key] for key in ("name", "value", "sigma", "unit", "determined", "prior_sigma")}}
        for own in outcomes
        for parameter in own.result.get("parameters", ())
    ]
