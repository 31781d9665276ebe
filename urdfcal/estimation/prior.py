"""What is known of the parameters before the data: independent Gaussians, some of them in groups of one unknown scale."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from urdfcal.base.geometry import Mask, Vector


@dataclass(frozen=True)
class Prior:
    """Independent Gaussians over the parameters.

    Attributes:
        names: Of the parameters.
        mean: Means, (p,).
        sigma: Standard deviations, (p,).
        groups: Which group each belongs to, whose scale the data may choose; the empty string where the sigma is kept.
    """

    names: tuple[str, ...]
    mean: Vector
    sigma: Vector
    groups: tuple[str, ...]

    def members(self, group: str) -> Mask:
        """Which parameters are of a group, (p,)."""
        return np.array([own == group for own in self.groups], dtype=bool)

    def with_scales(self, scales: Mapping[str, float]) -> Prior:
        """The same with other standard deviations of the groups."""
        sigma = [scales[group] if group else own for group, own in zip(self.groups, self.sigma.tolist(), strict=True)]
        return replace(self, sigma=np.array(sigma))
