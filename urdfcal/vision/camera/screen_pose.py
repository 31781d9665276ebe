"""Where the screen is: ArUco markers or a chessboard on it, found in one picture.

A picture taken from the back shows the screen mirrored. It is turned around before anything is looked for in it, and the
pixels that were found are turned back: so corners have the same order from either side.

One wrong marker does not spoil the pose. Every pair of markers gives a pose; the pair with which most markers agree is the start.
Then each marker is held against the pose of the others, and left out where the chi-squared of its eight numbers, with the
stated accuracy of placement, the corner noise (at least `LEAST_NOISE_PX`) and the covariance of that pose, is above `GATE`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import cv2
import numpy as np
import pinocchio as pin

from urdfcal.base.errors import InputError
from urdfcal.base.geometry import MM, Array3, Matrix
from urdfcal.sensors.camera import Camera, Side
from urdfcal.vision.camera.boards import Chessboard
from urdfcal.vision.camera.lens import WORST_RMS_PX
from urdfcal.vision.camera.marker_search import SeenMarker, find_markers
from urdfcal.vision.camera.markers import ScreenMarkers
from urdfcal.vision.camera.plane_pose import PlaneFit, PlanePoints, fit_plane
from urdfcal.vision.pictures import Grey

LEAST_NOISE_PX = 0.3
GATE = 31.8  # 99.99 % of chi-squared with 8 degrees of freedom
_PAIR_GATE = 35.6  # ... with 10, of two markers alone
_MOST_PAIRS = 100


@dataclass(frozen=True, eq=False)
class ScreenFit:
    """A screen that was found.

    Attributes:
        camera: The camera with its screen.
        fit: Pose, covariance and residual.
        used: Ids of the markers that decided it; empty for a board.
        wrong: Markers that were left out, and where they seem to be off to, (y, z) [m].
        hidden: Ids of screen.yaml that were not seen.
        unknown: Ids that were seen but are not in screen.yaml.
    """

    camera: Camera
    fit: PlaneFit
    used: tuple[int, ...] = ()
    wrong: tuple[tuple[int, tuple[float, float]], ...] = ()
    hidden: tuple[int, ...] = ()
    unknown: tuple[int, ...] = ()


def screen_from_markers(camera: Camera, picture: Grey, markers: ScreenMarkers, name: str) -> ScreenFit:
    """The screen's pose from the markers on it.

    Args:
        camera: The lens.
        picture: Brightness, (height, width).
        markers: What is on the screen.
        name: The picture, for messages.

    Raises:
        InputError: fewer than two markers are seen, or no two of them agree.
    """
    found = find_markers(picture, markers, camera)
    known = [marker for marker in found if marker.id in markers.centres]
    if len(known) < 2:
        raise InputError(_too_few(camera, picture, markers, known), name)
    start = _consensus(camera, markers, known)
    if start is None:
        ids = ", ".join(str(marker.id) for marker in known)
        raise InputError(
            f"markers {ids} contradict each other: too few of them lie as screen.yaml has it; check its size_mm and markers",
            name,
        )
    fit, kept = _without_wrong(camera, markers, known, start)
    posed = _with_screen(camera, fit, markers.side)
    wrong = [(marker.id, _off(posed, markers, marker)) for marker, good in zip(known, kept, strict=True) if not good]
    return ScreenFit(
        posed,
        fit,
        tuple(marker.id for marker, good in zip(known, kept, strict=True) if good),
        tuple(wrong),
        tuple(sorted(set(markers.centres) - {marker.id for marker in known})),
        tuple(sorted({marker.id for marker in found} - set(markers.centres))),
    )


def screen_from_board(camera: Camera, picture: Grey, board: Chessboard, origin: tuple[float, float], side: Side, name: str) -> ScreenFit:
    """The screen's pose from a chessboard on it, columns along -y (to the right, seen from the front), rows along -z (down).

    Args:
        camera: The lens, rolled by less than 90 deg (45 deg where the board has as many columns as rows).
        picture: Brightness, (height, width).
        board: The board.
        origin: (y, z) of its first inner corner, the one at the top left seen from the front, [m].
        side: From which side the camera looks.
        name: The picture, for messages.

    Raises:
        InputError: the board is not found.
    """
    shown = cv2.flip(picture, 1) if side == "back" else picture
    found = board.find(np.asarray(shown, dtype=np.uint8), name)
    if isinstance(found, str):
        raise InputError(found, name)
    grid = _upright(found.pixels.reshape(board.rows, board.columns, 2)).reshape(-1, 2)
    pixels = unmirrored(grid, picture.shape[1]) if side == "back" else grid
    points = np.column_stack([np.zeros(len(pixels)), np.array(origin) - board.points[:, :2]])
    fit = fit_plane(camera, PlanePoints(points, pixels, np.zeros(len(pixels), dtype=np.intp)))
    if fit is None or fit.rms > WORST_RMS_PX:
        raise InputError(f"the {board} fits no pose in this camera; is the lens the right one?", name)
    return ScreenFit(_with_screen(camera, fit, side), fit)


def unmirrored(pixels: Matrix, width: int) -> Matrix:
    """Pixels (n, 2) of a mirrored picture in the picture itself, and the other way round."""
    return np.asarray(pixels * [-1, 1] + [width - 1, 0])


def _upright(grid: Array3) -> Array3:
    """The corners (rows, columns, 2) turned so that columns run to the right and rows down."""
    across = grid[:, -1].mean(axis=0) - grid[:, 0].mean(axis=0)
    down = grid[-1].mean(axis=0) - grid[0].mean(axis=0)
    if across[0] * down[1] - across[1] * down[0] < 0:
        grid, across = grid[:, ::-1], -across
    square = grid.shape[0] == grid.shape[1]
    turns = [np.rot90(grid, quarter) for quarter in ((0, 1, 2, 3) if square else (0, 2))]
    return max(turns, key=lambda turned: float((turned[:, -1] - turned[:, 0]).mean(axis=0)[0] + (turned[-1] - turned[0]).mean(axis=0)[1]))


def _with_screen(camera: Camera, fit: PlaneFit, side: Side) -> Camera:
    return replace(camera, T_camera_screen=fit.T_camera_plane, side=side, screen_rms=fit.rms, screen_covariance=fit.covariance)


def _points(markers: ScreenMarkers, seen: Sequence[SeenMarker]) -> PlanePoints:
    points = np.concatenate([markers.corners_of(marker.id) for marker in seen])
    return PlanePoints(points, np.concatenate([marker.pixels for marker in seen]), np.repeat(np.arange(len(seen)), 4), markers.placement)


def _consensus(camera: Camera, markers: ScreenMarkers, seen: Sequence[SeenMarker]) -> list[bool] | None:
    """Which markers agree with the pair that most agree with; None where that decides nothing."""
    ways = []
    for pair in _pairs(markers, seen):
        fit = fit_plane(camera, _points(markers, [seen[index] for index in pair]), LEAST_NOISE_PX)
        if fit is None or fit.cost > _PAIR_GATE:
            continue
        others = [_misfit(camera, markers, marker, fit) for index, marker in enumerate(seen) if index not in pair]
        agree = [index in pair for index in range(len(seen))]
        for index, misfit in zip([index for index in range(len(seen)) if index not in pair], others, strict=True):
            agree[index] = misfit < GATE
        ways.append((sum(agree), -float(np.minimum(others, GATE).sum()) - fit.cost, agree))
    best = max(ways, default=None, key=lambda way: way[:2])
    if best is None or (best[0] == 2 < len(seen) and sum(way[0] == 2 for way in ways) > 1):
        return None
    return best[2]


def _pairs(markers: ScreenMarkers, seen: Sequence[SeenMarker]) -> list[tuple[int, int]]:
    """Pairs of markers, those far apart first."""
    centres = np.array([markers.centres[marker.id] for marker in seen])
    pairs = [pair for pair in combinations(range(len(seen)), 2) if seen[pair[0]].id != seen[pair[1]].id]
    return sorted(pairs, key=lambda pair: -float(np.linalg.norm(centres[pair[0]] - centres[pair[1]])))[:_MOST_PAIRS]


def _misfit(camera: Camera, markers: ScreenMarkers, marker: SeenMarker, fit: PlaneFit) -> float:
    """Chi-squared of a marker's eight numbers under a pose that was found without it."""
    points, T = markers.corners_of(marker.id), fit.T_camera_plane
    in_camera = points @ T.rotation.T + T.translation
    off = (marker.pixels - camera.project(in_camera)).ravel()
    if not np.isfinite(off).all():
        return np.inf
    by_point = camera.project_jacobian(in_camera) @ T.rotation
    twist = np.concatenate([np.broadcast_to(np.eye(3), (4, 3, 3)), -np.array([pin.skew(point) for point in points])], axis=2)
    by_pose = (by_point @ twist).reshape(8, 6)
    arms = points - points.mean(axis=0)
    turn = np.column_stack([np.zeros(4), -arms[:, 2], arms[:, 1]]) / (markers.size / 2)
    by_placement = np.column_stack([by_point[:, :, 1].ravel(), by_point[:, :, 2].ravel(), np.einsum("nij,nj->ni", by_point, turn).ravel()])
    noise = max(fit.sigma, LEAST_NOISE_PX)
    covariance = noise**2 * np.eye(8) + by_pose @ fit.covariance @ by_pose.T + markers.placement**2 * by_placement @ by_placement.T
    return float(off @ np.linalg.solve(covariance, off))


