"""What an arm may do with the pose: columns of a joint that turns by one, times what that goes with."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from urdfcal.base.geometry import Array3
from urdfcal.calibration.asking.ground import Ground
from urdfcal.calibration.asking.questions import Question
from urdfcal.calibration.richer import usual_range
from urdfcal.model.softness import EXTRAS, Softness, Term, extra_terms, gravity_terms

_WAVES = (("ecc_sin", "ecc_cos"), ("ecc_sin2", "ecc_cos2"))
_WHAT = {"sag": "sag", "sag_1": "sag", "sag_2": "sag", "scale": "scale", "approach": "approach"}
_WHAT |= {name: "eccentricity" for waves in _WAVES for name in waves}


def arm_columns(ground: Ground) -> tuple[Array3, list[Question]]:
    """Columns (n, m, k) of what the arm may do, in units of their usual sizes, and the questions about them."""
    chain, data = ground.robot.chain, ground.model.data
    extras = [extra for extra in EXTRAS if extra != "approach" or data.approach is not None]
    pulled = gravity_terms(chain, ground.weighed.moments(usual_range(ground.robot, data)))
    terms = (*pulled, *extra_terms(chain, extras))
    softness = Softness(chain, terms, ground.weighed, ground.robot.rig.tip)
    basis, questions = softness.basis(data.q, data.payload, data.approach), list(_questions(terms))
    if data.payload is not None and np.ptp(data.payload) > 0 and pulled:
        bare = softness.basis(data.q, None, data.approach)
        questions.append(Question("payload", "", np.arange(len(terms), len(terms) + len(pulled))))
        basis, terms = np.hstack([basis, (basis - bare)[:, : len(pulled)]]), (*terms, *pulled)
    turned, units = ground.turns
    unit = {(term.joint, term.axis): number for number, term in enumerate(units)}
    own = [unit[term.joint, term.axis] for term in terms]
    return turned[:, :, own] * (basis * [term.sigma for term in terms])[:, None], questions


def _questions(terms: Sequence[Term]) -> Iterator[Question]:
    """About all joints at once, and about each of them; of eccentricity also about one or two waves a turn alone."""
    split = [term.name.rpartition(".") for term in terms]
    for what in dict.fromkeys(_WHAT.values()):
        own = [number for number, (_, _, name) in enumerate(split) if _WHAT[name] == what]
        sorts = [own, *([number for number in own if split[number][2] in waves] for waves in _WAVES)] if what == "eccentricity" else [own]
        joints = dict.fromkeys(split[number][0] for number in own) if what != "sag" else {}
        asked = [("", columns) for columns in sorts if columns]
        asked += [(joint, [number for number in columns if split[number][0] == joint]) for joint, columns in product(joints, sorts)]
        for where, columns in asked:
            price = np.log(2 * len(sorts) * (len(joints) if where else 1))  # one of two ways to ask: of all, or of one
            yield Question(what, where, np.array(columns, dtype=np.intp), float(price))
