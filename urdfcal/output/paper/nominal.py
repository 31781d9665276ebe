"""Tables I and IV: the arm as it is published, and as it is derived from the URDF."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from urdfcal.base.geometry import DEG, MM
from urdfcal.model.dh import dh_table
from urdfcal.output.paper.exhibit import Exhibit, three_lines
from urdfcal.output.report.document import Table
from urdfcal.robot.robot import Robot
from urdfcal.simulation.published import TABLE_I, TABLE_IV, NominalRow

_COLUMNS = ("joint", "", "a (mm)", "d (mm)", "α (°)", "θ (°)", "from (°)", "to (°)")
_ANOTHER = 0.05  # [mm] and [deg]: beyond it the published digits differ


def nominal_exhibit(robot: Robot, section: int) -> Exhibit:
    """Table I or IV beside the D-H table that follows from the URDF."""
    number, published, arm = ("I", TABLE_I, "7-DOF arm") if section == 4 else ("IV", TABLE_IV, "4-DOF arm")
    own = nominal_rows(robot)
    rows: list[tuple[str, ...]] = []
    for theirs, ours in itertools.zip_longest(published, own):
        rows += three_lines((theirs or ours).name, theirs and theirs[1:], ours and ours[1:], 1)
    return Exhibit(
        f"table-{number}",
        f"Table {number}: nominal D-H parameters of the {arm}",
        "Trans(x, a) Trans(z, d) Rot(x, α) Rot(z, θ), equation (1); θ is what is added to the joint's reading, from and to are its range. "
        f"Here: derived from the URDF of '{robot.name}'.",
        Table(_COLUMNS, tuple(rows), words=2),
        "" if same_arm(published, own) else f"'{robot.name}' is not the arm of Table {number}: what is published below is of another arm.",
        lines=3,
    )


def nominal_rows(robot: Robot) -> list[NominalRow]:
    """The D-H table of a robot with the ranges of its joints, [mm] and [deg]."""
    joints, rows = robot.tree.joints, []
    for place, row in enumerate(dh_table(robot.chain), start=1):
        moves = joints.get(row.name)
        low, high = np.degrees([moves.lower, moves.upper]) if moves is not None else (0.0, 0.0)
        name = str(place) if moves is not None else "SLM"
        rows.append(NominalRow(name, row.a / MM, row.d / MM, row.alpha / DEG, row.theta / DEG, float(low), float(high)))
    return rows


def same_arm(published: Sequence[NominalRow], own: Sequence[NominalRow]) -> bool:
    """Whether a robot is the arm of a table, to its printed digits."""
    return len(published) == len(own) and bool(np.allclose([row[1:] for row in published], [row[1:] for row in own], atol=_ANOTHER, rtol=0))
