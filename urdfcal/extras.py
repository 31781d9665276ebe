"""What `fit` says on request beyond its own tables: accuracy of a tool over the workspace, cross-validation."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from urdfcal.error_table import rms_mm
from urdfcal.fit_result import CrossValidation, FitResult
from urdfcal.geometry import MM
from urdfcal.prediction import SpotAccuracy, base_link, poses_in_view, spot_accuracy, tool_sigma
from urdfcal.report import spot_table_block, table_json
from urdfcal.robot import Robot
from urdfcal.simulation import joint_limits

if TYPE_CHECKING:
    from rich.console import RenderableType

_CONFIGURATIONS = 200


@dataclass(frozen=True)
class WorkspaceAccuracy:
    """Predicted error of a link relative to the base, over random configurations within the joint limits.

    Attributes:
        link, base: The two links.
        mm, mrad: Root mean square over the configurations of the predicted error in position and rotation.
        worst_mm: Of the worst configuration.
    """

    link: str
    base: str
    mm: float
    mrad: float
    worst_mm: float

    def words(self) -> str:
        """One line."""
        return (
            f"{self.link} relative to {self.base}, over the workspace: {self.mm:.2g} mm and {self.mrad:.2g} mrad expected, "
            f"{self.worst_mm:.2g} mm in the worst configuration"
        )


def workspace_accuracy(robot: Robot, calibration: FitResult, link: str, rng: np.random.Generator) -> WorkspaceAccuracy:
    """Predict how far off a link still is, from the covariance of the fit; see `prediction.py` for what carries no sigma."""
    lower, upper = joint_limits(robot)
    q = rng.uniform(lower, upper, (_CONFIGURATIONS, len(lower)))
    sigma = tool_sigma(robot, calibration.errors, calibration.covariance, calibration.x, link, q) * 1e3
    mm, mrad = np.sqrt(np.mean(sigma**2, axis=0))
    return WorkspaceAccuracy(link, base_link(robot, link), float(mm), float(mrad), float(sigma[:, 0].max()))


def predicted_spots(robot: Robot, calibration: FitResult, rng: np.random.Generator) -> SpotAccuracy | None:
    """How far off the spots still are over the workspace, by the fit's covariance; None where no laser was seen."""
    if not calibration.data.seen.any():
        return None
    errors, x = calibration.errors, calibration.x
    q = poses_in_view(robot, errors, x, calibration.data, rng)
    return spot_accuracy(errors, calibration.covariance, x, q if len(q) else calibration.data.q)


@dataclass(frozen=True)
class Extras:
    """What is said beyond the fit itself.

    Attributes:
        accuracy: Of a tool, if it was asked for.
        folds: Cross-validation, if it was asked for.
        spots: Predicted accuracy of the spots, where there are lasers.
    """

    accuracy: WorkspaceAccuracy | None
    folds: CrossValidation | None
    spots: SpotAccuracy | None = None

    def blocks(self) -> list[RenderableType]:
        """For people."""
        blocks: list[RenderableType] = []
        if self.spots is not None:
            rows = zip(self.spots.lasers, self.spots.median / MM, self.spots.most / MM, self.spots.worst / MM, strict=True)
            words = "; ".join(f"{laser} {median:.2g}, {most:.2g}, {worst:.2g} mm" for laser, median, most, worst in rows)
            blocks += ["", f"Predicted error of the spots over the workspace (median, 95 %, worst): {words}"]
        if self.accuracy is not None:
            blocks += ["", self.accuracy.words()]
        if self.folds is not None:
            blocks += ["", "Cross-validation: every pose predicted by a fit that did not see it", ""]
            blocks += [spot_table_block([(f"{self.folds.folds}-fold", self.folds.before, self.folds.after)], self.folds.spots)]
            blocks += [f"fold rejected: {reason}" for reason in self.folds.rejected]
        return blocks

    def machine(self) -> dict[str, Any]:
        """For machines."""
        machine: dict[str, Any] = {}
        if self.spots is not None:
            rows = zip(self.spots.lasers, self.spots.median, self.spots.most, self.spots.worst, strict=True)
            machine["predicted_spots"] = {
                laser: {"median": float(median), "quantile_95": float(most), "worst": float(worst)} for laser, median, most, worst in rows
            }
        if self.accuracy is not None:
            machine["tool"] = asdict(self.accuracy)
        if self.folds is not None:
            machine["kfold"] = {
                "folds": self.folds.folds,
                "before": table_json(self.folds.before),
                "after": table_json(self.folds.after),
                "rms_mm": rms_mm(self.folds.after),
                "rejected": list(self.folds.rejected),
            }
        return machine
