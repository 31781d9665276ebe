"""urdfcal: the real geometry of a robot arm, from measurements, back into its URDF.

robot = urdfcal.load_robot("arm7.urdf.xacro")
data = urdfcal.read_measurements("measurements.csv", robot)
calibration = urdfcal.fit(robot, data)
model = calibration.apply_to(robot.model)
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from urdfcal.calibration import Calibration, fit
    from urdfcal.compensation import load_compensation
    from urdfcal.error_model import PriorScale
    from urdfcal.errors import FitRejected, InputError, UrdfcalError, UsageError
    from urdfcal.evaluation import evaluate
    from urdfcal.gauge import ModelOptions
    from urdfcal.gravity import Gravity
    from urdfcal.measurement_file import read_measurements, write_measurements
    from urdfcal.measurements import Measurements, measurements_from
    from urdfcal.online import OnlineCalibrator
    from urdfcal.robot import Robot, load_robot
    from urdfcal.sag import fit_sag
    from urdfcal.stored_calibration import StoredCalibration, apply
    from urdfcal.stored_calibration import read_calibration as load_calibration
    from urdfcal.validation import holdout, kfold

_HOME = {
    "Calibration": "calibration",
    "evaluate": "evaluation",
    "fit": "calibration",
    "StoredCalibration": "stored_calibration",
    "apply": "stored_calibration",
    "load_calibration": "stored_calibration",
    "FitRejected": "errors",
    "InputError": "errors",
    "UrdfcalError": "errors",
    "UsageError": "errors",
    "PriorScale": "error_model",
    "holdout": "validation",
    "kfold": "validation",
    "ModelOptions": "gauge",
    "OnlineCalibrator": "online",
    "Gravity": "gravity",
    "fit_sag": "sag",
    "load_compensation": "compensation",
    "Measurements": "measurements",
    "measurements_from": "measurements",
    "read_measurements": "measurement_file",
    "write_measurements": "measurement_file",
    "Robot": "robot",
    "load_robot": "robot",
}
_OTHER_NAMES = {"load_calibration": "read_calibration"}

__all__ = [
    "__version__",
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


def __getattr__(name: str) -> Any:
    """Load a public name when it is first asked for: Pinocchio takes a while, and `urdfcal --help` does not need it."""
    if name not in _HOME:
        raise AttributeError(f"module 'urdfcal' has no attribute '{name}'")
    value = getattr(import_module(f"urdfcal.{_HOME[name]}"), _OTHER_NAMES.get(name, name))
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """What there is, loaded or not."""
    return sorted({*globals(), *__all__})
