"""What an estimator sees of a problem at one state: residual, Jacobian, and which numbers are one reading."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Array3, Mask, Matrix, Vector
from urdfcal.estimation.normal import Numbers, Summing, Sums

Kinds = npt.NDArray[np.intp]
Linearise = Callable[[Vector], "Linearisation"]


@dataclass(frozen=True)
class Block:
    """Numbers of a pose that are one observation: a spot, a point, an orientation.

    Attributes:
        name: What tables call it: the laser, or the target.
        columns: Its numbers among those of a pose.
        kind: Index of its noise.
        unit: In which tables give it: `mm`, `deg` or `px`.
    """

    name: str
    columns: slice
    kind: int = 0
    unit: str = "mm"


@dataclass(frozen=True)
class Linearisation:
    """Residual and Jacobian of a whole set of poses at one state.

    Attributes:
        residual: m - h(x), (n, m), 0 where nothing was measured.
        jacobian: (n, m, p), 0 where nothing was measured; where a function was given in its place, worked out when it is first wanted.
        joint_jacobian: Derivative by the measured joints, (n, m, inputs).
        measured: Which of the m numbers of each pose were measured, (n, m).
        stated_sigma: Standard deviation stated with each number, (n, m), nan for none.
        blocks: Which numbers are one observation, and whose noise they have; one noise for all if empty.
        lost: Which observations were made and are out of the sensor's reach in the model, (n, blocks); none if it is None.
        poses: Index of the pose that each row is a reading of, (n,), without gaps; None where every row is a pose of its own.
        root: Root of the weight that each number has among those of its pose, (n, m), by which its row was scaled; None for 1.
        known: How many rows at the end are no readings, but what is known beforehand.
    """

    residual: Matrix
    jacobian: Any
    joint_jacobian: Array3
    measured: Any
    stated_sigma: Matrix
    blocks: tuple[Block, ...] = ()
    lost: Mask | None = None
    poses: Kinds | None = None
    root: Matrix | None = None
    known: int = 0

    @cached_property
    def trouble(self) -> str:
        """A key of `ekf.STOPS` if the model cannot produce what was measured, else empty."""
        if self.lost is not None and self.lost.any():
            return "left_screen"
        return "" if np.isfinite(self.residual).all() else "not_finite"

    def without(self, out: Mask) -> Linearisation:
        """The same as if some observations, (n, blocks), had not been made."""
        if not out.any():
            return self
        numbers = ~out[:, self.block_of]
        return replace(
            self,
            residual=np.where(numbers, self.residual, 0.0),
            jacobian=lambda: np.where(numbers[..., None], self.jacobian, 0.0),
            joint_jacobian=np.where(numbers[..., None], self.joint_jacobian, 0.0),
            measured=self.measured & numbers,
            lost=None if self.lost is None else self.lost & ~out,
        )

    def of_poses(self, count: int) -> Linearisation:
        """The first rows alone: those of poses, without what is known beforehand."""
        return replace(
            self,
            residual=self.residual[:count],
            jacobian=lambda: self.jacobian[:count],
            joint_jacobian=self.joint_jacobian[:count],
            measured=self.measured[:count],
            stated_sigma=self.stated_sigma[:count],
            lost=None if self.lost is None else self.lost[:count],
            known=0,
            poses=None if self.poses is None else self.poses[:count],
            root=None if self.root is None else self.root[:count],
        )

    @property
    def block_of(self) -> Kinds:
        """Which block each number of a pose belongs to, (m,)."""
        return np.repeat(np.arange(len(self.blocks)), [block.columns.stop - block.columns.start for block in self.blocks])

    @property
    def made(self) -> Mask:
        """Which observations were made, (n, blocks)."""
        return np.column_stack([np.asarray(self.measured)[:, block.columns].any(axis=1) for block in self.blocks])

    @cached_property
    def kinds(self) -> Kinds:
        """Index of the noise of each of the m numbers, (m,)."""
        kinds = np.zeros(self.residual.shape[1], dtype=np.intp)
        for block in self.blocks:
            kinds[block.columns] = block.kind
        return kinds

    @cached_property
    def shares(self) -> Any:
        """What each number counts, (n, m): 1 where it was measured, and together 1 where it was read several times at one pose."""
        if self.poses is None:
            return self.measured
        times = np.zeros((self.poses.max(initial=-1) + 1, self.residual.shape[1]))
        np.add.at(times, self.poses, self.measured)
        return np.where(self.measured, 1 / np.maximum(times, 1.0)[self.poses], 0.0)

    @property
    def counts(self) -> Vector:
        """How many numbers of each kind were measured, (kinds,); several readings of one pose are one."""
        return self.of_kinds(self.shares)

    def of_kinds(self, numbers: Any) -> Vector:
        """Sum of something that each number has, (n, m), by kind, (kinds,)."""
        return np.asarray(np.bincount(self.kinds, np.asarray(numbers.sum(axis=0), dtype=float)))

    def leverages(self, H: Matrix, P: Matrix) -> Matrix:
        """What each number was drawn towards its measurement, as a share of its variance, (n, m): the diagonal of H P H'.

        Args:
            H: Whitened Jacobian, (n m, p).
            P: Covariance of the parameters, (p, p).
        """
        return np.asarray(np.einsum("ij,ij->i", H @ P, H).reshape(self.residual.shape))

    @property
    def read(self) -> Any:
        """Which numbers were read, (n, m): not known beforehand."""
        rows = np.arange(len(self.residual)) < len(self.residual) - self.known
        return self.measured & rows[:, None]

    @property
    def unstated(self) -> Any:
        """Which numbers were measured and do not state their noise, (n, m)."""
        return self.measured & np.isnan(self.stated_sigma)

    @cached_property
    def stating(self) -> bool:
        """Whether any number states its noise."""
        return bool(np.isfinite(self.stated_sigma).any())

    @property
    def usable(self) -> bool:
        """Whether the model produces everything that was measured."""
        return not self.trouble

    @property
    def count(self) -> int:
        """How many numbers were measured; several readings of one pose are one."""
        return round(float(np.sum(self.shares)))

    @cached_property
    def sums(self) -> Sums:
        """Its normal equations by kind of noise; every number for itself, also where poses were read several times."""
        n, jacobian = len(self.residual) - self.known, self.jacobian
        summing = Summing(jacobian.shape[2], Numbers(self.kinds, self.stated_sigma[:n]))
        columns = np.concatenate([jacobian, self.residual[..., None]], axis=2)
        summing.add(np.ascontiguousarray(columns[:n].transpose(2, 1, 0)), slice(n))
        known = (columns[n:] / np.where(self.measured[n:], self.stated_sigma[n:], np.inf)[..., None]).reshape(-1, columns.shape[2])
        return summing.sums.plus(known.T @ known)

    def with_sums(self, sums: Sums) -> Linearisation:
        """The same, whose sums are known."""
        self.__dict__["sums"] = sums
        return self

    @property
    def rms(self) -> float:
        """Root of the mean squared residual of the measured numbers; of the first kind alone, where there are several."""
        residual, measured, first = self.residual, self.measured, self.kinds == 0
        if not first.all():
            residual, measured = residual[:, first], measured[:, first]
        return float(np.linalg.norm(residual) / np.sqrt(max(int(np.count_nonzero(measured)), 1)))


class _WhenAsked:
    """A field that may be given as a function, which is asked for it once, when somebody wants it."""

    def __init__(self, name: str) -> None:
        self.name = name

    def __get__(self, instance: object, owner: type) -> Any:
        known = instance.__dict__
        if callable(known[self.name]):
            known[self.name] = known[self.name]()
        return known[self.name]

    def __set__(self, instance: object, value: Any) -> None:
        instance.__dict__[self.name] = value


setattr(Linearisation, "jacobian", _WhenAsked("jacobian"))  # noqa: B010  # behind the dataclass, which would take it for a default


def remembering(linearise: Linearise) -> Linearise:
    """The same function, that knows its last answer: fit, gate, covariance and tables ask for the same state."""
    last: list[tuple[bytes, Linearisation]] = []

    def linearised(x: Vector) -> Linearisation:
        key = np.asarray(x, dtype=float).tobytes()
        if not last or last[0][0] != key:
            last[:] = [(key, linearise(x))]
        return last[0][1]

    return linearised
