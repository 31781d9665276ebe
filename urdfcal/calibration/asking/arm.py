"""What an arm may do with the pose: columns of a joint that turns by one, times what that goes with."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from urdfcal.base.geometry import Array3, Matrix
from urdfcal.calibration.asking.ground import Ground
from urdfcal.calibration.asking.questions import Question
from urdfcal.calibration.channel import Rows
from urdfcal.model.gravity import WeighedRobot
from urdfcal.model.softness import EXTRAS, Softness, Term, extra_terms, gravity_terms, pulled

_WAVES = (("ecc_sin", "ecc_cos"), ("ecc_sin2", "ecc_cos2"))
_WHAT = {"scale": "scale", "approach": "approach"} | {name: "eccentricity" for waves in _WAVES for name in waves}


@dataclass(frozen=True)
class _Goes:
    """Some terms, and what they go with.

    Attributes:
        terms: Of the joints.
        basis: What each is multiplied by at some poses, (n, terms).
    """

    terms: tuple[Term, ...]
    basis: Callable[[Rows], Matrix]


class ArmColumns:
    """Columns of what the arm may do, in units of their usual sizes.

    Attributes:
        questions: About the columns.
        count: How many there are.
    """

    def __init__(self, ground: Ground, first: int) -> None:
        """Of all that a fit may be asked of its arm; questions are about columns from the first on."""
        self.questions: list[Question] = []
        self._goes: list[_Goes] = []
        self.first, self.count = first, 0
        for weighed in ground.pulls:
            self._pulled(ground, weighed)
        self._of_joints(ground)
        unit = {(term.joint, term.axis): number for number, term in enumerate(ground.turns)}
        terms = [term for own in self._goes for term in own.terms]
        self._units = np.array([unit[term.joint, term.axis] for term in terms], dtype=np.intp)
        self._sigma = np.array([term.sigma for term in terms])

    def fill(self, out: Array3, turned: Array3, rows: Rows) -> None:
        """Columns of some poses, (count, m, n), from what is read more where a joint turns by one, (turns, m, n)."""
        basis = np.concatenate([own.basis(rows).T for own in self._goes]) * self._sigma[:, None]
        turned.take(self._units, axis=0, out=out, mode="clip")  # which needs no further array
        out *= basis[:, None]

    def _ask(self, what: str, where: str, columns: Sequence[int], price: float) -> None:
        self.questions.append(Question(what, where, np.array(columns, dtype=np.intp) + self.first + self.count, price))

    def _add(self, terms: tuple[Term, ...], basis: Callable[[Rows], Matrix]) -> None:
        self._goes.append(_Goes(terms, basis))
        self.count += len(terms)

    def _pulled(self, ground: Ground, weighed: WeighedRobot) -> None:
        """What one gravity does: sag, and what a payload adds where that changes."""
        chain, data = ground.robot.chain, ground.model.data
        moments = weighed.moments(data.q)
        terms, price = gravity_terms(chain, moments), float(np.log(len(ground.pulls)))
        if not terms:
            return
        count = range(len(terms))
        self._ask("sag", "", count, price)
        if data.payload is None or not np.ptp(data.payload) > 0:
            self._add(terms, lambda rows: pulled(chain, terms, moments[rows]))
            return
        added = data.payload[:, None, None] * weighed.payload_moments(data.q, ground.robot.rig.tip)
        self._ask("payload", "", [len(terms) + number for number in count], price)
        self._add(terms, lambda rows: pulled(chain, terms, moments[rows] + added[rows]))
        self._add(terms, lambda rows: pulled(chain, terms, added[rows]))

    def _of_joints(self, ground: Ground) -> None:
        """What joints do whatever pulls them."""
        chain, data = ground.robot.chain, ground.model.data
        extras = [extra for extra in EXTRAS if extra != "approach" or data.approach is not None]
        soft = Softness(chain, extra_terms(chain, extras), ground.pulls[0], ground.robot.rig.tip)
        for question in _questions(soft.terms):
            self._ask(*question)
        self._add(soft.terms, lambda rows: soft.basis(data.q[rows], None, None if data.approach is None else data.approach[rows]))


def _questions(terms: Sequence[Term]) -> Iterator[tuple[str, str, list[int], float]]:
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
            yield what, where, columns, float(price)
