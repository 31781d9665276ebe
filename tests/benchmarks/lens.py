"""Lens and screen: real photographs beside their reference, and the screen's pose from simulated pictures.

    python tests/benchmarks/lens.py [--data DIR] [--scenes 40] [--placement-mm 0.5]

Photographs: OpenCV's 13 left and 13 right views of a 9 x 6 board (Debian package opencv-doc), looked for in ../shared/data next to the
checkout; RMS beside the reference of 0.409 and 0.459 px for a window of fixed size and the same five-parameter model; held out:
each view's RMS under a lens from the other twelve (its pose fitted).
Scenes: random cameras in turn from the front and the back, up to 45 deg oblique, k1 from -0.25 to 0; in turn nothing odd, one
marker hidden, one 10 to 60 mm off, both. The true lens is used; SIMULATED pictures of 1280 x 960 px.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
import pinocchio as pin

from tests.support.vision_scenes import corners_in_picture, marker_light, picture, random_camera
from urdfcal.base.geometry import MM, distance_mm_mrad
from urdfcal.sensors.camera import Camera
from urdfcal.sensors.lenses import intrinsic_names
from urdfcal.vision.camera.boards import BoardView, Chessboard
from urdfcal.vision.camera.lens import calibrate_lens
from urdfcal.vision.camera.marker_search import find_markers
from urdfcal.vision.camera.markers import ScreenMarkers
from urdfcal.vision.camera.plane_pose import T_SCREEN_SHEET, PlanePoints, fit_plane
from urdfcal.vision.camera.screen_pose import screen_from_markers
from urdfcal.vision.pictures import picture_files, read_grey

REFERENCE = {"left": 0.409, "right": 0.459}
CENTRES = {0: (0.55, 0.4), 1: (-0.55, 0.4), 2: (0.55, -0.4), 3: (-0.55, -0.4), 4: (0.0, 0.4)}
KINDS = ("all right", "one hidden", "one wrong", "one hidden, one wrong")


def photographs(folder: Path) -> None:
    for side, reference in REFERENCE.items():
        views = [Chessboard(9, 6, 0.025).find(read_grey(path), path.name) for path in picture_files([f"{folder}/{side}*.jpg"])]
        found = [view for view in views if isinstance(view, BoardView)]
        size = (640, 480)
        fit = calibrate_lens(found, size)
        bic = ", ".join(f"{lens} {value:.1f}" for lens, value in fit.bic.items())
        print(f"{side}: {len(found)} of {len(views)} views, {len(fit.dropped)} left out; {fit.camera.lens} lens (BIC {bic})")
        print(f"  RMS {fit.camera.rms:.3f} px (reference {reference}); views {fit.view_rms.min():.3f} to {fit.view_rms.max():.3f} px")
        for lens in ("plain", "rational", "fisheye"):
            left_out = [held_out(calibrate_lens([v for v in found if v is not view], size, lens).camera, view) for view in found]
            rms = calibrate_lens(found, size, lens).camera.rms
            print(f"  {lens:8}: RMS {rms:.3f} px, held out {np.sqrt(np.mean(np.square(left_out))):.3f} px (worst view {max(left_out):.3f})")
        sigma = np.sqrt(np.diag(fit.camera.lens_covariance))
        values = [*fit.camera.matrix[[0, 1, 0, 1], [0, 1, 2, 2]], *fit.camera.distortion]
        print("  " + ", ".join(f"{n} {v:.4g} +- {s:.2g}" for n, v, s in zip(intrinsic_names(fit.camera.lens), values, sigma, strict=True)))


def held_out(camera: Camera, view: BoardView) -> float:
    points = view.points @ T_SCREEN_SHEET.rotation.T
    fit = fit_plane(camera, PlanePoints(points, view.pixels, np.zeros(len(points), dtype=np.intp)))
    return np.inf if fit is None else fit.rms


def scenes(count: int, placement: float) -> None:
    rows, corner_errors, named = [], [], 0
    for seed in range(count):
        rng = np.random.default_rng(seed)
        kind, side = KINDS[seed // 2 % 4], ("front", "back")[seed % 2]
        camera, markers = random_camera(rng, side), ScreenMarkers("DICT_4X4_50", 0.1, CENTRES, side, placement)
        moved = {marker: rng.normal(0, placement, 2) for marker in CENTRES}
        wrong, way = int(rng.integers(5)), rng.normal(size=2)
        hidden = ((wrong + 1) % 5,) if "hidden" in kind else ()
        if "wrong" in kind:
            moved[wrong] = way / np.linalg.norm(way) * rng.uniform(0.01, 0.06)
        shown = picture(camera, marker_light(markers, moved, hidden), rng, noise=rng.uniform(1, 5), rays=5)
        true = replace(markers, centres={marker: tuple(np.array(centre) + moved[marker]) for marker, centre in CENTRES.items()})
        corner_errors += [marker.pixels - corners_in_picture(camera, true, marker.id) for marker in find_markers(shown, markers, camera)]
        found = screen_from_markers(replace(camera, T_camera_screen=None), shown, markers, f"scene {seed}")
        named += found.hidden == hidden and [marker for marker, _ in found.wrong] == ([wrong] if "wrong" in kind else [])
        T = found.camera.T_camera_screen
        xi = pin.log6(T.actInv(camera.T_camera_screen)).vector
        sigma = np.sqrt(np.diag(found.fit.covariance))
        rows.append(
            (seed // 2 % 4, *distance_mm_mrad(T, camera.T_camera_screen), xi @ np.linalg.solve(found.fit.covariance, xi), *(xi / sigma))
        )
    table, corners = np.array(rows), np.concatenate(corner_errors)
    print(
        f"{count} simulated scenes, markers put up with a sigma of {placement / MM:g} mm: hidden and wrong markers named rightly in {named}"
    )
    print(
        f"  corners: RMS {np.sqrt((corners**2).mean()):.3f} px, median {np.median(np.abs(corners)):.3f}, worst {np.abs(corners).max():.2f}"
    )
    for index, kind in enumerate(KINDS):
        mine = table[table[:, 0] == index]
        (mm, mrad), (worst_mm, worst_mrad) = np.median(mine[:, 1:3], axis=0), mine[:, 1:3].max(axis=0)
        print(f"  {kind:22}: pose off by {mm:.2f} mm, {mrad:.2f} mrad (median), {worst_mm:.2f} mm, {worst_mrad:.2f} mrad (worst)")
    squared = table[:, 3] / 6
    print(f"  squared error over covariance, per degree of freedom: mean {squared.mean():.2f}, median {np.median(squared):.2f} (1, 0.89)")
    print(f"  within 1, 2, 3 sigma: {', '.join(f'{np.mean(np.abs(table[:, 4:]) < k):.3f}' for k in (1, 2, 3))} (0.683, 0.954, 0.997)")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path(__file__).parents[3] / "shared" / "data")
    parser.add_argument("--scenes", type=int, default=40)
    parser.add_argument("--placement-mm", type=float, default=0.5)
    options = parser.parse_args()
    folder = options.data / "opencv_chessboard"
    if folder.is_dir():
        photographs(folder)
    else:
        print(f"skipped: the chessboard photographs are not in {folder}")
    if options.scenes:
        scenes(options.scenes, options.placement_mm * MM)


if __name__ == "__main__":
    main()
