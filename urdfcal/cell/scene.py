"""`scene.yaml`: what stands around a robot.

Every entry may be missing; lengths in mm, angles in deg, in the frame of a link:

    link: base_link                    # that the scene stands on; by default the robot's root
    boxes: {table: {size_mm: [800, 600, 40], xyz_mm: [0, 0, -30], rpy_deg: [0, 0, 0]}}
    cylinders: {post: {radius_mm: 40, length_mm: 900, xyz_mm: [500, 0, 450]}}   # along its own z
    planes: {floor: {normal: [0, 0, 1], xyz_mm: [0, 0, -700]}}                  # all behind it is solid
    meshes: {fixture: {file: fixture.stl, scale: 0.001, xyz_mm: [600, 0, 0]}}   # beside this file or below its folder
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import coal
import numpy as np
import pinocchio as pin
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from urdfcal.base.errors import RigError, RobotError
from urdfcal.base.files import read_yaml
from urdfcal.base.geometry import DEG, MM, SE3, pose
from urdfcal.calibration.rig_file import in_words
from urdfcal.cell.bodies import Bodies, mesh_from
from urdfcal.output.view.mesh_files import MeshFiles
from urdfcal.robot.robot import Robot

_FARTHEST = 1e6  # [mm]
_Length = Annotated[float, Field(gt=0, le=_FARTHEST, allow_inf_nan=False)]
_Number = Annotated[float, Field(ge=-_FARTHEST, le=_FARTHEST, allow_inf_nan=False)]
_Three = tuple[_Number, _Number, _Number]


class _Placed(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    xyz_mm: _Three = (0.0, 0.0, 0.0)
    rpy_deg: _Three = (0.0, 0.0, 0.0)

    @property
    def placement(self) -> SE3:
        """In the link that the scene stands on."""
        return pose(np.array(self.xyz_mm) * MM, np.array(self.rpy_deg) * DEG)


class BoxEntry(_Placed):
    """A box about its middle."""

    size_mm: tuple[_Length, _Length, _Length]


class CylinderEntry(_Placed):
    """A cylinder along z about its middle."""

    radius_mm: _Length
    length_mm: _Length


class PlaneEntry(BaseModel):
    """A wall or a floor: all behind it is solid."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    normal: _Three = (0.0, 0.0, 1.0)
    xyz_mm: _Three = (0.0, 0.0, 0.0)


class MeshEntry(_Placed):
    """A mesh, in metres unless a scale says otherwise."""

    file: str
    scale: _Length = 1.0


class SceneFile(BaseModel):
    """The whole file; every entry may be missing."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    link: str | None = None
    boxes: dict[str, BoxEntry] = {}
    cylinders: dict[str, CylinderEntry] = {}
    planes: dict[str, PlaneEntry] = {}
    meshes: dict[str, MeshEntry] = {}


_ENTRIES: dict[str, type[BaseModel]] = {"boxes": BoxEntry, "cylinders": CylinderEntry, "planes": PlaneEntry, "meshes": MeshEntry}


def add_scene(path: str | Path, robot: Robot, bodies: Bodies) -> None:
    """Put what a scene.yaml holds among the bodies.

    Raises:
        RigError: naming the file, the entry, what was found and what was expected.
        RobotError: the link that it stands on is none of the robot's.
    """
    path = Path(path)
    file = read_yaml(path, RigError)
    if not isinstance(file.content or {}, dict):
        raise RigError(f"holds a {type(file.content).__name__}, expected entries such as `boxes:`", path, file.line())
    try:
        scene = SceneFile.model_validate(file.content or {})
    except ValidationError as error:
        found = error.errors()[0]
        raise RigError(in_words(found, _known), path, file.line(found["loc"])) from None
    link = robot.tree.require_link(scene.link) if scene.link else robot.tree.root
    files = MeshFiles(replace(robot.description, path=path.absolute()))
    for kind in _ENTRIES:
        for name, entry in getattr(scene, kind).items():
            try:
                placement, form = _solid(entry, files)
            except RobotError as error:
                raise RigError(f"entry '{kind}.{name}': {error}", path, file.line((kind, name))) from None
            bodies.add(robot, link, f"{kind}.{name}", placement, form)


def _solid(entry: Any, files: MeshFiles) -> tuple[SE3, Any]:
    if isinstance(entry, BoxEntry):
        return entry.placement, coal.Box(*(np.array(entry.size_mm) * MM).tolist())
    if isinstance(entry, CylinderEntry):
        return entry.placement, coal.Cylinder(entry.radius_mm * MM, entry.length_mm * MM)
    if isinstance(entry, MeshEntry):
        return entry.placement, mesh_from(files.find(entry.file), (entry.scale,) * 3)
    length = float(np.linalg.norm(entry.normal))
    if not length:
        raise RobotError("normal is 0, 0, 0, expected a direction that leads out of what is solid")
    return pin.SE3(np.eye(3), np.array(entry.xyz_mm) * MM), coal.Halfspace(np.array(entry.normal) / length, 0.0)


def _known(steps: list[str]) -> list[str]:
    """The entries that the file may have at some place."""
    return list(_ENTRIES.get(steps[0] if steps else "", SceneFile).model_fields)
