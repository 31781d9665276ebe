"""A calibration read back from its file: put on a robot again, on a Pinocchio model, and shown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from urdfcal.base.errors import CalibrationFileError, UsageError, did_you_mean
from urdfcal.base.files import read_yaml
from urdfcal.base.foreign_text import shown
from urdfcal.base.geometry import SE3, distance_mm_mrad, product
from urdfcal.base.yaml_kinds import is_not
from urdfcal.calibration.result import FitResult
from urdfcal.model.earlier import EarlierJoints
from urdfcal.model.options import ModelOptions
from urdfcal.robot.corrections import SAME, Applicable, OriginCorrection, applied, same_origin
from urdfcal.robot.frames import FoundFrame
from urdfcal.robot.placed_frames import Chosen, frame_origins
from urdfcal.robot.robot import Robot, require_robot, with_text
from urdfcal.robot.urdf_writer import with_origins
from urdfcal.sensors.measurements import Measurements

if TYPE_CHECKING:
    from urdfcal.output.stored_entries import PosteriorEntry
    from urdfcal.output.view.viewer import View


@dataclass(frozen=True, repr=False)
class StoredCalibration(Applicable):
    """A calibration read from its file.

    Attributes:
        path: The file.
        corrections: Nominal and corrected origin by joint name.
        posterior: What was decided of the joints' parameters, as the file has it; None if it does not say.
        description: The file of the robot that was calibrated, as it was named then; empty if the file does not say.
        measured: The module, or the link of the first target; empty if the file does not say.
        frames: Where instruments and targets were found, each on its link and with its covariance.
    """

    path: Path
    corrections: dict[str, OriginCorrection]
    posterior: PosteriorEntry | None = None
    description: str = ""
    measured: str = ""
    frames: tuple[FoundFrame, ...] = ()

    def __repr__(self) -> str:
        """In a line."""
        return f"<{type(self).__name__} {shown(str(self.path))}: {shown(', '.join(self.corrections))}>"

    def _repr_html_(self) -> str:
        from urdfcal.base.notebook import card

        return card(f"Calibration of {len(self.corrections)} joints", (str(self.path), ", ".join(self.corrections)))

    def origins_for(self, robot: Robot, force: bool = False, frames: Chosen[FoundFrame] | None = None) -> tuple[dict[str, SE3], list[str]]:
        """The origins to write into a robot description that may have changed elsewhere.

        An origin that equals the nominal one gets the corrected one; one that already equals the corrected one stays.

        Args:
            robot: The target.
            force: Where an origin is neither, put the correction on top of it.
            frames: Those that are to go into the description, too: of links that stand for one the origins are among those returned, and a
                robot that holds all else already is one to which something is added.

        Returns:
            Origins by joint name, and the calibrated joints that the target does not have.

        Raises:
            CalibrationFileError: the target is calibrated already, lacks a moving joint, or has an origin that is neither.
        """
        present, asked = robot.tree.joints, frames or Chosen[FoundFrame]()
        origins, already, missing = {}, 0, []
        for name, correction in {**self.corrections, **frame_origins(asked.written)}.items():
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
                raise CalibrationFileError(
                    f"joint '{name}' of {robot.description.path} is neither at its nominal nor at its corrected origin "
                    f"({_apart(origin, correction.nominal)} from nominal); --force puts the correction on top",
                    self.path,
                )
        if already and not asked.added and all(same_origin(present[name].origin, origin) for name, origin in origins.items()):
            raise CalibrationFileError(f"the robot {robot.description.path} is already calibrated with this file", self.path)
        if not (origins or already or asked.added):
            raise CalibrationFileError(
                f"the robot {robot.description.path} has none of the calibrated joints: {', '.join(missing)}"
                if missing
                else "holds frames alone; --write-frames or --add-frames puts them on a robot",
                self.path,
            )
        for frame in asked.added if not force else ():
            self._require_its_link(robot, origins, frame)
        return origins, missing

    def _require_its_link(self, robot: Robot, origins: Mapping[str, SE3], frame: FoundFrame) -> None:
        """Refuse to add a frame to a link that stands elsewhere than where it was found on it."""
        tree = robot.tree
        path = tree.path_from_root(frame.link)[len(tree.path_from_root(tree.moving_link(frame.link))) :]
        present = product([origins.get(joint.name, joint.origin) for joint in path])
        expected = frame.placement * frame.on_link.inverse()
        if same_origin(present, frame.placement) and not same_origin(expected, frame.placement):
            words = f"link '{frame.link}' of {robot.description.path} stands at the frame '{frame.child}' already"
            raise CalibrationFileError(words, self.path)
        if not same_origin(present, expected):
            raise CalibrationFileError(
                f"link '{frame.link}' of {robot.description.path} is {_apart(present, expected)} from where the frame "
                f"'{frame.child}' was found on it; --force adds it all the same",
                self.path,
            )

    @property
    def joints(self) -> EarlierJoints:
        """What was decided of the joints' parameters, for a later fit: `fit(robot, data, after=load_calibration(path).joints)`.

        Raises:
            CalibrationFileError: the file does not say.
        """
        said = self.posterior
        missing = [name for name in ([] if said is None else said.names) if name.rpartition(".")[0] not in self.corrections]
        if said is None or missing:
            raise CalibrationFileError(
                "has no entry 'posterior' with what was decided of the joints; expected a file that urdfcal fit wrote: fit again", self.path
            )
        joints = {name.rpartition(".")[0] for name in said.names}
        return EarlierJoints(
            tuple(said.names),
            np.array(said.prior_sigma),
            np.array(said.twists).T,
            np.array(said.covariance),
            {joint: self.corrections[joint].corrected for joint in joints},
        )

    def show(
        self, robot: Robot, data: Measurements | None = None, magnify: float | None = None, options: ModelOptions | None = None
    ) -> View:
        """Robot, beams and what was measured before and after, to look at; the file knows neither robot nor measurements.

        Args:
            robot: As its URDF has it.
            data: What was measured; without it one pose is shown.
            magnify: How many times longer than the errors their arrows are.
            options: Of which only what concerns the instruments matters.

        Raises:
            CalibrationFileError: the calibration is another robot's, or the robot is calibrated already.
            UsageError: a model or a path was given in place of the robot.
        """
        from urdfcal.output.view.viewer import view_of

        require_robot(robot, "show")
        return view_of(robot, data, corrected_robot(robot, self.origins_for(robot)[0]), magnify, options)


def _apart(a: SE3, b: SE3) -> str:
    """`1.2 mm, 0.3 mrad`; what rounding leaves is none."""
    mm, mrad = (0.0 if size < SAME else size for size in distance_mm_mrad(a, b))
    return f"{mm:.4g} mm, {mrad:.4g} mrad"


def corrected_robot(robot: Robot, origins: Mapping[str, SE3]) -> Robot:
    """The robot that a description with other origins, by joint name, is read as; screen, lasers and instruments stay."""
    return with_text(robot, with_origins(robot.description, origins))


def read_calibration(path: str | Path) -> StoredCalibration:
    """Read a calibration or the truth of a simulation.

    Raises:
        CalibrationFileError: the file is not one.
    """
    from pydantic import ValidationError

    from urdfcal.output.stored_entries import CalibrationEntries, RigEntry

    path = Path(path)
    file = read_yaml(path, CalibrationFileError)
    if not isinstance(file.content, dict) or "joints" not in file.content:
        raise CalibrationFileError(is_not("calibration", file.content, "joints", "fit or simulate"), path)
    try:
        entries = CalibrationEntries.model_validate(file.content)
    except ValidationError as error:
        found = error.errors()[0]
        raise CalibrationFileError(f"entry '{'.'.join(map(str, found['loc']))}': {found['msg']}", path, file.line(found["loc"])) from None
    corrections = {
        name: OriginCorrection(entry.nominal.placement(), entry.corrected.placement(), entry.moves)
        for name, entry in entries.joints.items()
    }
    rig, frames = entries.rig or RigEntry(), tuple(entry.frame() for entry in entries.frames)
    measured = rig.module or next(iter(rig.targets), "").partition(":")[0]
    return StoredCalibration(path, corrections, entries.posterior, entries.robot.file if entries.robot else "", measured, frames)


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
