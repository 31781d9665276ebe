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
        reaches: Of all that it does, H' B b, whitened, by the fit's parameters, (p,).
        left: Mean square that it leaves in the residuals over that of what the covariance predicts.
        length: Root mean square of what it leaves in readings of lengths, [m]; infinite where there are none.
    """

    reaches: Vector
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
        seen, moved = plain @ found.noise.normal(linearisation).A @ plain, plain @ self.reaches
        P = found.belief.P + self.left * (seen + seen.T) / 2 + np.outer(moved, moved)
        return replace(found, belief=Belief(found.belief.x, P))
