"""What something that is not in a fit does to it, and to what it predicts.

Something B b that geometry has no word for moves the parameters by P H' B b, and leaves M B b in the residuals, as it will in every
reading to come. The first is added to the covariance as it is, and that is made as much larger as the second is than what it predicts,
so that predictions are off by as much as they say.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from urdfcal.base.geometry import Matrix


@dataclass(frozen=True, eq=False)
class Lacking:
    """What stands out and is not in a fit.

    Attributes:
        root: B times the root of E[b b'], whitened, (N, k).
        left: Mean square that it leaves in the residuals over that of what the covariance predicts.
    """

    root: Matrix
    left: float

    def widened(self, P: Matrix, plain: Matrix, H: Matrix) -> Matrix:
        """A covariance that knows of it, (p, p).

        Args:
            P: The covariance that does not.
            plain: That of the data and the priors alone, from which P may differ by what is unsure of the priors' scales.
            H: Whitened Jacobian, (N or more, p).
        """
        moved = plain @ (H[: len(self.root)].T @ self.root)
        return np.asarray(P * (1 + self.left) + moved @ moved.T)
