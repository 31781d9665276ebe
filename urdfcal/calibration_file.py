"""The calibration as a file: origins, parameters, combinations and where they come from; and putting it on a robot again."""

from __future__ import annotations

import hashlib
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from urdfcal import __version__
from urdfcal.corrections import OriginCorrection, applied, same_origin
from urdfcal.error_table import SpotTable
from urdfcal.errors import CalibrationFileError, UsageError, did_you_mean
from urdfcal.files import read_yaml
from urdfcal.fit_result import FitResult
from urdfcal.geometry import DEG, MM, SE3, distance_mm_mrad, pose, xyz_rpy
from urdfcal.robot import Robot
from urdfcal.spot_model import kinds_of
from urdfcal.urdf_tree import FARTHEST

Finite = Annotated[float, Field(ge=-FARTHEST, le=FARTHEST, allow_inf_nan=False)]
Triple = tuple[Finite, Finite, Finite]


class _Loose(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)


class OriginEntry(_Loose):
    """xyz in metres, rpy in radians."""

    xyz: Triple
    rpy: Triple

    def placement(self) -> SE3:
        """As a placement."""
        return pose(np.array(self.xyz), np.array(self.rpy))


class JointEntry(_Loose):
    """One calibrated joint."""

    moves: bool
    nominal: OriginEntry
    corrected: OriginEntry


class CalibrationEntries(_Loose):
    """The part of the file that is read back."""

    joints: dict[str, JointEntry] = Field(min_length=1)


@dataclass(frozen=True)
class StoredCalibration:
    """A calibration read from its file.

    Attributes:
        path: The file.
        corrections: Nominal and corrected origin by joint name.
    """

    path: Path
    corrections: dict[str, OriginCorrection]

    def apply_to(self, model: Any, *geometry_models: Any) -> Any:
        """Corrected copies of a Pinocchio model of this robot and of its geometry models; for a controller.

        The model may be without the rig, free-flying, or reduced. Joints, frames and inertias come out as if the calibrated
        URDF had been read, so the corrected model costs what the nominal one costs.

        Args:
            model: `pin.Model`; left unchanged.
            geometry_models: `pin.GeometryModel`s of it (visual, collision); left unchanged.

        Returns:
            The corrected model; with geometry models the tuple (model, *geometry_models).

        Raises:
            RobotError: the model lacks a joint that was calibrated, is calibrated already, or is of another description.
        """
        return applied(model, geometry_models, self.corrections)

    def origins_for(self, robot: Robot, force: bool = False) -> tuple[dict[str, SE3], list[str]]:
        """The origins to write into a robot description that may have changed elsewhere.

        An origin that equals the nominal one gets the corrected one; one that already equals the corrected one stays.

        Args:
            robot: The target.
            force: Where an origin is neither, put the correction on top of it.

        Returns:
            Origins by joint name, and the calibrated joints that the target does not have.

        Raises:
            CalibrationFileError: the target is calibrated already, lacks a moving joint, or has an origin that is neither.
        """
        present = robot.tree.joints
        origins, already, missing = {}, 0, []
        for name, correction in self.corrections.items():
            if name not in present:
                if correction.moving:
                    raise CalibrationFileError(
                        f"the robot {robot.description.path} has no joint '{name}'{did_you_mean(name, present)}", self.path
                    )
                missing.append(name)
                continue
            origin = present[name].origin
            if same_origin(origin, correction.nominal):
                origins[name] = correction.corrected
            elif same_origin(origin, correction.corrected):
                already += 1
            elif force:
                origins[name] = origin * correction.delta
            else:
                off_mm, off_mrad = distance_mm_mrad(origin, correction.nominal)
                raise CalibrationFileError(
                    f"joint '{name}' of {robot.description.path} is neither at its nominal nor at its corrected origin "
                    f"({off_mm:.4g} mm, {off_mrad:.4g} mrad from nominal); --force puts the correction on top",
                    self.path,
                )
        if already and all(same_origin(self.corrections[name].nominal, origin) for name, origin in origins.items()):
            raise CalibrationFileError(f"the robot {robot.description.path} is already calibrated with this file", self.path)
        if not origins:
            raise CalibrationFileError(
                f"the robot {robot.description.path} has none of the calibrated joints: {', '.join(missing)}", self.path
            )
        return origins, missing


def apply(model: Any, calibration: FitResult | StoredCalibration | str | Path, *geometry_models: Any) -> Any:
    """Corrected copies of a Pinocchio model and of its geometry models, by a fit, a stored calibration or the path of one.

    Args:
        model: `pin.Model` of the robot; left unchanged.
        calibration: What `fit` or `load_calibration` gave, or a file that `urdfcal fit` wrote.
        geometry_models: `pin.GeometryModel`s of it; left unchanged.

    Returns:
        The corrected model; with geometry models the tuple (model, *geometry_models).

    Raises:
        UsageError: one of the arguments is something else, such as a `Robot` in place of its `model`.
        CalibrationFileError: the file is no calibration.
        RobotError: the model lacks a joint that was calibrated, is calibrated already, or is of another description.
    """
    found = read_calibration(calibration) if isinstance(calibration, str | Path) else calibration
    if not isinstance(found, FitResult | StoredCalibration):
        raise UsageError(
            f"found a {type(found).__name__} where the calibration belongs; expected apply(robot.model, calibration), "
            "with what fit or load_calibration gave, or the path of its file"
        )
    return applied(model, geometry_models, found.corrections)


