"""What was understood of a file of measurements, as text and for machines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from urdfcal.base.geometry import DEG, MM
from urdfcal.base.terminal import decimals, figures_table, many, titled
from urdfcal.sensors.overview import JointRange, Overview, ReadingCount, by_board, told

if TYPE_CHECKING:
    from rich.console import RenderableType


def overview_blocks(found: Overview) -> list[RenderableType]:
    """A line in words, joints, readings, poses, and what is missing."""
    blocks: list[RenderableType] = [f"{found.robot.name}: {found.data.counted} with {found.data.summary}", ""]
    blocks += [titled("Joints", _joint_table(found)), "", titled(_readings_title(found), _reading_table(found)), ""]
    blocks += _pose_lines(found)
    if not (all(joint.stated for joint in found.joints) and all(each.stated for each in found.readings)):
        blocks.append("a unit in brackets is the default: the header states none")
    missing = list(found.missing())
    return blocks + (["", "What is missing:", *(f"  {line}" for line in missing)] if missing else [])


def overview_json(found: Overview) -> dict[str, Any]:
    """The same for machines; SI."""
    data = found.data
    return {
        "joints": [_joint_entry(joint) for joint in found.joints],
        "readings": [
            {
                "target": each.readings.target,
                **({"instrument": each.readings.instrument} if each.readings.instrument else {}),
                "link": each.readings.link,
                "sensor": each.readings.sensor,
                "columns": list(each.columns),
                "units": list(each.units),
                "unit_stated": each.stated,
                "seen": each.seen,
                "in_part": int(each.partly.sum()),
            }
            for each in found.readings
        ],
        "reference": (data.instruments.placed and found.robot.rig.instruments.reference) or None,
        "rows": len(data),
        "poses": data.pose_count,
        "copies": found.copies,
        "rows_without_readings": found.unread,
        "sets": {name: int(np.count_nonzero(data.sets == name)) for name in ("fit", "test")},
        "sessions": {name: int(np.count_nonzero(data.sessions == name)) for name in data.session_names},
        "payload_kg": [] if data.payload is None else sorted({float(mass) for mass in data.payload}),
        "missing": list(found.missing()),
        "warnings": list(data.warnings),
    }


def _joint_entry(joint: JointRange) -> dict[str, Any]:
    return {
        "name": joint.name,
        "column_unit": joint.unit,
        "unit_stated": joint.stated,
        "unit": "m" if joint.prismatic else "rad",
        "lower": joint.lower,
        "upper": joint.upper,
        "limits": None if joint.limits is None else list(joint.limits),
        "share": joint.share,
    }


def _joint_table(found: Overview) -> Any:
    table = figures_table("joint", "column in")
    for label in ("from", "to", "limits", "share"):
        table.add_column(label, justify="right")
    for joint in found.joints:
        size, unit = (MM, "mm") if joint.prismatic else (DEG, "deg")
        limits = "none" if joint.limits is None else " to ".join(f"{limit / size:.0f}" for limit in joint.limits)
        span = decimals(joint.lower / size, 1), f"{decimals(joint.upper / size, 1)} {unit}"
        share = "" if joint.share is None else f"{100 * joint.share:.0f} %"
        table.add_row(joint.name, _unit(joint.unit, joint.stated), *span, limits, share)
    return table


def _readings_title(found: Overview) -> str:
    if not found.data.instruments.placed:
        return "Readings"
    if found.data.instruments.others:
        return f"Readings, measured from {', '.join(own.name for own in found.robot.rig.instruments.every)}"
    return f"Readings, measured from a frame on the link {found.robot.rig.instruments.reference}"


def _reading_table(found: Overview) -> Any:
    table = figures_table("target", "read", "columns", "in")
    for group in by_board(found):
        first, units = group[0], dict.fromkeys(unit for each in group for unit in each.units)
        stated = all(each.stated for each in group)
        table.add_row(_called(group, found), told(group), _columns(first), _unit(", ".join(units), stated))
    return table


def _called(group: Sequence[ReadingCount], found: Overview) -> str:
    """`tool0`, `board, 54 corners`."""
    own = group[0].readings
    if len(group) == 1:
        return own.label
    at = f"@{own.instrument}" if own.instrument else ""
    return f"{own.link}{at}, {len(group)} {'corners' if own.link in found.data.boards else 'targets'}"


def _columns(each: ReadingCount) -> str:
    return " ".join(f".{name.rpartition('.')[2]}" for name in each.columns) or "none"


def _unit(unit: str, stated: bool) -> str:
    return unit if stated or not unit else f"({unit})"


def _pose_lines(found: Overview) -> list[str]:
    data, test = found.data, int(np.count_nonzero(found.data.sets == "test"))
    rows = f"{many(len(data), 'row')}, {many(data.pose_count, 'different pose')}"
    rows += f"; {many(found.copies, 'row')} of them copied from others" if found.copies else ""
    rows += f"; nothing was read in {many(found.unread, 'row')}" if found.unread else ""
    lines = [rows, f"{many(len(data) - test, 'row')} to fit, {test} to test"]
    if (data.sessions != "").any():
        lines.append(f"{many(len(data.session_names), 'session')}: {', '.join(name or '(no name)' for name in data.session_names)}")
    if data.payload is not None:
        lines.append(f"payload from {data.payload.min():g} to {data.payload.max():g} kg")
    return lines
