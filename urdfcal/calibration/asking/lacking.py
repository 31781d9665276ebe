"""What something that is not in a fit does to it, and to what it predicts.

Something B b that geometry has no word for moves the parameters by P H' B b, and leaves M B b in the residuals, as it will in every
reading to come. The square of the first is added to the covariance. The second acts as noise that no number of readings averages out:
what the covariance predicts of readings like those that were made is to be larger by it, so it is taken through P H' as noise is, P H' H P,
times the mean square that it leaves over what is predicted. So predictions are off by as much as they say, and directions that data do not
see stay as they were. The coefficients b are those that the data give: where they cannot be told from geometry, geometry makes up for
them as well in readings to come.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from urdfcal.base.geometry import Matrix, Vector
from urdfcal.estimation.ekf import Belief, Estimate
from urdfcal.estimation.residual import Linearisation


@dataclass(frozen=True, eq=False)
class Lacking:
    """What stands out and is not in a fit.

    Attributes:
        does: What it does to all that was measured, B b, whitened, (N,).
        left: Mean square that it leaves in the residuals over that of what the covariance predicts.
        length: Root mean square of what it leaves in readings of lengths, [m]; infinite where there are none.
    """

    does: Vector
    left: float
    length: float

    def beside(self, predicted: float) -> float:
        """What it adds to an error that is predicted without it, root mean squares, [m]: in proportion, and no more than it was seen to."""
        return min(predicted * float(np.sqrt(self.left)), self.length)

    def widening(self, found: Estimate, linearisation: Linearisation, plain: Matrix) -> Estimate:
        """An estimate whose covariance knows of it.

        Args:
            found: The fit.
            linearisation: Of what was fitted, at the estimate.
            plain: Covariance of the data and the priors alone, (p, p).
        """
        H = found.noise.weights(linearisation).jacobian(linearisation)
        return replace(found, belief=Belief(found.belief.x, self.widened(found.belief.P, plain, H)))

    def widened(self, P: Matrix, plain: Matrix, H: Matrix) -> Matrix:
        """The fit's covariance that knows of it, (p, p).

        Args:
            P: The covariance that does not.
            plain: That of the data and the priors alone, from which P may differ by what is unsure of the priors' scales.
            H: Whitened Jacobian, (N or more, p).
        """
        seen, moved = plain @ H.T, plain @ (H[: len(self.does)].T @ self.does)
        return np.asarray(P + self.left * (seen @ seen.T) + np.outer(moved, moved))