def calibration_yaml(calibration: FitResult, command: Sequence[str]) -> bytes:
    """A calibration as YAML: provenance, rig, noise, origins, parameters, combinations, spot distances."""
    noise = calibration.estimate.noise
    content = {
        **_provenance(calibration.robot, command),
        "measurements": _data_entry(calibration),
        "estimator": {
            "name": calibration.estimator,
            "error_model": calibration.error_model,
            "parameters": len(calibration.errors.names),
            "rank": calibration.identifiability.rank,
            "converged": calibration.converged,
            "stop": calibration.stop_reason,
            "sweeps": len(calibration.estimate.history) - 1,
            "chi_squared_per_degree_of_freedom": calibration.chi_squared,
        },
        "noise": {
            "spot_sigma_mm": noise.spot_sigma / MM if calibration.data.lasers else None,
            "spot_sigma_stated": noise.all_stated,
            "extra": dict(calibration.extra_noise),
            "sigma": dict(zip(kinds_of(calibration.data), noise.sigma.tolist(), strict=True)),
            "joint_sigma_deg": [float(sigma / DEG) for sigma in noise.joint_sigma],
        },
        "joints": joint_entries(calibration.corrections),
        "parameters": parameter_entries(calibration),
        "carried": dict(calibration.errors.carried),
        "combinations": [asdict(combination) for combination in calibration.identifiability.combinations],
        "spots": {"before": _table(calibration.before), "after": _table(calibration.after)},
    }
    if calibration.test:
        content["spots"]["test"] = {"before": _table(calibration.test[0]), "after": _table(calibration.test[1])}
    return _yaml("Calibration by urdfcal. xyz and values in metres, rpy in radians, unless the name says otherwise.", content)


def truth_yaml(
    robot: Robot,
    corrections: Mapping[str, OriginCorrection],
    values: Mapping[str, float],
    command: Sequence[str],
    noise: Mapping[str, Any],
) -> bytes:
    """The errors of a simulated robot as YAML; the file can be applied like a calibration, which gives the true robot."""
    content = {
        **_provenance(robot, command),
        "simulated": True,
        "noise": dict(noise),
        "joints": joint_entries(corrections),
        "parameters": {name: {"value": float(value)} for name, value in values.items()},
    }
    return _yaml("The true errors of a SIMULATED robot. xyz and values in metres, rpy in radians.", content)


def read_calibration(path: str | Path) -> StoredCalibration:
    """Read a calibration or the truth of a simulation.

    Raises:
        CalibrationFileError: the file is not one.
    """
    path = Path(path)
    file = read_yaml(path, CalibrationFileError)
    if not isinstance(file.content, dict) or "joints" not in file.content:
        raise CalibrationFileError("is no calibration: it has no entry 'joints'; expected a file written by urdfcal fit or simulate", path)
    try:
        entries = CalibrationEntries.model_validate(file.content)
    except ValidationError as error:
        found = error.errors()[0]
        raise CalibrationFileError(f"entry '{'.'.join(map(str, found['loc']))}': {found['msg']}", path, file.line(found["loc"])) from None
    corrections = {
        name: OriginCorrection(entry.nominal.placement(), entry.corrected.placement(), entry.moves)
        for name, entry in entries.joints.items()
    }
    return StoredCalibration(path, corrections)


def parameter_entries(calibration: FitResult) -> list[dict[str, Any]]:
    """Name, value, sigma, unit, prior and whether the data decided it, for every parameter; SI."""
    rows = zip(calibration.errors.parameters, calibration.x, calibration.sigma, calibration.identifiability.determined, strict=True)
    return [
        {
            "name": parameter.name,
            "value": float(value),
            "sigma": float(sigma),
            "unit": parameter.unit,
            "determined": determined,
            "prior_sigma": parameter.sigma,
        }
        for parameter, value, sigma, determined in rows
    ]


def joint_entries(corrections: Mapping[str, OriginCorrection]) -> dict[str, Any]:
    """Nominal origin, corrected origin and delta by joint name."""
    return {
        name: {
            "moves": correction.moving,
            "nominal": _origin(correction.nominal),
            "corrected": _origin(correction.corrected),
            "delta": _origin(correction.delta),
        }
        for name, correction in corrections.items()
    }


def sha256(content: bytes) -> str:
    """Hash of some bytes, in hexadecimal."""
    return hashlib.sha256(content).hexdigest()


def _provenance(robot: Robot, command: Sequence[str]) -> dict[str, Any]:
    words = [Path(command[0]).name, *command[1:]] if command else []
    return {
        "urdfcal": __version__,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": _readable(shlex.join(words)),
        "robot": {
            "name": robot.name,
            "file": _readable(str(robot.description.path)),
            "sha256": sha256(robot.description.text),
            "expanded_by_xacro": robot.description.expanded,
        },
        "rig": {"screen": robot.rig.screen, "module": robot.rig.module, "lasers": list(robot.rig.lasers)},
    }


def _data_entry(calibration: FitResult) -> dict[str, Any]:
    data = calibration.data
    entry: dict[str, Any] = {"poses": len(data), "spots": int(data.seen.sum())}
    if data.source:
        entry = {"file": _readable(data.source), "sha256": data.sha256, **entry}
    return entry


def _readable(text: str) -> str:
    """A path as text, also where its bytes are no UTF-8."""
    return text.encode("utf-8", "backslashreplace").decode()


def _origin(placement: SE3) -> dict[str, list[float]]:
    xyz, rpy = xyz_rpy(placement)
    return {"xyz": [float(value) + 0.0 for value in xyz], "rpy": [float(value) + 0.0 for value in rpy]}


def _table(table: SpotTable) -> dict[str, Any]:
    return {name: row.entry() for name, row in table.items()}


def _yaml(comment: str, content: Mapping[str, Any]) -> bytes:
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    text = yaml.dump(dict(content), Dumper=dumper, sort_keys=False, default_flow_style=None, width=160, allow_unicode=True)
    return f"# {comment}\n{text}".encode()
