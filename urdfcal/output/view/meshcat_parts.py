"""What is used of meshcat and of Pinocchio's display, imported in one place, since meshcat's imports warn of pyzmq's past."""

from __future__ import annotations

import warnings
from pathlib import Path

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)
    import meshcat.geometry as mg
    from meshcat.geometry import umsgpack
    from meshcat.servers.zmqserver import VIEWER_ROOT
    from meshcat.visualizer import Visualizer
    from pinocchio.visualize import MeshcatVisualizer
    from pinocchio.visualize.meshcat_visualizer import Plane, loadMesh

VIEWER_SCRIPT = Path(VIEWER_ROOT) / "main.min.js"

__all__ = ["VIEWER_SCRIPT", "MeshcatVisualizer", "Plane", "Visualizer", "loadMesh", "mg", "umsgpack"]
