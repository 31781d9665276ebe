"""What `urdfcal fit` writes, and what it is asked about sag; both are refused before any work is done."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from urdfcal.base.errors import UsageError, no_such
from urdfcal.base.files import is_yaml, sha256
from urdfcal.base.version import __version__
from urdfcal.cli.console import Working, say
from urdfcal.cli.notes import listed
from urdfcal.cli.places import STDOUT, named
from urdfcal.estimation.evidence import LEAST_POSES
from urdfcal.model.gravity import Gravity, parse_gravity, parse_payload
from urdfcal.model.softness import EXTRAS
from urdfcal.output.endings import ENDINGS
from urdfcal.output.formats import Deployment, deployment
from urdfcal.output.pairs import CORRECTED, written_with
from urdfcal.output.replaced import require_earlier, require_marked
from urdfcal.output.sources.wanted import SourcesWish
from urdfcal.output.text.frames import undetermined
from urdfcal.robot.placed_frames import FramesWish

if TYPE_CHECKING:
    from urdfcal.api import Calibration
    from urdfcal.calibration.analysis.sag import SagFit
    from urdfcal.model.options import ModelOptions
    from urdfcal.output.sources.tree import SourceTree
    from urdfcal.output.text.result import Extras
    from urdfcal.robot.robot import Robot
    from urdfcal.sensors.measurements import Measurements


@dataclass(frozen=True)
class Outputs:
    """The files that a fit will leave.

    Attributes:
        plan: Deployed formats and their places.
        reports: Those that are wanted.
        compensation: The compensation, if one is wanted; its URDF stands beside it.
        camera: Whether laser spots were read as pixels, so that the fit corrects the camera, too.
        tree: The xacro's sources, where they are to be changed.
        lenses: Cameras whose lenses are refined.
    """

    plan: Deployment
    reports: tuple[Path, ...] = ()
    compensation: Path | None = None
    camera: bool = False
    tree: SourceTree | None = None
    lenses: tuple[str, ...] = ()

    @property
    def places(self) -> dict[str, Path]:
        """Every file by what it is; beside standard output there is none that was not asked for."""
        places = {**self.plan.places, **({} if self.plan.main == STDOUT else self._beside)}
        places |= {f"report {number}" if number > 1 else "report": path for number, path in enumerate(self.reports, start=1)}
        return places | (
            {"compensation": self.compensation, "compensated_urdf": self.compensation.with_suffix(".urdf")} if self.compensation else {}
        )

    @property
    def pair_words(self) -> str:
        """Which URDF belongs to which file; the empty string where no compensation is written."""
        if self.compensation is None:
            return ""
        pair, alone = self.places["compensated_urdf"], self.plan.places.get("urdf")
        return f"{pair} belongs to {self.compensation}: use the two together, and neither with another file" + (
            f"; {alone} is geometry alone and stands by itself" if alone is not None else ""
        )

    @property
    def _beside(self) -> dict[str, Path]:
        """What goes beside the main output under its name."""
        kinds = {"calibration": "calibration"} | ({"camera": "camera"} if self.camera else {})
        kinds |= {_lens(name): name if name == "camera" else f"{name}_camera" for name in self.lenses}
        return {kind: self.plan.main.parent / f"{self.plan.stem}_{ending}.yaml" for kind, ending in kinds.items()}

    def require_free(self, robot: Robot, data: Measurements) -> None:
        """Refuse to replace what no earlier fit of the same robot and measurements has written.

        Raises:
            UsageError: names the first of them.
        """
        places = {name: place for name, place in self.places.items() if place != STDOUT}
        record = places.pop("calibration", STDOUT)
        cameras = [places.pop(kind, None) for kind in ("camera", *map(_lens, self.lenses))]
        require_earlier(record, places.values(), robot, data)
        for camera in filter(None, cameras):
            require_marked(camera, (CORRECTED,), "camera that an earlier fit has corrected")

    def require_sag(self, data: Measurements) -> None:
        """Refuse a compensation where too little was measured for any.

        Raises:
            UsageError: says how many poses there are, and how many it takes.
        """
        poses = len(np.unique(data.pose_of[data.sets == "fit"]))
        if self.compensation is not None and poses < LEAST_POSES:
            raise UsageError(f"--compensation {self.compensation}: {_few(poses)}; nothing was fitted")

    def contents(
        self, calibration: Calibration, sag: SagFit | None, extra: Extras, rng: np.random.Generator, frames: FramesWish
    ) -> tuple[dict[str | Path, bytes], list[str]]:
        """What goes into them, and what the user ought to know of it.

        Raises:
            UsageError: a compensation is wanted, and there is nothing to compensate.
        """
        deployed, places = replace(calibration.deployed(rng, frames), tree=self.tree), self.places
        files: dict[str | Path, bytes] = dict(deployed.files(self.plan))
        if self.reports:
            from urdfcal.output.report.files import report_bytes

            files |= {report: report_bytes(report, calibration, sys.argv, sag, extra.machine(), extra.spots) for report in self.reports}
        if self.compensation is not None and not calibration.rejection:
            if sag is None:
                raise UsageError(f"--compensation {self.compensation}: {_no_sag(calibration)}; there is nothing to write")
            urdf, text = sag.files(places["compensated_urdf"].name, frames)
            files |= {places["compensated_urdf"]: urdf, self.compensation: text}
        if "calibration" in places:  # the last of all: it tells whether the others are its own
            record = calibration.record(sys.argv, written_with(places["calibration"], files))
            files |= {places["camera"]: _camera_file(calibration.corrected_camera(), record)} if self.camera else {}
            refined = calibration.refined_cameras() if self.lenses else {}
            files |= {places[_lens(name)]: _camera_file(camera, record) for name, camera in refined.items()}
            files |= deployed.beside(self.plan)
            files[places["calibration"]] = record
        else:
            files |= deployed.beside(self.plan)
        chosen = frames.chosen(calibration.frames, calibration.robot.tree)
        told = undetermined((*chosen.written, *chosen.added))
        return files, [*deployed.warnings(self.plan), *self.plan.without_frames(frames), *told]


def require_frames(wish: FramesWish, robot: Robot, data: Measurements, options: ModelOptions) -> None:
    """Refuse frames that will not be found, or that no URDF of this robot can take, before any work is done.

    Raises:
        UsageError: names the first of them.
        RobotError: a link of the new one's name is there.
    """
    from urdfcal.model.found_frames import frame_sites
    from urdfcal.model.slots import slots_of

    known = {"reference": options.reference_known, "target": options.target_known}
    slots = [slot for slot in slots_of(robot.chain, robot.rig, options.error_model, options.per_joint) if not known.get(slot.kind, False)]
    sites = frame_sites(robot.tree, robot.chain, robot.rig, slots, data.session_names or ("",))
    wish.chosen([site for _, site in sites], robot.tree)


def _no_sag(calibration: Calibration) -> str:
    """Why there is no sag to compensate."""
    poses = calibration.data.pose_count
    return _few(poses) if poses < LEAST_POSES else "gravity bends no joint of this robot"


def _few(poses: int) -> str:
    return f"sag is looked at from {LEAST_POSES} fitted poses on, and there {'is' if poses == 1 else 'are'} {poses}"


def _lens(name: str) -> str:
    """What the file of a refined camera is called among the others."""
    return f"lens of {name}"


def _camera_file(camera: Any, record: bytes) -> bytes:
    """A camera that the fit changed, with the hash of the calibration that it goes with."""
    from urdfcal.vision.camera.camera_file import camera_yaml

    return camera_yaml(camera, {"urdfcal": __version__, CORRECTED: sha256(record)})


def planned(
    formats: Sequence[str] | None,
    output: Path | None,
    stem: str,
    ur_hash_from: Path | None,
    reports: Sequence[Path],
    compensation: Path | None,
) -> Outputs:
    """The files that the options ask for.

    Raises:
        UsageError: an ending or a format is none of ours.
    """
    reports = [named(report, f"{stem}_report.html") for report in reports]
    if reports:
        from urdfcal.output.report.files import require_report_ending

        for report in reports:
            require_report_ending(report)
    if compensation is not None and not is_yaml(compensation):
        raise UsageError(f"{compensation}: a compensation ends in .yaml; its URDF will stand beside it")
    return Outputs(planned_formats(formats or (), output, stem, ur_hash_from), tuple(reports), compensation)


def planned_formats(formats: Sequence[str], output: Path | None, stem: str, ur_hash_from: Path | None) -> Deployment:
    """The formats that are asked for, in a file, in a folder or on standard output.

    Raises:
        UsageError: an ending or a format is none of ours, or several are to go to standard output.
    """
    if output is not None and output != STDOUT:
        output = named(output, f"{stem}{ENDINGS.get(next(iter(formats), 'urdf'), '')}")
    plan = deployment(formats, None if output == STDOUT else output, stem, ur_hash_from)
    if output != STDOUT:
        return plan
    if len(plan.places) > 1:
        raise UsageError(f"-o -: {len(plan.places)} formats do not go to one standard output; name one --format, or a file")
    return replace(plan, places=dict.fromkeys(plan.places, STDOUT))


def with_sources(plan: Deployment, *, split: bool, folder: Path | None, in_place: bool, overwrite: bool) -> Deployment:
    """The files with what is wanted of a xacro's sources.

    Raises:
        UsageError: something is wanted of them without the format xacro.
    """
    asked = {"--split": split, "--in-place": in_place, "--xacro-folder": folder is not None}
    for option, given in asked.items():
        if given and "xacro" not in plan.places:
            raise UsageError(f"{option} means something with --format xacro alone")
    return replace(plan, sources=SourcesWish(split, folder, in_place, overwrite))


def looked_at(robot: Robot, options: ModelOptions, data: Measurements, plan: Deployment, quiet: bool) -> SourceTree | None:
    """The sources of a xacro that is to be changed, before the fit takes its time; which of them will change is said.

    Raises:
        RobotError: a number cannot be corrected where it stands; names it by file and line.
    """
    if "xacro" not in plan.places:
        return None
    from urdfcal.output.sources.rehearsal import rehearsed

    with Working("trying whether the xacro's sources can take a calibration", quiet):
        patch = rehearsed(robot, options, data.session_names, split=plan.sources.split)
        plan.sources.files(patch)
    if patch.after:
        say(not quiet, f"the calibration goes into {listed(map(patch.layout.way, patch.after))}")
    return patch.tree


@dataclass(frozen=True)
class SagWish:
    """What is asked about sag.

    Attributes:
        wanted: Whether it is to be fitted at all.
        gravity: Where down is, and what is carried.
        estimate: Whether the direction is to be found from the data.
        extras: Further terms to try.
    """

    wanted: bool
    gravity: Gravity
    estimate: bool
    extras: tuple[str, ...]

    @property
    def stated(self) -> Gravity | None:
        """Gravity and payloads as far as the user said anything of them."""
        return None if self.estimate or self.gravity == Gravity() else self.gravity

    def cautions(self, calibration: Calibration) -> list[str]:
        """What the user asked about sag, and will not be told."""
        asked = self.wanted and (self.extras or self.estimate or self.gravity != Gravity())
        few = calibration.data.pose_count < LEAST_POSES
        return [f"sag is not looked at with fewer than {LEAST_POSES} poses; what was asked about it has no effect"] if asked and few else []

    def require_links(self, robot: Robot) -> None:
        """Refuse payloads on links that the robot does not have, whether sag will be looked at or not.

        Raises:
            UsageError: names the nearest.
        """
        for link, mass in self.gravity.payloads.items():
            if link not in robot.tree.links:
                raise UsageError(f"--payload {mass:g}@{link}: {no_such('link', link, robot.tree.links)}")

    def of(self, calibration: Calibration) -> SagFit | None:
        """The joint fit of geometry and sag, if it is wanted, the calibration can be trusted and gravity bends anything."""
        from urdfcal.calibration.analysis.sag import estimated_gravity, fit_sag

        if not self.wanted or calibration.rejection or calibration.data.pose_count < LEAST_POSES:
            return None
        direction = estimated_gravity(calibration).direction if self.estimate else self.gravity.direction
        return fit_sag(calibration, Gravity(direction, self.gravity.payloads), extras=self.extras or None)


def sag_wish(wanted: bool, gravity: str | None, payloads: Sequence[str] | None, also: Sequence[str] | None) -> SagWish:
    """What the options ask about sag.

    Raises:
        UsageError: an option means nothing.
    """
    if not wanted and (gravity is not None or payloads or also):
        raise UsageError("--gravity, --payload and --also are about the sag that --no-sag leaves out; use one of the two")
    for term in also or ():
        if term not in EXTRAS:
            raise UsageError(f"--also {term}: there are: {', '.join(EXTRAS)}")
    estimate = gravity == "estimate"
    direction = Gravity().direction if gravity is None or estimate else parse_gravity(gravity)
    return SagWish(wanted, Gravity(direction, dict(parse_payload(text) for text in payloads or ())), estimate, tuple(also or ()))
