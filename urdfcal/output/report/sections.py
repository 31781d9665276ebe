"""Sections of a report: where frames, targets and places were found, how well touches agree, and where the calibration comes from."""

from __future__ import annotations

import math
import platform
import shlex
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from urdfcal.base.files import sha256
from urdfcal.base.geometry import DEG, MM
from urdfcal.base.minus import with_minus
from urdfcal.base.terminal import displayed, many
from urdfcal.base.version import __version__
from urdfcal.calibration.analysis.sag import SagFit
from urdfcal.calibration.result import FitResult
from urdfcal.model.parameters import FLAT
from urdfcal.output.report.document import Block, Cell, Gallery, Section, Table
from urdfcal.output.report.residuals import Residuals
from urdfcal.output.report.touches import MOST_PLACES, PlaceScatter, scatter_of_places
from urdfcal.output.text.instruments import frame_entries, length_entries, measuring_frame, noise_in_words, place_entries, rig_in_words
from urdfcal.output.text.sag import deflections, extras_rows, sag_words
from urdfcal.robot.frames import FoundFrame
from urdfcal.sensors.measurements import Measurements

_COLUMNS = ("frame", "on link", "x", "y", "z", "sigma", "roll", "pitch", "yaw", "sigma")

_ABSOLUTE = ("frame", "in link", "x", "y", "z", "x", "y", "z", "w")
_KINDS = {"reference": "measuring frame", "target": "targets", "place": "places"}


def fixed(value: float) -> str:
    """A figure for a column: `1.226`, `228.6`."""
    return (
        "–" if not math.isfinite(value) else f"{value:.3f}" if abs(value) < 100 else f"{value:.1f}" if abs(value) < 1e6 else f"{value:.3g}"
    )


def frames_section(calibration: FitResult) -> Section:
    """Placement of every measuring frame and target on its link."""
    entries = frame_entries(calibration)
    if not entries:
        return Section("frames", "Frames found", ())
    text = (
        "Where measuring frames and targets stand on their links. They were found with the fit; a URDF holds them where --write-frames or "
        "--add-frames put them into it."
    )
    turned = any(entry["rotation_sigma"] is not None for entry in entries)
    groups = (("", 2), ("position in mm", 4), *([("orientation in deg", 4)] if turned else []))
    width = sum(count for _, count in groups)
    table = Table(_COLUMNS[:width], tuple(_frame_row(each)[:width] for each in entries), words=2, groups=groups)
    absolute = (
        "The same in the link that a joint moves, or in the root, under the names that ROS 2 publishes them by: beside the calibrated "
        "robot, not beside the nominal one. The calibration file has covariances and the commands."
    )
    return Section("frames", "Frames found", (text, table, absolute, _absolute_table(calibration.frames)))


def _absolute_table(frames: Sequence[FoundFrame]) -> Table:
    """Every frame in the link nearest to the root that it is rigidly joined to."""
    rows = []
    for frame in frames:
        lengths = [f"{length / MM:.3f}" for length in frame.xyz] if frame.placed else [""] * 3
        numbers = [f"{number:.6f}" for number in frame.quaternion] if frame.turned else [""] * 4
        rows.append((frame.child, frame.parent, *lengths, *numbers))
    groups = (("", 2), ("position in mm", 3), *([("orientation, a quaternion", 4)] if any(frame.turned for frame in frames) else []))
    width = sum(count for _, count in groups)
    return Table(_ABSOLUTE[:width], tuple(row[:width] for row in rows), words=2, groups=groups)


def _frame_row(entry: dict[str, Any]) -> tuple[Cell, ...]:
    placed, turned = entry["sigma"] is not None, entry["rotation_sigma"] is not None
    lengths = [f"{length / MM:.3f}" for length in (*entry["xyz"], entry["sigma"])] if placed else [""] * 4
    angles = [f"{angle / DEG:.4f}" for angle in (*entry["rpy"], entry["rotation_sigma"])] if turned else [""] * 4
    return (entry["name"], entry["link"], *lengths, *angles)


