"""`rig.yaml`: what the user knows of his rig beyond the URDF. Narrows links, error models, noise and priors.

Every entry may be missing:

    screen: screen                     # links, if not named as usual
    lasers: [laser_1, laser_2]
    error_model: auto
    error_models: {joint3: offset}     # single joints
    estimate: [beams]
    noise: {spot_mm: 1.0, joint_deg: 0.05, point_mm: 0.1}  # also orientation_deg, distance_mm, inclination_deg ...
    priors: {joint: '1mm,0.1deg', mount: '20mm,2deg', screen: flat}
    reference: tracker                 # link that points and orientations are measured from
    instruments: {head: {link: head_camera, camera: head.yaml}, leica: {}}  # what columns such as hand@head.u, hand@leica.x name
    reference_known: false             # whether they are measured in that link's own frame
    target_known: false                # whether what is measured is the targets' links themselves
    target: tool0                      # link of figaroh's columns x1, y1 ...
    sockets: {distances_mm: {'*/0 - */1': 50}}
    boards: {board: '9x6:25mm'}        # links that are boards: inner corners and the side of a square; circles:4x11:20mm
    beams: {laser_1: [0.02, 0.47, 0.88]}  # in module axes, that the parameters below are relative to; another robot is refused
    parameters:
      joint3.d_alpha: {sigma_deg: 0.1}
      slm.trans_x: {value_mm: 2.5, sigma_mm: 0.2}
      joint*.d_a: {fixed: true}

Aliases and entries that stand twice are refused.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model, field_validator

from urdfcal.base.errors import RigError, did_you_mean
from urdfcal.base.files import read_yaml
from urdfcal.base.geometry import DEG, MM
from urdfcal.base.yaml_kinds import RIG, kind_of
from urdfcal.model.options import ModelOptions, ParameterPrior, parse_prior
from urdfcal.model.parameters import Kind, PriorScale
from urdfcal.robot.rig import Grid
from urdfcal.robot.urdf_xml import FARTHEST
from urdfcal.sensors.registry import WORDS

if TYPE_CHECKING:
    from urdfcal.robot.robot import Robot


Positive = Annotated[float, Field(ge=1e-9, le=FARTHEST, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, le=FARTHEST, allow_inf_nan=False)]
Finite = Annotated[float, Field(ge=-FARTHEST, le=FARTHEST, allow_inf_nan=False)]


_ROUNDING = 0.01 * DEG  # of angles that were typed into a URDF
_BOARD = re.compile(r"(circles:)?(\d+)x(\d+):(\d+\.?\d*)(mm|m)(?::(\d+\.?\d*)(mm|m))?")


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)  # until a file is read: it takes as long as a robot


class _JointNoise(_Strict):
    """Stated noise of the joints."""

    joint_deg: NotNegative | None = None
    joints_deg: dict[str, NotNegative] = {}

    def by_kind(self) -> dict[str, float]:
        """What is stated, by kind of reading: [m], [rad] or [px]."""
        stated = {kind: getattr(self, f"{kind}_{of.unit}") for kind, of in WORDS.items()}
        return {kind: value * WORDS[kind].size for kind, value in stated.items() if value is not None}


if TYPE_CHECKING:
    NoiseEntry = _JointNoise
else:  # with an entry for every kind that a sensor has
    _OF_SENSORS = {f"{kind}_{of.unit}": (Positive | None, None) for kind, of in WORDS.items()}
    NoiseEntry = create_model("NoiseEntry", __base__=_JointNoise, __doc__="Stated noise, by kind of reading.", **_OF_SENSORS)


class ParameterEntry(_Strict):
    """What is said of the parameters that a pattern matches; a translation in mm, a rotation in deg."""

    value_mm: Finite | None = None
    value_deg: Finite | None = None
    sigma_mm: Positive | None = None
    sigma_deg: Positive | None = None
    fixed: bool = False

    def prior(self) -> ParameterPrior:
        """The same in metres and radians."""
        mean = self.value_mm * MM if self.value_mm is not None else self.value_deg * DEG if self.value_deg is not None else None
        sigma = self.sigma_mm * MM if self.sigma_mm is not None else self.sigma_deg * DEG if self.sigma_deg is not None else None
        return ParameterPrior(mean, sigma, self.fixed)

    def unit(self) -> str:
        """`m`, `rad`, or empty where no number is stated."""
        lengths = self.value_mm is not None or self.sigma_mm is not None
        angles = self.value_deg is not None or self.sigma_deg is not None
        if lengths and angles:
            raise ValueError("a parameter is a length or an angle, not both; use _mm or _deg")
        return "m" if lengths else "rad" if angles else ""


class SocketsEntry(_Strict):
    """Known distances between sockets, by pattern: each * stands for the same text on both sides."""

    distances_mm: dict[str, Positive] = {}


class InstrumentEntry(_Strict):
    """Something that readings name: the link that it stands on, and its camera.yaml if it sees in pixels."""

    link: str = ""
    camera: str = ""


class RigFile(_Strict):
    """The whole file; every entry may be missing."""

    screen: str | None = None
    lasers: list[str] | None = None
    error_model: Literal["auto", "dh", "hayati", "placement", "offset"] | None = None
    error_models: dict[str, Literal["dh", "hayati", "placement", "offset"]] = {}
    estimate: list[Literal["beams", "beams4", "screen", "lens"]] = []
    noise: NoiseEntry = NoiseEntry.model_construct()
    priors: dict[Literal["joint", "mount", "screen", "beam", "reference", "target", "place"], str] = {}
    beams: dict[str, tuple[Finite, Finite, Finite]] = {}
    parameters: dict[str, ParameterEntry] = {}
    reference: str | None = None
    instruments: dict[str, InstrumentEntry] = {}
    reference_known: bool = False
    target_known: bool = False
    target: str | None = None
    sockets: SocketsEntry = SocketsEntry.model_construct()
    boards: dict[str, str] = {}

    @field_validator("priors")
    @classmethod
    def _readable(cls, priors: dict[Any, str]) -> dict[Any, str]:
        for text in priors.values():
            parse_prior(text)
        return priors

    @field_validator("boards")
    @classmethod
    def _grids(cls, boards: dict[str, str]) -> dict[str, str]:
        for text in boards.values():
            parse_grid(text)
        return boards

    @field_validator("beams")
    @classmethod
    def _directions(cls, beams: dict[str, Any]) -> dict[str, Any]:
        for laser, beam in beams.items():
            if not np.linalg.norm(beam) > 0:
                raise ValueError(f"the beam of {laser} has no direction")
        return beams

    @field_validator("parameters")
    @classmethod
    def _one_unit(cls, parameters: dict[str, ParameterEntry]) -> dict[str, ParameterEntry]:
        for entry in parameters.values():
            entry.unit()
        return parameters

    def prior_scales(self) -> dict[Kind, PriorScale]:
        """Standard deviations by group."""
        return {kind: parse_prior(text) for kind, text in self.priors.items()}

    def options(self) -> ModelOptions:
        """What is to be calibrated, as the file alone has it."""
        return ModelOptions(
            error_model=self.error_model or "auto",
            per_joint=self.error_models,
            estimate=tuple(self.estimate),
            priors=self.prior_scales(),
            single={pattern: entry.prior() for pattern, entry in self.parameters.items()},
            reference_known=self.reference_known,
            target_known=self.target_known,
        )

    def require_beams(self, robot: Robot, path: str | Path) -> None:
        """Refuse a robot whose beams are not those that the parameters are relative to: they would be counted twice, or not at all.

        Args:
            robot: The robot.
            path: This file, for the message.

        Raises:
            RigError: naming the laser.
        """
        for index, way in enumerate(robot.chain.laser_joints):
            laser, actual = way[-1].child, robot.chain.laser_axes(index)[:, 2]
            stated = np.array(self.beams.get(laser, actual))
            off = float(np.arctan2(np.linalg.norm(np.cross(stated, actual)), stated @ actual))
            if off > _ROUNDING:
                there, here = (", ".join(f"{part:.4f}" for part in beam) for beam in (stated / np.linalg.norm(stated), actual))
                raise RigError(
                    f"entry 'beams': the parameters are relative to a {laser} along ({there}) in the module, but {robot.name} has it along "
                    f"({here}), {off / DEG:.2f} deg beside; make the file for this robot with urdfcal module BENCH.csv --robot ROBOT",
                    path,
                )

    def grids(self) -> dict[str, Grid]:
        """Links that are boards."""
        return {link: parse_grid(text) for link, text in self.boards.items()}

    def cameras(self) -> list[Path]:
        """The files of its instruments' cameras."""
        return [Path(entry.camera) for entry in self.instruments.values() if entry.camera]

    def lengths(self) -> list[tuple[str, float]]:
        """Known distances between sockets: pattern and length, [m]."""
        return [(pattern, length * MM) for pattern, length in self.sockets.distances_mm.items()]


