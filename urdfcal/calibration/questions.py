"""Ask the residuals of a fit what its model lacks: one score test for everything that robots and rigs are known to do.

Each question is about a few columns. What the arm does turns joints, so its columns are those of a joint turned by one, times what it
goes with: gravity's moments, sin q and cos q, q itself, the direction of the last move. What the rig does is `disturbances.py`'s.
Answers come strongest first; each is taken into account before the next is looked for, since one that is large leaves traces in all.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import DEG, Array3, Matrix, Vector
from urdfcal.calibration.disturbances import courses_of, disturbances, progress
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.richer import usual_range
from urdfcal.estimation.ekf import Belief, Estimate
from urdfcal.estimation.residual import Linearisation
from urdfcal.estimation.score import Fitted, Score
from urdfcal.model.error_model import with_softness
from urdfcal.model.gravity import Gravity, WeighedRobot
from urdfcal.model.rig_terms import RigTerm
from urdfcal.model.softness import EXTRAS, Softness, Term, extra_terms, gravity_terms, unit_terms
from urdfcal.robot.robot import Robot

NAMED = 5.0  # [nats] from which an answer is told
_MOST = 6  # answers
CYCLES = np.arange(3, 201)  # a turn of a joint, at which gears are looked for

Rows = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Question:
    """Columns that are asked about together.

    Attributes:
        what: What would cause them.
        where: The joint; the empty string where it is of all of them, or of the rig.
        columns: Which they are.
        price: Log of how many questions of this sort there are.
    """

    what: str
    where: str
    columns: Rows
    price: float = 0.0


@dataclass(frozen=True)
class Answer:
    """What stands out.

    Attributes:
        what, where: As of the question.
        gain: Log evidence, [nats].
        columns: Whitened, in units of the size that the data give them, (N, k).
        rig: Terms of the rig that it is; none where the arm does it.
        cycles: A turn of the joint, of a gear's harmonic.
        noise: Of a noise, roots of the inverse covariance of each row's numbers beside their own, (rows, m, m).
        joint_sigma: Noise of the joints' readings that it is, [rad].
    """

    what: str
    where: str
    gain: float
    columns: Matrix = field(repr=False)
    rig: tuple[RigTerm, ...] = ()
    cycles: int = 0
    noise: Array3 | None = field(default=None, repr=False)
    joint_sigma: float = 0.0

    @property
    def of_the_rig(self) -> bool:
        """Whether it belongs into the fit, and not into a compensation: the rig does it, or it is noise."""
        return bool(self.rig or self.joint_sigma)

    @property
    def name(self) -> str:
        """Which columns these are: a drift that wanders is another one."""
        return self.rig[0].what if self.rig else f"{self.what} {self.where}"


@dataclass(frozen=True)
class StandsOut:
    """Something that the residuals say the model lacks, as a result tells it.

    Attributes:
        what: `sag`, `eccentricity`, `harmonics`, `scale`, `approach`, `joint_noise`, `drift`, `temperature`, `screen_bow`, `lens`,
            `readings_scale` or `payload`.
        where: The joint; the empty string where it is of all of them, or of the rig.
        gain: Log evidence for it beside all that stand before it, [nats].
        entered: Whether it is in the fit, or in the compensation beside it.
        cycles: A turn of the joint, of a gear's harmonic.
    """

    what: str
    where: str
    gain: float
    entered: bool = False
    cycles: int = 0

    def entry(self) -> dict[str, object]:
        """For machines."""
        own: dict[str, object] = {"what": self.what, "where": self.where, "gain_nats": self.gain, "entered": self.entered}
        return own | ({"cycles_a_turn": self.cycles} if self.cycles else {})


@dataclass(frozen=True)
class Interview:
    """A fit, and everything that may be asked of it.

    Attributes:
        robot: The nominal robot, as it was measured.
        model: The fit's problem.
        estimate: The fit.
        gravity: Where down is, and what is carried.
    """

    robot: Robot
    model: Problem
    estimate: Estimate
    gravity: Gravity = field(default_factory=Gravity)

    def answers(self, least: float = NAMED) -> list[Answer]:
        """What stands out, strongest first."""
        fitted, found = self.fitted, list[Answer]()
        while len(found) < _MOST:
            best = max(self._asked(fitted), key=lambda answer: answer.gain)
            if best.gain < least:
                break
            fitted = fitted.beside(best.columns) if best.noise is None else fitted.spread(best.noise)
            found.append(best)
        return found

    @cached_property
    def linearisation(self) -> Linearisation:
        """At the estimate."""
        return self.model.linearise(self.estimate.belief.x)

    @cached_property
    def fitted(self) -> Fitted:
        """The fit before any question."""
        errors = self.model.errors
        prior = Belief.independent(errors.mean, errors.sigma)
        return Fitted.of(self.linearisation, self.estimate.noise, self.estimate.belief.x, prior)

    def beside(self, answers: Sequence[Answer]) -> Fitted:
        """The fit with some answers in it."""
        fitted = self.fitted
        for answer in answers:
            fitted = fitted.beside(answer.columns) if answer.noise is None else fitted.spread(answer.noise)
        return fitted

    def pays(self, answer: Answer, before: Sequence[Answer] = ()) -> bool:
        """Whether clusters of poses that are left out in turn are the more likely for an answer, beside others."""
        rows, folds = len(self.linearisation.residual), clustered(self.model.data.q, self.model.data.configuration_of)
        without, given = self.beside(before), self.beside((*before, answer))
        return given.predicted(folds, rows) > without.predicted(folds, rows)

    def widened(self, P: Matrix, answers: Sequence[Answer]) -> Matrix:
        """The covariance of a fit that does not know of what stands out, (p, p): with what that does to it.

        Something B b that geometry has no word for moves the parameters by P H' B b, and leaves M B b in the residuals, as it will in
        every reading to come. The first is added as it is, and the parameters' covariance is made as much larger as the second is than
        what it predicts, so that predictions are off by as much as they say.
        """
        known = [answer for answer in answers if answer.noise is None]
        if not known:
            return P
        own, fitted = self.fitted, self.beside(answers)
        p = own.H.shape[1]
        b, C = (fitted.P @ (fitted.H.T @ fitted.y))[p:], fitted.P[p:, p:]
        through = own.H.T @ (B := np.column_stack([answer.columns for answer in known]))
        second = np.outer(b, b) + C
        left = float(np.sum((B.T @ B - through.T @ own.P @ through) * second))
        predicted = p - float(np.trace(own.P))
        moved = (own.P @ through) * self.model.errors.sigma[:, None]
        return np.asarray(P * (1 + left / predicted) + moved @ second @ moved.T)

    def _asked(self, fitted: Fitted) -> Iterator[Answer]:
        """The best answer to each sort of question."""
        columns, questions, terms = self._columns
        score = fitted.asked(columns)
        answers: dict[str, tuple[float, Score, Question]] = {}
        for question in questions:
            own = score.part(question.columns)
            gain = own.gain - question.price
            if question.what not in answers or gain > answers[question.what][0]:
                answers[question.what] = gain, own, question
        for what, (gain, own, question) in answers.items():
            rig = tuple(replace(terms[n], sigma=terms[n].sigma * own.size) for n in question.columns.tolist() if n in terms)
            yield Answer(what, question.where, gain, columns[:, question.columns] * own.size, rig)
        yield from self._gears(fitted)
        if fitted.roots is None and not self.estimate.noise.of_joints:
            yield self._joint_noise(fitted)

    def _joint_noise(self, fitted: Fitted) -> Answer:
        """Readings of all turning joints that are noisy by one standard deviation."""
        turned, units = self.turns
        inputs = {joint.name for joint in self.robot.chain.inputs}
        joints = [self.robot.chain.moving[term.joint].joint for term in units]
        own = [i for i, (t, j) in enumerate(zip(units, joints, strict=True)) if t.axis is None and j.name in inputs and not j.prismatic]
        rows, m = self.linearisation.residual.shape
        reach = self._whitened(turned)[:, own].reshape(rows, m, len(own))
        values, vectors = np.linalg.eigh(reach @ reach.transpose(0, 2, 1))
        tried = []
        for sigma in _JOINT_SIGMAS.tolist():
            grown = 1 + sigma**2 * np.maximum(values, 0.0)
            roots = (vectors / np.sqrt(grown)[:, None]) @ vectors.transpose(0, 2, 1)
            spread = fitted.spread(roots)
            gain = spread.log_evidence - 0.5 * float(np.sum(np.log(grown))) - fitted.log_evidence
            scale = np.sqrt(spread.total / spread.numbers) if spread.numbers else 1.0
            tried.append((gain, float(sigma * scale), roots))
        gain, sigma, roots = max(tried, key=lambda each: each[0])
        return Answer("joint_noise", "", gain - float(np.log(len(tried))), np.empty((rows * m, 0)), noise=roots, joint_sigma=sigma)

    @cached_property
    def _columns(self) -> tuple[Matrix, list[Question], dict[int, RigTerm]]:
        """All columns whitened, (N, k), the questions about them, and which of them are the rig's."""
        arm, arm_questions = self._of_arm
        rig, terms = self._of_rig
        first = arm.shape[2]
        questions = [*arm_questions, *_rig_questions(terms, first)]
        raw = np.concatenate([arm, rig], axis=2)
        return self._whitened(raw), questions, {first + number: term for number, term in enumerate(terms)}

    def _whitened(self, columns: Array3) -> Matrix:
        """Columns (poses, m, k) in units of the noise, (N, k); what is known beforehand has none."""
        padded = np.zeros((*self.linearisation.residual.shape, columns.shape[2]))
        padded[: len(columns)] = columns
        padded *= np.asarray(self.linearisation.measured)[..., None]
        return self.estimate.noise.weights(self.linearisation).jacobian(replace(self.linearisation, jacobian=padded))

    @cached_property
    def turns(self) -> tuple[Array3, tuple[Term, ...]]:
        """What is read more where a joint turns, or slides, by one, (n, m, terms), and about what."""
        terms = unit_terms(self.robot.chain)
        errors = with_softness(self.model.errors, terms, self._weighed, self.robot.rig.tip)
        x = np.concatenate([self.estimate.belief.x, np.zeros(len(terms))])
        linearised = Problem(errors, self.model.data).linearise(x)
        return linearised.jacobian[: len(self.model.data), :, len(self.estimate.belief.x) :], terms

    @cached_property
    def _weighed(self) -> WeighedRobot:
        return WeighedRobot(self.robot, self.gravity)

    @cached_property
    def _of_arm(self) -> tuple[Array3, list[Question]]:
        """Columns (n, m, k) of what the arm may do, in units of their usual sizes, and the questions about them."""
        chain, data = self.robot.chain, self.model.data
        extras = [extra for extra in EXTRAS if extra != "approach" or data.approach is not None]
        terms = (*gravity_terms(chain, self._weighed.moments(usual_range(self.robot, data))), *extra_terms(chain, extras))
        basis = Softness(chain, terms, self._weighed, self.robot.rig.tip).basis(data.q, data.payload, data.approach)
        turned, units = self.turns
        unit = {(term.joint, term.axis): number for number, term in enumerate(units)}
        own = [unit[term.joint, term.axis] for term in terms]
        columns = turned[:, :, own] * (basis * [term.sigma for term in terms])[:, None]
        return columns, list(_arm_questions(terms))

    @cached_property
    def _of_rig(self) -> tuple[Array3, list[RigTerm]]:
        """Columns (n, m, k) of what the rig may do, in units of their usual sizes, and its terms."""
        data = self.model.data
        at, x = progress(data, courses_of(data)), self.estimate.belief.x
        places: dict[str, int] = {}
        terms: list[RigTerm] = []
        found: list[tuple[slice, int, Matrix]] = []
        for channel, view in zip(self.model.channels, self.model.views(x), strict=True):
            look = channel.sensor.look(view, channel.values)
            for moved in disturbances(channel.sensor, view, look, channel.values, at):
                if moved.term.name not in places:
                    places[moved.term.name] = len(terms)
                    terms.append(moved.term)
                found.append((channel.block.columns, places[moved.term.name], moved.column * moved.term.sigma))
        columns = np.zeros((len(data), self.linearisation.residual.shape[1], len(terms)))
        for numbers, place, column in found:
            columns[:, numbers, place] = column
        return np.where(np.isfinite(columns), columns, 0.0), terms

    def _gears(self, fitted: Fitted) -> Iterator[Answer]:
        """The best harmonic of any joint's gear."""
        best: tuple[float, Answer] | None = None
        for joint, column, one, other in self._gear_waves:
            pairs = fitted.asked_in_pairs(column, one, other)
            score = pairs.score(pairs.best)
            if best is None or score.gain > best[0]:
                waves = np.stack([own[:, pairs.best] for own in (one, other)], axis=1) * score.size
                columns = (column.reshape(len(one), -1, 1) * waves[:, None]).reshape(-1, 2)
                price = float(np.log(len(CYCLES) * len(self._gear_waves)))
                best = score.gain, Answer("harmonics", joint, score.gain - price, columns, cycles=int(CYCLES[pairs.best]))
        if best is not None:
            yield best[1]

    @cached_property
    def _gear_waves(self) -> list[tuple[str, Vector, Matrix, Matrix]]:
        """Of each turning joint its name, its whitened column (N,), and sin and cos of its angle times CYCLES, (rows, cycles)."""
        inputs = {joint.name: index for index, joint in enumerate(self.robot.chain.inputs)}
        turned, units = self.turns
        whitened, found = self._whitened(turned), []
        for number, term in enumerate(units):
            joint = self.robot.chain.moving[term.joint].joint
            if term.axis is None and joint.name in inputs and not joint.prismatic:
                q = np.zeros(len(self.linearisation.residual))
                q[: len(self.model.data)] = self.model.data.q[:, inputs[joint.name]]
                angles = q[:, None] * CYCLES
                found.append((joint.name, whitened[:, number] * _GEAR, np.sin(angles), np.cos(angles)))
        return found


