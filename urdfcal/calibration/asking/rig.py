"""What a rig may do: columns of `disturbances.py`, of all channels at once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from urdfcal.base.geometry import Array3, Matrix
from urdfcal.calibration.asking.disturbances import courses_of, disturbances, progress
from urdfcal.calibration.asking.ground import Ground
from urdfcal.calibration.asking.questions import Question
from urdfcal.model.rig_terms import RigTerm


def rig_columns(ground: Ground) -> tuple[Array3, list[RigTerm]]:
    """Columns (n, m, k) of what the rig may do, in units of their usual sizes, and its terms."""
    model, terms, found = ground.model, dict[str, RigTerm](), list[tuple[slice, str, Matrix]]()
    at = progress(model.data, courses_of(model.data))
    for channel, view in zip(model.channels, model.views(ground.estimate.belief.x), strict=True):
        if not channel.readings.measured.any():
            continue
        look = channel.sensor.look(view, channel.values)
        for moved in disturbances(channel.sensor, view, look, at):
            terms.setdefault(moved.term.name, moved.term)
            found.append((channel.block.columns, moved.term.name, moved.column * moved.term.sigma))
    place = {name: number for number, name in enumerate(terms)}
    columns = np.zeros((len(model.data), ground.linearisation.residual.shape[1], len(terms)))
    for numbers, name, column in found:
        columns[:, numbers, place[name]] = column
    return np.where(np.isfinite(columns), columns, 0.0), list(terms.values())


def rig_questions(terms: Sequence[RigTerm], first: int) -> Iterator[Question]:
    """About each thing that a rig may do; what wanders is a drift, too."""
    for what in dict.fromkeys(term.what for term in terms):
        columns = np.array([first + number for number, term in enumerate(terms) if term.what == what], dtype=np.intp)
        yield Question("drift" if what == "wander" else what, "", columns, float(np.log(2)) if what in ("drift", "wander") else 0.0)
