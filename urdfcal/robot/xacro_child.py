"""xacro in a process of its own: a description's Python runs there, within a time and a memory that are stated.

It protects the caller from descriptions that never end or take all memory, not from malice: the child may do what the user may.
"""

from __future__ import annotations

import base64
import json
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from urdfcal.base import opened
from urdfcal.base.child import answers_alone, ending, kill, limit_memory, module_path, started
from urdfcal.base.errors import RobotError
from urdfcal.base.reading import DESCRIPTION

# the caller's path comes with the request
_COMMAND = "import json, sys; r = json.load(sys.stdin); sys.path[:] = r['sys_path']; import urdfcal.robot.xacro_child as x; x.main(r)"
_WAY_OUT = "; allow more with --xacro-limit if this is as it should be"


@dataclass(frozen=True)
class XacroLimit:
    """What the expansion of a xacro file may take.

    Attributes:
        seconds: By the clock.
        gigabytes: Of memory, where the system can limit it.
    """

    seconds: float = 60.0
    gigabytes: float = 4.0


USUAL_LIMIT = XacroLimit()


@dataclass(frozen=True)
class Expanded:
    """What became of a xacro file.

    Attributes:
        text: The expanded document.
        files: All files that were read for it, the file itself first.
    """

    text: bytes
    files: tuple[Path, ...]


def expanded(path: Path, xacro_args: Mapping[str, str], package_dirs: tuple[Path, ...], limit: XacroLimit) -> Expanded:
    """Expand a xacro file in a process of its own.

    Raises:
        RobotError: xacro cannot expand it, or not within the limit.
    """
    request = {
        "sys_path": module_path(),
        "path": str(path),
        "xacro_args": dict(xacro_args),
        "package_dirs": [str(folder) for folder in package_dirs],
        "gigabytes": limit.gigabytes,
    }
    answer = _answer(json.dumps(request).encode(), path, limit)
    opened.note(answer["opened"])  # YAML that a macro loads is an input, too
    if "error" in answer:
        raise RobotError(answer["error"])
    return Expanded(base64.b64decode(answer["text"]), tuple(map(Path, answer["files"])))


def _answer(request: bytes, path: Path, limit: XacroLimit) -> Any:
    try:
        child = started(_COMMAND)
    except OSError as error:
        raise RobotError(f"xacro: no process can be started for it: {error.strerror or error}", path) from None
    try:
        said, _ = child.communicate(request, timeout=limit.seconds)
        return json.loads(said)
    except subprocess.TimeoutExpired:
        raise RobotError(f"xacro: not expanded after {limit.seconds:g} s{_WAY_OUT}", path) from None
    except ValueError:  # no answer: killed, or ended by the file's own Python
        raise RobotError(f"xacro: its process ended without a result ({ending(child.wait())})", path) from None
    finally:
        kill(child)
        child.communicate()


def main(request: Mapping[str, Any]) -> None:
    """Answer one request, on what was standard output; what the file's own Python prints goes nowhere."""
    answer_to = answers_alone(0, 1, 2)
    limit_memory(request["gigabytes"])
    opened.begin()
    answer = _expand(request)
    json.dump({**answer, "opened": opened.opened()}, answer_to)
    answer_to.close()


def _expand(request: Mapping[str, Any]) -> dict[str, Any]:
    from urdfcal.robot.xacro_text import expand

    path = Path(request["path"])
    try:
        text, files = expand(path, request["xacro_args"], tuple(map(Path, request["package_dirs"])))
    except MemoryError:
        return {"error": str(RobotError(f"xacro: takes more than {request['gigabytes']:g} GB of memory{_WAY_OUT}", path))}
    except RobotError as error:
        return {"error": str(error)}
    if len(text) > DESCRIPTION:
        return {"error": str(RobotError(f"xacro: expands to more than {DESCRIPTION >> 20} MB, which no robot needs", path))}
    return {"text": base64.b64encode(text).decode(), "files": [str(file) for file in files]}
