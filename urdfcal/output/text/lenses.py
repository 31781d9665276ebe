"""Lenses of cameras that a fit refined, in words: what their files said, and what is known now."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from urdfcal.base.terminal import figures_table, titled, value_and_sigma
from urdfcal.calibration.result import FitResult, refined_cameras

if TYPE_CHECKING:
    from rich.console import RenderableType

_IN_PIXELS = ("fx", "fy", "cx", "cy")


def lens_blocks(calibration: FitResult) -> list[RenderableType]:
    """A table of the intrinsics of every camera that was refined; nothing where none was."""
    rows = list(_rows(calibration))
    if not rows:
        return []
    table = figures_table("camera", "")
    for title in ("file ± sigma", "found ± sigma"):
        table.add_column(title, justify="right", no_wrap=True)
    table.add_column("unit")
    for row in rows:
        table.add_row(*row)
    return ["", titled("Lenses refined with the fit", table)]


def _rows(calibration: FitResult) -> Iterator[tuple[str, ...]]:
    if not calibration.data.refines:
        return
    from urdfcal.sensors.camera import usual_covariance
    from urdfcal.sensors.lenses import intrinsic_names

    before = calibration.data.seeing
    for name, camera in refined_cameras(calibration.data, calibration.errors, calibration.estimate.belief).items():
        old = before[name]
        stated = usual_covariance(old) if old.lens_covariance is None else old.lens_covariance
        for row, intrinsic in enumerate(intrinsic_names(camera.lens)):
            was, now = (float(np.sqrt(max(covariance[row, row], 0.0))) for covariance in (stated, camera.lens_covariance))
            told = (value_and_sigma(float(old.intrinsics[row]), was), value_and_sigma(float(camera.intrinsics[row]), now))
            yield (name if row == 0 else "", intrinsic, *told, "px" if intrinsic in _IN_PIXELS else "")
