"""Calibration while measuring: one pose at a time, with the accuracy to be expected after each.

Between two poses the state stands still, so a new pose is one Kalman update (14)-(15) of the belief, linearised at the present mean.
What such an update leaves behind is the linearisation of the older poses, which was taken at means that have moved since. All poses
are kept, therefore, and when the mean has moved by a sigma of its own, or the history has grown by half, the whole history
is linearised afresh: the belief then is the maximum a posteriori estimate that `fit` gives of the same poses. As sigmas shrink this
comes ever more seldom, and in between the belief differs from the batch answer by a small part of a sigma.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from urdfcal.base.errors import FitRejected, ShapeMismatch, UsageError
from urdfcal.base.geometry import MM, Matrix, Vector
from urdfcal.calibration.analysis.prediction import default_tool, spot_jacobians, tool_jacobian
from urdfcal.calibration.extra_noise import MORE, extra_noise, widened
from urdfcal.calibration.fitting import fit
from urdfcal.calibration.problem import Problem, problem_of
from urdfcal.calibration.reach import draw_poses
from urdfcal.calibration.result import FitResult
from urdfcal.estimation.chi_squared import chi_squared_gate
from urdfcal.estimation.ekf import Belief, Estimate, iterated_schedule, update
from urdfcal.estimation.noise import Misfit, Noise, misfits
from urdfcal.estimation.residual import Linearisation
from urdfcal.model.gauge import build_error_model
from urdfcal.model.jacobian import CHUNK
from urdfcal.model.options import ModelOptions
from urdfcal.robot.configurations import joint_limits, require_room
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements, spots_measured
from urdfcal.sensors.registry import start_sigma_of
from urdfcal.sensors.repeats import read_again
from urdfcal.sensors.stated_noise import joint_sigmas, stating_kinds

WORKSPACE = 50  # configurations over which accuracy is predicted
_STALE = 1.0  # [sigmas] by which the mean may move before the history is linearised afresh
_REST = 1e-3  # [sigmas] the last step of doing so
_GROWTH = 1.5  # and by how much the history may grow
_DISHONEST = 4.0  # sigmas of chi-squared beyond which the noise is not what it is taken for
_MOST_SKIPPED = 3  # poses in a row that a gate may leave out: then it is the belief that is wrong
_FREEDOM = 10.0  # degrees of freedom from which on the spot noise is estimated


@dataclass(frozen=True)
class OnlineState:
    """What is known after a pose.

    Attributes:
        poses: How many poses the belief holds.
        belief: Mean and covariance of the parameters, [m] and [rad].
        noise: Of spots and joints, as assumed in the belief.
        nis: Normalised innovation squared of the last pose: chi-squared if pose and model are sound.
        gate: Its 99.9 % quantile; 0 where the pose showed no spot.
        skipped: Why the last pose was left out; empty if it was not.
        relinearised: Whether the whole history was linearised afresh at this pose.
        spot_sigma_mm: Predicted error of a spot, without the noise of seeing it: RMS over configurations with every beam on the screen,
            [mm]; nan where such configurations are too rare.
        tool_sigma_mm: Predicted position error of the tool relative to the base link (see `prediction`): RMS over the workspace, [mm].
        tool_sigma_max_mm: The same at the worst configuration of the workspace, [mm].
        tool_sigma_mrad: Predicted rotation error of the tool, RMS over the workspace, [mrad].
        extra_noise_mm: What spots scatter beyond the noise that was stated with them, [mm].
        misfit: Chi-squared of the history where it was linearised last; None before.
        enough: Whether tool_sigma_mm is under the target, and the noise it rests on is known and no smaller than it is seen to be.
    """

    poses: int
    belief: Belief
    noise: Noise
    nis: float
    gate: float
    skipped: str
    relinearised: bool
    spot_sigma_mm: float
    tool_sigma_mm: float
    tool_sigma_max_mm: float
    tool_sigma_mrad: float
    extra_noise_mm: float
    misfit: Misfit | None
    enough: bool

    @property
    def x(self) -> Vector:
        """Estimated parameters, (p,), [m] and [rad]."""
        return self.belief.x

    @property
    def sigma(self) -> Vector:
        """Their standard deviations, (p,), [m] and [rad]."""
        return np.sqrt(np.diag(self.belief.P))

    @property
    def within_gate(self) -> bool:
        """Whether the last pose is one that could be expected."""
        return self.nis <= self.gate


class OnlineCalibrator:
    """Takes poses one by one; knows the belief and the accuracy to be expected after each.

    Attributes:
        robot: The nominal robot.
        errors: The error model.
        tool: The link whose accuracy is predicted.
        target_mm: What tool_sigma_mm is to fall under, [mm].
        state: What is known now.
    """

    def __init__(
        self,
        robot: Robot,
        options: ModelOptions | None = None,
        *,
        spot_sigma: float | None = None,
        joint_sigma: float | Vector = 0.0,
        tool: str | None = None,
        target_mm: float | None = None,
        gate: bool = False,
        workspace: Matrix | None = None,
        rng: np.random.Generator | None = None,
    ) -> None:
        """Start from the priors.

        Args:
            robot: Nominal robot; left unchanged.
            options: What is to be calibrated, as for `fit`.
            spot_sigma: Noise of a spot coordinate, [m]; if None it is estimated from the residual as soon as there is enough of it.
            joint_sigma: Noise of a joint reading as for `fit`, [rad], one number or one a joint.
            tool: Link whose pose relative to the base is to be accurate; the module by default.
            target_mm: Predicted position error of the tool that is good enough, [mm].
            gate: Leave out poses beyond the gate, but not one after the other without end: then the belief is wrong, and not they.
            workspace: Configurations over which the tool must be accurate, (n, inputs), [rad] or [m]; by default random within limits.
            rng: Source of randomness for the configurations.

        Raises:
            UsageError: an option means nothing here, or the limits leave no workspace and none is given.
            RobotError: the tool is not a link that the calibrated joints move.
        """
        _check(spot_sigma, target_mm, gate)
        self.robot, self.target_mm, self.options = robot, target_mm, options or ModelOptions()
        self.tool = default_tool(robot) if tool is None else tool
        self.errors = build_error_model(robot.chain, robot.rig, self.options)
        self._gated, self._stated, self._joint_sigma = gate, spot_sigma, joint_sigma
        rng = rng or np.random.default_rng(0)
        self._workspace = _anywhere(robot, rng) if workspace is None else workspace
        self._views = self._poses_on_screen(rng)
        self._prior = Belief.independent(self.errors.mean, self.errors.sigma)
        self._history = _History(robot)
        self._extra: dict[str, float] = {}
        self._skipped = 0
        self._misfit: Misfit | None = None
        noise = Noise(spot_sigma or start_sigma_of("spot"), joint_sigmas(robot, joint_sigma), stated=spot_sigma is not None)
        self._mark(self._prior.x)
        self.state = self._state(self._prior, noise)

    def update(self, q: npt.ArrayLike, spots: npt.ArrayLike, sigma: npt.ArrayLike | None = None) -> OnlineState:
        """Take one pose.

        Args:
            q: Joint positions in the order of `robot.chain.input_names`, (inputs,), [rad] or [m].
            spots: (y, z) on the screen, (lasers, 2), [m]; nan where a beam was not seen.
            sigma: Standard deviation of each spot, (lasers,), [m]; nan where nothing is stated.

        Raises:
            ShapeMismatch: the arrays do not fit the robot.
            FitRejected: a beam was seen that in the present model does not meet the screen; the pose was not taken.
        """
        pose = _one_pose(self.robot, q, spots, sigma, self._history.taken + 1)
        linearisation = problem_of(self.errors, widened(pose, self._extra), self.state.noise).linearise(self.state.x)
        self._history.taken += 1
        if not linearisation.usable:
            return self._refuse(pose)
        belief, nis = _updated(self.state.belief, linearisation, self.state.noise)
        gate = chi_squared_gate(linearisation.count)
        if self._gated and nis > gate and self._skipped < _MOST_SKIPPED:
            return self._skip(
                f"pose {pose.poses[0]}: its spots are {np.sqrt(nis / gate):.1f} times as far off as the belief allows", nis, gate
            )
        again = self._history.holds(pose)  # shares what that pose has in common, which an update would take for something new
        self._history.add(pose, again)
        self._skipped = 0
        fresh = self._settled(belief, self.state.noise) if linearisation.count and (again or self._stale(belief)) else None
        self.state = self._state(*(fresh or (belief, self.state.noise)), nis=nis, gate=gate, relinearised=fresh is not None)
        return self.state

    def measurements(self) -> Measurements:
        """The poses that the belief holds."""
        return self._history.measurements()

    def calibration(self, gated: bool = False, evidence: bool = False) -> FitResult:
        """The batch fit of the poses so far: report, corrected URDF and all.

        Args:
            gated: Look for outliers as `fit` does.
            evidence: Choose the joints' priors by the data as `fit` does; without both the answer is what the belief approximates.

        Raises:
            UsageError: no spot has been seen yet.
        """
        if not self._history.seen:
            raise UsageError("no pose with a spot has been taken yet; there is nothing to fit")
        how: dict[str, Any] = {"spot_sigma": self._stated, "joint_sigma": self._joint_sigma, "gated": gated, "evidence": evidence}
        return fit(self.robot, self.measurements(), options=self.options, **how)

    def _refuse(self, pose: Measurements) -> OnlineState:
        """A pose that the model cannot produce."""
        why = f"pose {pose.poses[0]}: a beam was seen that in the present model does not meet the screen; check the joints' units and signs"
        if not self._gated:
            raise FitRejected(why)
        return self._skip(why, np.inf, chi_squared_gate(2 * int(pose.seen.sum())))

    def _skip(self, why: str, nis: float, gate: float) -> OnlineState:
        """The belief as it was, and why."""
        self._skipped += 1
        self.state = replace(self.state, nis=nis, gate=gate, skipped=why, relinearised=False)
        return self.state

    def _stale(self, belief: Belief) -> bool:
        """Whether the history is to be linearised afresh."""
        moved = np.max(np.abs(belief.x - self._linearised_at) / np.sqrt(np.diag(belief.P)))
        return bool(moved > _STALE or len(self._history) >= _GROWTH * self._linearised_poses)

    def _settled(self, belief: Belief, noise: Noise) -> tuple[Belief, Noise] | None:
        """The maximum a posteriori belief of the whole history, and the noise that it finds; None if it cannot be had."""
        data = self.measurements()
        extra, model = self._extra, problem_of(self.errors, widened(data, self._extra), noise)
        found = self._batch(model, belief, noise)
        if found.converged and stating_kinds(data) and (extra or _misfit_of(model, found).sigmas > MORE):
            extra = extra_noise(model, found.belief.x, found.noise, data, ["spot"])
            model = problem_of(self.errors, widened(data, extra), noise)
            found = self._batch(model, found.belief, noise)
        if not found.converged:
            return None
        self._extra, self._misfit = extra, _misfit_of(model, found)
        self._mark(found.belief.x)
        return found.belief, found.noise.released(noise)

    def _batch(self, model: Problem, belief: Belief, noise: Noise) -> Estimate:
        held = noise.all_stated or self._freedom(belief) < _FREEDOM
        return iterated_schedule(model.linearise, self._prior, noise.hold() if held else noise, start=belief.x, tolerance=_REST)

    def _freedom(self, belief: Belief) -> float:
        """Measurements less the parameters that they decide; several readings of one pose are one."""
        decided = len(self.errors.names) - float(np.sum(np.diag(belief.P) / self.errors.sigma**2))
        return 2 * self._history.seen - decided

    def _mark(self, x: Vector) -> None:
        """Remember where the history was linearised, and take the Jacobians of what is predicted there."""
        self._linearised_at, self._linearised_poses = x, len(self._history)
        tool = tool_jacobian(self.robot, self.errors, x, self.tool, self._workspace)
        spots = spot_jacobians(self.errors, x, self._views)
        spots = spots[np.isfinite(spots).all(axis=(1, 2, 3))]
        self._sizes = len(tool), spots.shape[0] * spots.shape[1]
        self._rows = np.vstack([part.reshape(-1, len(x)) for part in (tool[:, :3], tool[:, 3:], spots)])

    def _state(self, belief: Belief, noise: Noise, nis: float = 0.0, gate: float = 0.0, relinearised: bool = False) -> OnlineState:
        variance = np.sum((self._rows @ belief.P) * self._rows, axis=1)
        n, beams = self._sizes
        position, rotation, spot = variance[: 3 * n], variance[3 * n : 6 * n], variance[6 * n :]
        tool = float(np.sqrt(position.sum() / n)) / MM
        known = noise.all_stated or self._freedom(belief) >= _FREEDOM
        honest = self._misfit is None or self._misfit.sigmas < _DISHONEST
        return OnlineState(
            poses=len(self._history),
            belief=belief,
            noise=noise,
            nis=nis,
            gate=gate,
            skipped="",
            relinearised=relinearised,
            spot_sigma_mm=float(np.sqrt(spot.sum() / beams)) / MM if beams else np.nan,
            tool_sigma_mm=tool,
            tool_sigma_max_mm=float(np.sqrt(position.reshape(n, 3).sum(axis=1).max())) / MM,
            tool_sigma_mrad=float(np.sqrt(rotation.sum() / n)) * 1e3,
            extra_noise_mm=self._extra.get("spot", 0.0) / MM,
            misfit=self._misfit,
            enough=self.target_mm is not None and known and honest and tool < self.target_mm,
        )

    def _poses_on_screen(self, rng: np.random.Generator) -> Matrix:
        try:
            return draw_poses(self.robot, self.errors, self.errors.mean, WORKSPACE, rng)
        except UsageError:  # too rare to be found at random: the error of the spots stays unknown, that of the tool does not
            return np.empty((0, len(self.robot.chain.inputs)))


def _anywhere(robot: Robot, rng: np.random.Generator) -> Matrix:
    """Random configurations within the joints' limits, (WORKSPACE, inputs)."""
    require_room(robot)
    lower, upper = joint_limits(robot)
    return rng.uniform(lower, upper, (WORKSPACE, len(lower)))


