"""Pictures of a calibration as figures of matplotlib: those of the report."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from urdfcal.base.errors import UsageError
from urdfcal.calibration.result import FitResult
from urdfcal.output.report.plots.svg import Picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def spots_figure(calibration: FitResult) -> Figure:
    """Where readings are and where the robot has them, before and after.

    Raises:
        UsageError: nothing was measured that has a place.
    """
    from urdfcal.output.report.plots.maps import map_pictures
    from urdfcal.output.report.residuals import residuals_of
    from urdfcal.output.report.suspects import suspects

    sets = residuals_of(calibration)
    return _figure(map_pictures(sets, suspects(calibration, sets)), "has a place; plot_residuals() shows it all")


def residuals_figure(calibration: FitResult) -> Figure:
    """How large residuals are, and number by number against the pose."""
    from urdfcal.output.report.plots.residuals import component_pictures, size_pictures
    from urdfcal.output.report.residuals import residuals_of

    sets = residuals_of(calibration)
    return _figure([*size_pictures(sets), *component_pictures(sets)], "was read")


def convergence_figure(calibration: FitResult) -> Figure:
    """The estimates after each sweep, as in the paper's Fig. 4, and the residual."""
    from urdfcal.output.report.plots.parameters import convergence_pictures

    return _figure(convergence_pictures(calibration), "was estimated")


def _figure(pictures: Sequence[Picture], what: str) -> Figure:
    from urdfcal.output.report.plots.figures import figure_of

    if not pictures:
        raise UsageError(f"there is nothing to draw: nothing that {what}")
    return figure_of(pictures)
