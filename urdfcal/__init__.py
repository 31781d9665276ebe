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
    """Load the public names when one is first asked for: Pinocchio takes a while, and `urdfcal --help` does not need it."""
    if name.startswith("_") and name not in ("__all__", "__version__"):
        raise AttributeError(f"module 'urdfcal' has no attribute '{name}'")
    api = import_module("urdfcal.api")  # `from urdfcal import api` would ask this function again
    public = {public: getattr(api, public) for public in api.__all__} | {"__all__": api.__all__}
    if name not in public:
        raise AttributeError(f"module 'urdfcal' has no attribute '{name}'")
    globals().update(public)
    return public[name]


def __dir__() -> list[str]:
    """The public names, loaded or not, and no module or helper."""
    return sorted(__getattr__("__all__"))
