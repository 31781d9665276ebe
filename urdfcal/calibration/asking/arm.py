"""What an arm may do with the pose: columns of a joint that turns by one, times what that goes with."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from urdfcal.base.geometry import Array3, Matrix
from urdfcal.calibration.asking.ground import Ground
from urdfcal.calibration.asking.questions import Question
from urdfcal.model.gravity import WeighedRobot
from urdfcal.model.softness import EXTRAS, Softness, Term, extra_terms, gravity_terms, pulled

_WAVES = (("ecc_sin", "ecc_cos"), ("ecc_sin2", "ecc_cos2"))
_WHAT = {"scale": "scale", "approach": "approach"} | {name: "eccentricity" for waves in _WAVES for name in waves}


def arm_columns(ground: Ground) -> tuple[Array3, list[Question]]:
    """Columns (n, m, k) of what the arm may do, in units of their usual sizes, and the questions about them."""
    asked = [_pulled(ground, weighed) for weighed in ground.pulls]
    asked.append(_of_joints(ground))
    columns, questions, first = [], list[Question](), 0
    for own, about in asked:
        columns.append(own)
        questions += [replace(question, columns=question.columns + first) for question in about]
        first += own.shape[2]
    return np.concatenate(columns, axis=2), questions


def _pulled(ground: Ground, weighed: WeighedRobot) -> tuple[Array3, list[Question]]:
    """What one gravity does: sag, and what a payload adds where that changes."""
    chain, data = ground.robot.chain, ground.model.data
    moments = weighed.moments(data.q)
    terms, price = gravity_terms(chain, moments), float(np.log(len(ground.pulls)))
    if not terms:
        return _columns(ground, terms, np.empty((len(data), 0))), []
    basis, count, questions = pulled(chain, terms, moments), len(terms), [Question("sag", "", np.arange(len(terms)), price)]
    if data.payload is not None and np.ptp(data.payload) > 0:
        added = pulled(chain, terms, data.payload[:, None, None] * weighed.payload_moments(data.q, ground.robot.rig.tip))
        questions.append(Question("payload", "", np.arange(count, 2 * count), price))
        basis, terms = np.hstack([basis + added, added]), (*terms, *terms)
    return _columns(ground, terms, basis), questions


def _of_joints(ground: Ground) -> tuple[Array3, list[Question]]:
    """What joints do whatever pulls them."""
    chain, data = ground.robot.chain, ground.model.data
    extras = [extra for extra in EXTRAS if extra != "approach" or data.approach is not None]
    terms = extra_terms(chain, extras)
    basis = Softness(chain, terms, ground.pulls[0], ground.robot.rig.tip).basis(data.q, None, data.approach)
    return _columns(ground, terms, basis), list(_questions(terms))


def _columns(ground: Ground, terms: Sequence[Term], basis: Matrix) -> Array3:
    """Columns of some terms with their bases (n, terms), in units of their usual sizes, (n, m, terms)."""
    turned, units = ground.turns
    unit = {(term.joint, term.axis): number for number, term in enumerate(units)}
    own = np.array([unit[term.joint, term.axis] for term in terms], dtype=np.intp)
    return np.asarray(turned[:, :, own] * (basis * [term.sigma for term in terms])[:, None])


def _questions(terms: Sequence[Term]) -> Iterator[Question]:
    """About all joints at once, and about each of them; of eccentricity also about one or two waves a turn alone."""
    split = [term.name.rpartition(".") for term in terms]
    for what in dict.fromkeys(_WHAT.values()):
        own = [number for number, (_, _, name) in enumerate(split) if _WHAT[name] == what]
        sorts = [own, *([number for number in own if split[number][2] in waves] for waves in _WAVES)] if what == "eccentricity" else [own]
        joints = dict.fromkeys(split[number][0] for number in own)
        asked = [("", columns) for columns in sorts if columns]
        asked += [(joint, [number for number in columns if split[number][0] == joint]) for joint, columns in product(joints, sorts)]
        for where, columns in asked:
            price = np.log(2 * len(sorts) * (len(joints) if where else 1))  # one of two ways to ask: of all, or of one
            yield Question(what, where, np.array(columns, dtype=np.intp), float(price))
