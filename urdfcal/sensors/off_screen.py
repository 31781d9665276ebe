"""Spots beyond the edge of the screen: a wrong unit, a frame elsewhere, or a sheet that is not as large as the URDF says."""

from __future__ import annotations

import numpy as np

from urdfcal.base.geometry import MM, Mask, Matrix
from urdfcal.robot.robot import Robot
from urdfcal.robot.sheet import stated_sheet
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.readings import Readings
from urdfcal.sensors.sensor import View

_MARGIN = 10 * MM  # beside the edge, where a spot is still half on the sheet


def beyond_the_screen(robot: Robot, data: Measurements) -> tuple[str, ...]:
    """A warning where measured spots lie beside the sheet that the URDF has; nothing where it says no size."""
    spots = [(reading, _on_screen(data, reading)) for reading in data.readings if reading.kind.beam]
    sheet = stated_sheet(robot) if spots else None
    if sheet is None:
        return ()
    off: list[Mask] = [reading.seen & ~sheet.holds(np.nan_to_num(places), _MARGIN) for reading, places in spots]
    count, seen = sum(int(own.sum()) for own in off), sum(int(reading.seen.sum()) for reading, _ in spots)
    if not count:
        return ()
    far = [np.where(own, np.linalg.norm(places - sheet.centre, axis=1), 0.0) for own, (_, places) in zip(off, spots, strict=True)]
    laser = int(np.argmax([own.max() for own in far]))
    pose = int(np.argmax(far[laser]))
    (y, z), name = spots[laser][1][pose], spots[laser][0].target
    return (
        f"{count} of {seen} spots lie beyond the edge of '{robot.rig.base}', which the URDF has as {sheet}; the farthest is {name} in "
        f"{data.where(pose)}, at y {y:.3f} m, z {z:.3f} m: check the unit of the columns, whether they are measured from the origin of "
        "that link, or the size of its box",
    )


def _on_screen(data: Measurements, reading: Readings) -> Matrix:
    """Where some readings have the spots of a laser, (n, 2) = (y, z), [m]; nan where none was seen."""
    n = len(reading.labels)
    anywhere = View(np.zeros((n, 3)), np.broadcast_to(np.eye(3), (n, 3, 3)), np.zeros((n, 6)), np.broadcast_to(np.eye(3), (n, 3, 3)))
    return np.where(reading.seen[:, None], data.sensor_of(reading).shown(anywhere, reading.values)[:, 1:], np.nan)
