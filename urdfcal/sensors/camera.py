"""A camera: its lens and, perhaps, the screen that it looks at.

Camera axes are OpenCV's (x right, y down, z ahead), the screen is the plane x = 0 of the screen frame, a spot is (y, z) in it.
Seen from the front (the -x side) +y is to the left and +z up. A camera at the back looks at the same plane from the other
side, through the screen: nothing is mirrored in space, the picture alone is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from urdfcal.base.errors import ShapeMismatch, UsageError
from urdfcal.base.geometry import SE3, Array3, Matrix, Vector
from urdfcal.sensors.lenses import DISTORTION_NAMES, Lens, projected, unprojected, unprojected_grid

Side = Literal["front", "back"]


_USUAL_SHARE = 0.01  # of the focal length, and of the width of the picture for its centre, where nothing is stated
_USUAL_BENT = {"p1": 2e-3, "p2": 2e-3}
_USUAL_RADIAL = 0.05


def usual_covariance(camera: Camera) -> Matrix:
    """Of intrinsics that somebody wrote down without any: 1 % of the focal length and of the width."""
    centre = _USUAL_SHARE * camera.size[0]
    bent = [_USUAL_BENT.get(name, _USUAL_RADIAL) for name in DISTORTION_NAMES[camera.lens]]
    return np.diag(np.square([_USUAL_SHARE * camera.matrix[0, 0], _USUAL_SHARE * camera.matrix[1, 1], centre, centre, *bent]))


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera with a lens, perhaps in front of a screen.

    Attributes:
        size: Width and height of its pictures, [px].
        matrix: (3, 3), [px].
        distortion: 5 (plain), 8 (rational) or 4 (fisheye) numbers, in the order of `lenses.DISTORTION_NAMES`.
        lens: Which of the models.
        T_camera_screen: Where the screen is; None where it is not known.
        side: Whether the camera looks at the screen's front (from its -x side) or at its back.
        rms: RMS distance from measured to predicted corner when the lens was calibrated, [px].
        lens_covariance: Of fx, fy, cx, cy, and the distortion, (4 + k, 4 + k).
        screen_rms: RMS distance of the screen's corners, [px].
        screen_covariance: Of xi in T_camera_screen exp(xi), (6, 6), [v, w] in screen axes, [m] and [rad].
    """

    size: tuple[int, int]
    matrix: Matrix
    distortion: Vector
    lens: Lens = "plain"
    T_camera_screen: SE3 | None = None
    side: Side = "front"
    rms: float | None = None
    lens_covariance: Matrix | None = None
    screen_rms: float | None = None
    screen_covariance: Matrix | None = None

    def __post_init__(self) -> None:
        if self.matrix.shape != (3, 3) or self.distortion.shape != (len(DISTORTION_NAMES[self.lens]),):
            raise ShapeMismatch(
                f"a {self.lens} lens has a 3 x 3 matrix and {len(DISTORTION_NAMES[self.lens])} distortion numbers, "
                f"found {self.matrix.shape} and {self.distortion.shape}"
            )

    @property
    def intrinsics(self) -> Vector:
        """Numbers of the lens in the order of `lenses.intrinsic_names`, (4 + k,)."""
        return np.concatenate([self.matrix[[0, 1, 0, 1], [0, 1, 2, 2]], self.distortion])

    @cached_property
    def lens_factor(self) -> Matrix:
        """F with F F' the covariance of the intrinsics, (4 + k, 4 + k), columns as axes of the ellipsoid; a usual one if none is stated."""
        covariance = usual_covariance(self) if self.lens_covariance is None else self.lens_covariance
        scale = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        unit = np.where(scale > 0, scale, 1.0)
        values, axes = np.linalg.eigh(covariance / np.outer(unit, unit))
        return np.asarray((scale[:, None] * axes * np.sqrt(np.maximum(values, 0.0)))[:, ::-1])

    def refined(self, off: Vector, covariance: Matrix | None = None) -> Camera:
        """The same with a lens that is off by some numbers (4 + k,), in standard deviations along the columns of its factor.

        Args:
            off: How far.
            covariance: What is known of these numbers, (4 + k, 4 + k); None keeps what is stated.
        """
        fx, fy, cx, cy, *distortion = (self.intrinsics + self.lens_factor @ off).tolist()
        known = self.lens_covariance if covariance is None else self.lens_factor @ covariance @ self.lens_factor.T
        matrix = np.array([[fx, self.matrix[0, 1], cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        return replace(self, matrix=matrix, distortion=np.array(distortion), lens_covariance=known)

    def projected(self, points: Matrix) -> tuple[Matrix, Array3, Array3]:
        """Pixels (n, 2) of points (n, 3) in camera axes, how they move with these, (n, 2, 3), and with the intrinsics, (n, 2, 4 + k)."""
        return projected(points, self.matrix, self.distortion, self.lens)

    def project(self, points: Matrix) -> Matrix:
        """Pixels (n, 2) of points (n, 3) in camera axes [m]; nan behind the camera and beyond the lens model's range."""
        return projected(points, self.matrix, self.distortion, self.lens)[0]

    def project_jacobian(self, points: Matrix) -> Array3:
        """How pixels move with the points, (n, 2, 3), [px/m]."""
        return projected(points, self.matrix, self.distortion, self.lens)[1]

    def rays(self, pixels: Matrix) -> Matrix:
        """Unit rays (n, 3) in camera axes that meet the pixels (n, 2); nan where the lens model has none."""
        rays = unprojected(pixels, self.matrix, self.distortion, self.lens)
        return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))

    def pixels_of_spots(self, spots: Matrix) -> Matrix:
        """Pixels (n, 2) of spots (n, 2) = (y, z) on the screen, [m].

        Raises:
            UsageError: the camera knows no screen.
        """
        return self.project(self._on_screen(spots))

    def spots_of_pixels(self, pixels: Matrix) -> Matrix:
        """Where the rays of pixels (n, 2) meet the screen, (n, 2) = (y, z), [m]; nan where they do not.

        Raises:
            UsageError: the camera knows no screen.
        """
        return self._met(self.rays(pixels))

    def spots_of_grid(self, u: Vector, v: Vector) -> Array3:
        """Where the rays of all pixels in columns u (w,) and rows v (h,), both growing, meet the screen, (h, w, 2) = (y, z), [m].

        It is what `spots_of_pixels` says of every pixel, to 1e-4 px, in a small part of the time; nan where rays do not meet it.

        Raises:
            UsageError: the camera knows no screen.
        """
        return self._met(unprojected_grid(u, v, self.matrix, self.distortion, self.lens))

    def _met(self, rays: Array3) -> Array3:
        """Where rays (..., 3) in camera axes, of any length, meet the screen, (..., 2) = (y, z), [m]."""
        rays = rays @ self.screen.rotation  # in screen axes
        centre = self.screen.actInv(np.zeros(3))
        with np.errstate(divide="ignore", invalid="ignore"):
            lengths = -centre[0] / rays[..., 0]
        lengths[~(lengths > 0)] = np.nan
        return np.asarray(centre[1:] + lengths[..., None] * rays[..., 1:])

    def spot_jacobian(self, pixels: Matrix) -> Array3:
        """How spots move with their pixels, (n, 2, 2), [m/px]: the inverse of how pixels move with the spots.

        Raises:
            UsageError: the camera knows no screen.
        """
        by_spot: Array3 = self.project_jacobian(self._on_screen(self.spots_of_pixels(pixels))) @ self.screen.rotation[:, 1:]
        jacobian = np.full(by_spot.shape, np.nan)
        seen = np.isfinite(by_spot).all(axis=(1, 2))
        jacobian[seen] = np.linalg.inv(by_spot[seen])
        return jacobian

    @cached_property
    def screen(self) -> SE3:
        """T_camera_screen.

        Raises:
            UsageError: the camera knows no screen.
        """
        if self.T_camera_screen is None:
            raise UsageError(
                "the camera knows no screen; add it with urdfcal camera --lens CAMERA.yaml --screen IMAGE --markers SCREEN.yaml"
            )
        T_camera_screen: SE3 = self.T_camera_screen
        return T_camera_screen

    def _on_screen(self, spots: Matrix) -> Matrix:
        """Points (n, 3) in camera axes of spots (n, 2)."""
        spots = np.asarray(spots, dtype=float).reshape(-1, 2)
        return np.asarray(spots @ self.screen.rotation[:, 1:].T + self.screen.translation)
