"""Poses as they come: numbers of one pose in a layout that many share, from which measurements are made again when they are asked for."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from typing import Any

import numpy as np

from urdfcal.base.geometry import Matrix, Vector
from urdfcal.calibration.pose_by_pose import PoseByPose
from urdfcal.estimation.noise import Noise
from urdfcal.sensors.measurements import OF_A_POSE, Measurements

_FACTS = tuple(name for name in OF_A_POSE if name != "order")  # poses that come have the order in which they come


@dataclass(frozen=True, eq=False)
class Layout:
    """What poses have in common that differ in numbers alone.

    Attributes:
        template: The first of them.
    """

    template: Measurements

    @cached_property
    def kinds(self) -> frozenset[str]:
        """Kinds of noise."""
        return frozenset(self.template.kinds)

    def measurements(self, rows: Sequence[Row]) -> Measurements:
        """Some of them, as measurements."""
        n, template = len(rows), self.template
        readings = tuple(
            replace(
                own,
                values=np.array([row.values[index] for row in rows]).reshape(n, -1),
                labels=np.repeat(own.labels, n),
                sigma=np.array([np.nan if row.sigma is None else row.sigma[index] for row in rows]),
            )
            for index, own in enumerate(template.readings)
        )
        facts: dict[str, Any] = {
            name: np.array(own) for name, *own in zip(_FACTS, *(row.facts for row in rows), strict=True) if own[0] is not None
        }
        return replace(
            template,
            q=np.array([row.q for row in rows]),
            readings=readings,
            poses=np.array([row.pose for row in rows]),
            sets=np.repeat(template.sets, n),
            sessions=np.repeat(template.sessions, n),
            lines=None,
            order=None,
            **facts,
        )


@dataclass(frozen=True, eq=False)
class Row:
    """Numbers of one pose.

    Attributes:
        layout: What they are.
        q: Joint positions, (inputs,), [rad] or [m].
        values: Of each reading, (stored,), nan where nothing was read.
        sigma: Standard deviation stated with each reading, (readings,), nan for none; None if none states any.
        pose: Its label.
        facts: What else is known of it: payload, approach, time, temperature; None for what is not.
    """

    layout: Layout
    q: Vector
    values: tuple[Vector, ...]
    sigma: Vector | None
    pose: str
    facts: tuple[Any, ...] = (None,) * len(_FACTS)

    def measurements(self) -> Measurements:
        """This pose alone."""
        return self.layout.measurements([self])


@dataclass(frozen=True)
class Arrived:
    """What was read at one pose, linearised: the numbers that were.

    Attributes:
        innovation: m - h(x), (m,).
        H: Derivatives of h by the parameters, (m, p).
        R: Covariance of the numbers, (m, m).
        lost: Whether any is out of the sensor's reach in the model.
    """

    innovation: Vector
    H: Matrix
    R: Matrix
    lost: bool


class Ready:
    """All that poses of one layout need, but for their numbers.

    Attributes:
        kinds: Kinds of noise.
    """

    def __init__(self, one: PoseByPose, noise: Noise, kinds: Sequence[str], extra: Mapping[str, float]) -> None:
        """Of a linearisation, the noise by kind, and what comes on top of noise that is stated with a reading, by kind."""
        self._one, self._noise, self._of_joints, self.kinds = one, noise, noise.of_joints, tuple(kinds)
        self._usual, self._usual_R = noise.sigma[one.kind] ** 2, np.diag(noise.sigma[one.kind] ** 2)
        self._extra = np.array([extra.get(kind, 0.0) for kind in kinds])[one.kind]

    def at(self, row: Row) -> Arrived:
        """One of them."""
        found, measured = self._one.at(row.q, row.values), self._one.measured(row.values)
        lost, R = found.lost, self._usual_R if row.sigma is None else np.diag(self._variance(row.sigma))
        if self._of_joints:
            reach = found.by_joints * self._noise.joint_sigma
            R = R + reach @ reach.T
        if measured is None:
            return Arrived(found.residual, found.H, R, lost is not None and bool(lost.any()))
        own = R[np.ix_(measured, measured)]
        return Arrived(found.residual[measured], found.H[measured], own, lost is not None and bool(lost[measured].any()))

    def _variance(self, sigma: Vector) -> Vector:
        """Of every number, (m,), as it is stated with the readings, (readings,), or as is usual."""
        stated = np.hypot(sigma[self._one.reading], self._extra)
        return np.asarray(np.where(np.isnan(stated), self._usual, stated**2))


class Layouts:
    """All layouts that came up, so that poses know whose they are."""

    def __init__(self) -> None:
        self._known: dict[Hashable, Layout] = {}

    def row(self, data: Measurements, index: int) -> Row:
        """One pose of some measurements."""
        sigma = np.array([reading.sigma[index] for reading in data.readings])
        return Row(
            self._of(data, index),
            data.q[index],
            tuple(reading.values[index] for reading in data.readings),
            None if np.isnan(sigma).all() else sigma,
            str(data.poses[index]),
            tuple(None if (own := getattr(data, name)) is None else own[index] for name in _FACTS),
        )

    def _of(self, data: Measurements, index: int) -> Layout:
        readings = tuple((own.sensor, own.target, own.link, own.instrument, str(own.labels[index])) for own in data.readings)
        on = {target.name: target.placed_by for target in data.instruments.targets}
        shown = frozenset((own.sensor, on.get(own.target, own.target), own.instrument) for own in data.readings if own.seen[index])
        said = tuple(getattr(data, name) is None for name in _FACTS)
        cameras = (id(data.camera), *((name, id(camera)) for name, camera in data.cameras.items()))  # templates keep them alive
        made_with = data.joints, data.reference, data.lengths, cameras, tuple(data.stations.items()), tuple(data.boards.items())
        key = made_with, readings, shown, said, str(data.sets[index]), str(data.sessions[index])
        if key not in self._known:
            self._known[key] = Layout(data.subset([index]))
        return self._known[key]


def as_measurements(parts: Sequence[Measurements | Row]) -> list[Measurements]:
    """Poses, those of one layout that follow each other together."""
    found: list[Measurements] = []
    for layout, group in groupby(parts, key=lambda part: part.layout if isinstance(part, Row) else None):
        own = list(group)
        rows = [part for part in own if isinstance(part, Row)]
        found += [layout.measurements(rows)] if layout is not None else [part for part in own if isinstance(part, Measurements)]
    return found
