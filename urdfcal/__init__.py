"""urdfcal: the real geometry of a robot arm, from measurements, back into its URDF.

robot = urdfcal.load_robot("arm7.urdf.xacro")
data = urdfcal.read_measurements("measurements.csv", robot)
calibration = urdfcal.fit(robot, data)
model = calibration.apply_to(robot.model)
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from urdfcal.api import *  # noqa: F403


def __getattr__(name: str) -> Any:
    """Load a public name when it is first asked for: Pinocchio takes a while, and `urdfcal --help` does not need it."""
    if name.startswith("_") and name not in ("__all__", "__version__"):
        raise AttributeError(f"module 'urdfcal' has no attribute '{name}'")
    api = import_module("urdfcal.api")  # `from urdfcal import api` would ask this function again
    if name not in ("__all__", *api.__all__):
        raise AttributeError(f"module 'urdfcal' has no attribute '{name}'")
    globals()[name] = getattr(api, name)
    return globals()[name]


def __dir__() -> list[str]:
    """The public names, loaded or not, and no module or helper."""
    return sorted(__getattr__("__all__"))
