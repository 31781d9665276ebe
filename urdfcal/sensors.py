"""What is measured, and Jac2: how a measurement moves with the twist of the body that carries its target.

A laser leaves its source p along z and meets the screen x = 0 at distance k = -p_x / z_x (8); the spot is the (y, z) of p + k z (7).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from urdfcal.geometry import Array3, Array4, Matrix

LEAST_ZX = 0.3  # beams that graze the screen more flatly than this make no spot


def spots_on_screen(source: Array3, direction: Array3) -> tuple[Array3, Matrix]:
    """Where beams meet the screen: equations (7) and (8).

    Args:
        source: (n, lasers, 3) in screen axes, [m].
        direction: (n, lasers, 3) unit vectors in screen axes.

    Returns:
        Spots (y, z), (n, lasers, 2), [m]; and beam lengths k, (n, lasers), [m], negative where the screen lies behind the laser
        and infinite or nan where the beam is parallel to it.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        length = -source[..., 0] / direction[..., 0]
        return source[..., 1:] + length[..., None] * direction[..., 1:], length


def makes_spot(length: Matrix, direction: Array3, nearest: float = 0.0, farthest: float = np.inf) -> npt.NDArray[np.bool_]:
    """Which beams make a spot that can be measured: they meet the screen, at no grazing angle, within a range of lengths.

    Args:
        length: Beam lengths k, (n, lasers), [m].
        direction: (n, lasers, 3) unit vectors in screen axes.
        nearest: Least length, [m].
        farthest: Greatest length, [m].

    Returns:
        (n, lasers).
    """
    with np.errstate(invalid="ignore"):
        return (length > nearest) & (length < farthest) & (np.abs(direction[..., 0]) > LEAST_ZX)


def spot_jacobian(spots: Array3, direction: Array3) -> Array4:
    """Jac2: motion of the spots per twist [v, w] of their lasers' carrier, in screen axes, taken at the screen's origin.

    The point of the beam that stands on the spot s moves with v + w x s; its motion along x is given back along the beam, so
    dy = v_y - (z_y / z_x) v_x and dz = v_z - (z_z / z_x) v_x of that point. Written for the twist at the source p, with
    s - p = k z, these are the two rows of equation (11).

    Args:
        spots: (n, lasers, 2), [m].
        direction: (n, lasers, 3).

    Returns:
        (n, lasers, 2, 6); rows are y and z of the spot.
    """
    y, z = spots[..., 0], spots[..., 1]
    jac2 = np.zeros((*y.shape, 2, 6))
    with np.errstate(divide="ignore", invalid="ignore"):
        lean = direction[..., 1:] / -direction[..., :1]
        jac2[..., 0] = lean
        jac2[..., 0, 1] = jac2[..., 1, 2] = 1.0
        jac2[..., 0, 3], jac2[..., 1, 3] = -z, y
        jac2[..., 4] = z[..., None] * lean
        jac2[..., 5] = -y[..., None] * lean
    return jac2
