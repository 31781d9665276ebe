"""What the files of each format are called."""

from __future__ import annotations

from pathlib import Path

from urdfcal.base.files import YAML_ENDINGS

ENDINGS = {
    "urdf": "_calibrated.urdf",
    "origins-yaml": "_origins.yaml",
    "ur": "_kinematics.yaml",
    "offsets": "_offsets.yaml",
    "rising": "_rising.urdf",
    "ros2-control": "_ros2_control.urdf",
    "xarm": "_xarm_kinematics.yaml",
    "franka": "_franka_kinematics.yaml",
    "flexiv": "_flexiv_kinematics.yaml",
    "tesseract": "_tesseract.yaml",
    "xacro": "_xacro.patch",
}
PATCHES = (".patch", ".diff")


def stem_of(path: Path) -> str:
    """A file's name without the endings that urdfcal gives: `arm` for `arm_calibrated.urdf`, `arm.urdf` and `arm_offsets.yaml`."""
    for ending in sorted(ENDINGS.values(), key=len, reverse=True):
        if path.name.endswith(ending) and path.name != ending:
            return path.name.removesuffix(ending)
    return path.stem if path.suffix in (".urdf", *YAML_ENDINGS, *PATCHES) else path.name