def _without_wrong(camera: Camera, markers: ScreenMarkers, seen: Sequence[SeenMarker], kept: list[bool]) -> tuple[PlaneFit, list[bool]]:
    """The pose of the markers that agree, each of them held against the others."""
    while True:
        inside = [index for index, good in enumerate(kept) if good]
        fit = fit_plane(camera, _points(markers, [seen[index] for index in inside]))
        if fit is None:  # pragma: no cover - its start was found before
            raise InputError("the markers fit no pose in this camera")
        misfits = {}
        for index in inside if len(inside) > 3 else ():
            others = fit_plane(camera, _points(markers, [seen[other] for other in inside if other != index]))
            misfits[index] = np.inf if others is None else _misfit(camera, markers, seen[index], others)
        worst = max(misfits, key=lambda index: misfits[index], default=None)
        if worst is None or misfits[worst] < GATE:
            return fit, kept
        kept = [good and index != worst for index, good in enumerate(kept)]


def _off(camera: Camera, markers: ScreenMarkers, marker: SeenMarker) -> tuple[float, float]:
    y, z = camera.spots_of_pixels(marker.pixels).mean(axis=0) - markers.centres[marker.id]
    return float(y), float(z)


def _too_few(camera: Camera, picture: Grey, markers: ScreenMarkers, known: Sequence[SeenMarker]) -> str:
    """Why there are too few markers, in words."""
    expected = f"expected 2 or more of {', '.join(map(str, markers.centres))} ({markers.dictionary})"
    if known:
        return f"shows only one of the screen's markers ({known[0].id}), {expected}; one alone gives no trustworthy pose"
    other: Side = "front" if markers.side == "back" else "back"
    if find_markers(picture, replace(markers, side=other), camera):
        return f"its markers are mirrored for a camera at the {markers.side}; does it look at the {other} (side: {other} in screen.yaml)?"
    strangers = sorted({marker.id for marker in find_markers(picture, markers, camera)})
    return f"shows none of the screen's markers{f' but {strangers}' if strangers else ''}, {expected}"


def pose_sigmas(fit: PlaneFit) -> tuple[Matrix, Matrix]:
    """Sigmas of the pose: (3,) [mm] and (3,) [mrad], along and about the screen's x, y, z."""
    sigma = np.sqrt(np.diag(fit.covariance))
    return sigma[:3] / MM, sigma[3:] * 1e3
