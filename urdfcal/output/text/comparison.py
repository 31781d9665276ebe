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

_FIGURES = ("mean", "95 %", "worst")
NOT_SAID = "± is one combined standard deviation along the difference, and nothing where nobody estimated it"


def comparison_blocks(found: Comparison) -> list[RenderableType]:
    """The finding in words, then joint by joint and at the tool."""
    return [
        finding(found),
        "",
        titled("Joint by joint, in the joint's own axes", _joint_table(found)),
        *(["", NOT_SAID] if found.expected is not None else []),
        "",
        titled(f"At '{found.tool}', over {len(found.at_tool.distance)} random configurations", _tool_table(found)),
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


def _joint_table(found: Comparison) -> Table:
    sure = found.expected is not None
    table = figures_table("joint")
    for heading in ("mm", "±", "deg", "±", "σ") if sure else ("mm", "deg"):
        table.add_column(heading, justify="right")
    for row in joint_rows(found):
        table.add_row(*row)
    return table


def joint_rows(found: Comparison) -> list[list[str]]:
    """Name, distance [mm] and angle [deg] by joint, each with its ± and both with σ where somebody says how sure he is."""
    sure, table = found.expected is not None, []
    for joint in found.joints:
        rows = ((joint.distance, joint.distance_sigma, MM), (joint.angle, joint.angle_sigma, DEG))
        cells = [_in(value, unit) for size, sigma, unit in rows for value in ((size, sigma) if sure else (size,))]
        table.append([joint.name, *cells, *([_sigmas(joint)] if sure else [])])
    return table


def _tool_table(found: Comparison) -> Table:
    table = figures_table("")
    for heading in _FIGURES:
        table.add_column(heading, justify="right")
    for row in tool_rows(found):
        table.add_row(*row)
    return table


def tool_rows(found: Comparison) -> tuple[tuple[str, ...], ...]:
    """What differs at the tool, with its mean, 95 % and worst."""
    tool = found.at_tool
    rows = (("distance, mm", tool.distance, MM), ("up to a constant, mm", tool.apart, MM), ("angle, deg", tool.angle, DEG))
    return tuple((name, *(f"{value / unit:.3f}" for value in _figures(values))) for name, values, unit in rows)


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
