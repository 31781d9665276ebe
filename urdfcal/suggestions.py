"""Whether further measurements would be worth the trouble: what is open before and after them."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np

from urdfcal.ekf import Belief, compress, update
from urdfcal.error_model import INSTRUMENTS, ErrorModel
from urdfcal.geometry import Matrix, Vector
from urdfcal.identifiability import identify
from urdfcal.measurements import Measurements
from urdfcal.noise import Noise
from urdfcal.spot_model import model_for

_WORTH_A_WORD = 0.15  # share of the open uncertainty that a suggestion must remove beyond what as many more of the same poses would


@dataclass(frozen=True)
class Suggestion:
    """Measurements that would help.

    Attributes:
        words: What to measure.
        gain: Share of the open uncertainty that they remove, beyond what as many more of the same poses would.
        determines: Parameters that would be determined in addition.
    """

    words: str
    gain: float
    determines: tuple[str, ...] = ()


def whitened(errors: ErrorModel, data: Measurements, noise: Noise, x: Vector) -> Matrix:
    """Jacobian of everything that was measured, in units of its noise, (m, p)."""
    here = model_for(errors, data, noise).linearise(x)
    return noise.weights(here).jacobian(here)


def posterior_of(errors: ErrorModel, H: Matrix) -> Matrix:
    """Covariance that measurements with this whitened Jacobian leave of the prior, (p, p)."""
    rows, _ = compress(H, np.zeros(len(H)), errors.sigma)
    return update(Belief.independent(errors.mean, errors.sigma), np.zeros(len(rows)), rows, np.eye(len(rows)))[0].P


def open_share(errors: ErrorModel, P: Matrix) -> float:
    """How much of the prior is left: the sum of posterior over prior variances of the robot's own parameters."""
    own = np.array([parameter.kind not in INSTRUMENTS for parameter in errors.parameters])
    return float(np.sum((np.diag(P)[: len(own)] / errors.sigma**2)[own]))


def determined_names(errors: ErrorModel, P: Matrix) -> list[str]:
    """The robot's own parameters that are determined under a posterior; rows of P behind ours are left out."""
    p = len(errors.names)
    found = identify(errors.names, errors.mean, P[:p, :p], errors.sigma).determined
    return [each.name for each, yes in zip(errors.parameters, found, strict=True) if yes and each.kind not in INSTRUMENTS]


def if_worth(errors: ErrorModel, words: str, before: float, P: Matrix, known: Collection[str]) -> Iterator[Suggestion]:
    """The suggestion, if it removes enough of what was open before, or determines what is not known yet."""
    gain = 1 - open_share(errors, P) / before
    more = tuple(name for name in determined_names(errors, P) if name not in known)
    if gain > _WORTH_A_WORD or more:
        yield Suggestion(words, gain, more)


def is_wider(new: Vector, old: Vector) -> bool:
    """Whether one joint's positions reach farther than others."""
    return bool(np.ptp(new) > 1.2 * np.ptp(old) + 1e-9)
