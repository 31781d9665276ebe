"""The public names: a robot and its measurements go in, a frozen `Calibration` comes out."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import numpy as np

from urdfcal.base.errors import FitRejected, InputError, UrdfcalError, UsageError
from urdfcal.base.files import write_whole
from urdfcal.base.version import __version__
from urdfcal.calibration import fitting
from urdfcal.calibration.analysis import online
from urdfcal.calibration.analysis.compensation import load_compensation
from urdfcal.calibration.analysis.sag import fit_sag
from urdfcal.calibration.analysis.validation import holdout, kfold
from urdfcal.calibration.analysis.verdict import Verdict, verdict_of
from urdfcal.calibration.fitting import with_test
from urdfcal.calibration.result import FitResult, corrected_camera
from urdfcal.calibration.start.nominal import evaluate, held_instruments
from urdfcal.model.gravity import Gravity
from urdfcal.model.options import ModelOptions
from urdfcal.model.parameters import PriorScale
from urdfcal.output import stored
from urdfcal.output.calibration_yaml import calibration_yaml
from urdfcal.output.formats import Deployed
from urdfcal.output.pairs import mixed
from urdfcal.output.stored import StoredCalibration
from urdfcal.output.text.result import text_report
from urdfcal.robot import robot as described
from urdfcal.robot.corrections import Applicable
from urdfcal.robot.robot import Robot, with_text
from urdfcal.robot.urdf_writer import with_origins
from urdfcal.robot.xacro_child import XacroLimit
from urdfcal.sensors.measurements import Measurements, measurements_from
from urdfcal.sensors.measurements_csv import read_measurements, write_measurements

if TYPE_CHECKING:
    from urdfcal.output.view.viewer import View
    from urdfcal.sensors.camera import Camera


__all__ = [
    "Calibration",
    "FitRejected",
    "Gravity",
    "InputError",
    "Measurements",
    "ModelOptions",
    "OnlineCalibrator",
    "PriorScale",
    "Robot",
    "StoredCalibration",
    "UrdfcalError",
    "UsageError",
    "Verdict",
    "XacroLimit",
    "__version__",
    "apply",
    "evaluate",
    "fit",
    "fit_sag",
    "holdout",
    "kfold",
    "load_calibration",
    "load_compensation",
    "load_robot",
    "measurements_from",
    "read_measurements",
    "write_measurements",
]

P = ParamSpec("P")
T = TypeVar("T")


def _telling(read: Callable[P, T]) -> Callable[P, T]:
    """The same call, with a warning where the file and those beside it are a mixed pair; the file is its first argument, `path`."""

    @wraps(read)
    def told(*arguments: P.args, **options: P.kwargs) -> T:
        found = read(*arguments, **options)
        for line in mixed(Path(str(arguments[0] if arguments else options["path"]))):
            warnings.warn(line, stacklevel=2)
        return found

    return told


load_robot = _telling(described.load_robot)
load_calibration = _telling(stored.read_calibration)


@wraps(stored.apply)
def apply(model: Any, calibration: FitResult | StoredCalibration | str | Path, *geometry_models: Any) -> Any:
    """As `urdfcal.output.stored.apply`, with the same warning."""
    found = load_calibration(calibration) if isinstance(calibration, str | Path) else calibration
    return stored.apply(model, found, *geometry_models)


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

    def require_trustworthy(self) -> None:
        """Raise if the calibration must not be used.

        Raises:
            FitRejected: says why.
        """
        self.verdict.require_usable()

    def report(self, test: Measurements | None = None) -> str:
        """The result as text; with the spot errors of further poses, if given."""
        return text_report(self if test is None else with_test(self, test))

    def urdf(self) -> bytes:
        """The robot's text with corrected origins."""
        return with_origins(self.robot.description, {name: correction.corrected for name, correction in self.corrections.items()})

    def deployed(self, rng: np.random.Generator | None = None) -> Deployed:
        """The calibration in the forms that people deploy: `.content("origins-yaml")` and so on.

        Args:
            rng: For the configurations over which joint offsets alone are judged; seeded by default.
        """
        origins = {name: correction.corrected for name, correction in self.corrections.items()}
        return Deployed(self.robot, origins, rng or np.random.default_rng(0))

    def write_urdf(self, path: str | Path) -> None:
        """Write the calibrated URDF, whole or not at all."""
        write_whole(path, self.urdf())

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

    def write(self, path: str | Path, command: Sequence[str] = ()) -> None:
        """Write the calibration as YAML: origins, parameters, combinations, provenance."""
        write_whole(path, self.record(command))

    def record(self, command: Sequence[str] = (), files: Mapping[str, str] | None = None) -> bytes:
        """The calibration as YAML; with the hashes of the files that are written with it, by their ways from its folder."""
        return calibration_yaml(self, command or sys.argv, files)


def _calibrating(numeric: Callable[P, FitResult]) -> Callable[P, Calibration]:
    """The same call, whose result can be written, shown and applied."""

    @wraps(numeric)
    def calibrated(*arguments: P.args, **options: P.kwargs) -> Calibration:
        return Calibration.of(numeric(*arguments, **options))

    return calibrated


fit = _calibrating(fitting.fit)


class OnlineCalibrator(online.OnlineCalibrator):
    """Calibration while measuring: see `calibration.analysis.online`."""

    def calibration(self, gated: bool = False, evidence: bool = False) -> Calibration:
        """What is known so far, as `fit` gives it."""
        return Calibration.of(super().calibration(gated, evidence))
