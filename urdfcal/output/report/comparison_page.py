"""Two accounts of one robot as a page: both beside each other, joint by joint and at the tool."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from urdfcal.base.geometry import DEG, MM, Vector
from urdfcal.calibration.analysis.comparison import Comparison, JointDifference
from urdfcal.output.report.document import Block, Gallery, Section, Table
from urdfcal.output.report.plain import PlainReport, made_of_section, plain_page
from urdfcal.output.report.plots.axes import Axes, Look
from urdfcal.output.report.plots.residuals import size_bins
from urdfcal.output.report.plots.svg import Picture, draw_picture, row_ends, row_height, shortened
from urdfcal.output.report.verdict import Level, Opening
from urdfcal.output.text.comparison import NOT_SAID, finding, joint_rows, tool_rows, worst_rows

_SUMMARIES: dict[bool | None, tuple[Level, str]] = {
    True: ("good", "The same within what either knows"),
    False: ("warn", "They differ by more than they are unsure of"),
    None: ("note", "They differ, and neither says how sure it is"),
}


def comparison_page(found: Comparison, files: Iterable[tuple[str, Path | None]], made_of: str) -> bytes:
    """The page.

    Args:
        found: What was compared.
        files: What it is made of: a word and the file.
        made_of: Their hash.
    """
    level, summary = _SUMMARIES[found.same]
    summary = "The same but for rounding" if found.identical else summary
    opening = Opening(level, summary, finding(found), (), None, "")
    sections = (_joints(found), _tool(found), made_of_section(files))
    report = PlainReport(f"Two calibrations compared at {found.tool}", f"{found.one} and {found.other}", opening, sections)
    return plain_page(report, _pictures(found), made_of)


def _joints(found: Comparison) -> Section:
    sure = found.expected is not None
    columns, rows = joint_rows(found)
    blocks: list[Block] = ["In the joint's own axes; what may be booked on a joint or on the one behind it is no difference."]
    blocks += [Table(columns, tuple(map(tuple, rows))), *([f"{NOT_SAID}."] if sure else []), Gallery("joints")]
    return Section("joints", "Joint by joint", tuple(blocks))


def _tool(found: Comparison) -> Section:
    text = (
        f"Distance of '{found.tool}' in the two, over {len(found.at_tool.distance)} random configurations within the joint limits: in the "
        "root's frame, and without what a constant placement of base and tool explains."
    )
    columns, rows = tool_rows(found)
    blocks: list[Block] = [text, Table(columns, tuple(map(tuple, rows)))]
    if not found.identical:
        blocks += [Gallery("histograms"), "Farthest apart at", Table(("joint", "position"), worst_rows(found))]
    return Section("tool", f"At {found.tool}", tuple(blocks))


def _pictures(found: Comparison) -> list[Picture]:
    joints = found.joints
    lengths = [(joint.distance / MM, _in(joint.distance_sigma, MM)) for joint in joints]
    angles = [(joint.angle / DEG, _in(joint.angle_sigma, DEG)) for joint in joints]
    bars = [_bars("Lengths", "mm", joints, lengths), _bars("Angles", "deg", joints, angles)]
    tool = found.at_tool
    sizes = [_sizes(title, values / MM, "mm") for title, values in (("Distance", tool.distance), ("Up to a constant", tool.apart))]
    return bars + ([] if found.identical else sizes)


def _in(sigma: float | None, unit: float) -> float:
    return np.nan if sigma is None else sigma / unit


def _bars(title: str, unit: str, joints: Sequence[JointDifference], values: Sequence[tuple[float, float]]) -> Picture:
    size, sigma = np.array(values).reshape(-1, 2).T
    rows = -np.arange(len(joints), dtype=float)
    known = np.isfinite(sigma)

    def draw(axes: Axes) -> None:
        axes.bars(np.zeros(known.sum()), sigma[known], rows[known], "band")
        axes.points(size, rows, Look("c0", mark="o"))
        axes.across(x=0.0)
        most = max(float(size.max(initial=0.0)), float(sigma[known].max(initial=0.0)), 1e-6)
        axes.x_label, axes.rows = f"difference in {unit}", [shortened(joint.name) for joint in joints]
        axes.x_ends, axes.y_ends = (0.0, 1.05 * most), row_ends(len(joints))

    caption = "How far each joint's placement differs; the band is one combined standard deviation." if known.any() else ""
    return draw_picture("joints", f"{title} by joint", caption, row_height(len(joints)), draw)


def _sizes(title: str, sizes: Vector, unit: str) -> Picture:
    edges = size_bins(sizes)
    counts = np.histogram(np.minimum(sizes, edges[-1]), edges)[0]

    def draw(axes: Axes) -> None:
        axes.steps(counts, edges, Look("c0", dash="solid"))
        axes.x_label, axes.y_label = f"apart in {unit}", "configurations"
        axes.x_ends, axes.y_ends = (0.0, float(edges[-1])), (0.0, 1.15 * max(int(counts.max()), 1))

    return draw_picture("histograms", title, "", 120, draw)
