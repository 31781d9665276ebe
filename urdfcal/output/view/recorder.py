"""meshcat without its server: what the viewer is told is kept here, and goes into a page whole.

meshcat's own server listens on every network interface and needs a process of its own; the page needs neither. What is used of meshcat
is imported here alone, since its imports warn of pyzmq's past. Pinocchio's display is not used: its import takes trimesh, viser and
SciPy along where they are.
"""

from __future__ import annotations

import base64
import gzip
import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)
    import meshcat.geometry as mg
    from meshcat.geometry import umsgpack
    from meshcat.servers.zmqserver import VIEWER_ROOT
    from meshcat.visualizer import Visualizer

__all__ = ["VIEWER_SCRIPT", "Collada", "Plane", "Recorder", "mg", "umsgpack"]

VIEWER_SCRIPT = Path(VIEWER_ROOT) / "main.min.js"
_REFERENCES = {"uuid", "geometry", "material", "map", "image"}


class Plane(mg.Geometry):  # type: ignore[misc]
    """A rectangle across z."""

    def __init__(self, width: float, height: float) -> None:
        super().__init__()
        self._size = (width, height)

    def lower(self, object_data: Any) -> dict[str, Any]:
        """As meshcat's viewer reads it."""
        return {"uuid": self.uuid, "type": "PlaneGeometry", "width": self._size[0], "height": self._size[1]}


class Collada(mg.ReferenceSceneElement):  # type: ignore[misc]
    """A Collada file with its textures, which the browser reads."""

    def __init__(self, text: str, textures: dict[str, str]) -> None:
        """Keep the file's text, and its textures as data: URIs by the names that they have in it."""
        super().__init__()
        self._text, self._textures, self._path, self._material = text, textures, "", None

    def send(self, node: Any, material: Any = None) -> None:
        """Put it at a node of the scene; a material stands for all that it has itself."""
        self._path, self._material = node.path.lower(), material
        node.window.send(self)

    def lower(self) -> dict[str, Any]:
        """As meshcat's viewer reads it."""
        file = {
            "uuid": self.uuid,
            "type": "_meshfile_object",
            "format": "dae",
            "data": self._text,
            "resources": self._textures,
            "matrix": np.eye(4).ravel().tolist(),
        }
        parts: dict[str, Any] = {"metadata": {"version": 4.5, "type": "Object"}, "geometries": [], "materials": [], "object": file}
        found = {"type": "set_object", "path": self._path, "object": parts}
        if self._material is not None:
            self._material.lower_in_object(found)
        return found


class Recorder:
    """Stands in for meshcat's window: keeps every command, packed as meshcat's viewer reads it; an animation as JSON."""

    def __init__(self) -> None:
        self._commands: list[bytes] = []
        self._names: dict[str, str] = {}

    def send(self, command: Any) -> None:
        """Keep one command."""
        data = command.lower()
        for geometry in data.get("object", {}).get("geometries", []) if data["type"] == "set_object" else []:
            if geometry["type"] == "_meshfile":  # the viewer calls this spelling of meshcat's Python side deprecated
                geometry["type"] = "_meshfile_geometry"
        if data["type"] == "set_animation":  # a hundred thousand numbers: JSON's C code is far quicker than msgpack's Python
            self._commands.append(json.dumps(data, separators=(",", ":"), allow_nan=False).encode())
        else:
            self._commands.append(umsgpack.packb(self._renamed(data)))

    def visualizer(self) -> Any:
        """Meshcat's Visualizer that draws into this."""
        return Visualizer(window=self)

    def packed(self) -> str:
        """All commands, each behind its length in four bytes, compressed, in base64."""
        content = b"".join(len(command).to_bytes(4, "little") + command for command in self._commands)
        return base64.b64encode(gzip.compress(content, 5, mtime=0)).decode()

    def _renamed(self, data: Any) -> Any:
        """The same with short names for meshcat's uuids, which hold the machine's address and the time: one scene, one page."""
        if isinstance(data, dict):
            return {
                key: self._short(value) if key in _REFERENCES and isinstance(value, str) else self._renamed(value)
                for key, value in data.items()
            }
        if isinstance(data, list) and data and isinstance(data[0], dict):
            return [self._renamed(entry) for entry in data]
        return data

    def _short(self, name: str) -> str:
        return self._names.setdefault(name, str(len(self._names)))
