"""A lens from views of a board: OpenCV's bundle adjustment, views that do not fit left out, the model chosen by evidence.

Views scatter unlike each other: blurred, far and oblique ones more, and weigh less for it (`bundle.py`). Wrong views: one whose RMS is
more than `OUTLIER` times the views' median and `LEAST_WRONG_PX` as well, which no corner that was found rightly is off by, is left out,
the worst first, and the lens is fitted again, until none is or `FEWEST` are left. Evidence: Schwarz's BIC over the corner coordinates; the
three more numbers of the rational model must lower it by more than `DECISIVE`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import pinocchio as pin

from urdfcal.base.errors import InputError
from urdfcal.base.geometry import SE3, Vector
from urdfcal.sensors.camera import Camera
from urdfcal.sensors.lenses import DISTORTION_NAMES, Lens
from urdfcal.vision.camera.boards import BoardView
from urdfcal.vision.camera.bundle import DECISIVE, Bundle, bic_of, covariance_of, excess_between_views, with_variances
from urdfcal.vision.camera.circles import shift_of

FEWEST = 3  # views
OUTLIER, LEAST_WRONG_PX = 6.0, 0.5
WORST_RMS_PX = 5.0
_CENTRINGS = 3  # rounds from the lens to circles' centres and back; the third moves them by less than 1e-4 px
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
        excess: How many times more, squared, views disagree on the lens than their corners scatter; its covariance is widened for it.
    """

    camera: Camera
    views: tuple[BoardView, ...]
    poses: tuple[SE3, ...]
    view_rms: Vector
    dropped: tuple[tuple[str, float], ...]
    bic: dict[str, float]
    excess: float = 1.0


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
    seen = list(views)
    fit = _fitted(seen, size, lens)
    for _ in range(_CENTRINGS if any(view.areas is not None for view in views) else 0):
        seen = _centred(views, seen, fit)
        fit = _fitted(seen, size, lens)
    _require_sense(fit)
    return fit


def _fitted(views: Sequence[BoardView], size: tuple[int, int], lens: Lens | None) -> LensFit:
    return _without_outliers(views, size, lens) if lens else _by_evidence(views, size)


def _centred(raw: Sequence[BoardView], seen: Sequence[BoardView], fit: LensFit) -> list[BoardView]:
    """Raw views with the centres of circles in place of the centres of what is seen of them, which lens and pose must be known for."""
    poses = {id(view): pose for view, pose in zip(fit.views, fit.poses, strict=True)}
    return [
        view
        if view.areas is None or id(last) not in poses
        else replace(view, pixels=view.pixels - shift_of(fit.camera, poses[id(last)], view.points, view.areas))
        for view, last in zip(raw, seen, strict=True)
    ]


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
        if fit.view_rms[worst] <= max(OUTLIER * np.median(fit.view_rms), LEAST_WRONG_PX) or len(kept) <= FEWEST:
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
    numbers = distortion.ravel()[: len(DISTORTION_NAMES[lens])].astype(float)
    return _judged(with_variances(Bundle(tuple(views), lens, np.asarray(matrix), numbers, poses, np.ones(len(views)))), size)


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


def _judged(bundle: Bundle, size: tuple[int, int]) -> LensFit:
    """What the residual says: RMS, BIC and the covariance of the lens."""
    looks = bundle.looks()
    squares = [(look.residual.reshape(-1, 2) ** 2).sum(axis=1) for look in looks]
    rms, view_rms = np.sqrt(np.concatenate(squares).mean()), np.array([np.sqrt(square.mean()) for square in squares])
    excess = excess_between_views(bundle, looks)
    covariance = np.sqrt(np.outer(excess, excess)) * covariance_of(bundle, looks)
    camera = Camera(size, bundle.matrix, bundle.distortion, bundle.lens, rms=float(rms), lens_covariance=covariance)
    return LensFit(camera, bundle.views, bundle.poses, view_rms, (), {bundle.lens: bic_of(bundle, looks)}, float(excess.min()))


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
