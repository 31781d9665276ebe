"""`urdfcal apply --onto`: the calibration put onto an MJCF or SDF model."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urdfcal.base.errors import RobotError, UsageError
from urdfcal.cli.console import finish, say, warn
from urdfcal.cli.inputs import lacking
from urdfcal.cli.notes import listed
from urdfcal.cli.places import STDOUT, deliver, named, require_ending, require_places, told

if TYPE_CHECKING:
    from urdfcal.base.geometry import SE3
    from urdfcal.deploy.onto.patched import Patched
    from urdfcal.robot.robot import Robot

_MOST = 1e-3  # [mm] and [mrad] that MuJoCo may see beyond what lies between the nominal models


def put_onto(
    model: Path,
    robot: Robot,
    output: Path,
    inputs: Sequence[Path],
    origins_for: Callable[[], tuple[dict[str, SE3], list[str]]],
    *,
    force: bool,
    overwrite: bool,
    seed: int,
    as_json: bool,
    quiet: bool,
    verbose: bool,
) -> None:
    """Write the model with the calibration in it, and the files that it includes as far as they change.

    Raises:
        UsageError: an output cannot be written there, or the options do not go together.
        InputError: the model or the calibration cannot be taken.
    """
    from urdfcal.base.terminal import rounded
    from urdfcal.deploy.onto.patched import patched
    from urdfcal.output.replaced import require_same

    place = named(output, f"{model.stem}_calibrated{model.suffix}")
    require_ending("-o", place, (model.suffix.lower(),), f"a model patched from {model.name}")
    require_places(place, inputs=(*inputs, model))
    origins, missing = origins_for()
    found = patched(robot, origins, model, force)
    files = _places(found.files, model, place)
    require_places(*files, inputs=(*inputs, *found.original))
    seen = _in_mujoco(found, seed) if found.kind == "mjcf" else None
    contents: dict[str | Path, bytes] = {own: content for own, content in files.items()}
    if not overwrite:
        require_same(contents)
    deliver(contents)
    warn(_said(found, model, seen, force), quiet)
    warn(lacking(robot, missing), quiet)
    say(verbose, f"corrected: {', '.join(origins)}")
    mm, mrad = found.nominal_off
    machine: dict[str, Any] = {"urdf": None, "files": {found.kind: str(place)}, "corrected": list(origins), "missing": missing}
    machine["onto"] = {
        "model": str(model),
        "written": [str(own) for own in files],
        "lost": list(found.lost),
        "nominal": {"mm": mm, "mrad": mrad},
    }
    machine["onto"]["mujoco"] = None if seen is None else {"mm": seen[1][0], "mrad": seen[1][1]}
    proof = "" if seen is None else f"; MuJoCo has its bodies within {rounded(max(seen[1][0], 1e-6), 2)} mm of the calibrated robot's links"
    finish(machine if as_json else None, f"wrote {listed(told(files))} with the calibration in it{proof}", quiet)


def _places(files: Mapping[Path, bytes], model: Path, place: Path) -> dict[Path, bytes]:
    """Where each file goes: included ones lie to the output as they lie to the model."""
    placed = {place: files[model]}
    for path, content in files.items():
        if path == model:
            continue
        way = os.path.relpath(path, model.parent)
        if place == STDOUT or way.startswith(".."):
            raise UsageError(f"{path}: is included by {model.name} and changes, too, but cannot be written beside {place}")
        placed[place.parent / way] = content
    return placed


def _in_mujoco(found: Patched, seed: int) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """How far MuJoCo has its bodies from the robot's links, before and after; None without the package.

    Raises:
        RobotError: MuJoCo puts them elsewhere than they were to be.
    """
    import numpy as np

    from urdfcal.deploy.onto.mujoco_check import mujoco_is_there, off_in_mujoco

    if not mujoco_is_there():
        return None
    before, after = off_in_mujoco(
        (found.original, found.whole), found.zero, found.before.T_model_base, found.joints, found.theirs, np.random.default_rng(seed)
    )
    if any(now > _MOST + 2 * then for then, now in zip(before, after, strict=True)):
        raise RobotError(
            f"MuJoCo puts bodies {after[0]:.3g} mm and {after[1]:.3g} mrad from the calibrated robot's links, {before[0]:.3g} mm and "
            f"{before[1]:.3g} mrad from the nominal one's; nothing is written",
            next(iter(found.original)),
        )
    return before, after


def _told(value: float) -> str:
    """A distance or an angle, without the dust of rounding."""
    return "0" if value < 1e-6 else f"{value:.3g}"


def _said(found: Patched, model: Path, seen: object, force: bool) -> list[str]:
    mm, mrad = found.nominal_off
    lines = [f"{model}: nothing in it is named after what {', '.join(found.lost)} holds, so that part is not in it"] if found.lost else []
    if found.joints != found.theirs:
        lines.append(f"{model}: no joint there is called as in the URDF; {found.theirs[0]} is taken for {found.joints[0]}, and so on")
    if others := found.other_frames:
        worst = max(others, key=lambda link: max(others[link]))
        lines.append(
            f"{model}: it has other frames of {', '.join(others)} than the URDF (at zero, {worst} by {_told(others[worst][0])} mm and "
            f"{_told(others[worst][1])} mrad), so that axes are all that was compared: zeros of the first and of the last joint may differ"
        )
    if found.kind == "mjcf" and seen is None:
        lines.append("not checked by MuJoCo's own kinematics, which is not installed: pip install 'urdfcal[mujoco]'")
    if force and found.before.first:
        lines.append(
            f"{model}: its joints are up to {_told(mm)} mm and {_told(mrad)} mrad from the robot's, and stay so: the correction is on top"
        )
    return lines
