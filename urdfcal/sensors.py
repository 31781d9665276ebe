"""What is measured, and Jac2: how a measurement moves with the twist of the body that carries its target.

A laser leaves its source p along z and meets the screen x = 0 at distance k = -p_x / z_x (8); the spot is the (y, z) of p + k z (7).
"""

from __future__ import annotations

import numpy as np

from urdfcal.geometry import Array3, Array4, Matrix, shift_covectors


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


def spot_jacobian(source: Array3, direction: Array3) -> Array4:
    """Jac2, equation (11): motion of the spot per twist [v, w] of its laser, in screen axes, taken at the laser.

    Returns:
        (n, lasers, 2, 6); rows are y and z of the spot.
    """
    px = source[..., 0]
    zx, zy, zz = np.moveaxis(direction, -1, 0)
    jac2 = np.zeros((*px.shape, 2, 6))
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = px / zx
        jac2[..., 0, 0] = -zy / zx
        jac2[..., 1, 0] = -zz / zx
        jac2[..., 0, 1] = jac2[..., 1, 2] = 1.0
        jac2[..., 0, 3] = zz * reach
        jac2[..., 0, 4] = zz * zy * reach / zx
        jac2[..., 0, 5] = -(1 - zz**2) * reach / zx
        jac2[..., 1, 3] = -zy * reach
        jac2[..., 1, 4] = (1 - zy**2) * reach / zx
        jac2[..., 1, 5] = -zz * zy * reach / zx
    return jac2


def spot_jacobian_at_screen(source: Array3, direction: Array3) -> Array4:
    """Equation (11) for the twist taken at the screen's origin, which all lasers share, (n, lasers, 2, 6)."""
    return shift_covectors(spot_jacobian(source, direction), source[..., None, :])
