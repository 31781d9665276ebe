"""Bundle adjustment of a lens and the board's poses, with corners of each view weighed by how well that view's corners were found.

Corners in a blurred or oblique view scatter more than in a sharp one. With r_v the residual of view v, A_v and B_v its derivatives by the
lens and by the pose, and w_v = 1 / s_v^2, a step for the lens, poses eliminated (Schur complement), is

    S dx = sum_v w_v (A_v - B_v B_v^+ A_v)' r_v      S = sum_v w_v A_v' (1 - B_v B_v^+) A_v

and S^-1 is its covariance. A view's variance s_v^2 = (|r_v|^2 + PRIOR s^2) / (f_v + PRIOR), with f_v its degrees of freedom and s^2 that of
all views, so that a few corners do not make a view look better than it can be. Views have variances of their own where that makes the
data more probable by more than their number costs (BIC); else one variance is for all.

Corners of a view may be off together: the board is not flat, the lens is not quite the model's. Then views disagree on the lens by more
than their corners scatter, and S^-1 is too small. Without view v the lens would be at d_v = -(S - S_v)^-1 g_v from where it is, with g_v
the view's part of the gradient, which were its corners off one by one had the covariance C_v = (S - S_v)^-1 S_v S^-1; so

    excess = sum_v d_v' S d_v / sum_v tr(S C_v)     (a jackknife over views, exact for independent corners)

is 1 on average for corners that are off one by one. Where it is above 1 by more than chance, variances are multiplied by it, or by the
like ratio of the one number of the lens where that is larger.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from urdfcal.base.errors import InputError
from urdfcal.base.geometry import SE3, Array3, Matrix, Vector
from urdfcal.sensors.lenses import Lens, projected
from urdfcal.vision.camera.boards import BoardView

DECISIVE = 6.0  # of BIC (Kass and Raftery 1995: "strong")
PRIOR = 10.0  # numbers that a view's variance is drawn to that of all views by
ALONE = 1e-9  # of what is known of a direction: others tell no more of it than rounding does
ROUNDING = 1e-15  # of an information matrix's largest eigenvalue, units made alike
CHANCE = 1.0  # standard deviations by which views must disagree for it to be believed
_SWEEPS, _HALVINGS, _STILL = 30, 8, 1e-9
_POSE = 6


@dataclass(frozen=True, eq=False)
class Bundle:
    """A lens and poses, as views of a board have them.

    Attributes:
        views: Boards in pictures.
        lens: The model.
        matrix: Camera matrix, (3, 3), [px].
        distortion: Its numbers.
        poses: T_camera_board of each view.
        variances: Of a corner's coordinate in each view, (views,), [px^2].
    """

    views: tuple[BoardView, ...]
    lens: Lens
    matrix: Matrix
    distortion: Vector
    poses: tuple[SE3, ...]
    variances: Vector

    @property
    def numbers(self) -> int:
        """How many the lens has."""
        return 4 + len(self.distortion)

    def looks(self) -> list[_Look]:
        """Every view as the lens has it.

        Raises:
            InputError: a view lies outside the range of the lens model.
        """
        return [self._look(view, pose) for view, pose in zip(self.views, self.poses, strict=True)]

    def _look(self, view: BoardView, pose: SE3) -> _Look:
        seen, by_point, by_lens = projected(view.points @ pose.rotation.T + pose.translation, self.matrix, self.distortion, self.lens)
        if not np.isfinite(seen).all():
            raise InputError(f"no {self.lens} lens explains the views: {view.name} lies outside the model's range")
        twist = np.concatenate([np.broadcast_to(np.eye(3), (len(seen), 3, 3)), -_skew(view.points)], axis=2)
        B = (by_point @ pose.rotation @ twist).reshape(-1, _POSE)
        A = by_lens.reshape(-1, self.numbers)
        to_pose = np.linalg.pinv(B)
        return _Look((view.pixels - seen).ravel(), A - B @ (to_pose @ A), A, to_pose)

    def moved(self, dx: Vector, looks: Sequence[_Look]) -> Bundle:
        """After a step of the lens, every pose where it then fits best."""
        matrix = self.matrix.copy()
        matrix[[0, 1, 0, 1], [0, 1, 2, 2]] += dx[:4]
        turns = [pin.exp6(look.to_pose @ (look.residual - look.by_lens @ dx)) for look in looks]
        poses = tuple(pose * turn for pose, turn in zip(self.poses, turns, strict=True))
        return replace(self, matrix=matrix, distortion=self.distortion + dx[4:], poses=poses)


@dataclass(frozen=True, eq=False)
class _Look:
    """One view: residual (2n,), derivative by the lens with the pose following and with the pose held (2n, k), what moves the pose."""

    residual: Vector
    followed: Matrix
    by_lens: Matrix
    to_pose: Matrix

    @property
    def square(self) -> float:
        return float(self.residual @ self.residual)


def covariance_of(bundle: Bundle, looks: Sequence[_Look]) -> Matrix:
    """Of the lens, the poses eliminated, (k, k)."""
    W = _whitener(_information(looks, bundle.variances))
    return W @ W.T


def excess_between_views(bundle: Bundle, looks: Sequence[_Look]) -> Vector:
    """How many times farther the views' lenses lie apart, squared, than their corners' scatter explains, (k,); 1 where that is chance.

    For each number of the lens its own, and no less than that of all of them together.
    """
    W = _whitener(_information(looks, bundle.variances))
    apart, scatter, found, expected, variance = np.zeros(len(W)), np.zeros(len(W)), 0.0, 0.0, 0.0
    for look, own in zip(looks, bundle.variances, strict=True):
        seen = W.T @ look.followed.T / np.sqrt(own)
        share, V = np.linalg.eigh(seen @ seen.T)
        without = _left_out(share)
        beyond = without * share
        d = V @ (without * (V.T @ (seen @ look.residual))) / np.sqrt(own)
        apart, scatter = apart + (W @ d) ** 2, scatter + (W @ V) ** 2 @ beyond
        found, expected, variance = found + float(d @ d), expected + float(beyond.sum()), variance + 2 * float(beyond @ beyond)
    if not expected > 0 or found <= expected + CHANCE * np.sqrt(variance):
        return np.ones(len(W))
    return np.maximum(np.divide(apart, scatter, out=np.zeros(len(W)), where=scatter > 0), found / expected)


def _left_out(share: Vector) -> Vector:
    """1 / (1 - share): by how much a direction's variance grows without a view; 0 where no other view tells anything of it."""
    rest = 1 - np.clip(share, 0, 1)
    return np.where(rest > ALONE, 1 / np.maximum(rest, ALONE), 0.0)