def parse_grid(text: str) -> Grid:
    """`9x6:25mm`, with a gap `12x8:30mm:9mm`, or `circles:4x11:20mm`.

    Raises:
        ValueError: the text is no board.
    """
    match = _BOARD.fullmatch(text.replace(" ", ""))
    if match is None or min(int(match[2]), int(match[3])) < 2 or not float(match[4]) > 0:
        raise ValueError(f"'{text}' is not a board; expected inner corners and the side of a square, such as 9x6:25mm")
    columns, rows, gap = int(match[2]), int(match[3]), match[6]
    if gap and match[1]:
        raise ValueError(
            f"'{text}' is not a board; of circles, expected columns, rows and the step between rows, such as circles:4x11:20mm"
        )
    if gap and (columns % 2 or rows % 2):
        raise ValueError(
            f"'{text}' is not a board; with a gap, squares have corners of their own: expected even numbers such as 12x8:30mm:9mm"
        )
    square, between = (float(length or 0) * (MM if unit == "mm" else 1.0) for length, unit in (match.group(4, 5), match.group(6, 7)))
    return Grid(columns, rows, square, between if gap else None, bool(match[1]))


def read_rig_file(path: str | Path) -> RigFile:
    """Read a rig.yaml.

    Raises:
        RigError: naming the file, the entry, what was found and what was expected.
    """
    file = read_yaml(path, RigError)
    if file.content is None:
        return RigFile()
    if not isinstance(file.content, dict):
        raise RigError(f"holds a {type(file.content).__name__}, expected entries such as `screen: wall`", path, file.line())
    try:
        return _beside(RigFile.model_validate(file.content), Path(path).parent)
    except ValidationError as error:
        if (kind := kind_of(file.content)) not in ("", RIG):
            raise RigError(f"is no rig file: it is {kind}", path) from None
        found = error.errors()[0]
        raise RigError(in_words(found, _entries), path, file.line(found["loc"])) from None


