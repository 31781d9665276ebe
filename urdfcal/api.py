"""The public names: a robot and its measurements go in, a frozen `Calibration` comes out."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, wraps
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import numpy as np

from urdfcal.base.errors import FitRejected, InputError, UrdfcalError, UsageError
from urdfcal.base.files import is_yaml, write_whole
from urdfcal.base.foreign_text import shown
from urdfcal.base.terminal import as_text
from urdfcal.base.version import __version__
from urdfcal.calibration import fitting
from urdfcal.calibration.analysis import check as analysis_check
from urdfcal.calibration.analysis import comparison, online
from urdfcal.calibration.analysis.compensation import load_compensation
from urdfcal.calibration.analysis.prediction import default_tool
from urdfcal.calibration.analysis.sag import fit_sag
from urdfcal.calibration.analysis.validation import holdout, kfold
from urdfcal.calibration.analysis.verdict import Verdict, verdict_of
from urdfcal.calibration.result import FitResult, corrected_camera, refined_cameras
from urdfcal.calibration.start.nominal import evaluate, held_instruments
from urdfcal.calibration.tested import with_test
from urdfcal.model.gravity import Gravity
from urdfcal.model.options import ModelOptions
from urdfcal.model.parameters import PriorScale
from urdfcal.output.accounts import Said, accounts_of
from urdfcal.output.calibration_yaml import calibration_yaml
from urdfcal.output.formats import Deployed
from urdfcal.output.pairs import warn_if_mixed
from urdfcal.output.stored import StoredCalibration, read_calibration
from urdfcal.output.stored import apply as put_on
from urdfcal.output.text.check import check_blocks
from urdfcal.output.text.comparison import comparison_blocks, in_short
from urdfcal.output.text.result import text_report
from urdfcal.robot.corrections import Applicable
from urdfcal.robot.placed_frames import NO_FRAMES, FramesWish, frame_origins
from urdfcal.robot.robot import Robot, with_text
from urdfcal.robot.robot import load_robot as read_robot
from urdfcal.robot.xacro_child import XacroLimit
from urdfcal.sensors.columns import Stations
from urdfcal.sensors.in_memory import measurements_from
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.measurements_csv import read_measurements, write_measurements

if TYPE_CHECKING:
    import numpy.typing as npt
    import pandas
    from matplotlib.figure import Figure

    from urdfcal.deploy.false_targets import FalseTargets
    from urdfcal.output.view.viewer import View
    from urdfcal.planning.plan import PosePlan, plan_poses
    from urdfcal.planning.plan import plan_poses as plan
    from urdfcal.sensors.camera import Camera
    from urdfcal.simulation.simulated import Simulation, simulate


__all__ = [
    "Calibration",
    "Comparison",
    "FitRejected",
    "Gravity",
    "InputError",
    "Measurements",
    "ModelOptions",
    "OnlineCalibrator",
    "PosePlan",
    "Prediction",
    "PriorScale",
    "Robot",
    "Simulation",
    "Stations",
    "StoredCalibration",
    "UrdfcalError",
    "UsageError",
    "Verdict",
    "XacroLimit",
    "__version__",
    "apply",
    "check",
    "compare",
    "evaluate",
    "fit",
    "fit_sag",
    "holdout",
    "kfold",
    "load_calibration",
    "load_compensation",
    "load_robot",
    "measurements_from",
    "plan",
    "plan_poses",
    "read_measurements",
    "simulate",
    "write_measurements",
]

P = ParamSpec("P")
F = TypeVar("F")
T = TypeVar("T")

_LATER = {
    "PosePlan": ("urdfcal.planning.plan", "PosePlan"),
    "plan_poses": ("urdfcal.planning.plan", "plan_poses"),
    "plan": ("urdfcal.planning.plan", "plan_poses"),
    "Simulation": ("urdfcal.simulation.simulated", "Simulation"),
    "simulate": ("urdfcal.simulation.simulated", "simulate"),
}


def __getattr__(name: str) -> Any:
    """What a fit does not need, loaded when it is first asked for."""
    if name not in _LATER:
        raise AttributeError(f"module 'urdfcal.api' has no attribute '{name}'")
    module, there = _LATER[name]
    return getattr(import_module(module), there)


@dataclass(frozen=True, repr=False)
class Calibration(FitResult, Applicable):
    """What a fit found, and what can be done with it."""

    @classmethod
    def of(cls, found: FitResult) -> Calibration:
        """The same, with what can be done with it."""
        return cls(**{each.name: getattr(found, each.name) for each in fields(found)})

    @cached_property
    def verdict(self) -> Verdict:
        """May it be used? `.use` is `yes`, `reservations` or `no`, with its `.reasons`; what terminal, reports and exit code say."""
        return verdict_of(self)

    def _repr_html_(self) -> str:
        from urdfcal.output.cards import calibration_card

        return calibration_card(self, self.verdict)

    def require_trustworthy(self) -> None:
        """Raise if the calibration must not be used.

        Raises:
            FitRejected: says why.
        """
        self.verdict.require_usable()

    def report(self, test: Measurements | None = None) -> str:
        """The result as text; with the spot errors of further poses, if given."""
        return text_report(self if test is None else with_test(self, test))

    @property
    def parameters(self) -> pandas.DataFrame:
        """What was estimated, one row a parameter: kind, unit, value, sigma, prior_sigma, left (of the prior) and determined; SI.

        Raises:
            UsageError: pandas is not installed; `x`, `sigma` and `errors.names` are there without it.
        """
        from urdfcal.output.dataframes import parameters_frame

        return parameters_frame(self)

    def residuals(self) -> pandas.DataFrame:
        """What is left of every number that was read, before and after: set, pose, reading, sensor, number, before, after, sigma, unit
        and sigmas (length of the reading's residual in its own standard deviations); SI.

        Raises:
            UsageError: pandas is not installed.
        """
        from urdfcal.output.dataframes import residuals_frame

        return residuals_frame(self)

    def plot_spots(self) -> Figure:
        """Where spots or targets were measured, and by arrows where the robot has them, before and after.

        Raises:
            UsageError: nothing was measured that has a place, as where only angles were.
        """
        from urdfcal.output.drawn import spots_figure

        return spots_figure(self)

    def plot_residuals(self) -> Figure:
        """How large residuals are beside what noise alone would show, and each number against the pose."""
        from urdfcal.output.drawn import residuals_figure

        return residuals_figure(self)

    def plot_convergence(self) -> Figure:
        """The estimates after each sweep, as in the paper's Fig. 4, and the RMS."""
        from urdfcal.output.drawn import convergence_figure

        return convergence_figure(self)

    def write_report(self, path: str | Path, command: Sequence[str] = ()) -> None:
        """Write the report, whole or not at all: `.html` is one self-contained page, `.md` the same without pictures, `.json` for machines.

        Raises:
            UsageError: the file has another ending, or cannot be written.
        """
        from urdfcal.output.report.files import write_report

        write_report(Path(path), self, command or sys.argv)

    def to_latex(self) -> str:
        """Tables for a paper: distances before and after, parameters with sigmas, and sums that are known alone; for booktabs."""
        from urdfcal.output.latex import calibration_latex

        return calibration_latex(self)

    def urdf(self, *, write_frames: bool = False, add_frames: bool = False, only: Mapping[str, str] | Sequence[str] = ()) -> bytes:
        """The robot's text with corrected origins.

        Args:
            write_frames: Whether links that were measured on are made to stand where their frames were found, as far as they can.
            add_frames: Whether `frames` that remain become links of their own.
            only: Names of the frames that are meant, by default all; a dictionary also says what added links are called.

        Raises:
            UsageError: there is no such frame, or its link cannot stand for it.
            RobotError: a link of the new one's name is there.
        """
        named = only if isinstance(only, Mapping) else dict.fromkeys(only, "")
        return self.deployed(None, FramesWish(write_frames, add_frames, named)).content("urdf")

    def deployed(self, rng: np.random.Generator | None = None, frames: FramesWish = NO_FRAMES) -> Deployed:
        """The calibration in the forms that people deploy: `.content("origins-yaml")` and so on.

        Args:
            rng: For the configurations over which joint offsets alone are judged; seeded by default.
            frames: What becomes of the frames that were found.
        """
        origins, chosen = {name: own.corrected for name, own in self.corrections.items()}, frames.chosen(self.frames, self.robot.tree)
        links = {name: own.corrected for name, own in frame_origins(chosen.written).items()}
        return Deployed(self.robot, origins, rng or np.random.default_rng(0), links, chosen.added)

    def false_targets(
        self, wanted: npt.ArrayLike, near: npt.ArrayLike | None = None, *, tool: str | None = None, base: str | None = None
    ) -> FalseTargets:
        """What to tell a controller that keeps its nominal geometry, so that the real tool comes where it was wanted.

        Args:
            wanted: Positions of the joints that move the tool, (n, k), [rad] or [m]: it is wanted where the nominal robot has it there. Or
                placements of the tool in the base, (n, 4, 4), [m].
            near: For placements: positions in whose configuration the controller reaches them, (k,) or (n, k).
            tool: The link that is meant; by default the module, or the first target's link.
            base: The link that placements are told in; by default the root.

        Returns:
            `.reached.q` are the positions to tell it, `.placements` the placements, `.reached.left_mm` and `.left_deg` what is left over.

        Raises:
            RobotError: no such link, or no joint moves the one in the other.
            ShapeMismatch: the numbers are neither positions nor placements.
            UsageError: placements without positions near them, or such that the nominal robot does not reach.
        """
        from urdfcal.deploy.false_targets import asked_for

        corrected = with_text(self.robot, self.urdf())
        found: FalseTargets = asked_for(
            self.robot, corrected, np.asarray(wanted, dtype=float), near, tool or default_tool(self.robot), base
        )
        return found

    def write_urdf(
        self, path: str | Path, *, write_frames: bool = False, add_frames: bool = False, only: Mapping[str, str] | Sequence[str] = ()
    ) -> None:
        """Write the calibrated URDF, whole or not at all.

        Args:
            path: The file.
            write_frames: As of `urdf`.
            add_frames: As of `urdf`.
            only: As of `urdf`.

        Raises:
            UsageError: the file cannot be written, or is the robot that was calibrated; or as for `urdf`.
            RobotError: as for `urdf`.
        """
        write_whole(self._apart(path), self.urdf(write_frames=write_frames, add_frames=add_frames, only=only))

    def _apart(self, path: str | Path) -> str | Path:
        """A file to write to, which must not be one that the robot was read from: the next fit would begin from what is lost."""
        read = self.robot.description
        if any(Path(path).resolve() == Path(source).resolve() for source in (read.path, *read.included)):
            raise UsageError(f"{path}: is the robot that was calibrated; name another file")
        return path

    def show(self, magnify: float | None = None) -> View:
        """Robot, beams and fitted spots before and after, to look at: at the end of a notebook's cell, or by `serve()` in a browser."""
        from urdfcal.output.view.viewer import view_of

        corrected = with_text(self.robot, self.urdf())
        data = replace(self.data, camera=self.corrected_camera()) if self.data.corrects_camera else self.data
        return view_of(self.robot, data, corrected, magnify, held_instruments(self.errors, self.data.instruments.places))

    def corrected_camera(self) -> Camera:
        """The camera that read laser spots as pixels, with the screen where the fit found it: the one for the calibrated robot.

        Raises:
            UsageError: no laser spots were read as pixels.
        """
        camera: Camera = corrected_camera(self.data, self.errors, self.estimate.belief)
        return camera

    def refined_cameras(self) -> dict[str, Camera]:
        """The cameras whose lenses were refined (`estimate=["lens"]`), by instrument, with what is known of them now; empty without."""
        return refined_cameras(self.data, self.errors, self.estimate.belief)

    def write(self, path: str | Path, command: Sequence[str] = ()) -> None:
        """Write the calibration as YAML: origins, parameters, combinations, provenance.

        Raises:
            UsageError: the file cannot be written, or is the robot that was calibrated.
        """
        write_whole(self._apart(path), self.record(command))

    def record(self, command: Sequence[str] = (), files: Mapping[str, str] | None = None) -> bytes:
        """The calibration as YAML; with the hashes of the files that are written with it, by their ways from its folder."""
        return calibration_yaml(self, command or sys.argv, files)


@dataclass(frozen=True, repr=False)
class Prediction(analysis_check.Check):
    """What a fit of some measurements would determine, and how well: see `check`."""

    @classmethod
    def of(cls, found: analysis_check.Check) -> Prediction:
        """The same, with what can be said of it."""
        return cls(**{each.name: getattr(found, each.name) for each in fields(found)})

    @property
    def parameters(self) -> pandas.DataFrame:
        """One row a parameter: kind, unit, the sigma that a fit would claim, prior_sigma and determined; SI.

        Raises:
            UsageError: pandas is not installed; `sigma` and `errors.names` are there without it.
        """
        from urdfcal.output.dataframes import expected_frame

        return expected_frame(self)

    def report(self) -> str:
        """All of it as text, as `urdfcal check` prints it."""
        return as_text(check_blocks(self))

    def _repr_html_(self) -> str:
        from urdfcal.output.cards import check_card

        return check_card(self)


def _giving(made: Callable[[F], T], numeric: Callable[P, F]) -> Callable[P, T]:
    """The same call, with what is made of its result: what can be reported, written, shown and applied."""

    @wraps(numeric)
    def given(*arguments: P.args, **options: P.kwargs) -> T:
        return made(numeric(*arguments, **options))

    return given


check = _giving(Prediction.of, analysis_check.check)
fit = _giving(Calibration.of, fitting.fit)


def _checked(read: Callable[P, T]) -> Callable[P, T]:
    """The same call, which warns (MixedFilesWarning) where the file does not belong to what stands beside it."""

    @wraps(read)
    def checked(*arguments: P.args, **options: P.kwargs) -> T:
        found = read(*arguments, **options)
        path = arguments[0] if arguments else options.get("path")
        if isinstance(path, str | Path):
            warn_if_mixed(path)
        return found

    return checked


load_robot = _checked(read_robot)
load_calibration = _checked(read_calibration)


@wraps(put_on)
def apply(model: Any, calibration: FitResult | StoredCalibration | str | Path, *geometry_models: Any) -> Any:
    """As `urdfcal.output.stored.apply`, with a warning where a file does not belong to what stands beside it."""
    found = load_calibration(calibration) if isinstance(calibration, str | Path) else calibration
    return put_on(model, found, *geometry_models)


@dataclass(frozen=True, repr=False, eq=False)
class Comparison(comparison.Comparison):
    """How far two accounts of one robot are apart, and whether they are the same within what either knows: see `compare`."""

    @classmethod
    def of(cls, found: comparison.Comparison) -> Comparison:
        """The same, with what can be said of it."""
        return cls(**{each.name: getattr(found, each.name) for each in fields(found)})

    def report(self) -> str:
        """All of it as text, as `urdfcal compare` prints it."""
        return as_text([*self.notes, *comparison_blocks(self)])

    def __repr__(self) -> str:
        """In a line."""
        return f"<{type(self).__name__} at {shown(self.tool)}: {in_short(self)}>"

    def _repr_html_(self) -> str:
        from urdfcal.output.cards import comparison_card

        return comparison_card(self)


def compare(
    one: Said | str | Path, other: Said | str | Path, *, robot: Robot | None = None, tool: str | None = None, seed: int = 0
) -> Comparison:
    """How far two accounts of one robot are apart, joint by joint and at the tool.

    Args:
        one: A fit, a stored calibration, a robot, or a path of the last two.
        other: The like.
        robot: What stored calibrations are put on; by default the other's robot, or the description that the first one names.
        tool: The link at which they are compared; by default behind as many of the joints that differ as can be.
        seed: Of the random configurations.

    Returns:
        `.joints`, `.at_tool`, `.same` (None where neither says how sure it is), `.report()`; lengths [m], angles [rad].

    Raises:
        CalibrationFileError: a file is no calibration, or another robot's.
        RobotError: a file is no description, the two are not of one robot, or there is no such link.
        UsageError: something else was given, or the robot that was calibrated is not found.
    """
    ours, theirs, words = accounts_of(_said(one), _said(other), robot, read_robot)
    found = comparison.compare(ours, theirs, tool or comparison.default_tool(ours, theirs), np.random.default_rng(seed))
    return replace(Comparison.of(found), notes=words)


def _said(of: Said | str | Path) -> Said:
    if not isinstance(of, str | Path):
        return of
    return load_calibration(of) if is_yaml(Path(of)) else load_robot(of)


class OnlineCalibrator(online.OnlineCalibrator):
    """Calibration while measuring: see `calibration.analysis.online`."""

    def calibration(self, gated: bool = False, evidence: bool = False) -> Calibration:
        """What is known so far, as `fit` gives it."""
        return Calibration.of(super().calibration(gated, evidence))
