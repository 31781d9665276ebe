"""The D-H table as text and for machines, and what the automatic error model leaves out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import compress
from typing import TYPE_CHECKING, Any

from urdfcal.base.geometry import DEG, MM
from urdfcal.base.terminal import decimals, figures_table, titled
from urdfcal.model.dh import DhRow

if TYPE_CHECKING:
    from rich.console import RenderableType


def dh_block(rows: Iterable[DhRow], corrected: Iterable[DhRow] | None = None) -> RenderableType:
    """A D-H table in mm and deg; with a second one, its values stand behind the nominal ones."""
    rows, corrected = list(rows), None if corrected is None else list(corrected)
    every = rows + (corrected or [])
    columns = [
        ("a\nmm", True),
        ("d\nmm", True),
        ("alpha\ndeg", True),
        ("beta\ndeg", tilts := any(abs(row.beta) > 1e-9 for row in every)),
        ("theta\ndeg", True),
        ("then along z\nmm", any(abs(row.slide) > 1e-9 for row in every)),
        ("slides along\nx, y, z", sliding := any(row.direction is not None for row in every)),
    ]
    wanted = [there for _, there in columns]
    table = figures_table("joint")
    for name, there in columns:
        if there:
            table.add_column(name, justify="right")
    for row in rows:
        table.add_row(row.name, *compress(_dh_cells(row), wanted))
    if corrected is not None:
        table.add_section()
        for row in corrected:
            table.add_row(f"{row.name} (corrected)", *compress(_dh_cells(row), wanted))
    form = f"Trans(x,a) Trans(z,d) Rot(x,alpha) {'Rot(y,beta) ' if tilts else ''}Rot(z,theta)"
    if sliding:
        table.caption, table.caption_justify = "A joint that slides does so in the frame where the row before it ends.", "left"
    return titled(f"D-H table at q = 0: {form}", table)


def dh_json(rows: Iterable[DhRow]) -> list[dict[str, Any]]:
    """The D-H table in metres and radians; of a joint that slides, where to."""
    names = ("name", "a", "d", "alpha", "beta", "theta", "slide")
    return [
        {name: getattr(row, name) for name in names} | {"direction": None if row.direction is None else row.direction.tolist()}
        for row in rows
    ]


def carried_lines(carried: Mapping[str, str]) -> list[str]:
    """`carried by the screen: joint1.d_a, joint1.d_alpha`, a line a carrier."""
    by_carrier: dict[str, list[str]] = {}
    for name, carrier in carried.items():
        by_carrier.setdefault(carrier, []).append(name)
    return [f"carried by {carrier}: {', '.join(names)}" for carrier, names in by_carrier.items()]


def _dh_cells(row: DhRow) -> list[str]:
    """Every column, of which some may not be shown; a joint that slides has a direction alone."""
    if row.direction is not None:
        return [""] * 6 + ["  ".join(decimals(part, 4) for part in row.direction)]
    lengths = [decimals(row.a / MM, 4), decimals(row.d / MM, 4)]
    angles = [decimals(angle / DEG, 4) for angle in (row.alpha, row.beta, row.theta)]
    return [*lengths, *angles, decimals(row.slide / MM, 4) if row.slide else "", ""]
