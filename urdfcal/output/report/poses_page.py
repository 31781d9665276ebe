"""Planned poses as a page: what they are worth beside random ones, what they leave open, how the joints are turned, the tour."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from urdfcal.base.geometry import DEG, MM, Vector
from urdfcal.base.terminal import many, rounded
from urdfcal.output.report.document import Block, Gallery, Points, Section, Table
from urdfcal.output.report.plain import PlainReport, made_of_section, plain_page
from urdfcal.output.report.plots.axes import Axes, Look
from urdfcal.output.report.plots.svg import Picture, draw_picture
from urdfcal.output.report.verdict import Opening
from urdfcal.output.text.poses import set_of
from urdfcal.planning.plan import PosePlan
from urdfcal.planning.tour import Tour
from urdfcal.robot.configurations import joint_limits

_ROW = 22.0  # [px] for a joint
_MOST_NAMED = 40  # parameters that are named


def poses_page(
    plan: PosePlan,
    tour: Tour,
    test: int,
    said: Sequence[str],
    files: Iterable[tuple[str, Path | None]],
    made_of: str,
) -> bytes:
    """The page.

    Args:
        plan: The poses.
        tour: Their order.
        test: Every so many-th is to test on.
        said: Warnings.
        files: What the page is made of: a word and the file.
        made_of: Their hash.
    """
    after, random = rounded(plan.tool_sigma_mm[-1], 3), rounded(plan.at_random_mm, 3)
    headline = (
        f"{plan.tool} is predicted to be {after} mm off (RMS over the workspace) after all of them are fitted, {random} mm after as many "
        "random ones."
    )
    summary = (
        f"{many(len(plan), 'pose')} in an order to drive" if not tour.blocked else f"{many(len(tour.blocked), 'leg')} not to be driven"
    )
    opening = Opening("warn" if tour.blocked or said else "good", summary, headline, (), _figures(plan), "")
    sections = (_accuracy(plan), _open(plan), *_looked(plan, said), _joints(plan), _poses(plan, tour, test), made_of_section(files))
    subtitle = f"{plan.robot.name}: {many(len(plan), 'pose')} for {plan.tool}"
    return plain_page(PlainReport("Poses to measure", subtitle, opening, sections), _pictures(plan, tour, test), made_of)


def _figures(plan: PosePlan) -> Table:
    counts = [count for count in dict.fromkeys((0, 10, 20, 30, len(plan))) if count <= len(plan)]
    rows = tuple((str(count), *(rounded(curve[count], 3) for curve in (plan.tool_sigma_mm, plan.random_mm))) for count in sorted(counts))
    return Table(("poses", "planned, mm", "random, mm"), rows)


def _accuracy(plan: PosePlan) -> Section:
    ahead = np.flatnonzero(plan.tool_sigma_mm <= plan.random_mm[-1])
    few = f" The first {int(ahead[0])} are worth {len(plan)} random ones." if len(ahead) and 0 < ahead[0] < len(plan) else ""
    text = f"Position error of {plan.tool} relative to the base, as the covariance of the fit predicts it, after each pose.{few}"
    return Section("accuracy", "How far off the tool will be", (text, Gallery("accuracy")))


def _open(plan: PosePlan) -> Section:
    names = plan.undetermined
    if not names:
        return Section("undetermined", "What stays undetermined", ("Nothing: every parameter is known to half of its prior or better.",))
    text = f"{many(len(names), 'parameter')} that these poses leave above half of what is known of them before any:"
    more = f"and {len(names) - _MOST_NAMED} more"
    listed = ", ".join((*names[:_MOST_NAMED], *([more] if len(names) > _MOST_NAMED else [])))
    return Section("undetermined", "What stays undetermined", (text, Points((listed,))))


def _looked(plan: PosePlan, said: Sequence[str]) -> tuple[Section, ...]:
    blocks: list[Block] = []
    total = plan.looked
    if total:
        counts = {"can be measured": total - sum(plan.reasons.values()), **plan.reasons}
        rows = tuple((what, str(count), f"{100 * count / total:.0f} %") for what, count in counts.items())
        blocks.append(Table(("positions that", "count", "share"), rows, words=1))
    if said:
        blocks.append(Points(tuple(said)))
    return (Section("candidates", "What was looked at", tuple(blocks)),) if blocks else ()


def _joints(plan: PosePlan) -> Section:
    return Section("joints", "How the joints are turned", ("Every pose on each joint's range, its limits at the ends.", Gallery("joints")))


def _poses(plan: PosePlan, tour: Tour, test: int) -> Section:
    slides = [joint.prismatic for joint in plan.robot.chain.inputs]
    units = np.where(slides, MM, DEG)
    names = tuple(f"{name}, {'mm' if slide else 'deg'}" for name, slide in zip(plan.joints, slides, strict=True))
    on = [*("blocked" if leg in tour.blocked else f"{seconds:.1f}" for leg, seconds in enumerate(tour.seconds)), ""]
    rows = tuple(
        (f"p{number:02d}", set_of(plan, number, test), *(f"{value:.1f}" for value in q / units), left)
        for number, (q, left) in enumerate(zip(plan.q[tour.order], on, strict=True), start=1)
    )
    whole = f", {float(tour.seconds.sum()):.0f} s at full speed; with what the way to the next one takes" if len(tour.seconds) else ""
    text = f"In the order to drive them{whole}."
    return Section("poses", "The tour", (text, Gallery("tour"), Table(("pose", "set", *names, "next in s"), rows, words=2)))


def _pictures(plan: PosePlan, tour: Tour, test: int) -> list[Picture]:
    return [_curves(plan), _covered(plan, tour, test), _driven(plan, tour)]


def _curves(plan: PosePlan) -> Picture:
    number = np.arange(len(plan.tool_sigma_mm), dtype=float)

    def draw(axes: Axes) -> None:
        axes.points(number, plan.random_mm, Look("c1", mark="o", dash="dotted", size=4), "random poses, on average")
        axes.points(number, plan.tool_sigma_mm, Look("c0", mark="s", dash="solid", size=4), "planned poses")
        every = np.concatenate([plan.random_mm, plan.tool_sigma_mm])
        axes.x_label, axes.y_label, axes.whole = "poses", "predicted error of the tool, mm", True
        axes.y_kind, axes.y_ends = "log", (0.8 * float(every.min()), 1.25 * float(every.max()))

    return draw_picture("accuracy", "Predicted error", "", 200, draw)


def _shares(plan: PosePlan, tour: Tour) -> Vector:
    """Where every pose of the tour is on each joint's range, (n, joints), in %."""
    low, high = joint_limits(plan.robot)
    room = np.where(high > low, high - low, 1.0)
    return np.asarray(100 * (plan.q[tour.order] - low) / room)


