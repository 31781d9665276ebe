"""Planned poses as a table of measurements to fill, in words and for machines."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import Any

import numpy as np

from urdfcal.base.terminal import many, rounded
from urdfcal.output.drives import pose_names
from urdfcal.output.ways_around import ways_lines
from urdfcal.planning.plan import PosePlan
from urdfcal.planning.tour import Tour

_DECIMALS = 6


def plan_csv(plan: PosePlan, tour: Tour, test: int, made_of: str, both_sides: bool = False) -> bytes:
    """A row a reading in the tour's order, to which what is read there is to be added.

    Every so many-th pose is to test on, and all of a check. From both sides each is two rows, with the way that its joints came. Comments
    behind the rows have the ways around.
    """
    text = io.StringIO()
    text.write(f"# poses for {plan.robot.name}, chosen by urdfcal poses; joints in rad (m where they slide); add what is read in each\n")
    text.write(f"# sha256 of what they were made of: {made_of}\n")
    writer = csv.writer(text, lineterminator="\n")
    approaches = [f"{joint}.approach" for joint in plan.joints] if both_sides else []
    writer.writerow(["pose", "set", *plan.joints, *approaches])
    for number, (names, q) in enumerate(zip(pose_names(len(plan), both_sides), plan.q[tour.order], strict=True), start=1):
        kind = set_of(plan, number, test)
        for name, side in zip(names, (1, -1), strict=False):
            writer.writerow([name, kind, *(f"{position + 0.0:.{_DECIMALS}f}" for position in q), *[side] * len(approaches)])
    text.writelines(f"# {line}\n" for line in ways_lines(plan, tour, both_sides))
    return text.getvalue().encode()


def set_of(plan: PosePlan, number: int, test: int) -> str:
    """Whether the so many-th pose of the tour, counted from 1, is to fit or to test on: every so many-th, and all of a check."""
    return "test" if number % test == 0 or plan.detects_mm is not None else "fit"


def plan_lines(plan: PosePlan, tour: Tour, completed: bool = False) -> list[str]:
    """What was chosen and what it is worth, in sentences; `completed` where others were measured before."""
    before, after = rounded(plan.tool_sigma_mm[0], 3), rounded(plan.tool_sigma_mm[-1], 3)
    first = "with those alone that were measured already" if completed else "before any"
    lines = [
        plan.usable,
        f"{many(len(plan), 'more pose' if completed else 'pose')} for {plan.robot.name}: '{plan.tool}' predicted to be {after} mm off (RMS "
        f"over the workspace, all fitted), {before} mm {first}, {rounded(plan.at_random_mm, 3)} mm after {_as_many(plan)}",
    ]
    if plan.detects_mm is not None:
        lines[-1] = (
            f"{many(len(plan), 'pose')} for {plan.robot.name} to measure now and again later: {_detected(plan)} shows in nine of ten cases"
        )
    if plan.criterion != "I":
        better = "larger" if plan.criterion.startswith("O") else "smaller"
        value, at_random = rounded(plan.value, 3), rounded(plan.value_at_random, 3)
        lines.append(f"{plan.criterion} is {value} of them, {at_random} of {_as_many(plan)}; {better} is better")
    return [*lines, *_driven(tour)]


def _as_many(plan: PosePlan) -> str:
    return "one random one" if len(plan) == 1 else "as many random ones"


def _driven(tour: Tour) -> list[str]:
    """How long the way is; nothing where there is none."""
    if not len(tour.seconds):
        return []
    detours = f", {many(len(tour.vias), 'leg')} of {len(tour.seconds)} by a detour" if tour.vias else ""
    without = f", without {many(len(tour.blocked), 'leg')} for which no way was found" if tour.blocked else ""
    seconds = float(np.delete(tour.seconds, list(tour.blocked)).sum())
    return [f"from the first to the last in this order takes {_whole(seconds)} s at full speed{detours}{without}"]


def _whole(seconds: float) -> str:
    return f"{seconds:.0f}" if seconds >= 10 else f"{seconds:.1f}"


def _detected(plan: PosePlan) -> str:
    if plan.detects_mm is None or not np.isfinite(plan.detects_mm):
        return "no change of the joints, however large,"
    return f"a change that moves '{plan.tool}' by {rounded(plan.detects_mm, 3)} mm (RMS over the workspace)"


def plan_json(plan: PosePlan, tour: Tour, files: Sequence[str]) -> dict[str, Any]:
    """The same for machines; SI where the name says nothing."""
    return {
        "tool": plan.tool,
        "joints": list(plan.joints),
        "poses": plan.q[tour.order].tolist(),
        "tool_sigma_mm": plan.tool_sigma_mm.tolist(),
        "at_random_mm": plan.at_random_mm,
        "criterion": {"name": plan.criterion, "value": plan.value, "at_random": plan.value_at_random},
        "detects_mm": plan.detects_mm if plan.detects_mm is not None and np.isfinite(plan.detects_mm) else None,
        "candidates": {"looked_at": plan.looked, "not_measurable": dict(plan.reasons)},
        "assumed": list(plan.assumed),
        "seconds": tour.seconds.tolist(),
        "vias": {str(leg + 1): via.tolist() for leg, via in tour.vias.items()},
        "blocked": [leg + 1 for leg in tour.blocked],
        "files": list(files),
    }