_FOLDS = 8


def clustered(q: Matrix, configuration_of: Rows) -> list[Rows]:
    """Rows in clusters of neighbouring poses of about equal size: halved where they are spread most, in units of the whole spread.

    Args:
        q: Joint positions, (n, joints).
        configuration_of: Index of the configuration of each row; rows of one stay together.
    """
    spread = np.ptp(q, axis=0)
    scaled = q / np.where(spread > 0, spread, 1.0)
    first = np.unique(configuration_of, return_index=True)[1]
    parts = [np.arange(len(first))]
    while len(parts) < _FOLDS:
        largest = max(range(len(parts)), key=lambda number: len(parts[number]))
        part = parts.pop(largest)
        if len(part) < 2:
            return []
        joint = int(np.argmax(np.ptp(scaled[first[part]], axis=0)))
        order = part[np.argsort(scaled[first[part], joint], kind="stable")]
        parts += [order[: len(order) // 2], order[len(order) // 2 :]]
    return [np.flatnonzero(np.isin(configuration_of, part)) for part in parts]


_JOINT_SIGMAS = 0.005 * DEG * np.sqrt(2.0) ** np.arange(9)
_GEAR = 0.2e-3  # [rad] that gears usually err by
_HARMONIC_SORTS = (("ecc_sin", "ecc_cos"), ("ecc_sin2", "ecc_cos2"))
_SORTS = {"sag": "sag", "sag_1": "sag", "sag_2": "sag", "scale": "scale", "approach": "approach"}
_SORTS |= {name: "eccentricity" for sort in _HARMONIC_SORTS for name in sort}


def _arm_questions(terms: Sequence[Term]) -> Iterator[Question]:
    """About all joints at once, and about each of them."""
    names = [term.name.rpartition(".") for term in terms]
    for what in dict.fromkeys(_SORTS.values()):
        own = np.array([number for number, (_, _, name) in enumerate(names) if _SORTS[name] == what], dtype=np.intp)
        joints = list(dict.fromkeys(names[number][0] for number in own))
        sorts = [own] if what != "eccentricity" else [own, *([n for n in own if names[n][2] in sort] for sort in _HARMONIC_SORTS)]
        asked = [("", np.array(columns, dtype=np.intp)) for columns in sorts if len(columns)]
        if what != "sag":
            asked += [(joint, np.array([n for n in columns if names[n][0] == joint])) for joint in joints for columns in sorts]
        for where, columns in asked:
            yield Question(what, where, columns, float(np.log(2 * (len(sorts) if not where else len(joints) * len(sorts)))))


def _rig_questions(terms: Sequence[RigTerm], first: int) -> Iterator[Question]:
    """About each thing that a rig may do; what wanders is a drift, too."""
    for what in dict.fromkeys(term.what for term in terms):
        columns = np.array([first + number for number, term in enumerate(terms) if term.what == what], dtype=np.intp)
        yield Question("drift" if what == "wander" else what, "", columns, float(np.log(2)) if what in ("drift", "wander") else 0.0)
