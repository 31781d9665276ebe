"""Where a calibration comes from: command, versions, files, noise, error model, priors."""

from __future__ import annotations

import platform
import shlex
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pinocchio as pin

from urdfcal import __version__
from urdfcal.calibration_file import sha256
from urdfcal.error_model import FLAT
from urdfcal.fit_result import FitResult
from urdfcal.geometry import DEG
from urdfcal.instrument_report import noise_in_words, rig_in_words
from urdfcal.measurements import Measurements
from urdfcal.report import displayed
from urdfcal.reporting.document import Table
from urdfcal.reporting.verdict import count_of

_KINDS = {"reference": "measuring frame", "target": "targets", "place": "places"}


def provenance_table(calibration: FitResult, command: Sequence[str]) -> Table:
    """Command, versions, files with their hashes, noise, error model and priors."""
    robot = calibration.robot
    words = [Path(command[0]).name, *command[1:]] if command else []
    rows = [
        ("command", shlex.join(words) or "–"),
        ("created", datetime.now(UTC).isoformat(timespec="seconds")),
        ("versions", f"urdfcal {__version__}, Pinocchio {pin.__version__}, NumPy {np.__version__}, Python {platform.python_version()}"),
        ("robot", f"{robot.description.path}{', expanded by xacro' if robot.description.expanded else ''}"),
        ("robot's sha256", sha256(robot.description.text)),
        *_data_rows("measurements", calibration.data),
        *(_data_rows("test poses", calibration.test_data) if calibration.test_data is not None else []),
        ("rig", rig_in_words(robot)),
        ("estimator", calibration.estimator),
        ("noise", _noise_text(calibration)),
        *_evidence_rows(calibration),
        *_model_rows(calibration),
    ]
    return Table(("what", "value"), tuple(rows), words=2)


def prior_text(sigma: float, unit: str) -> str:
    """A prior sigma as `10 mm`, `1 deg` or `flat`."""
    name, size = displayed(unit)
    return "flat" if sigma >= FLAT else f"{sigma / size:.4g} {name}"


def _data_rows(label: str, data: Measurements) -> list[tuple[str, str]]:
    rows = [(label, f"{data.source or 'from memory'}, {count_of(len(data), 'pose')}, {data.summary}")]
    return [*rows, (f"{label}' sha256", data.sha256)] if data.sha256 else rows


def _noise_text(calibration: FitResult) -> str:
    noise = calibration.estimate.noise
    joints = dict.fromkeys(f"{sigma / DEG:.3g} deg" for sigma in noise.joint_sigma)
    readings = f"; joint readings {', '.join(joints)}" if noise.of_joints else "; joint readings taken as exact"
    return f"{noise_in_words(calibration)}{readings}; chi-square {calibration.chi_squared:.3g} per degree of freedom"


def _evidence_rows(calibration: FitResult) -> list[tuple[str, str]]:
    if calibration.evidence is None:
        return []
    units = {"translation": "m"}
    scales = (f"{group} {prior_text(scale, units.get(group, 'rad'))}" for group, scale in calibration.evidence.scales.items())
    return [("chosen by evidence", f"prior sigmas of joint errors: {', '.join(scales)}")]


def _model_rows(calibration: FitResult) -> list[tuple[str, str]]:
    """What each group of parameters consists of, and its priors."""
    rows = []
    for kind in dict.fromkeys(parameter.kind for parameter in calibration.errors.parameters):
        own = [parameter for parameter in calibration.errors.parameters if parameter.kind == kind]
        names = dict.fromkeys(parameter.name.rsplit(".", 1)[-1] for parameter in own)
        priors = dict.fromkeys(prior_text(parameter.sigma, parameter.unit) for parameter in own)
        rows.append(
            (_KINDS.get(kind, f"{kind} errors"), f"{count_of(len(own), 'parameter')} ({', '.join(names)}); prior sigma {', '.join(priors)}")
        )
    held = {name: value for name, value in calibration.errors.held.items() if value}
    return [*rows, ("held", ", ".join(held))] if held else rows
