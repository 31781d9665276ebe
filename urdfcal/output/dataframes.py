"""Results as DataFrames, for whoever has pandas. SI units, in columns of their own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from urdfcal.base.errors import UsageError
from urdfcal.calibration.result import FitResult
from urdfcal.model.parameters import Parameter
from urdfcal.output.report.residuals import Residuals, residuals_of

if TYPE_CHECKING:
    from urdfcal.calibration.analysis.check import Check

_IN_SI = {"mm": "m", "deg": "rad"}


def parameters_frame(calibration: FitResult) -> Any:
    """One row a parameter, by name: `kind`, `unit`, `value`, `sigma`, `prior_sigma`, `left` of the stated prior, and `determined`.

    Raises:
        UsageError: pandas is not installed.
    """
    seen = calibration.identifiability
    columns = {"value": calibration.x, "sigma": calibration.sigma, **_of_priors(calibration.errors.parameters)}
    return _frame("parameters", calibration.errors.parameters, columns | {"left": list(seen.left), "determined": list(seen.determined)})


def expected_frame(check: Check) -> Any:
    """One row a parameter, by name: `kind`, `unit`, the `sigma` that a fit would claim, `prior_sigma` and `determined`.

    Raises:
        UsageError: pandas is not installed.
    """
    columns = {"sigma": check.sigma, **_of_priors(check.errors.parameters), "determined": list(check.predicted.determined)}
    return _frame("parameters", check.errors.parameters, columns)


def residuals_frame(calibration: FitResult) -> Any:
    """One row a number that was read, of the fitted poses and then of the test poses.

    `set`, `pose`, `reading` (laser or target), `sensor`, `number` (which of its numbers), `before` and `after` (measured less predicted by
    the nominal and by the calibrated robot), `sigma` (of its noise), `unit`, and `sigmas` (length of the whole reading's residual in its
    own standard deviations).

    Raises:
        UsageError: pandas is not installed.
    """
    pandas = _pandas("residuals()")
    parts = [_of_reading(own) for own in residuals_of(calibration)]
    return pandas.concat([pandas.DataFrame(part) for part in parts], ignore_index=True) if parts else pandas.DataFrame()


def _of_priors(parameters: Sequence[Parameter]) -> dict[str, Any]:
    return {"prior_sigma": [parameter.sigma for parameter in parameters]}


def _frame(what: str, parameters: Sequence[Parameter], columns: dict[str, Any]) -> Any:
    pandas = _pandas(what)
    told = {"kind": [parameter.kind for parameter in parameters], "unit": [parameter.unit for parameter in parameters]}
    return pandas.DataFrame(told | columns, index=pandas.Index([parameter.name for parameter in parameters], name="parameter"))


def _of_reading(own: Residuals) -> dict[str, Any]:
    n, k = own.after.shape
    size, numbers = own.sensor.words.size, list(own.sensor.components) or [str(number) for number in range(k)]
    return {
        "set": own.label,
        "pose": np.repeat(own.poses, k),
        "reading": own.name,
        "sensor": own.sensor.name,
        "number": numbers[:k] * n,
        "before": own.before.ravel() * size,
        "after": own.after.ravel() * size,
        "sigma": own.sigma.ravel() * size,
        "unit": _IN_SI.get(own.unit, own.unit),
        "sigmas": np.repeat(own.lengths, k),
    }


def _pandas(what: str) -> Any:
    """The library.

    Raises:
        UsageError: it is not installed.
    """
    try:
        import pandas
    except ImportError:
        raise UsageError(f"{what} is a DataFrame, and pandas is not installed: pip install 'urdfcal[pandas]'") from None
    return pandas