def _beside(rig: RigFile, folder: Path) -> RigFile:
    """The same with its cameras' files as they are seen from here: they are stated as seen from the file's own folder."""
    own = {
        name: entry.model_copy(update={"camera": str(folder / entry.camera)}) if entry.camera else entry
        for name, entry in rig.instruments.items()
    }
    return rig.model_copy(update={"instruments": own}) if own else rig


def in_words(found: Mapping[str, Any], known: Callable[[list[str]], list[str]]) -> str:
    """What pydantic found in a file, in words.

    Args:
        found: One of its errors.
        known: Tells of the steps to an entry which entries there may be.
    """
    steps = [str(step) for step in found["loc"] if step != "[key]"]
    if found["type"] == "extra_forbidden":
        return f"entry '{'.'.join(steps)}' is unknown{did_you_mean(steps[-1], known(steps[:-1]))}"
    value = found.get("input")
    shown = f", found {value!r}" if isinstance(value, str | int | float | bool) else ""
    return f"entry '{'.'.join(steps)}': {found['msg'].removeprefix('Value error, ')}{shown}"


def _entries(steps: list[str]) -> list[str]:
    """The entries that the file may have at some place."""
    kinds: dict[str, type[BaseModel]] = {
        "noise": NoiseEntry,
        "parameters": ParameterEntry,
        "instruments": InstrumentEntry,
        "sockets": SocketsEntry,
    }
    return list(kinds.get(steps[0] if steps else "", RigFile).model_fields)
