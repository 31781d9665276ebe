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
import numpy.typing as npt

from urdfcal.base.geometry import MM, Array3, Vector
from urdfcal.base.progress import counted
from urdfcal.calibration.asking.beside import Bare, Beside
from urdfcal.calibration.asking.gears import CYCLES, GEARS, gears
from urdfcal.calibration.asking.ground import Ground
from urdfcal.calibration.asking.joint_noise import EVERY, JointNoise, under_noise
from urdfcal.calibration.asking.lacking import Lacking
from urdfcal.calibration.asking.questions import NAMED, Answer, Question
from urdfcal.calibration.asking.sheet import Sheet
from urdfcal.calibration.error_table import error_table, main_unit, rms_of
from urdfcal.estimation.left_out_rows import predicted
from urdfcal.sensors.sensor import MAIN_UNIT

_MOST = 10  # answers
_PART = 4  # of few rows, one of so many tell about how large noise of the joints is
_GEARS = 8  # of these; more of them are told by the cycles that are known


@dataclass(frozen=True)
class Interview:
    """A fit, and everything that may be asked of it."""

    ground: Ground

    def answers(self, least: float = NAMED) -> list[Answer]:
        """What stands out by so many nats, strongest first; where anything does, gravity may pull elsewhere than down."""
        found = self._answers(least)
        return self._answering._answers(least) if found and self._answering is not self else found

    @property
    def _answering(self) -> Interview:
        """Whose answers these are, if there are any."""
        return self if self.ground.gravity is not None or self.ground.anywhere else self._anywhere

    @cached_property
    def _anywhere(self) -> Interview:
        return Interview(replace(self.ground, anywhere=True))

    @cached_property
    def _sheet(self) -> Sheet:
        return Sheet(self.ground)

    @cached_property
    def _bare(self) -> Bare:
        return Bare(self._sheet)

    def _answers(self, least: float) -> list[Answer]:
        found = list[Answer]()
        if not self.ground.fitted.tells:
            return found
        with counted("question to the residuals", _MOST) as advance:
            while len(found) < _MOST and (beside := Beside(self._bare, found)).fitted.tells:
                best = max(self._asked(beside, found), key=lambda answer: answer.gain)
                if best.gain < least:
                    break
                found.append(best)
                advance()
        return found

    def pays(self, answer: Answer, before: Sequence[Answer] = ()) -> bool:
        """Whether clusters of poses that are left out in turn are the more likely for an answer, beside others."""
        asked = self._answering
        return asked.foretold((*before, answer)) > asked.foretold(before)

    def foretold(self, answers: Sequence[Answer] = ()) -> float:
        """Log density of clusters of poses that are left out in turn, less what whitening adds, with some answers in the fit."""
        beside, (cluster_of, count) = Beside(self._bare, answers), self.ground.clusters

        def strips() -> Iterator[tuple[Array3, npt.NDArray[np.intp]]]:
            return ((beside.fitted.kept.rows(strip.columns), cluster_of[strip.rows]) for strip in beside.strips())

        return predicted(beside.fitted, strips, count, self.ground.rows) - beside.grown / 2 - self.ground.lost

    def lacking(self, answers: Sequence[Answer]) -> Lacking | None:
        """What those answers do to a fit that does not know of them; None where there are none."""
        known = [answer for answer in answers if not answer.noise]
        return self._answering._lacking(answers, known) if known else None

    def _lacking(self, answers: Sequence[Answer], known: Sequence[Answer]) -> Lacking:
        beside, plain, p = Beside(self._bare, answers), Beside(self._bare, known), self._sheet.p
        does = np.zeros(len(plain.fitted.products) - 1)
        does[beside.fitted.kept.own[p:]] = beside.fitted.x[p:] * beside.fitted.kept.scale[p:]
        own, products = self._bare.fitted, plain.fitted.products[:-1, :-1]
        reaches = products[:p] @ does
        moved, seen = own.P @ reaches, np.eye(p) - own.P  # P H'H: what the data decide of each parameter
        left = float(does @ products @ does - moved @ reaches) / float(np.sum(seen * seen.T))
        rest = does.copy()
        rest[:p] -= moved
        return Lacking(reaches / self.ground.model.errors.sigma, left, self._length(self.ground.laid_out(plain.combined(rest))))

    def _length(self, rest: Vector) -> float:
        """Root mean square length of whitened numbers, (N,), in the readings of lengths, [m]; infinite where there are none."""
        linearisation = self.ground.linearisation
        sizes = rest.reshape(linearisation.residual.shape) * self.ground.estimate.noise.of_numbers(linearisation)
        table = error_table(replace(linearisation, residual=sizes), len(self.ground.model.data))
        return rms_of(table) * MM if main_unit(table) == MAIN_UNIT else np.inf

    def _asked(self, beside: Beside, found: Sequence[Answer]) -> Iterator[Answer]:
        """The best answer to each sort of question beside what was found: gravity pulls one way, and likes of a gear may err alike."""
        yield from self._of_columns(beside, any(answer.what == "sag" for answer in found))
        known, of_gears = {answer.cycles for answer in found}, sum(answer.what == "harmonics" for answer in found)
        yield from gears(
            tuple(self.ground.joints),
            self._sheet.angles[:, beside.few.rows],
            beside.of_few,
            beside.few,
            [GEARS & np.isin(CYCLES, [*known]), GEARS & (of_gears < _GEARS)],
        )
        if self._sheet.asks_of_joint_noise and not beside.noise:
            yield self._joint_noise(beside, bare=not found)

    def _joint_noise(self, beside: Beside, bare: bool) -> Answer:
        """Noise of the joints' readings, guessed from few of the rows where these are not all."""
        few, some = beside.of_few, beside.few
        if self._sheet.stride == 1:
            return JointNoise(beside.fitted, under_noise(few.kept, [some], EVERY)).answer
        some = some.every(self._sheet.stride * _PART)
        few = few.alone(some.flat @ some.flat.T, len(some.rows) / len(beside.few.rows))
        guess = JointNoise(few, under_noise(few.kept, [some], EVERY))
        return JointNoise(beside.fitted, self._bare.under if bare else {}).uphill(guess, beside.strips).answer

    def _of_columns(self, beside: Beside, pulled: bool) -> Iterator[Answer]:
        """The best answer to each sort of question about columns; but for sag, where it is known which way gravity pulls."""
        sheet, best = self._sheet, dict[str, tuple[float, Question]]()
        questions = [question for question in sheet.questions if question.what != "sag" or not pulled]
        score = beside.fitted.asked(np.arange(sheet.p, sheet.count))
        gains = score.gains_of_parts([question.columns - sheet.p for question in questions])
        for question, gain in zip(questions, gains, strict=True):
            if question.what not in best or gain - question.price > best[question.what][0]:
                best[question.what] = gain - question.price, question
        for what, (gain, question) in best.items():
            own, columns, terms = score.part(question.columns - sheet.p), question.columns, sheet.terms
            rig = tuple(replace(terms[n], sigma=terms[n].sigma * max(own.size, 1.0)) for n in columns.tolist() if n in terms)
            yield Answer(what, question.where, gain, columns, own.size, rig, share=own.explained)
