"""What the files of each format are called."""

from __future__ import annotations

from pathlib import Path

from urdfcal.base.errors import did_you_mean
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
_KEPT = "its controllers keep their geometry; urdfcal correct changes what they are told, --format urdf what you plan with"
_ONTO = "urdfcal apply ROBOT CALIBRATION --onto MODEL puts a calibration on a model of yours"
_KINOVA = "Kinova's drivers read no geometry of a single arm; kortex_description has it in the arm's macro, which --format xacro changes"
_PAL = (
    "how PAL's robots read master_calibration.yaml is not public; the offsets in the calibration xacros of their descriptions, such as "
    "TALOS has, are what --format xacro changes"
)
ELSEWHERE = {  # names that are asked for, and what there is instead
    **dict.fromkeys(("kinova", "kortex", "gen3"), _KINOVA),
    **dict.fromkeys(("pal", "tiago", "talos", "master-calibration"), _PAL),
    **dict.fromkeys(("abb", "kuka", "fanuc", "staubli", "yaskawa", "motoman", "doosan", "denso"), _KEPT),
    **dict.fromkeys(("mjcf", "mujoco", "sdf", "gazebo"), _ONTO),
}
PATCHES = (".patch", ".diff")


def no_format(name: str) -> str:
    """What to say of a format that there is not."""
    own = ELSEWHERE.get(name.lower().replace("_", "-"))
    return f"no format '{name}': {own}" if own else f"no format '{name}'{did_you_mean(name, ENDINGS)}"


def stem_of(path: Path) -> str:
    """A file's name without the endings that urdfcal gives: `arm` for `arm_calibrated.urdf`, `arm.urdf` and `arm_offsets.yaml`."""
    for ending in sorted(ENDINGS.values(), key=len, reverse=True):
        if path.name.endswith(ending) and path.name != ending:
            return path.name.removesuffix(ending)
    return path.stem if path.suffix in (".urdf", *YAML_ENDINGS, *PATCHES) else path.name
