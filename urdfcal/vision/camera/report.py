"""What `urdfcal camera` says: the views, the lens with its sigmas, the screen; for people and for machines; and what to beware of."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from urdfcal.base.geometry import MM, xyz_rpy
from urdfcal.base.terminal import figures_table, many, titled, value_and_sigma
from urdfcal.sensors.camera import Camera
from urdfcal.sensors.lenses import intrinsic_names
from urdfcal.vision.camera.lens import OUTLIER, LensFit
from urdfcal.vision.camera.screen_pose import ScreenFit, pose_sigmas

if TYPE_CHECKING:
    from rich.console import RenderableType


_ROWS, _COLUMNS = 6, 8
LEAST_COVERED = 0.6
FEW_VIEWS = 8
LOOSE_FOCAL = 0.01
WEAK_SCREEN_MM = 5.0
WORTH_A_WORD = 2.0  # of excess, squared


def coverage(fit: LensFit) -> tuple[float, float]:
    """Share of the picture inside the hull of all corners, and share of its 8 x 6 fields that hold a corner."""
    pixels, size = np.concatenate([view.pixels for view in fit.views]), np.array(fit.camera.size)
    hull = float(cv2.contourArea(cv2.convexHull(pixels.astype(np.float32)))) / float(size.prod())
    fields = np.unique(np.floor(pixels / size * [_COLUMNS, _ROWS]).clip(0, [_COLUMNS - 1, _ROWS - 1]), axis=0)
    return hull, len(fields) / (_ROWS * _COLUMNS)


def lens_warnings(fit: LensFit) -> list[str]:
    """What the lens calibration lacks."""
    hull, _ = coverage(fit)
    warnings = [
        f"{name}: left out, its corners are {rms:.2f} px off (RMS), more than {OUTLIER:g} times the views' median"
        for name, rms in fit.dropped
    ]
    if fit.excess > WORTH_A_WORD:
        warnings.append(
            f"the views disagree on the lens {np.sqrt(fit.excess):.1f} times as much as their corners scatter, and its sigmas are wider "
            "for it; is the board flat, and stiff?"
        )
    if len(fit.views) < FEW_VIEWS:
        warnings.append(f"only {many(len(fit.views), 'view')}; 10 to 20 give a lens that can be relied upon")
    if hull < LEAST_COVERED:
        warnings.append(
            f"the corners cover {hull:.0%} of the picture; outside of them the lens is a guess: hold the board into the corners"
        )
    sigma = _lens_sigma(fit.camera)
    if sigma is not None and sigma[0] > LOOSE_FOCAL * fit.camera.matrix[0, 0]:
        warnings.append(f"the focal length is known to {sigma[0]:.1f} px only; tilt the board by 20 to 40 deg in several directions")
    return warnings


def screen_warnings(fit: ScreenFit, name: str) -> list[str]:
    """What is odd about the screen's picture."""
    wrong = [
        f"{name}: marker {marker} is left out: it lies {np.hypot(*off) / MM:.1f} mm from where screen.yaml has it "
        f"(y {off[0] / MM:+.1f} mm, z {off[1] / MM:+.1f} mm), by the other markers"
        for marker, off in fit.wrong
    ]
    hidden = [f"{name}: marker {marker} of screen.yaml is not seen" for marker in fit.hidden]
    unknown = [f"{name}: marker {marker} is seen, but is not in screen.yaml" for marker in fit.unknown]
    weak = []
    if len(fit.used) == 2:
        weak.append(f"{name}: only markers {fit.used[0]} and {fit.used[1]} decide the screen's pose; nothing would show that one is wrong")
    if pose_sigmas(fit.fit)[0].max() > WEAK_SCREEN_MM:
        known = f"{pose_sigmas(fit.fit)[0].max():.1f} mm"
        weak.append(f"{name}: the screen's place is known to {known} only; take more or larger markers, farther apart")
    return [*wrong, *hidden, *unknown, *weak]


def lens_blocks(fit: LensFit) -> list[RenderableType]:
    """Views and parameters of a lens."""
    hull, fields = coverage(fit)
    used, left = len(fit.views), len(fit.dropped)
    tried = ", ".join(f"{lens} {bic:.1f}" for lens, bic in fit.bic.items())
    return [
        f"{fit.camera.lens} lens from {many(used, 'view')}{f' ({left} left out)' if left else ''}, "
        f"{sum(len(view.pixels) for view in fit.views)} corners: RMS {fit.camera.rms:.3f} px",
        f"evidence (BIC, less is better): {tried}",
        f"the corners cover {hull:.0%} of the picture (their hull) and lie in {fields:.0%} of its 8 x 6 fields",
        "",
        _views_table(fit),
        "",
        _parameters_table(fit.camera),
    ]


