"""Planned poses as a table of measurements to fill, as a trajectory, in words and for machines."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import Any

import numpy as np
import yaml

from urdfcal.base.terminal import many, rounded
from urdfcal.planning.plan import PosePlan
from urdfcal.planning.roads import times_between
from urdfcal.planning.tour import Tour, legs, speeds_of

_DECIMALS = 6


def plan_csv(plan: PosePlan, tour: Tour, test: int, made_of: str) -> bytes:
    """A row a pose in the tour's order, to which what is read there is to be added; every so many-th is to test on."""
    text = io.StringIO()
    text.write(f"# poses for {plan.robot.name}, chosen by urdfcal poses; joints in rad (m where they slide); add what is read in each\n")
    text.write(f"# sha256 of what they were made of: {made_of}\n")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["pose", "set", *plan.joints])
    for number, q in enumerate(plan.q[tour.order], start=1):
        kind = "test" if number % test == 0 else "fit"
        writer.writerow([f"p{number:02d}", kind, *(f"{position + 0.0:.{_DECIMALS}f}" for position in q)])
    return text.getvalue().encode()


def trajectory_yaml(plan: PosePlan, tour: Tour, speed: float, made_of: str) -> bytes:
    """The tour as trajectory_msgs/JointTrajectory, each leg at a share of the joints' full speed; it begins where the tour does."""
    speeds, clock = speeds_of(plan.robot) * speed, 0.0
    stations = [plan.q[tour.order][:1], *(leg[1:] for leg in legs(plan.q, tour))]
    points, last = [], stations[0][0]
    for q in np.concatenate(stations):
        clock += float(times_between(last[None], q[None], speeds)[0, 0])
        last = q
        seconds = int(clock)
        points.append(
            {
                "positions": [round(float(position), _DECIMALS) for position in q],
                "time_from_start": {"sec": seconds, "nanosec": int((clock - seconds) * 1e9)},
            }
        )
    head = f"# trajectory_msgs/JointTrajectory by urdfcal poses; it begins at its first point\n# sha256 of what it was made of: {made_of}\n"
    body = yaml.safe_dump({"joint_names": list(plan.joints), "points": points}, sort_keys=False, default_flow_style=None, width=160)
    return (head + body).encode()


def plan_lines(plan: PosePlan, tour: Tour) -> list[str]:
    """What was chosen and what it is worth, in sentences."""
    before, after = rounded(plan.tool_sigma_mm[0], 3), rounded(plan.tool_sigma_mm[-1], 3)
    minutes = f"{float(tour.seconds.sum()):.0f} s at full speed"
    lines = [
        f"{many(len(plan), 'pose')} for {plan.robot.name}: '{plan.tool}' predicted to be {after} mm off (RMS over the workspace), "
        f"{before} mm before any, {rounded(plan.at_random_mm, 3)} mm after as many random ones",
        f"driven in this order they take {minutes}" + (f", {many(len(tour.vias), 'leg')} by a detour" if tour.vias else ""),
    ]
    return lines


def plan_json(plan: PosePlan, tour: Tour, files: Sequence[str]) -> dict[str, Any]:
    """The same for machines; SI where the name says nothing."""
    return {
        "tool": plan.tool,
        "joints": list(plan.joints),
        "poses": plan.q[tour.order].tolist(),
        "tool_sigma_mm": plan.tool_sigma_mm.tolist(),
        "at_random_mm": plan.at_random_mm,
        "seconds": tour.seconds.tolist(),
        "vias": {str(leg + 1): via.tolist() for leg, via in tour.vias.items()},
        "blocked": [leg + 1 for leg in tour.blocked],
        "files": list(files),
    }
