"""Columns that say more of a pose than its joints: when it was measured, how warm it was, what was carried, from where it was reached."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from urdfcal.base.geometry import Matrix, Vector
from urdfcal.base.tables import Table
from urdfcal.robot.urdf_xml import FARTHEST
from urdfcal.sensors.repeats import last_moves

SECONDS = {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0}
_A_MASS = "expected a mass in kg, or nothing"
_A_TEMPERATURE = "expected degrees Celsius"
_A_DIRECTION = "expected -1, 0 or 1, the direction of the joint's last move, or nothing"
APPROACH = "approach"


@dataclass(frozen=True)
class PoseFacts:
    """What is known of the poses.

    Attributes:
        payload: (n,), [kg]; None where nothing is said.
        time: (n,), [s]; None where nothing is said.
        temperature: (n,), [degC]; None where nothing is said.
        approach: Direction of each joint's last move, (n, joints): as stated, else by the order of the rows.
        warnings: Columns that could not be used.
    """

    payload: Vector | None
    time: Vector | None
    temperature: Vector | None
    approach: Matrix
    warnings: tuple[str, ...] = ()


def pose_facts(table: Table, joints: Sequence[str], q: Matrix) -> PoseFacts:
    """What the columns of a table say of its poses.

    Args:
        table: The table.
        joints: Names of the measured joints.
        q: Their positions, (n, joints).

    Raises:
        MeasurementError: a cell means nothing.
    """
    time, warnings = _time(table)
    return PoseFacts(_payload(table), time, _temperature(table), _approach(table, joints, q), warnings)


def _payload(table: Table) -> Vector | None:
    """Masses; an empty cell is none."""
    if "payload" not in table.names:
        return None
    kilograms = np.nan_to_num(table.numbers("payload", {"kg": 1.0}, _A_MASS, empty=True, most=FARTHEST))
    table.refuse("payload", kilograms < 0, f"is below zero; {_A_MASS}")
    return kilograms


def _time(table: Table) -> tuple[Vector | None, tuple[str, ...]]:
    """Seconds, from numbers or from dates; without those that are neither, for which there is a warning."""
    if "time" not in table.names:
        return None, ()
    try:
        stamps = np.array([cell.strip().rstrip("Zz") for cell in table.columns["time"]], dtype="datetime64[us]")
        dates = any("-" in cell[1:] or ":" in cell for cell in table.columns["time"])
    except ValueError:
        dates = False
    if dates and not np.isnat(stamps).any():
        return (stamps - np.datetime64(0, "us")) / np.timedelta64(1, "s"), ()
    if any(not _is_number(cell) for cell in table.columns["time"]):
        where = f"{table.header}: column 'time'"
        return None, (f"{where} has cells that are neither seconds nor dates (2026-01-31T12:00:00); the order of the rows is taken for it",)
    return table.numbers("time", SECONDS, "expected seconds"), ()


def _is_number(cell: str) -> bool:
    try:
        return bool(np.isfinite(float(cell)))
    except ValueError:
        return False


def _temperature(table: Table) -> Vector | None:
    if "temperature" not in table.names:
        return None
    return table.numbers("temperature", {"degC": 1.0, "C": 1.0}, _A_TEMPERATURE, most=FARTHEST)


def _approach(table: Table, joints: Sequence[str], q: Matrix) -> Matrix:
    """Directions that are stated, beside those that the order of the rows shows; an empty cell is an unknown one."""
    approach = last_moves(q)
    for number, joint in enumerate(joints):
        name = f"{joint}.{APPROACH}"
        if name in table.names:
            stated = np.nan_to_num(table.numbers(name, {"": 1.0}, _A_DIRECTION, empty=True))
            table.refuse(name, ~np.isin(stated, (-1, 0, 1)), f"is no direction; {_A_DIRECTION}")
            approach[:, number] = stated
    return approach
