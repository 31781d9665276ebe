"""How far off tool and spots are to be expected, for any covariance of the parameters, without another look at the robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from urdfcal.base.geometry import Array3, Array4, Matrix


@dataclass(frozen=True)
class Forecast:
    """Sums over the configurations at which accuracy is asked for: the mean of |J e|^2 is that of J'J with the covariance of e.

    Attributes:
        position: Derivatives of the tool's position, (n, 3, p).
        of_position, of_rotation: Mean of J'J over the workspace, (p, p).
        of_spots: The same of spots on the screen; nan where there are none.
    """

    position: Array3
    of_position: Matrix
    of_rotation: Matrix
    of_spots: Matrix

    @staticmethod
    def of(tool: Array3, spots: Array4) -> Forecast:
        """From derivatives of the tool's pose, (n, 6, p), and of spots, (n, lasers, 2, p)."""
        position, rotation = np.ascontiguousarray(tool[:, :3]), tool[:, 3:]
        p = tool.shape[2]
        return Forecast(position, _mean(position), _mean(rotation), _mean(spots.reshape(-1, 2, p)))

    def tool_rms(self, P: Matrix) -> float:
        """RMS error of the tool's position over the workspace, [m]."""
        return _root(self.of_position, P)

    def tool_worst(self, P: Matrix) -> float:
        """The same at the worst configuration, [m]."""
        rows = self.position.reshape(-1, self.position.shape[2])
        return float(np.sqrt(np.sum((rows @ P) * rows, axis=1).reshape(-1, 3).sum(axis=1).max()))

    def rotation_rms(self, P: Matrix) -> float:
        """RMS error of its rotation, [rad]."""
        return _root(self.of_rotation, P)

    def spot_rms(self, P: Matrix) -> float:
        """RMS error of a spot, [m]; nan where none was asked for."""
        return _root(self.of_spots, P)


def _mean(jacobians: Array3) -> Matrix:
    """J'J over all (n, k, p), (p, p); nan if there are none."""
    n, _, p = jacobians.shape
    rows = jacobians.reshape(-1, p)
    return rows.T @ rows / n if n else np.full((p, p), np.nan)


def _root(gram: Matrix, P: Matrix) -> float:
    return float(np.sqrt(np.maximum(np.sum(gram * P), 0.0)))
