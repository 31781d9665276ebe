"""What the data of a robot say of its joints' errors: a Gaussian, everything else marginalised out.

It has information L and vector h. Under a prior N(0, D) the errors are N(P h, P), P = (L + D^-1)^-1, and the data's log evidence is

    1/2 [log det D^-1 - log det(L + D^-1) + h' P h].

L is what a fit's posterior has beyond its prior, P^-1 - D^-1. Where that prior was chosen by the data, the posterior is a little wider than
the one of known variances, and L a little less.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from urdfcal.base.geometry import Array3, Matrix, Vector
from urdfcal.model.parameters import Parameter


@dataclass(frozen=True, eq=False)
class Likelihood:
    """What a robot's data say of its joints.

    Attributes:
        names: Parameters.
        groups: `translation`, `rotation` or `zero` of each.
        information: L, (k, k).
        vector: h, (k,).
    """

    names: tuple[str, ...]
    groups: tuple[str, ...]
    information: Matrix
    vector: Vector

    @staticmethod
    def of(
        names: Sequence[str], units: Sequence[str], x: Vector, P: Matrix, prior_sigma: Vector, prior_mean: Vector | None = None
    ) -> Likelihood:
        """From a posterior N(x, P) and the standard deviations of the prior before it, whose mean is zero if none is stated."""
        scaled = np.linalg.inv(P / np.outer(prior_sigma, prior_sigma))
        size, V = np.linalg.eigh((scaled + scaled.T) / 2 - np.eye(len(x)))
        beyond = (V * np.maximum(size, 0.0)) @ V.T
        groups = tuple(Parameter(name, unit, "joint", 0.0, 1.0).scale_group for name, unit in zip(names, units, strict=True))
        beside = x if prior_mean is None else x - prior_mean
        vector = (beyond @ (x / prior_sigma) + beside / prior_sigma) / prior_sigma
        return Likelihood(tuple(names), groups, beyond / np.outer(prior_sigma, prior_sigma), vector)

    def posterior(self, variance: Vector) -> tuple[Vector, Matrix]:
        """X and P under a prior with these variances, (k,)."""
        P: Matrix = np.asarray(np.linalg.inv(self.information + np.diag(1 / variance)), dtype=np.float64)
        return P @ self.vector, P

    def evidence(self, scales: Mapping[str, float], mean: Mapping[str, float] | None = None) -> float:
        """Log evidence of the data, but for a constant, under a prior of these scales about a mean, [m] and [rad] by name."""
        return Alike.stacked([self])[0].about(mean or {}).evidence(scales)

    def variances(self, scales: Mapping[str, float]) -> Vector:
        """Of every parameter's group."""
        return np.array([scales[group] ** 2 for group in self.groups])


@dataclass(frozen=True, eq=False)
class Alike:
    """Robots with the same parameters, stacked.

    Attributes:
        names: Parameters.
        groups: Of each.
        information: (r, k, k).
        vector: (r, k).
        constant: Of the log evidence, where errors are counted from elsewhere, (r,).
    """

    names: tuple[str, ...]
    groups: tuple[str, ...]
    information: Array3
    vector: Matrix
    constant: Vector

    @staticmethod
    def stacked(robots: Sequence[Likelihood]) -> list[Alike]:
        """Robots by their parameters."""
        alike: dict[tuple[str, ...], list[Likelihood]] = {}
        for own in robots:
            alike.setdefault(own.names, []).append(own)
        return [
            Alike(
                names,
                own[0].groups,
                np.array([each.information for each in own]),
                np.array([each.vector for each in own]),
                np.zeros(len(own)),
            )
            for names, own in alike.items()
        ]

    def about(self, mean: Mapping[str, float]) -> Alike:
        """The same of what is left of the errors beyond a mean."""
        m = np.array([mean.get(name, 0.0) for name in self.names])
        seen = self.information @ m
        return replace(self, vector=self.vector - seen, constant=self.constant + self.vector @ m - 0.5 * seen @ m)

    def posterior(self, scales: Mapping[str, float]) -> tuple[Vector, Matrix, Array3]:
        """Variances of the prior (k,), errors (r, k) and their covariances (r, k, k)."""
        variance = np.array([scales[group] ** 2 for group in self.groups])
        P: Array3 = np.asarray(np.linalg.inv(self.information + np.diag(1 / variance)), dtype=np.float64)
        return variance, (P @ self.vector[..., None])[..., 0], P

    def told(self, scales: Mapping[str, float]) -> tuple[Matrix, Matrix]:
        """Of every robot and parameter: x^2, and how far the data decide it, (r, k) each."""
        variance, x, P = self.posterior(scales)
        return x**2, 1 - np.diagonal(P, axis1=1, axis2=2) / variance

    def evidence(self, scales: Mapping[str, float]) -> float:
        """Log evidence of all of them."""
        variance, x, P = self.posterior(scales)
        log_det = float(np.linalg.slogdet(P)[1].sum()) - len(P) * float(np.log(variance).sum())
        return 0.5 * (log_det + float(np.sum(self.vector * x))) + float(self.constant.sum())

    def of_mean(self, scales: Mapping[str, float]) -> tuple[Array3, Matrix]:
        """What each says of a mean that all share: information (r, k, k) and vector (r, k), its own errors marginalised out."""
        variance, x, P = self.posterior(scales)
        return np.diag(1 / variance) - P / np.outer(variance, variance), x / variance
