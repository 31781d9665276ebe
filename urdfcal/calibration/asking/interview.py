"""Ask the residuals of a fit what its model lacks: one score test for everything that robots and rigs are known to do.

Each question is about a few columns. What the arm does turns joints, so its columns are those of a joint turned by one, times what it
goes with: gravity's moments, sin q and cos q, q itself, the direction of the last move. What the rig does is `disturbances.py`'s.
Answers come strongest first; each is taken into account before the next is looked for, since one that is large leaves traces in all.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from urdfcal.base.geometry import MM, Matrix, Vector
from urdfcal.base.progress import counted
from urdfcal.calibration.asking.arm import arm_columns
from urdfcal.calibration.asking.gears import CYCLES, Gears
from urdfcal.calibration.asking.ground import Ground
from urdfcal.calibration.asking.joint_noise import joint_noise
from urdfcal.calibration.asking.lacking import Lacking
from urdfcal.calibration.asking.questions import NAMED, Answer, Question
from urdfcal.calibration.asking.rig import rig_columns, rig_questions
from urdfcal.calibration.error_table import error_table, main_unit, rms_of
from urdfcal.estimation.score import Fitted
from urdfcal.model.rig_terms import RigTerm
from urdfcal.sensors.sensor import MAIN_UNIT

_MOST = 10  # answers
_GEARS = 8  # of these; more of them are told by the cycles that are known


@dataclass(frozen=True)
class Interview:
    """A fit, and everything that may be asked of it."""

    ground: Ground

    def answers(self, least: float = NAMED) -> list[Answer]:
        """What stands out by so many nats, strongest first; where anything does, gravity may pull elsewhere than down."""
        found = self._answers(least)
        if not found or self.ground.gravity is not None or self.ground.anywhere:
            return found
        return Interview(replace(self.ground, anywhere=True))._answers(least)

    def _answers(self, least: float) -> list[Answer]:
        fitted, found = self.ground.fitted, list[Answer]()
        with counted("question to the residuals", _MOST) as advance:
            while len(found) < _MOST and fitted.tells:
                best = max(self._asked(fitted, found), key=lambda answer: answer.gain)
                if best.gain < least:
                    break
                fitted = best.within(fitted)
                found.append(best)
                advance()
        return found

    def beside(self, answers: Sequence[Answer]) -> Fitted:
        """The fit with some answers in it."""
        fitted = self.ground.fitted
        for answer in answers:
            fitted = answer.within(fitted)
        return fitted

    def pays(self, answer: Answer, before: Sequence[Answer] = ()) -> bool:
        """Whether clusters of poses that are left out in turn are the more likely for an answer, beside others."""
        return self.ground.foretold(self.beside((*before, answer))) > self.ground.foretold(self.beside(before))

    def lacking(self, answers: Sequence[Answer]) -> Lacking | None:
        """What those answers do to a fit that does not know of them; None where there are none."""
        known = [answer for answer in answers if answer.noise is None]
        if not known:
            return None
        own, fitted = self.ground.fitted, self.beside(answers)
        p = own.H.shape[1]
        does = np.column_stack([answer.columns for answer in known]) @ fitted.x[p:]
        through = own.H.T @ does
        rest = does - own.H @ (own.P @ through)
        seen = np.eye(p) - own.P  # P H'H: what the data decide of each parameter
        left, laid_out = float(does @ rest) / float(np.sum(seen * seen.T)), self.ground.laid_out
        return Lacking(laid_out(does)[: self.ground.numbers], left, self._length(laid_out(rest)))

    def _length(self, rest: Vector) -> float:
        """Root mean square length of whitened numbers, (N,), in the readings of lengths, [m]; infinite where there are none."""
        linearisation = self.ground.linearisation
        sizes = rest.reshape(linearisation.residual.shape) * self.ground.estimate.noise.of_numbers(linearisation)
        table = error_table(replace(linearisation, residual=sizes), len(self.ground.model.data))
        return rms_of(table) * MM if main_unit(table) == MAIN_UNIT else np.inf

    def _asked(self, fitted: Fitted, found: Sequence[Answer]) -> Iterator[Answer]:
        """The best answer to each sort of question beside what was found: gravity pulls one way, and likes of a gear may err alike."""
        known, pulled = {answer.cycles for answer in found}, any(answer.what == "sag" for answer in found)
        columns, questions, terms = self._columns
        questions = [question for question in questions if question.what != "sag" or not pulled]
        score, best = fitted.asked(columns), dict[str, tuple[float, Question]]()
        for question, gain in zip(questions, score.gains_of_parts([question.columns for question in questions]), strict=True):
            if question.what not in best or gain - question.price > best[question.what][0]:
                best[question.what] = gain - question.price, question
        for what, (gain, question) in best.items():
            own = score.part(question.columns)
            rig = tuple(replace(terms[n], sigma=terms[n].sigma * max(own.size, 1.0)) for n in question.columns.tolist() if n in terms)
            yield Answer(what, question.where, gain, columns[:, question.columns] * own.size, rig, share=own.explained)
        gears = sum(answer.what == "harmonics" for answer in found)
        asked = [np.isin(CYCLES, list(known))] + ([np.ones(len(CYCLES), dtype=bool)] if gears < _GEARS else [])
        for cycles in asked:
            if (answer := self._gears.answer(fitted, cycles)) is not None:
                yield answer
        if fitted.roots is None and not self.ground.estimate.noise.of_joints and self.ground.turning:
            yield joint_noise(self.ground, fitted)

    @cached_property
    def _gears(self) -> Gears:
        return Gears(self.ground)

    @cached_property
    def _columns(self) -> tuple[Matrix, list[Question], dict[int, RigTerm]]:
        """All columns whitened, (N, k), the questions about them, and which of them are the rig's."""
        (arm, questions), (rig, terms) = arm_columns(self.ground), rig_columns(self.ground)
        first = arm.shape[2]
        whitened = self.ground.whitened(np.concatenate([arm, rig], axis=2))
        return whitened, [*questions, *rig_questions(terms, first)], {first + number: term for number, term in enumerate(terms)}
