"""A lens from views of a board: OpenCV's bundle adjustment, views that do not fit left out, the model chosen by evidence.

Outlier views: a view whose RMS is more than `OUTLIER` times the views' median is left out, the worst first, and the lens is fitted again,
until none is or `FEWEST` are left. Evidence: Schwarz's BIC = n ln(rss / n) + p ln n over the n corner coordinates; the three more
numbers of the rational model must lower it by more than `DECISIVE` (Kass and Raftery 1995: "strong").
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import pinocchio as pin

from urdfcal.base.errors import InputError
from urdfcal.base.geometry import SE3, Matrix, Vector
from urdfcal.sensors.camera import Camera
from urdfcal.sensors.lenses import DISTORTION_NAMES, Lens, projected
from urdfcal.vision.camera.boards import BoardView

FEWEST = 3  # views
OUTLIER = 2.5
DECISIVE = 6.0
WORST_RMS_PX = 5.0
_SETTLED = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-10)


@dataclass(frozen=True, eq=False)
class LensFit:
    """A lens and the views that it was found from.

    Attributes:
        camera: Size, matrix, distortion, RMS and covariance.
        views: The views that were used.
        poses: T_camera_board of each.
        view_rms: RMS distance of each view's corners, [px].
        dropped: Views that did not fit, with their RMS when they were left out, [px].
        bic: By lens model, for those that were tried.
    """

    camera: Camera
    views: tuple[BoardView, ...]
    poses: tuple[SE3, ...]
    view_rms: Vector
    dropped: tuple[tuple[str, float], ...]
    bic: dict[str, float]


def calibrate_lens(views: Sequence[BoardView], size: tuple[int, int], lens: Lens | None = None) -> LensFit:
    """The lens that the views show.

    Args:
        views: Boards in pictures.
        size: Width and height of the pictures, [px].
        lens: The model; None: plain or rational, by evidence.

    Raises:
        InputError: too few views, or no lens that explains them.
    """
    if len(views) < FEWEST:
        raise InputError(
            f"{len(views)} {'view shows' if len(views) == 1 else 'views show'} the board, expected {FEWEST} or more (10 to 20 are good)"
        )
    fit = _without_outliers(views, size, lens) if lens else _by_evidence(views, size)
    _require_sense(fit)
    return fit


def _by_evidence(views: Sequence[BoardView], size: tuple[int, int]) -> LensFit:
    """Plain unless the rational model explains the same views decidedly better, or plain explains them not at all."""
    try:
        plain = _without_outliers(views, size, "plain")
    except InputError:
        return _without_outliers(views, size, "rational")
    try:
        rational = _fit(plain.views, size, "rational")
    except InputError:
        return plain
    bic = plain.bic | rational.bic
    return replace(rational if bic["rational"] < bic["plain"] - DECISIVE else plain, bic=bic, dropped=plain.dropped)


def _without_outliers(views: Sequence[BoardView], size: tuple[int, int], lens: Lens) -> LensFit:
    kept = list(views)
    dropped: list[tuple[str, float]] = []
    while True:
        fit = _fit(kept, size, lens)
        worst = int(fit.view_rms.argmax())
        if fit.view_rms[worst] <= OUTLIER * np.median(fit.view_rms) or len(kept) <= FEWEST:
            return replace(fit, dropped=tuple(dropped))
        dropped.append((kept[worst].name, float(fit.view_rms[worst])))
        del kept[worst]


def _fit(views: Sequence[BoardView], size: tuple[int, int], lens: Lens) -> LensFit:
    """One lens model from all the views.

    Raises:
        InputError: OpenCV finds none.
    """
    try:
        matrix, distortion, turns, shifts = _opencv(views, size, lens)
    except cv2.error as error:
        why = str(error.err).strip()
        raise InputError(f"no {lens} lens explains the views ({why}); take views that fill the picture, tilted by 20 to 40 deg") from None
    poses = tuple(pin.SE3(pin.exp3(turn.ravel()), shift.ravel().astype(float)) for turn, shift in zip(turns, shifts, strict=True))
    return _judged(views, size, lens, np.asarray(matrix), distortion.ravel()[: len(DISTORTION_NAMES[lens])].astype(float), poses)


def _opencv(views: Sequence[BoardView], size: tuple[int, int], lens: Lens) -> tuple[Any, Any, Any, Any]:
    """Matrix, distortion, rotation vectors and translations by OpenCV."""
    blank = np.zeros((3, 3)), np.zeros((4, 1))
    if lens == "fisheye":
        home: Any = cv2.fisheye if hasattr(cv2.fisheye, "CALIB_FIX_SKEW") else cv2  # OpenCV 4, OpenCV 5
        flags = home.CALIB_RECOMPUTE_EXTRINSIC | home.CALIB_FIX_SKEW
        points, pixels = [view.points[None] for view in views], [view.pixels[None] for view in views]
        return cv2.fisheye.calibrate(points, pixels, size, *blank, flags=flags, criteria=_SETTLED)[1:]
    flags = cv2.CALIB_RATIONAL_MODEL if lens == "rational" else 0
    points, pixels = [view.points.astype(np.float32) for view in views], [view.pixels.astype(np.float32) for view in views]
    return cv2.calibrateCamera(points, pixels, size, *blank, flags=flags, criteria=_SETTLED)[1:]


def _judged(
    views: Sequence[BoardView], size: tuple[int, int], lens: Lens, matrix: Matrix, distortion: Vector, poses: tuple[SE3, ...]
) -> LensFit:
    """What the residual says: RMS, BIC and the covariance of the lens, the poses eliminated (Schur complement)."""
    numbers = 4 + len(distortion)
    information, squares = np.zeros((numbers, numbers)), []
    for view, pose in zip(views, poses, strict=True):
        seen, by_point, by_lens = projected(view.points @ pose.rotation.T + pose.translation, matrix, distortion, lens)
        if not np.isfinite(seen).all():
            raise InputError(f"no {lens} lens explains the views: {view.name} lies outside the model's range")
        squares.append(((seen - view.pixels) ** 2).sum(axis=1))
        twist = np.concatenate(
            [np.broadcast_to(np.eye(3), (len(seen), 3, 3)), -np.array([pin.skew(point) for point in view.points])], axis=2
        )
        by_pose, by_lens = (by_point @ pose.rotation @ twist).reshape(-1, 6), by_lens.reshape(-1, numbers)
        mixed = by_lens.T @ by_pose
        information += by_lens.T @ by_lens - mixed @ np.linalg.pinv(by_pose.T @ by_pose) @ mixed.T
    total, count = float(sum(square.sum() for square in squares)), 2 * sum(len(square) for square in squares)
    variance = total / max(count - numbers - 6 * len(views), 1)
    scale = 1 / np.sqrt(np.diag(information))
    covariance = variance * scale[:, None] * np.linalg.pinv(scale[:, None] * information * scale, hermitian=True) * scale
    camera = Camera(size, matrix, distortion, lens, rms=float(np.sqrt(2 * total / count)), lens_covariance=covariance)
    bic = count * np.log(total / count) + numbers * np.log(count)
    return LensFit(camera, tuple(views), poses, np.array([np.sqrt(square.mean()) for square in squares]), (), {lens: float(bic)})


def _require_sense(fit: LensFit) -> None:
    """Refuse a lens that is none.

    Raises:
        InputError: the corners are far from where it puts them, or its axis lies outside the picture.
    """
    camera = fit.camera
    rms, centre = camera.rms or 0.0, camera.matrix[:2, 2]
    if not rms <= WORST_RMS_PX:
        raise InputError(
            f"no {camera.lens} lens explains the views: corners are {rms:.1f} px off (RMS), expected under {WORST_RMS_PX:g} px; "
            "is the board flat, and --board right?"
        )
    if not ((centre > 0) & (centre < camera.size)).all():
        raise InputError(
            f"the views put the lens's axis at ({centre[0]:.0f}, {centre[1]:.0f}) px, outside the picture of {camera.size[0]} x "
            f"{camera.size[1]} px; take views that are tilted by 20 to 40 deg in several directions"
        )