def with_variances(bundle: Bundle) -> Bundle:
    """The same bundle with one variance for all views, or with their own, whichever the data ask for; fitted anew with their own."""
    looks = bundle.looks()
    alike = replace(bundle, variances=_shared(bundle, looks))
    if bic_of(alike, looks, own=False) < bic_of(alike, looks, own=True) + DECISIVE:
        return alike
    return _refined(replace(alike, variances=_own(alike, looks)))


def bic_of(bundle: Bundle, looks: Sequence[_Look], own: bool | None = None) -> float:
    """Schwarz's criterion, n ln(rss / n) + p ln n over the corner coordinates, with variances of each view's own or shared ones.

    Args:
        bundle: Lens and poses.
        looks: Of its views.
        own: Which of the two; the better one if None.
    """
    if own is None:
        return min(bic_of(bundle, looks, True), bic_of(bundle, looks, False))
    squares, counts = np.array([look.square for look in looks]), np.array([len(look.residual) for look in looks])
    freedom, n = np.maximum(counts - _POSE, 1), counts.sum()
    if not own:
        return float(n * np.log(squares.sum() / n) + bundle.numbers * np.log(n))
    shared = squares.sum() / freedom.sum()
    variances = (squares + PRIOR * shared) / (freedom + PRIOR)
    misfit = np.sum(squares / variances) - n * squares.sum() / (shared * n)
    return float(np.sum(counts * np.log(variances * freedom.sum() / n)) + misfit + (bundle.numbers + len(looks) - 1) * np.log(n))


def _refined(bundle: Bundle) -> Bundle:
    """Gauss-Newton with the views' own variances, which follow."""
    looks, last = bundle.looks(), np.inf
    for _ in range(_SWEEPS):
        gradient = sum(look.followed.T @ look.residual / variance for look, variance in zip(looks, bundle.variances, strict=True))
        dx = covariance_of(bundle, looks) @ gradient
        found = _stepped(bundle, looks, dx)
        if found is None:
            return bundle
        bundle, looks = found
        cost = float(np.sum(np.log(bundle.variances)))
        bundle = replace(bundle, variances=_own(bundle, looks))
        if abs(cost - last) < _STILL * len(looks):
            break
        last = cost
    return bundle


def _stepped(bundle: Bundle, looks: Sequence[_Look], dx: Vector) -> tuple[Bundle, list[_Look]] | None:
    """The longest step, halved if need be, that does not make the fit worse."""
    before = _cost(looks, bundle.variances)
    for halving in range(_HALVINGS):
        moved = bundle.moved(dx / 2**halving, looks)
        try:
            there = moved.looks()
        except InputError:  # too far: the lens model has turned back
            continue
        if _cost(there, bundle.variances) <= before * (1 + _STILL):
            return moved, there
    return None


def _cost(looks: Sequence[_Look], variances: Vector) -> float:
    return float(np.sum(np.array([look.square for look in looks]) / variances))


def _shared(bundle: Bundle, looks: Sequence[_Look]) -> Vector:
    freedom = sum(len(look.residual) for look in looks) - bundle.numbers - _POSE * len(looks)
    return np.full(len(looks), sum(look.square for look in looks) / max(freedom, 1))


def _own(bundle: Bundle, looks: Sequence[_Look]) -> Vector:
    """Every view's variance, drawn to the median of all, (views,)."""
    P = covariance_of(bundle, looks)
    drawn = np.array([np.sum((look.followed @ P) * look.followed) for look in looks]) / bundle.variances
    freedom = np.maximum(np.array([len(look.residual) for look in looks]) - _POSE - drawn, 0.0)
    squares = np.array([look.square for look in looks])
    typical = float(np.median(squares / np.maximum(freedom, 1.0)))
    return np.asarray((squares + PRIOR * typical) / (freedom + PRIOR))


def _information(looks: Sequence[_Look], variances: Vector) -> Matrix:
    return np.asarray(sum(look.followed.T @ look.followed / variance for look, variance in zip(looks, variances, strict=True)))


def _whitener(information: Matrix) -> Matrix:
    """W with W W^T the inverse of a matrix whose numbers have many units, and W^T `information` W = 1, (k, rank)."""
    scale = 1 / np.sqrt(np.diag(information))
    size, V = np.linalg.eigh(scale[:, None] * information * scale)
    kept = size > ROUNDING * size[-1]
    return np.asarray(scale[:, None] * V[:, kept] / np.sqrt(size[kept]))


def _skew(points: Matrix) -> Array3:
    return np.array([pin.skew(point) for point in points])