def _covered(plan: PosePlan, tour: Tour, test: int) -> Picture:
    shares, rows = _shares(plan, tour), -np.arange(len(plan.joints), dtype=float)
    tested = np.array([set_of(plan, number, test) == "test" for number in range(1, len(plan) + 1)])

    def draw(axes: Axes) -> None:
        axes.bars(np.zeros(len(rows)), np.full(len(rows), 100.0), rows, "band")
        for mine, look, label in ((~tested, Look("c0", mark="o", size=5), "to fit"), (tested, Look("c1", mark="D", size=6), "to test")):
            axes.points(shares[mine].ravel(), np.tile(rows, int(mine.sum())), look, label)
        axes.rows, axes.x_label, axes.x_ends, axes.y_ends = plan.joints, "of the range, %", (-2.0, 102.0), (rows[-1] - 0.6, 0.6)

    return draw_picture("joints", "Positions of the joints", "", max(_ROW * len(rows), 80.0), draw)


def _driven(plan: PosePlan, tour: Tour) -> Picture:
    shares, number = _shares(plan, tour), np.arange(1, len(plan) + 1, dtype=float)

    def draw(axes: Axes) -> None:
        for index, name in enumerate(plan.joints):
            axes.points(number, shares[:, index], Look(f"c{index % 8}", dash=("solid", "dashed")[index // 8 % 2], width=1.2), name)
        axes.x_label, axes.y_label, axes.whole, axes.y_ends = "pose of the tour", "of the range, %", True, (-3.0, 103.0)

    return draw_picture("tour", "The joints over the tour", "", 170, draw)
