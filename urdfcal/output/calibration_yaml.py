"""The calibration as a file: origins, parameters, combinations and where they come from."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from urdfcal.base.files import sha256
from urdfcal.base.geometry import DEG, MM, SE3, xyz_rpy
from urdfcal.base.version import __version__
from urdfcal.calibration.known_joints import joints_of
from urdfcal.model.earlier import EarlierJoints
from urdfcal.output.text.instruments import frame_entries, noise_in_common
from urdfcal.robot.corrections import OriginCorrection
from urdfcal.robot.rig import Rig
from urdfcal.robot.robot import Robot

if TYPE_CHECKING:  # what a fit is takes long to import, and reading and replacing files wants none
    from urdfcal.calibration.error_table import SpotTable
    from urdfcal.calibration.result import FitResult

FRAMES_NOTE = (
    "pose: of child in parent, which a joint moves or which is the root; quaternion x y z w; matrix T_parent_child. xyz and rpy beside it: "
    "on the link that was measured on. covariance: of the twist (v, w) in the child's own axes, T = T_found exp(v, w), rows and columns "
    "x y z rot_x rot_y rot_z, m and rad, null where nothing is known. All of it is right with the corrected joints, not with the nominal "
    "ones. joint: what `urdfcal apply --write-frames` writes; static_transform: for ROS 2, beside the calibrated URDF."
)


def calibration_yaml(calibration: FitResult, command: Sequence[str], files: Mapping[str, str] | None = None) -> bytes:
    """A calibration as YAML: provenance, rig, noise, origins, parameters, combinations, spot distances.

    Args:
        calibration: What was found.
        command: The command line, for the record.
        files: Hashes of the files that are written with it, by their ways from its folder.
    """
    noise, spot_noise = calibration.estimate.noise, calibration.noise_of("spot")
    content = {
        **_provenance(calibration.robot, command),
        **({"files": dict(files)} if files else {}),
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
            "spot_sigma_mm": None if spot_noise is None else spot_noise / MM,
            "spot_sigma_stated": noise.all_stated,
            "extra_noise": dict(calibration.extra_noise),
            "sigma": dict(zip(calibration.data.kinds, noise.sigma.tolist(), strict=True)),
            **({"in_common": shared} if (shared := noise_in_common(calibration)) else {}),
            "joint_sigma_deg": [float(sigma / DEG) for sigma in noise.joint_sigma],
        },
        "joints": joint_entries(calibration.corrections),
        "parameters": parameter_entries(calibration),
        **posterior_entry(calibration),
        "carried": dict(calibration.errors.carried),
        **frames_entry(calibration),
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


def imported_yaml(
    robot: Robot, corrections: Mapping[str, OriginCorrection], joints: EarlierJoints | None, source: Path, command: Sequence[str]
) -> bytes:
    """Corrections that somebody else found, as a calibration.

    Args:
        robot: The description that they correct.
        corrections: By joint name.
        joints: What a later fit is to believe of them; None where nothing is assumed.
        source: The file that they come from.
        command: The command line, for the record.
    """
    content = {
        **_provenance(robot, command, rig=False),
        "imported": {"file": _readable(str(source)), "sha256": sha256(source.read_bytes())},
        "joints": joint_entries(corrections),
        **_gaussian(joints),
    }
    return _yaml("A calibration that was not made by urdfcal, imported. xyz and values in metres, rpy in radians.", content)


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
            **({"prior_mean": parameter.mean} if parameter.mean else {}),
        }
        for parameter, value, sigma, determined in rows
    ]


def posterior_entry(calibration: FitResult) -> dict[str, Any]:
    """The joints' parameters as a Gaussian about the corrected origins, for a later fit that shares some of them; SI."""
    return _gaussian(joints_of(calibration))


def _gaussian(joints: EarlierJoints | None) -> dict[str, Any]:
    if joints is None or not joints.names:
        return {}
    entry = {
        "names": list(joints.names),
        "prior_sigma": joints.sigma.tolist(),
        "twists": joints.screws.T.tolist(),
        "covariance": joints.covariance.tolist(),
    }
    return {"posterior": entry}


def frames_entry(calibration: FitResult) -> dict[str, Any]:
    """Where instruments and targets were found, for whoever publishes, draws or applies them; nothing where there are none."""
    entries = [{**entry, "static_transform": _Line(entry["static_transform"])} for entry in frame_entries(calibration)]
    return {"frames_note": FRAMES_NOTE, "frames": entries} if entries else {}


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


def _provenance(robot: Robot, command: Sequence[str], rig: bool = True) -> dict[str, Any]:
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
        **({"rig": _rig_entry(robot.rig)} if rig else {}),
    }


def _rig_entry(rig: Rig) -> dict[str, Any]:
    entry: dict[str, Any] = {"screen": rig.base, "module": rig.tip, "lasers": list(rig.lasers)} if rig.lasers else {}
    seen = rig.instruments
    if seen.others:
        entry["instruments"] = {own.name: own.link for own in seen.every}
    return entry | ({"reference": seen.reference, "targets": [target.name for target in seen.targets]} if seen.targets else {})


def _data_entry(calibration: FitResult) -> dict[str, Any]:
    data = calibration.data
    entry: dict[str, Any] = {"poses": data.pose_count} | ({"rows": len(data)} if data.again else {})
    entry |= {"spots": int(data.seen.sum())} if data.lasers else {}
    entry |= {} if data.only_spots else {"readings": data.summary}
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


class _Line(str):
    """A command, which is to stand in one line."""


class _Dumper(getattr(yaml, "CSafeDumper", yaml.SafeDumper)):  # type: ignore[misc]  # with the C library where there is one
    """YAML with commands in one line, to be copied."""


_Dumper.add_representer(_Line, lambda dumper, line: dumper.represent_scalar("tag:yaml.org,2002:str", str(line), style="|"))


def _yaml(comment: str, content: Mapping[str, Any]) -> bytes:
    text = yaml.dump(dict(content), Dumper=_Dumper, sort_keys=False, default_flow_style=None, width=160, allow_unicode=True)
    return f"# {comment}\n{text}".encode()