def places_section(calibration: FitResult, sets: Sequence[Residuals]) -> Section:
    """How well the touches of each socket and plane agree, and the distances that were known."""
    blocks: list[Block] = []
    scatters, positions = scatter_of_places(sets), _positions(calibration)
    if scatters:
        kinds = " and ".join(dict.fromkeys(f"{scatter.kind}s" for scatter in scatters))
        blocks += [
            f"RMS distance of the touches from their place, for {kinds}; no place was known beforehand. "
            f"Positions are in {measuring_frame(calibration)}.",
            Gallery("consistency"),
            _place_table(scatters, positions),
        ]
        blocks += [f"{len(scatters) - MOST_PLACES} more are not listed."] if len(scatters) > MOST_PLACES else []
    known = length_entries(calibration)
    if known:
        rows = tuple(_length_row(entry) for entry in known[:MOST_PLACES])
        blocks += ["Distances that were known beforehand, and that give the arm its scale:"]
        blocks += [Table(("between", "known in mm", "found in mm", "known to, in mm"), rows)]
    return Section("places", "Places touched", tuple(blocks))


def _place_table(scatters: Sequence[PlaceScatter], positions: dict[str, list[float]]) -> Table:
    columns = ("poses", "place", "touches", "before in mm", "after in mm", "x in mm", "y in mm", "z in mm")
    rows: list[tuple[Cell, ...]] = []
    for each in scatters[:MOST_PLACES]:
        where = [f"{value / MM:.2f}" for value in positions.get(f"{each.kind}:{each.name}", [])] or ["", "", ""]
        rows.append((each.label, each.name, str(each.touches), fixed(each.before), fixed(each.after), *where))
    width = len(columns) if any(row[-1] for row in rows) else len(columns) - 3
    return Table(columns[:width], tuple(row[:width] for row in rows), words=2)


def _positions(calibration: FitResult) -> dict[str, list[float]]:
    """Where sockets were found, [m]."""
    return {entry["name"]: entry["xyz"] for entry in place_entries(calibration) if "xyz" in entry}


def _length_row(entry: dict[str, Any]) -> tuple[Cell, ...]:
    between = " – ".join(entry[end].partition(":")[2] for end in ("one", "other"))
    return (between, fixed(entry["known"] / MM), fixed(entry["found"] / MM), fixed(entry["sigma"] / MM))


def sag_section(sag: SagFit | None) -> Section | None:
    """For a report."""
    if sag is None:
        return None
    rows = tuple((each.joint, f"{each.mrad:.3f}", f"{each.tool_mm:.3f}") for each in deflections(sag))
    table = Table(("joint", "largest deflection in mrad", "moves the tool by mm"), rows)
    words, extras = with_minus(sag_words(sag)), tuple(extras_rows(sag))
    beside = (Table(("found beside sag", "value ± sigma", "unit"), extras),) if extras else ()
    text = "Not in the calibrated URDF, which is that of geometry alone: --compensation writes it, beside a URDF of its own."
    return Section("sag", "Sag under gravity", (f"{words[0].upper()}{words[1:]}.", text, *beside, table))


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
    rows = [(label, f"{data.source or 'from memory'}, {data.counted}, {data.summary}")]
    return [*rows, (f"{label}' sha256", data.sha256)] if data.sha256 else rows


def _noise_text(calibration: FitResult) -> str:
    exact = "" if calibration.estimate.noise.of_joints else "; joint readings taken as exact"
    return f"{noise_in_words(calibration)}{exact}; chi-square {calibration.chi_squared:.3g} per degree of freedom"


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
            (_KINDS.get(kind, f"{kind} errors"), f"{many(len(own), 'parameter')} ({', '.join(names)}); prior sigma {', '.join(priors)}")
        )
    held = {name: value for name, value in calibration.errors.held.items() if value}
    return [*rows, ("held", ", ".join(held))] if held else rows
