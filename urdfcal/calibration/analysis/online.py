"""Calibration while measuring: one pose at a time, with the accuracy to be expected after each.

Between two poses the state stands still, so a new pose is one Kalman update (14)-(15) of the belief. It is linearised where all poses
before it were: Jacobians taken at one state agree on what no reading can see, and those taken at a mean that moves do not, so that a
filter comes to believe that it sees it (Huang, Mourikis and Roumeliotis, 2010). As the mean moves away from there the linearisation
ages. All poses are kept, therefore, and when the mean has moved by a sigma of its own, or the history has grown by half, the whole history
is linearised afresh: the belief then is the maximum a posteriori estimate that `fit` gives of the same poses. As sigmas shrink this
comes ever more seldom, and in between the belief differs from the batch answer by a small part of a sigma.

Measuring frames, targets and places that poses share are found from nothing, which takes some poses. What is read of one of them for
the first time waits aside until there is enough of it; then frames and all are found from the whole history, in which it is from there on.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import isfinite
from typing import Any

import numpy as np
import numpy.typing as npt

from urdfcal.base.errors import FitRejected, ShapeMismatch, UsageError, no_such
from urdfcal.base.foreign_text import shown
from urdfcal.base.geometry import MM, Matrix, Vector
from urdfcal.base.terminal import many
from urdfcal.calibration.analysis.arrivals import (
    WORKSPACE,
    History,
    NotYet,
    Rows,
    Seen,
    Thing,
    in_order,
    no_spots,
    placed_instruments,
    poses_on_screen,
    ready,
)
from urdfcal.calibration.analysis.forecast import Forecast
from urdfcal.calibration.analysis.next_pose import NextPose, measured_before, read_at, whitened
from urdfcal.calibration.analysis.online_state import OnlineState
from urdfcal.calibration.analysis.prediction import default_tool, spot_jacobians, tool_jacobian
from urdfcal.calibration.analysis.stream import Arrived, Layout, Layouts, Ready, Row
from urdfcal.calibration.extra_noise import MORE, extra_noise, widened
from urdfcal.calibration.fitting import fit
from urdfcal.calibration.pose_by_pose import PoseByPose
from urdfcal.calibration.problem import Problem, problem_of
from urdfcal.calibration.result import FitResult
from urdfcal.calibration.start.begin import start_of, with_scale
from urdfcal.calibration.start.nominal import NominalFit
from urdfcal.estimation.chi_squared import chi_squared_gate
from urdfcal.estimation.ekf import Belief, Estimate, iterated_schedule, update
from urdfcal.estimation.gains import gains
from urdfcal.estimation.noise import Misfit, Noise, misfits
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import LENS, ModelOptions
from urdfcal.model.parameters import INSTRUMENTS
from urdfcal.robot.configurations import measured_positions, random_positions
from urdfcal.robot.rig import Grid
from urdfcal.robot.robot import Robot, require_robot
from urdfcal.sensors.columns import NONE, Stations
from urdfcal.sensors.in_memory import is_table, measurements_from, named_columns
from urdfcal.sensors.measurements import Measurements, as_measured, refining, require_screen_of_camera, spots_measured
from urdfcal.sensors.registry import WORDS, noun, start_sigma_of
from urdfcal.sensors.stated_noise import joint_sigmas, noise_for, noise_of, states_all, stating_kinds

_STALE = 1.0  # [sigmas] by which the mean may move before the history is linearised afresh
_REST = 1e-3  # [sigmas] the last step of doing so
_GROWTH = 1.5  # and by how much the history may grow
_DISHONEST = 4.0  # sigmas of chi-squared beyond which the noise is not what it is taken for
_MOST_SKIPPED = 3  # poses in a row that a gate may leave out: then it is the belief that is wrong
_FREEDOM = 10.0  # degrees of freedom from which on the noise is estimated


class OnlineCalibrator:
    """Takes poses one by one, of whatever sensors; knows the belief and the accuracy to be expected after each.

    Attributes:
        robot: The nominal robot.
        target_mm: What tool_sigma_mm is to fall under, [mm].
    """

    def __init__(
        self,
        robot: Robot,
        options: ModelOptions | None = None,
        *,
        spot_sigma: float | None = None,
        sigmas: Mapping[str, float] | None = None,
        joint_sigma: float | Vector = 0.0,
        tool: str | None = None,
        target_mm: float | None = None,
        gate: bool = False,
        workspace: Matrix | None = None,
        rng: np.random.Generator | None = None,
        reference: str | None = None,
        camera: Any = None,
        boards: Mapping[str, Grid] | None = None,
        stations: Stations = NONE,
    ) -> None:
        """Start from the priors.

        Args:
            robot: Nominal robot; left unchanged.
            options: What is to be calibrated, as for `fit`.
            spot_sigma: Noise of a spot coordinate, [m]; if None it is estimated from the residual as soon as there is enough of it.
            sigmas: The same of other readings by kind: `point`, `orientation`, `distance` ...; [m], [rad] or [px].
            joint_sigma: Noise of a joint reading as for `fit`, [rad], one number or one a joint.
            tool: Link whose pose relative to the base is to be accurate; by default the module, or the target that most joints move.
            target_mm: Predicted position error of the tool that is good enough, [mm].
            gate: Leave out poses beyond the gate, but not one after the other without end: then the belief is wrong, and not they.
            workspace: Configurations over which the tool must be accurate, (n, inputs), [rad] or [m]; by default random within limits.
            rng: Source of randomness for the configurations.
            reference: Link that the measuring frame stands on; by default `tracker`, or the root.
            camera: What pixels are read with.
            boards: Links that are boards, with the grids of their corners.
            stations: Instruments that readings such as `tool0@head.point` name, beside links.

        Raises:
            UsageError: an option means nothing here, or the limits leave no workspace and none is given.
            RobotError: the tool is not a link that the calibrated joints move.
        """
        require_robot(robot, "OnlineCalibrator")
        self._known = _known_noise(spot_sigma, sigmas or {})
        _check(target_mm, gate, self._known)
        self.robot, self.target_mm, self.options = robot, target_mm, options or ModelOptions()
        self._gated, self._joint_sigma, self._tool, self._asked_for = gate, joint_sigma, tool, workspace
        self._how: dict[str, Any] = {"reference": reference, "camera": camera, "boards": boards, "stations": stations}
        self._rng = rng or np.random.default_rng(0)
        self._history, self._waiting, self._came = History(), list[tuple[int, Measurements]](), Rows(robot)
        self._layouts = Layouts()
        self._of_spots: Layout | None = None
        self._ready: dict[Layout, Ready | None] = {}
        self._extra: dict[str, float] = {}
        self._skipped, self._taken = 0, 0
        self._misfit: Misfit | None = None
        self._seen: Seen | None = None
        self._state: OnlineState | None = None
        if (nothing := no_spots(robot)) is not None:
            self._look_at(nothing, placed=frozenset())

    @property
    def errors(self) -> ErrorModel:
        """The error model, of all that was read so far.

        Raises:
            UsageError: nothing was read yet, and the robot has no lasers that it could be about.
        """
        return self._seeing.errors

    @property
    def tool(self) -> str:
        """The link whose accuracy is predicted; raises as `errors`."""
        return self._seeing.tool

    @property
    def state(self) -> OnlineState:
        """What is known now; raises as `errors`."""
        self._seeing  # noqa: B018  # says what is missing
        assert self._state is not None
        return self._state

    @property
    def _seeing(self) -> Seen:
        if self._seen is None:
            raise UsageError("no pose was taken yet; what is calibrated follows from what is read, since the robot has no lasers")
        return self._seen

    def __repr__(self) -> str:
        """In a line."""
        state = self._state
        words = f"after {many(state.poses, 'pose')}" if state is not None else "before any pose"
        waiting = f", {len(self._waiting)} waiting" if self._waiting else ""
        return f"<{type(self).__name__} of {shown(self.robot.name)} {words}{waiting}>"

    def update(self, q: Any, readings: Any = None, sigma: npt.ArrayLike | None = None) -> OnlineState:
        """Take one pose, or several one after the other.

            update(row)                                        # a dictionary, a row of a DataFrame, or several rows: as in a file
            update(q, {"tool0.point": p, "ball.socket": "a"})  # joint positions, and what sensors read
            update(q, spots)                                   # joint positions, and the spots of all lasers
            update(measurements)                               # all poses of some Measurements

        Args:
            q: Joint positions, (inputs,), [rad] or [m]; or a table or Measurements.
            readings: What sensors read at this pose, by column or by `<target>.<sensor>`, as for `measurements_from` but for one pose:
                `point` (3,) [m], `pose` (7,) or (4, 4), `distance` a number ...; or (y, z) of all lasers, (lasers, 2), [m], nan where a
                beam was not seen.
            sigma: With spots of all lasers: standard deviation of each, (lasers,), [m]; nan where nothing is stated.

        Raises:
            ShapeMismatch: the arrays do not fit the robot.
            MeasurementError: a column or cell means nothing.
            FitRejected: a beam was seen that in the present model does not meet the screen; the pose was not taken.
            UsageError: there is a gate, and noise of what was read is not stated.
        """
        if not isinstance(q, Measurements) and readings is not None and not is_table(q) and not is_table(readings):
            self._take(self._spots(q, readings, sigma))
            return self.state
        poses = q if isinstance(q, Measurements) else self._measured(q, readings)
        require_screen_of_camera(poses)
        poses = refining(poses, LENS in self.options.estimate)
        if is_table(q):
            self._came.keep(self._taken + 1, _as_rows(dict(named_columns(q))))
        for row in range(len(poses)):
            self._take(self._layouts.row(poses, row))
        return self.state

    def measurements(self) -> Measurements:
        """The poses that the belief holds.

        Raises:
            UsageError: there are none, and the robot has no lasers that they could be of.
        """
        return self._history.measurements()

    def next_pose(self, candidates: npt.ArrayLike) -> NextPose:
        """Which of some poses to measure next: the one after which the tool's predicted mean squared error is least, given the belief.

        Every instrument is taken to read there what it has read before, where the belief says that it can. Poses that were measured
        already are passed over, and so is what touches.

        Args:
            candidates: Positions that the robot may take, (m, inputs), [rad] or [m], in the order of the `joints` of what was measured:
                of the robot's `chain.input_names` as the sensors see it.

        Raises:
            UsageError: nothing is placed yet, only touches were read, or none of the candidates tells anything new.
            ShapeMismatch: the candidates do not fit the robot.
        """
        seen = self._seeing
        q = measured_positions(seen.robot, candidates, "next_pose: candidates")
        if seen.placed is None:
            raise UsageError(f"next_pose: {self.state.waiting or 'nothing is placed yet'}; begin with poses that differ in every joint")
        held = self._history.measurements()
        there = read_at(seen.robot, seen.errors, self.state.x, held, q)
        noise = noise_for(self.state.noise, seen.kinds, there)
        M, P = self._forecast.of_position, self.state.belief.P
        gain = gains(whitened(self.errors, self._linearised_at, widened(there, self._extra), noise), P, M)
        gain[measured_before(q, held)] = 0.0
        best = int(np.argmax(gain)) if len(gain) else 0
        if not len(gain) or not gain[best] > 0:
            raise UsageError(f"next_pose: none of {many(len(q), 'candidate')} tells anything: measured already, or nothing is seen there")
        return NextPose(best, q[best].copy(), float(np.sqrt(np.sum(P * M) - gain[best])) / MM)

    def calibration(self, gated: bool = False, evidence: bool = False) -> FitResult:
        """The batch fit of the poses so far: report, corrected URDF and all.

        Args:
            gated: Look for outliers as `fit` does.
            evidence: Choose the joints' priors by the data as `fit` does. With either of both the residuals are asked what the model lacks,
                too; without both the answer is what the belief approximates.

        Raises:
            UsageError: nothing has been read yet.
        """
        if not self._history.numbers:
            waiting = f": {self._state.waiting}" if self._state is not None and self._state.waiting else ""
            raise UsageError(f"no pose with a reading has been taken yet; there is nothing to fit{waiting}")
        data = self.measurements()
        stated = {kind: sigma for kind, sigma in self._known.items() if kind in data.kinds and not states_all(data, kind)}
        how: dict[str, Any] = {
            "sigmas": stated,
            "joint_sigma": self._joint_sigma,
            "gated": gated,
            "evidence": evidence,
            "asking": gated or evidence,
        }
        return fit(self.robot, data, options=self.options, **how)

    def _measured(self, q: Any, readings: Any) -> Measurements:
        """What was given, as measurements."""
        label = [str(self._taken + 1)]
        if is_table(q):
            table = _as_rows(dict(named_columns(q)))
            number = None if "pose" in table or len(next(iter(table.values()), ())) > 1 else label
            return measurements_from(self.robot, self._came.with_blanks(table), readings, poses=number, **self._how)
        positions = np.asarray(q, dtype=float)[None]
        one = {name: np.asarray(value)[None] for name, value in named_columns(readings)}
        return measurements_from(self.robot, positions, one, poses=label, **self._how)

    def _spots(self, q: Any, spots: Any, sigma: npt.ArrayLike | None) -> Row:
        """The spots of all lasers; what no array of the right shape can get wrong is looked at in the first ones alone."""
        positions, places, lasers = np.array(q, dtype=float), np.array(spots, dtype=float), len(self.robot.rig.lasers)
        if places.shape != (lasers, 2):
            raise ShapeMismatch(f"the spots of one pose have shape (lasers, 2) = {(lasers, 2)}, found {places.shape}")
        stated, label = None if sigma is None else np.array(sigma, dtype=float), str(self._taken + 1)
        sound = positions.shape == (len(self.robot.chain.inputs),) and isfinite(positions @ positions)
        if self._of_spots is None or not sound or stated is not None or not isfinite(places.sum()):
            one = spots_measured(self.robot, positions[None], places[None], sigma=None if stated is None else stated[None], poses=[label])
            row = self._layouts.row(one, 0)
            self._of_spots = row.layout
            return row
        return Row(self._of_spots, positions, tuple(places), None, label)

    def _take(self, row: Row) -> None:
        """One pose: an update of the belief, or a look at the whole history where it shows something new."""
        if self._gated and not row.layout.kinds <= self._known.keys():
            _require_stated(row.measurements(), self._known)
        self._taken += 1
        one = self._ready_for(row.layout)
        if one is None:
            self._open(row.measurements())
            return
        seen = one.at(row)
        if seen.lost or not isfinite(seen.innovation @ seen.innovation):
            self._refuse(row, seen)
            return
        belief, nis = self.state.belief, 0.0
        if numbers := len(seen.innovation):
            belief, nis = update(belief, seen.innovation - seen.H @ (belief.x - self._linearised_at), seen.H, seen.R)
        gate = chi_squared_gate(numbers)
        if self._gated and nis > gate and self._skipped < _MOST_SKIPPED:
            read = noun(one.kinds[0]) if len(one.kinds) == 1 else "readings"
            self._skip(f"pose {row.pose}: its {read} are {np.sqrt(nis / gate):.1f} times as far off as the belief allows", nis, gate)
            return
        again = self._history.holds(row.q)  # shares what that pose has in common, which an update would take for something new
        self._history.add_row(self._taken, row, 0 if again else numbers)
        self._skipped = 0
        fresh = self._settled(self._history.measurements()) if numbers and (again or self._stale(belief)) else None
        self._state = self._state_of(*(fresh or (belief, self.state.noise)), nis=nis, gate=gate, relinearised=fresh is not None)

    def _ready_for(self, layout: Layout) -> Ready | None:
        """What a pose of a layout is made of where the history was linearised; None if it shows what was not seen before."""
        if layout not in self._ready:
            known = self._seen is not None and self._seen.knows(layout.template)
            self._ready[layout] = self._made_ready(layout.template) if known else None
        return self._ready[layout]

    def _made_ready(self, pose: Measurements) -> Ready:
        noise = noise_for(self.state.noise, self._seeing.kinds, pose)
        return Ready(PoseByPose(problem_of(self.errors, pose, noise), self._linearised_at), noise, pose.kinds, self._extra)

    def _open(self, pose: Measurements) -> None:
        """A pose that shows what was not seen before: into the belief with all that waits as soon as it can be placed."""
        self._waiting.append((self._taken, pose))
        if not self._history.count:
            self._history = History()  # without the lasers that were expected
        self._with_joints_of(pose)
        if not self._history.count:
            self._look_at(in_order(self._waiting), placed=None)
        placed = self._seeing.placed or frozenset()
        try:
            rows, placed = ready([pose for _, pose in self._waiting], placed)
            now = [self._waiting[row] for row in rows]
            found = self._settled(in_order([*self._history.parts, *now]), placed)
        except NotYet as told:
            self._state = replace(self.state, waiting=str(told), skipped="", relinearised=False)
            return
        if found is None:
            self._state = replace(self.state, waiting="the fit of all poses does not come to rest yet", skipped="", relinearised=False)
            return
        for number, waiting in now:
            self._history.add(number, waiting, self._history.holds(waiting.q[0]))
        self._waiting = [own for row, own in enumerate(self._waiting) if row not in rows]
        self._state = replace(self._state_of(*found, relinearised=True), waiting=self._what_waits(placed))

    def _what_waits(self, placed: frozenset[Thing]) -> str:
        """What the poses that are left wait for, in words; empty where none is."""
        if self._waiting:
            try:
                ready([pose for _, pose in self._waiting], placed)
            except NotYet as told:
                return str(told)
        return ""

    def _with_joints_of(self, pose: Measurements) -> None:
        """Read all rows once more with the joints of one that shows another branch, where it does."""
        parts = [(number, part.measurements() if isinstance(part, Row) else part) for number, part in self._history.parts]
        if all(part.joints == pose.joints for _, part in (*parts, *self._waiting)):
            return
        again = [(number, self._again(number, part)) for number, part in (*parts, *self._waiting)]
        count, self._history = len(parts), History()
        for number, part in again[:count]:
            self._history.add(number, part, len(part) > 0 and self._history.holds(part.q[0]))
        self._waiting = again[count:]

    def _again(self, number: int, part: Measurements) -> Measurements:
        """A row read once more, as one with all columns that came meanwhile; what did not come as a row stays as it is."""
        row = self._came.row(number)
        if row is None or not len(part):
            return part
        return measurements_from(self.robot, row, poses=part.poses.tolist() if "pose" not in row else None, **self._how)

    def _refuse(self, row: Row, seen: Arrived) -> None:
        """A pose that the model cannot produce."""
        why = f"pose {row.pose}: a beam was seen that in the present model does not meet the screen; check the joints' units and signs"
        if not self._gated:
            raise FitRejected(why)
        self._skip(why, np.inf, chi_squared_gate(len(seen.innovation)))

    def _skip(self, why: str, nis: float, gate: float) -> None:
        """The belief as it was, and why."""
        self._skipped += 1
        self._state = replace(self.state, nis=nis, gate=gate, skipped=why, relinearised=False)

    def _stale(self, belief: Belief) -> bool:
        """Whether the history is to be linearised afresh."""
        if len(self._history) >= _GROWTH * self._linearised_poses:
            return True
        return bool(((belief.x - self._linearised_at) ** 2 > _STALE**2 * belief.P.diagonal()).any())

    def _model_of(self, data: Measurements) -> tuple[Robot, ErrorModel]:
        """The robot as some measurements see it, and its error model before anything is placed."""
        robot = as_measured(self.robot, data)
        sessions = data.session_names or ("",)
        return robot, with_scale(build_error_model(robot.chain, robot.rig, self.options, sessions), data)[0]

    def _look_at(self, data: Measurements, placed: frozenset[Thing] | None) -> None:
        """Start from the priors of what some measurements see; where nothing is `placed` all waits."""
        robot, errors = self._model_of(data)
        noise = self._noise_of(data)
        self._seen = self._as_seen(robot, errors, data, placed)
        if placed is not None:
            self._history.add(0, data, again=True)
        self._mark(errors.mean)
        self._state = self._state_of(Belief.independent(errors.mean, errors.sigma), noise)

    def _as_seen(self, robot: Robot, errors: ErrorModel, data: Measurements, placed: frozenset[Thing] | None) -> Seen:
        """The same with tool, workspace and views, which stay as long as the robot is seen so."""
        if self._seen is not None and self._seen.robot == robot:
            return replace(self._seen, errors=errors, kinds=data.kinds, placed=placed)
        tool = default_tool(robot) if self._tool is None else self._tool
        workspace = random_positions(robot, WORKSPACE, self._rng) if self._asked_for is None else self._asked_for
        return Seen(robot, errors, data.kinds, tool, workspace, poses_on_screen(robot, errors, self._rng), placed)

    def _settled(self, data: Measurements, placed: frozenset[Thing] | None = None) -> tuple[Belief, Noise] | None:
        """The maximum a posteriori belief of the whole history, and the noise that it finds; None if it cannot be had.

        Args:
            data: The history.
            placed: All that can be placed with it; None for what was placed before.

        Raises:
            NotYet: says what it takes to place it.
        """
        robot, errors = self._model_of(data)
        placed = self._seeing.placed if placed is None else placed
        noise = self._noise_of(data)
        nominal = placed_instruments(errors, data, noise)
        extra, model = self._extra, problem_of(nominal.errors, widened(data, self._extra), noise)
        found = self._batch(model, self._starts(nominal, data, noise), noise)
        if found.converged and stating_kinds(data) and (extra or _worst(model, found).sigmas > MORE):
            kinds = [kind for kind in data.kinds if kind in stating_kinds(data)]
            extra = extra_noise(model, found.belief.x, found.noise, data, kinds)
            model = problem_of(nominal.errors, widened(data, extra), noise)
            found = self._batch(model, [found.belief.x], noise)
        if not found.converged:
            return None
        self._seen = self._as_seen(robot, nominal.errors, data, placed)
        self._extra, self._misfit = extra, _worst(model, found)
        self._mark(found.belief.x, len(data))
        return found.belief, found.noise.released(noise)

    def _noise_of(self, data: Measurements) -> Noise:
        """Noise as it is stated, or as far as it has been found."""
        noise = noise_of(data, self._known, joint_sigmas(as_measured(self.robot, data), self._joint_sigma))
        stated = np.array([kind in self._known or states_all(data, kind) for kind in data.kinds])
        last = {} if self._state is None else dict(zip(self._seeing.kinds, range(len(self._seeing.kinds)), strict=True))
        sigma, common = noise.sigma.copy(), noise.common.copy()
        for index, kind in enumerate(data.kinds):
            if kind in last and self._state is not None:
                common[index] = self._state.noise.common[last[kind]]
                sigma[index] = sigma[index] if stated[index] else self._state.noise.sigma[last[kind]]
        return replace(noise, sigma=sigma, stated=stated, common=common)

    def _starts(self, nominal: NominalFit, data: Measurements, noise: Noise) -> list[Vector]:
        """Where to begin: where the belief has the robot, with instruments as they suit the nominal one; else with all of that."""
        begin = start_of(data, nominal.errors, noise, nominal.x, sane=False) if not self._history.numbers else nominal.x
        if self._state is None:
            return [begin]
        believed = dict(zip(self.errors.names, self.state.x.tolist(), strict=True))
        own = [parameter.name in believed and parameter.kind not in INSTRUMENTS for parameter in nominal.errors.parameters]
        named = [believed.get(name, 0.0) for name in nominal.errors.names]
        return [np.where(own, named, begin), begin]

    def _batch(self, model: Problem, starts: list[Vector], noise: Noise) -> Estimate:
        """The estimate from the first of some starts from which there is one."""
        errors = model.errors
        prior = Belief.independent(errors.mean, errors.sigma)
        held = noise.all_stated or self._freedom(model.data.numbers, self._state) < _FREEDOM
        for start in starts:
            found = iterated_schedule(model.linearise, prior, noise.hold() if held else noise, start=start, tolerance=_REST)
            if found.converged:
                break
        return found

    def _freedom(self, numbers: int, state: OnlineState | None) -> float:
        """Measurements less the parameters that they decide; several readings of one pose are one."""
        if state is None:
            return 0.0
        decided = len(self.errors.names) - float(np.sum(np.diag(state.belief.P) / self.errors.sigma**2))
        return numbers - decided

    def _mark(self, x: Vector, poses: int = 0) -> None:
        """Remember where the history was linearised, and take the Jacobians of what is predicted there."""
        seen = self._seeing
        self._linearised_at, self._linearised_poses = x, poses
        tool = tool_jacobian(seen.robot, seen.errors, x, seen.tool, seen.workspace)
        spots = spot_jacobians(seen.errors, x, seen.views) if len(seen.views) else np.empty((0, 0, 2, len(x)))
        self._forecast, self._ready = Forecast.of(tool, spots[np.isfinite(spots).all(axis=(1, 2, 3))]), {}
        self._prior_variance = seen.errors.sigma**2

    def _state_of(self, belief: Belief, noise: Noise, nis: float = 0.0, gate: float = 0.0, relinearised: bool = False) -> OnlineState:
        state = OnlineState(
            poses=len(self._history),
            belief=belief,
            noise=noise,
            nis=nis,
            gate=gate,
            skipped="",
            relinearised=relinearised,
            extra_noise=dict(self._extra),
            misfit=self._misfit,
            waiting=self._state.waiting if self._state is not None and self._waiting else "",
            enough=False,
            forecast=self._forecast,
        )
        return replace(state, enough=True) if self._is_enough(state) else state

    def _is_enough(self, state: OnlineState) -> bool:
        """Whether the target is met, and the noise that says so is known and no smaller than it is seen to be."""
        if self.target_mm is None or not len(self._history) or state.tool_sigma_mm >= self.target_mm:
            return False
        known = state.noise.all_stated or self._freedom(self._history.numbers, state) >= _FREEDOM
        return known and (self._misfit is None or self._misfit.sigmas < _DISHONEST)


def _worst(model: Problem, found: Estimate) -> Misfit:
    """Of the kind of reading that scatters most beyond its noise."""
    every = misfits(model.linearise(found.belief.x), found.noise, found.belief.P)
    return max(every, key=lambda own: own.sigmas)


def _as_rows(cells: dict[str, Any]) -> dict[str, Any]:
    """Columns by name; those of one row where any cell of it is no column."""
    one = any(np.ndim(values) == 0 for values in cells.values())
    return {name: np.asarray(values)[None] for name, values in cells.items()} if one else cells


def _known_noise(spot_sigma: float | None, sigmas: Mapping[str, float]) -> dict[str, float]:
    """Noise that is stated, by kind.

    Raises:
        UsageError: there is no such kind, or it is not above zero.
    """
    if spot_sigma is not None and not spot_sigma > 0:
        raise UsageError(f"the spot noise must be above zero, found {spot_sigma:g} m")
    for kind, sigma in sigmas.items():
        if kind not in WORDS:
            raise UsageError(f"sigmas: {no_such('kind', kind, WORDS)}")
        if not 0 < sigma < np.inf:
            raise UsageError(f"the {kind} noise must be above zero and finite, found {sigma:g}")
    return {**sigmas, **({} if spot_sigma is None else {"spot": spot_sigma})}


def _require_stated(pose: Measurements, known: Mapping[str, float]) -> None:
    """Refuse a reading whose noise a gate would have to guess."""
    for kind in pose.kinds:
        if kind not in known and not states_all(pose, kind):
            raise UsageError(
                f"a gate needs to know the noise; state that of {noun(kind)} in sigmas, as {{'{kind}': {start_sigma_of(kind):g}}}"
            )


def _check(target_mm: float | None, gate: bool, known: Mapping[str, float]) -> None:
    if target_mm is not None and not target_mm > 0:
        raise UsageError(f"the target must be above zero, found {target_mm:g} mm")
    if gate and not known:
        raise UsageError("a gate needs to know the noise; state spot_sigma, or sigmas of other readings")
