"""Poses at which something is seen: what cameras look at takes turns, so that of several boards and cameras none comes short."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import Mask, Matrix
from urdfcal.calibration.reach import DrawnPoses, draw_where, on_screen
from urdfcal.model.jacobian import CHUNK
from urdfcal.robot.configurations import joint_limits, random_positions, require_room
from urdfcal.simulation.setup import SimulatedSetup

_MOST_PICTURES = 200_000
_LOOKED_AT = 2 * CHUNK  # random poses by which it is told what is seen at all
Sight = Callable[[Matrix], Mask]  # at which of some positions (n, inputs) something is seen, (n,)


def poses_in_sight(setup: SimulatedSetup, session: str, poses: int, rng: np.random.Generator) -> DrawnPoses:
    """Random true positions at which a camera sees a board or target, each in its turn, and every beam meets the screen if there are any.

    Raises:
        UsageError: they are too rare.
    """
    require_room(setup.robot)
    sights = list(_sights(setup, session, rng))
    turns = [np.arange(first, poses, len(sights)) for first in range(len(sights))]
    q, looked, limits = np.empty((poses, len(setup.robot.chain.inputs))), 0, np.array(joint_limits(setup.robot))
    for (named, sight), own in zip(sights, turns, strict=True):
        drawn = draw_where(sight, limits, len(own), rng, most=_MOST_PICTURES, batch=CHUNK)
        if len(drawn.q) < len(own):
            raise UsageError(
                f"{named} sees its target in {len(drawn.q)} of {drawn.looked} random poses, {len(own)} were asked for; "
                "see that board and camera look at each other, or let the camera stand anywhere (without --reference-known)"
            )
        q[own], looked = drawn.q, looked + drawn.looked
    return DrawnPoses(q, looked)


def _sights(setup: SimulatedSetup, session: str, rng: np.random.Generator) -> Iterator[tuple[str, Sight]]:
    """What a camera is called, and when it sees one of its subjects, for each of those that it ever sees; of none any."""
    beams = on_screen(replace(setup.errors, sessions=("",)), setup.x, setup.area) if setup.robot.rig.lasers else None
    for instrument in setup.looking:
        named = f"the camera {instrument}".strip()
        views = _views(setup, session, instrument, random_positions(setup.robot, _LOOKED_AT, rng) if several(setup) else None)
        for view in views:
            yield named, view if beams is None else lambda q, view=view: view(q) & beams(q)  # type: ignore[misc]


def several(setup: SimulatedSetup) -> bool:
    """Whether cameras look at more than one thing."""
    return len({(sensor.link if sensor.link in setup.boards else sensor.target, sensor.instrument) for sensor in setup.pictured}) > 1


def _views(setup: SimulatedSetup, session: str, instrument: str, tried: Matrix | None) -> list[Sight]:
    """When a camera sees each of its subjects that it ever sees."""

    def view(number: int) -> Sight:
        return lambda q: setup.subjects(q, session, instrument)[number].in_view(setup.camera_of(instrument))

    if tried is None:
        return [view(0)]
    camera, subjects = setup.camera_of(instrument), setup.subjects(tried, session, instrument)
    seen = [number for number, own in enumerate(subjects) if own.in_view(camera).any()]
    return [view(number) for number in seen or [0]]
