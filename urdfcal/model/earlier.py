"""What an earlier calibration decided of a robot's joints: the prior of a later one that shares some of them.

The earlier state x ~ N(0, P) is counted from the origins that were written, each parameter a twist of its joint's placement. Of the
joints that both calibrations have, s, the marginal P_ss is what is known. Since the prior of every parameter is in it already, a later
fit gets what lies beyond that,

    W' W = P_ss^-1 - diag(1 / sigma^2),

as rows of its own. The joints that the earlier one alone has, l, follow: what is said of s is said of them,

    x_l = G x_s,    P_ll' = P_ll - G (P_ss - P_ss') G',    G = P_ls P_ss^-1.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from urdfcal.base.geometry import SE3, Matrix, Vector, six_screws
from urdfcal.model.parameters import DEFAULT_PRIORS, FLAT
from urdfcal.robot.rig import SIX

_HELD = 1e-9  # [m] and [rad]: rounding


@dataclass(frozen=True, eq=False)
class EarlierJoints:
    """A Gaussian over the placements of joints, about the origins that a calibration wrote.

    Attributes:
        names: Of its parameters, `<joint>.<parameter>`.
        sigma: What their priors were, (k,), [m] and [rad].
        screws: Twist [v, w] of the joint's placement, in its own axes, per unit of each parameter, (6, k).
        covariance: Of the parameters, (k, k).
        origins: What was written, by joint.
    """

    names: tuple[str, ...]
    sigma: Vector
    screws: Matrix
    covariance: Matrix
    origins: Mapping[str, SE3]

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Joints that the parameters are of, (k,)."""
        return tuple(name.rpartition(".")[0] for name in self.names)

    def of(self, joint: str) -> dict[str, Vector]:
        """Screw of each parameter of one joint, (6,), by the second half of its name."""
        rows = zip(self.joints, self.names, self.screws.T, strict=True)
        return {name.rpartition(".")[2]: screw for own, name, screw in rows if own == joint}

    def sigma_of(self, name: str) -> float:
        """What the prior of a parameter was."""
        return float(self.sigma[self.names.index(name)])

    def rows(self, joints: Collection[str], names: Sequence[str]) -> Matrix:
        """What is known beyond the priors of the parameters with these names, whitened, (shared, p); what is not among them is held.

        Args:
            joints: All that the later calibration shares.
            names: Of its state, (p,).
        """
        shared = self._shared(joints)
        free = [row for row, index in enumerate(shared) if self.names[index] in names]
        sigma = self.sigma[[shared[row] for row in free]]
        beyond = np.linalg.inv(self._block(shared, shared))[np.ix_(free, free)] - np.diag(1 / sigma**2)
        values, vectors = np.linalg.eigh((beyond + beyond.T) / 2)
        whitened = np.zeros((len(free), len(names)))
        whitened[:, [names.index(self.names[shared[row]]) for row in free]] = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
        return whitened

    def in_six(self, joints: Collection[str]) -> EarlierJoints:
        """What is known of joints, as all six numbers of each placement; what the gauge left out is as unsure as a joint usually is."""
        own = [index for index, joint in enumerate(self.joints) if joint in joints]
        names = list(dict.fromkeys(self.joints[index] for index in own))
        S = np.zeros((6 * len(names), len(own)))
        for column, index in enumerate(own):
            row = 6 * names.index(self.joints[index])
            S[row : row + 6, column] = self.screws[:, index]
        usual = np.tile([DEFAULT_PRIORS["joint"].sigma(unit) for unit in ("m",) * 3 + ("rad",) * 3], len(names))
        beside = np.eye(len(S)) - S @ np.linalg.pinv(S)
        covariance = S @ self._block(own, own) @ S.T + beside @ np.diag(usual**2) @ beside.T + _HELD**2 * np.eye(len(S))
        every = tuple(f"{joint}.{name}" for joint in names for name in SIX)
        screws = np.tile(six_screws(), len(names))
        return EarlierJoints(every, np.full(len(every), FLAT), screws, covariance, {joint: self.origins[joint] for joint in names})

    def followers(self, joints: Collection[str], names: Sequence[str]) -> dict[str, Matrix]:
        """How far the placement of each joint that is not shared follows the state, as a twist in its own axes, (6, p), by joint."""
        gain = self._gain(joints) @ self._selection(joints, names)
        twists: dict[str, Matrix] = {}
        for row, index in enumerate(self._rest(joints)):
            twists[self.joints[index]] = twists.get(self.joints[index], 0.0) + np.outer(self.screws[:, index], gain[row])
        return twists

    def updated(self, joints: Collection[str], names: Sequence[str], P: Matrix) -> tuple[EarlierJoints, Matrix]:
        """What is known of the joints that are not shared once the state has covariance P (p, p), and how they vary with it, (l, p)."""
        shared, rest, selection, gain = self._shared(joints), self._rest(joints), self._selection(joints, names), self._gain(joints)
        left = self._block(rest, rest) - gain @ (self._block(shared, shared) - selection @ P @ selection.T) @ gain.T
        origins = {self.joints[index]: self.origins[self.joints[index]] for index in rest}
        own = EarlierJoints(tuple(self.names[index] for index in rest), self.sigma[rest], self.screws[:, rest], left, origins)
        return own, gain @ selection @ P

    def _gain(self, joints: Collection[str]) -> Matrix:
        shared = self._shared(joints)
        return np.asarray(np.linalg.solve(self._block(shared, shared), self._block(shared, self._rest(joints))).T)

    def _selection(self, joints: Collection[str], names: Sequence[str]) -> Matrix:
        """The shared parameters out of a state with these names, (shared, p); zero for those that are held."""
        return np.array([[float(name == self.names[index]) for name in names] for index in self._shared(joints)]).reshape(-1, len(names))

    def _shared(self, joints: Collection[str]) -> list[int]:
        return [index for index, joint in enumerate(self.joints) if joint in joints]

    def _rest(self, joints: Collection[str]) -> list[int]:
        return [index for index, joint in enumerate(self.joints) if joint not in joints]

    def _block(self, rows: Sequence[int], columns: Sequence[int]) -> Matrix:
        return self.covariance[np.ix_(rows, columns)]
