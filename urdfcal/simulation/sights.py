"""Poses at which something is seen: what cameras look at, and lasers are aimed at, takes turns, so that none of it comes short."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import Mask, Matrix
from urdfcal.calibration.reach import DrawnPoses, draw_where, on_screen
from urdfcal.model.jacobian import CHUNK
from urdfcal.robot.configurations import joint_limits, random_positions, require_room
from urdfcal.sensors.spots import LEAST_LENGTH, beams_of
from urdfcal.simulation.setup import SimulatedSensor, SimulatedSetup

_MOST_PICTURES = 200_000
_LOOKED_AT = 2 * CHUNK  # random poses by which it is told what is seen at all
Sight = Callable[[Matrix], Mask]  # at which of some positions (n, inputs) something is seen, (n,)


@dataclass(frozen=True)
class _Said:
    """What is said where it is seen too rarely."""

    verb: str
    way_out: str


def poses_in_sight(setup: SimulatedSetup, session: str, poses: int, rng: np.random.Generator) -> DrawnPoses:
    """Random true positions at which a camera sees a board or target, or lasers meet the screen that they name, each in its turn.

    The robot's own lasers, if there are any, meet the screen in all of them.

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
            raise UsageError(f"{named.verb} in {len(drawn.q)} of {drawn.looked} random poses, {len(own)} were asked for; {named.way_out}")
        q[own], looked = drawn.q, looked + drawn.looked
    return DrawnPoses(q, looked)


def _sights(setup: SimulatedSetup, session: str, rng: np.random.Generator) -> Iterator[tuple[_Said, Sight]]:
    """When each camera sees each of its subjects that it ever sees, and each carrier's lasers meet a screen."""
    beams = on_screen(replace(setup.errors, sessions=("",)), setup.x, setup.area) if setup.robot.rig.lasers else None
    for instrument in setup.looking:
        named = _Said(
            f"{f'the camera {instrument}'.strip()} sees its target",
            "see that board and camera look at each other, or let the camera stand anywhere (without --reference-known)",
        )
        views = _views(setup, session, instrument, random_positions(setup.robot, _LOOKED_AT, rng) if several(setup) else None)
        for view in views:
            yield named, _both(view, beams)
    aimed = dict.fromkeys((setup.robot.tree.moving_link(own.link), own.instrument) for own in setup.sensors if own.aimed)
    for carrier, screen in aimed:
        own = [sensor for sensor in setup.sensors if sensor.aimed and sensor.instrument == screen]
        own = [sensor for sensor in own if setup.robot.tree.moving_link(sensor.link) == carrier]
        said = _Said(f"{' and '.join(sensor.target for sensor in own)} beam onto {screen}", "turn them to each other, or make it larger")
        yield said, _both(partial(_on_screen, setup, session, own), beams)


def _both(one: Sight, other: Sight | None) -> Sight:
    return one if other is None else lambda q: one(q) & other(q)


def _on_screen(setup: SimulatedSetup, session: str, lasers: Sequence[SimulatedSensor], q: Matrix) -> Mask:
    """At which positions all of some lasers make a spot on the screen that they are aimed at, (n,)."""
    seen, area = setup.motion(q, session)[1], setup.area_of(lasers[0].instrument)
    p, R = (np.stack([seen[own.pair][part] for own in lasers], axis=1) for part in (0, 1))
    beams = beams_of(p, R[..., 2])
    return np.asarray((area.holds(beams.spots) & beams.makes_spot(nearest=LEAST_LENGTH)).all(axis=1))


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