def screen_blocks(fit: ScreenFit) -> list[RenderableType]:
    """The screen's pose."""
    what = f"{many(len(fit.used), 'marker')} ({', '.join(map(str, sorted(fit.used)))})" if fit.used else "a chessboard"
    table = figures_table("T_camera_screen")
    table.add_column("value ± sigma", justify="right")
    table.add_column("unit")
    place, turn = pose_sigmas(fit.fit)
    rotation = fit.fit.T_camera_plane.rotation
    sigmas = np.sqrt(np.diag(rotation @ fit.fit.covariance[:3, :3] @ rotation.T)) / MM
    for axis, value, sigma in zip("xyz", fit.fit.T_camera_plane.translation / MM, sigmas, strict=True):
        table.add_row(axis, value_and_sigma(float(value), float(sigma)), "mm")
    return [
        f"screen seen from the {fit.camera.side}, by {what}: RMS {fit.fit.rms:.3f} px",
        f"sigma along the screen's x, y, z: {place[0]:.2f}, {place[1]:.2f}, {place[2]:.2f} mm; "
        f"about them: {turn[0]:.2f}, {turn[1]:.2f}, {turn[2]:.2f} mrad",
        "",
        titled("The screen's origin in camera axes", table),
    ]


def camera_json(camera: Camera, lens: LensFit | None, failed: dict[str, str], screen: ScreenFit | None) -> dict[str, Any]:
    """All of it for machines, SI."""
    sigma, names = _lens_sigma(camera), intrinsic_names(camera.lens)
    machine: dict[str, Any] = {
        "size_px": list(camera.size),
        "lens": camera.lens,
        "rms_px": camera.rms,
        "intrinsics": dict(zip(names, _intrinsics(camera), strict=True)),
        "sigma": None if sigma is None else dict(zip(names, map(float, sigma), strict=True)),
        "views": None,
        "screen": None,
    }
    if lens is not None:
        hull, fields = coverage(lens)
        machine["views"] = {view.name: float(rms) for view, rms in zip(lens.views, lens.view_rms, strict=True)}
        machine |= {"dropped": dict(lens.dropped), "failed": failed, "bic": lens.bic, "coverage": {"hull": hull, "fields": fields}}
    if screen is not None:
        xyz, rpy = xyz_rpy(screen.fit.T_camera_plane)
        machine["screen"] = {
            "side": screen.camera.side,
            "xyz": xyz.tolist(),
            "rpy": rpy.tolist(),
            "rms_px": screen.fit.rms,
            "covariance": screen.fit.covariance.tolist(),
            "used": list(screen.used),
            "wrong": {str(marker): list(off) for marker, off in screen.wrong},
            "hidden": list(screen.hidden),
            "unknown": list(screen.unknown),
        }
    return machine


def _views_table(fit: LensFit) -> RenderableType:
    table = figures_table("view")
    for name in ("corners", "RMS px"):
        table.add_column(name, justify="right")
    for view, rms in zip(fit.views, fit.view_rms, strict=True):
        table.add_row(view.name, str(len(view.pixels)), f"{rms:.3f}")
    for name, rms in fit.dropped:
        table.add_row(name, "left out", f"{rms:.3f}")
    return titled("Distance from measured to predicted corner", table)


def _parameters_table(camera: Camera) -> RenderableType:
    table = figures_table("parameter")
    table.add_column("value ± sigma", justify="right")
    table.add_column("unit")
    sigma = _lens_sigma(camera)
    for index, (name, value) in enumerate(zip(intrinsic_names(camera.lens), _intrinsics(camera), strict=True)):
        table.add_row(name, value_and_sigma(value, 0.0 if sigma is None else float(sigma[index])), "px" if index < 4 else "")
    return titled("Lens", table)


def _intrinsics(camera: Camera) -> list[float]:
    return [float(value) for value in (*camera.matrix[[0, 1, 0, 1], [0, 1, 2, 2]], *camera.distortion)]


def _lens_sigma(camera: Camera) -> Any:
    return None if camera.lens_covariance is None else np.sqrt(np.diag(camera.lens_covariance))