class _History:
    """All poses in arrays that grow by doubling."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.taken, self.count, self.seen = robot, 0, 0, 0
        lasers = len(robot.rig.lasers)
        self.q, self.spots = np.empty((CHUNK, len(robot.chain.inputs))), np.empty((CHUNK, lasers, 2))
        self.sigma, self.labels = np.empty((CHUNK, lasers)), np.empty(CHUNK, dtype="U20")

    def __len__(self) -> int:
        return self.count

    def holds(self, pose: Measurements) -> bool:
        """Whether this is a further reading of a pose that is held."""
        return read_again(self.q[: self.count], pose.q[0])

    def add(self, pose: Measurements, again: bool) -> None:
        if self.count == len(self.q):
            for name in ("q", "spots", "sigma", "labels"):
                old = getattr(self, name)
                setattr(self, name, np.concatenate([old, np.empty_like(old)]))
        self.q[self.count], self.spots[self.count], self.sigma[self.count] = pose.q[0], pose.spots[0], pose.sigma[0]
        self.labels[self.count] = pose.poses[0]
        self.count, self.seen = self.count + 1, self.seen + (0 if again else int(pose.seen.sum()))

    def measurements(self) -> Measurements:
        n = self.count
        labels = self.labels[:n].tolist()
        return spots_measured(self.robot, self.q[:n].copy(), self.spots[:n].copy(), sigma=self.sigma[:n].copy(), poses=labels)


def _misfit_of(model: Problem, found: Estimate) -> Misfit:
    return misfits(model.linearise(found.belief.x), found.noise, found.belief.P)[0]


def _updated(belief: Belief, linearisation: Linearisation, noise: Noise) -> tuple[Belief, float]:
    """The belief after one pose, and its normalised innovation squared."""
    if not linearisation.count:
        return belief, 0.0
    weights = noise.weights(linearisation)
    rows = linearisation.measured.ravel()
    innovation, H = weights.residual(linearisation)[rows], weights.jacobian(linearisation)[rows]
    return update(belief, innovation, H, np.eye(len(innovation)))


def _one_pose(robot: Robot, q: npt.ArrayLike, spots: npt.ArrayLike, sigma: npt.ArrayLike | None, number: int) -> Measurements:
    places = np.asarray(spots, dtype=float)
    stated = None if sigma is None else np.asarray(sigma, dtype=float)[None]
    expected = (len(robot.rig.lasers), 2)
    if places.shape != expected:
        raise ShapeMismatch(f"the spots of one pose have shape (lasers, 2) = {expected}, found {places.shape}")
    return spots_measured(robot, np.asarray(q, dtype=float)[None], places[None], sigma=stated, poses=[str(number)])


def _check(spot_sigma: float | None, target_mm: float | None, gate: bool) -> None:
    if spot_sigma is not None and not spot_sigma > 0:
        raise UsageError(f"the spot noise must be above zero, found {spot_sigma:g} m")
    if target_mm is not None and not target_mm > 0:
        raise UsageError(f"the target must be above zero, found {target_mm:g} mm")
    if gate and spot_sigma is None:
        raise UsageError("a gate needs to know the noise; state spot_sigma")
