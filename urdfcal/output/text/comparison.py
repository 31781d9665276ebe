"""Two accounts of one robot, as text and for machines."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from urdfcal.base.geometry import DEG, MM, Vector
from urdfcal.base.terminal import figures_table, rounded, titled
from urdfcal.calibration.analysis.comparison import Comparison, JointDifference

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

JOINT_BY_JOINT = "Joint by joint, in the joint's own axes"
_FIGURES = ("mean", "95 %", "worst")
NOT_SAID = "± is one combined standard deviation along the difference, and nothing where nobody estimated it"


def comparison_blocks(found: Comparison) -> list[RenderableType]:
    """The finding in words, then joint by joint and at the tool."""
    return [
        finding(found),
        "",
        titled(JOINT_BY_JOINT, _table(*joint_rows(found))),
        *(["", NOT_SAID] if found.expected is not None else []),
        "",
        titled(at_tool(found), _table(*tool_rows(found))),
        *([] if found.identical else ["", f"Farthest apart at {_where(found)}"]),
    ]


def finding(found: Comparison) -> str:
    """Whether the two are the same."""
    between = f"{found.one} and {found.other}"
    if found.identical:
        return f"{between} are the same but for rounding."
    apart = _rms(found.at_tool.apart)
    at = f"up to a constant of base and tool '{found.tool}' differs by {_mm(apart)} mm (RMS)"
    if found.expected is None or found.by_chance is None:
        return f"{between} differ, and neither says how sure it is: {at}."
    expected = f"{_mm(found.expected)} mm would be expected of what they do not know"
    if found.same:
        return f"{between} are the same within what either knows: {at}, and {expected}."
    return f"{between} differ by more than they are unsure of: {at}, where {expected} (by chance {_percent(found.by_chance)})."


def in_short(found: Comparison) -> str:
    """How far apart, and whether that is the same."""
    known = {True: "the same within what either knows", False: "more than they are unsure of", None: "neither says how sure it is"}
    return f"{_mm(_rms(found.at_tool.apart))} mm (RMS) apart up to a constant, {known[found.same]}"


def comparison_json(found: Comparison) -> dict[str, Any]:
    """The same for machines; SI where the name says nothing."""
    tool = found.at_tool
    return {
        "one": found.one,
        "other": found.other,
        "same": found.same,
        "joints": [_joint_entry(joint) for joint in found.joints],
        "tool": {
            "link": found.tool,
            "configurations": len(tool.distance),
            "distance_mm": _entry(tool.distance / MM),
            "up_to_constant_mm": _entry(tool.apart / MM) | {"rms": _rms(tool.apart) / MM},
            "angle_deg": _entry(tool.angle / DEG),
            "worst_at": tool.worst,
            "expected_up_to_constant_mm": None if found.expected is None else found.expected / MM,
            "by_chance": found.by_chance,
        },
    }


def joint_rows(found: Comparison) -> tuple[tuple[str, ...], list[list[str]]]:
    """Headings and cells, joint by joint."""
    sure = found.expected is not None
    rows = []
    for joint in found.joints:
        parts = ((joint.distance, joint.distance_sigma, MM), (joint.angle, joint.angle_sigma, DEG))
        cells = [_in(value, unit) for size, sigma, unit in parts for value in ((size, sigma) if sure else (size,))]
        rows.append([joint.name, *cells, *([_sigmas(joint)] if sure else [])])
    return ("joint", *(("mm", "±", "deg", "±", "σ") if sure else ("mm", "deg"))), rows


def tool_rows(found: Comparison) -> tuple[tuple[str, ...], list[list[str]]]:
    """Headings and cells, at the tool."""
    tool = found.at_tool
    parts = (("distance, mm", tool.distance, MM), ("up to a constant, mm", tool.apart, MM), ("angle, deg", tool.angle, DEG))
    return ("", *_FIGURES), [[name, *(f"{value / unit:.3f}" for value in _figures(values))] for name, values, unit in parts]


def at_tool(found: Comparison) -> str:
    """Where, and over what."""
    return f"At '{found.tool}', over {len(found.at_tool.distance)} random configurations"


def _table(columns: tuple[str, ...], rows: list[list[str]]) -> Table:
    table = figures_table(columns[0])
    for heading in columns[1:]:
        table.add_column(heading, justify="right")
    for row in rows:
        table.add_row(*row)
    return table


def worst_rows(found: Comparison) -> tuple[tuple[str, str], ...]:
    """Joints and their positions where the two are farthest apart."""
    return tuple((name, _position(found, name, value)) for name, value in found.at_tool.worst.items())


def _in(value: float | None, unit: float) -> str:
    return "" if value is None else f"{value / unit:.3f}"


def _sigmas(joint: JointDifference) -> str:
    return "" if joint.sigmas is None else f"{joint.sigmas:.1f}"


def _joint_entry(joint: JointDifference) -> dict[str, Any]:
    return {
        "name": joint.name,
        "distance": joint.distance,
        "distance_sigma": joint.distance_sigma,
        "angle": joint.angle,
        "angle_sigma": joint.angle_sigma,
    }


def _where(found: Comparison) -> str:
    return ", ".join(f"{name} {position}" for name, position in worst_rows(found))


def _position(found: Comparison, name: str, value: float) -> str:
    return f"{rounded(value / MM, 4)} mm" if name in found.sliding else f"{value / DEG:.1f} deg"


def _figures(values: Vector) -> tuple[float, float, float]:
    return float(np.mean(values)), float(np.quantile(values, 0.95)), float(np.max(values))


def _entry(values: Vector) -> dict[str, float]:
    return dict(zip(("mean", "p95", "worst"), _figures(values), strict=True))


def _rms(values: Vector) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _mm(value: float) -> str:
    return rounded(value / MM, 3)


def _percent(share: float) -> str:
    return f"{rounded(share * 100, 2)} %" if share >= 1e-4 else "under 0.01 %"
