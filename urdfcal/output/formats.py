"""The forms in which a calibration is deployed: `--format`, where each one is written, and its bytes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from urdfcal.base.errors import UsageError
from urdfcal.base.files import YAML_ENDINGS
from urdfcal.base.geometry import SE3
from urdfcal.output.driver_yaml import origins_yaml, ur_joints, ur_warnings, ur_yaml
from urdfcal.output.endings import ENDINGS, PATCHES, no_format, stem_of
from urdfcal.output.joint_offsets import OffsetLoss, offset_loss, offsets_yaml
from urdfcal.output.makers_yaml import MAKERS, maker_warnings, maker_yaml, tesseract_yaml
from urdfcal.output.sources.wanted import SourcesWish
from urdfcal.output.ur_file import UrFile, read_ur_file
from urdfcal.output.zeros_aside import ASIDE, require_places_aside, zeros_aside_urdf
from urdfcal.robot.frames import FoundFrame
from urdfcal.robot.placed_frames import FramesWish, with_frames
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_writer import with_origins

if TYPE_CHECKING:
    from urdfcal.output.sources.patch import SourcePatch
    from urdfcal.output.sources.tree import SourceTree

_OTHERS = (".csv", ".html", ".htm", ".md", ".json", ".pdf", ".svg", ".png", ".jpg", ".dae", ".stl", ".obj", ".py")
_XML = (".urdf", ".xacro", ".xml")
_WITH_LINKS = ("urdf", *ASIDE)  # what can have further links
_WITH_FIXED = (*_WITH_LINKS, "origins-yaml", "tesseract", "xacro")  # what has origins of fixed joints
_KINDS = {"urdf": "a URDF", **dict.fromkeys(ASIDE, "a URDF"), "xacro": "a patch"}  # of the others: YAML
_FOREIGN = {  # what files of the kind must not be called
    "a URDF": (*YAML_ENDINGS, *PATCHES, *_OTHERS),
    "a patch": (*YAML_ENDINGS, *_XML, *_OTHERS),
    "YAML": (*_XML, *PATCHES, *_OTHERS),
}


@dataclass(frozen=True)
class Deployment:
    """The files that were asked for.

    Attributes:
        places: Where each format is written; the first is the main output.
        ur_file: Whose hash the UR format gets.
        sources: What becomes of a xacro's sources.
    """

    places: Mapping[str, Path]
    ur_file: UrFile | None = None
    sources: SourcesWish = field(default_factory=SourcesWish)

    @property
    def main(self) -> Path:
        """The main output, which `-o` names."""
        return next(iter(self.places.values()))

    @property
    def stem(self) -> str:
        """What the files beside the main output are named after."""
        return stem_of(self.main)

    def require_fit_for(self, robot: Robot, calibrated: Iterable[str]) -> None:
        """Refuse a robot that a format is not for, before any work is done.

        Args:
            robot: The robot.
            calibrated: Names of the joints that are, or are to be, calibrated.

        Raises:
            RobotError: says what is missing.
            InputError: the kinematics file is of another model.
        """
        names = tuple(calibrated)
        if "ur" in self.places:
            ur_joints(robot, names)
        for name in ASIDE.keys() & self.places.keys():
            require_places_aside(name, robot, names)
        for name in MAKERS.keys() & self.places.keys():
            MAKERS[name].joints(robot, names, name)
        if "xacro" in self.places:
            self.sources.require_possible(robot.description)
        if self.ur_file is not None:
            self.ur_file.require_model_of(robot, names)

    def require_holding(self, wish: FramesWish) -> None:
        """Refuse frames that none of the formats can hold.

        Raises:
            UsageError: names a format that can.
        """
        for option, wanted, able in (("--write-frames", wish.write, _WITH_FIXED), ("--add-frames", wish.add, _WITH_LINKS)):
            if wanted and not set(able) & self.places.keys():
                raise UsageError(f"{option}: --format {' and '.join(self.places)} cannot hold {_LACK[option]}; add --format urdf")

    def without_frames(self, wish: FramesWish) -> tuple[str, ...]:
        """A warning of the formats that cannot hold the frames which others beside them hold."""
        able = _WITH_LINKS if wish.add else _WITH_FIXED
        unable = [name for name in self.places if name not in able] if wish else []
        holding = [str(place) for name, place in self.places.items() if name in able]
        return (f"--format {' and '.join(unable)}: cannot hold all of the frames; {' and '.join(holding)} can",) if unable else ()


def deployment(formats: Sequence[str], output: Path | None, stem: str, ur_hash_from: Path | None = None) -> Deployment:
    """Lay out the files of some formats: `-o` names the main one, the others stand beside it under their own endings.

    Args:
        formats: Names of formats; none means `urdf`.
        output: The main output. It is that of the format whose ending its name has, else of the first format.
        stem: What files are named after where there is no `output`.
        ur_hash_from: A kinematics file of the UR driver whose hash is taken over.

    Raises:
        UsageError: an unknown format, a name that belongs to another kind of file, or two files of one name.
        InputError: there is no hash in the file.
    """
    wanted = list(dict.fromkeys(formats)) or ["urdf"]
    for name in wanted:
        if name not in ENDINGS:
            raise UsageError(no_format(name))
    if ur_hash_from is not None and "ur" not in wanted:
        raise UsageError("--ur-hash-from means something with --format ur alone")
    main = wanted[0] if output is None else _meant(wanted, output)
    folder, stem = (Path(), stem) if output is None else (output.parent, stem_of(output))
    places = {main: output or Path(f"{stem}{ENDINGS[main]}")}
    places |= {name: folder / f"{stem}{ENDINGS[name]}" for name in wanted if name != main}
    if len(set(places.values())) < len(places):
        raise UsageError(f"{output}: two formats would be written to this file; name another with -o")
    return Deployment(places, None if ur_hash_from is None else read_ur_file(ur_hash_from))


def _meant(wanted: Sequence[str], output: Path) -> str:
    own = [name for name in wanted if output.name.endswith(ENDINGS[name])]
    alike = [name for name in wanted if output.suffix.lower() not in _FOREIGN[_KINDS.get(name, "YAML")]]
    if not alike:
        kind = _KINDS.get(wanted[0], "YAML")
        raise UsageError(f"{output}: --format {wanted[0]} writes {kind}, expected a name that does not end in {output.suffix}")
    return (own or alike)[0]


_LACK = {"--write-frames": "origins of fixed joints", "--add-frames": "further links"}


@dataclass(frozen=True)
class Deployed:
    """A calibration in the forms that were asked for.

    Attributes:
        robot: The description that the origins belong to.
        origins: Corrected placement by joint name.
        rng: For the configurations over which an offsets-only deployment is judged.
        links: Placement of the fixed joint, by its name, of every link that is made to stand where a frame was found.
        added: Frames that become links of their own.
        tree: The xacro's sources, if they were looked at before.
    """

    robot: Robot
    origins: Mapping[str, SE3]
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    links: Mapping[str, SE3] = field(default_factory=dict)
    added: Sequence[FoundFrame] = ()
    tree: SourceTree | None = field(default=None, repr=False, compare=False)
    _sources: dict[bool, SourcePatch] = field(default_factory=dict, repr=False, compare=False)

    @cached_property
    def loss(self) -> OffsetLoss:
        """What offsets alone lose."""
        return offset_loss(self.robot, self.origins, self.rng)

    def files(self, plan: Deployment) -> dict[str | Path, bytes]:
        """Content by place, the main output first.

        Raises:
            RobotError: a format is not for this robot.
        """
        kinematics_hash = plan.ur_file.hash if plan.ur_file is not None else None
        return {place: self.content(name, kinematics_hash, split=plan.sources.split) for name, place in plan.places.items()}

    def beside(self, plan: Deployment) -> dict[str | Path, bytes]:
        """A xacro's sources themselves, in place or in a folder, where they are wanted beside their patch.

        Raises:
            RobotError: they cannot be calibrated, or are not the user's own.
            UsageError: the content of a source before an earlier change would be lost.
        """
        return plan.sources.files(self.sources(plan.sources.split)) if "xacro" in plan.places else {}

    def sources(self, split: bool = False) -> SourcePatch:
        """The calibration as changed sources of the xacro that the robot was expanded from.

        Args:
            split: Whether a number that feeds several joints may become a parameter of its macro.

        Raises:
            RobotError: it is no xacro, or its sources cannot be changed so; says where.
        """
        from urdfcal.output.sources.patch import patched_sources

        if split not in self._sources:
            self._sources[split] = patched_sources(self.robot.description, self._whole, split=split, tree=self.tree)
        return self._sources[split]

    def content(self, name: str, kinematics_hash: str | None = None, *, split: bool = False) -> bytes:
        """One format's bytes.

        Raises:
            UsageError: there is no such format.
            RobotError: it is not for this robot.
        """
        if name == "urdf":
            return self._with_links(with_origins(self.robot.description, self._whole))
        if name == "origins-yaml":
            return origins_yaml(self.robot, self._whole)
        if name == "ur":
            return ur_yaml(self.robot, self.origins, kinematics_hash)
        if name == "offsets":
            return offsets_yaml(self.robot, self.origins, self.loss)
        if name in ASIDE:
            return self._with_links(zeros_aside_urdf(name, self.robot, self._whole))
        if name in MAKERS:
            return maker_yaml(name, self.robot, self.origins)
        if name == "tesseract":
            return tesseract_yaml(self._whole)
        if name == "xacro":
            return self.sources(split).unified
        raise UsageError(no_format(name))

    @property
    def _whole(self) -> dict[str, SE3]:
        """Of calibrated joints, and of links that stand for frames."""
        return {**self.origins, **self.links}

    def _with_links(self, text: bytes) -> bytes:
        return with_frames(replace(self.robot.description, text=text), self.added)

    def warnings(self, plan: Deployment) -> tuple[str, ...]:
        """What keeps a format from carrying the whole calibration."""
        ur = ur_warnings(self.robot, self.origins) if "ur" in plan.places else ()
        whose = plan.ur_file.warnings(self.robot, self.origins) if plan.ur_file is not None else ()
        makers = (line for name in plan.places if name in MAKERS for line in maker_warnings(name, self.robot, self.origins))
        copied = self.sources(plan.sources.split).warnings if "xacro" in plan.places else ()
        return (*ur, *whose, *makers, *copied, *(self.loss.warnings if "offsets" in plan.places else ()))
