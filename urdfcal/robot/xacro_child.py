"""xacro in a process of its own: a description's Python runs there, within a time and a memory that are stated.

It protects the caller from descriptions that never end or take all memory, not from malice: the child may do what the user may.
"""

from __future__ import annotations

import base64
import contextlib
import json
import signal
import subprocess
from collections.abc import Iterator, Mapping, Sequence
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


@dataclass(frozen=True)
class Variant:
    """What became of a xacro file with other content of its sources.

    Attributes:
        text: The expanded document; None where it cannot be expanded.
        fault: Why it cannot be.
        files: All files that were read for it, YAML too.
    """

    text: bytes | None
    fault: str
    files: tuple[Path, ...]


def variants(
    path: Path,
    xacro_args: Mapping[str, str],
    package_dirs: tuple[Path, ...],
    limit: XacroLimit,
    overlays: Sequence[Mapping[str, bytes]],
) -> list[Variant]:
    """Expand a xacro file many times in one process, each time with other content of some of the files that are read for it.

    Args:
        path: The xacro file.
        xacro_args: Values of `<xacro:arg>`.
        package_dirs: Folders in which `$(find pkg)` looks first.
        limit: Time that each expansion, and memory that all, may take.
        overlays: Content by a file's real path, once for each expansion; other files are read as they are.

    Raises:
        RobotError: the process gave no answer.
    """
    request = {
        "sys_path": module_path(),
        "path": str(path),
        "xacro_args": dict(xacro_args),
        "package_dirs": [str(folder) for folder in package_dirs],
        "gigabytes": limit.gigabytes,
        "seconds": limit.seconds,
        "overlays": [{name: base64.b64encode(content).decode() for name, content in overlay.items()} for overlay in overlays],
    }
    whole = XacroLimit(limit.seconds * (len(overlays) + 1), limit.gigabytes)
    answer = _answer(json.dumps(request).encode(), path, whole)
    if "error" in answer:
        raise RobotError(answer["error"])
    return [
        Variant(base64.b64decode(each["text"]) if "text" in each else None, each.get("error", ""), tuple(map(Path, each.get("files", ()))))
        for each in answer["variants"]
    ]


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
    answer = {"variants": list(_variants(request))} if "overlays" in request else _expand(request, None)
    json.dump({**answer, "opened": opened.opened()}, answer_to)
    answer_to.close()


def _variants(request: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    for overlay in request["overlays"]:
        with _alarm(request["seconds"]):
            yield _expand(request, {name: base64.b64decode(content) for name, content in overlay.items()})


@contextlib.contextmanager
def _alarm(seconds: float) -> Iterator[None]:
    """An error in here after so much time, as one variant of a description may never end though the description does."""

    def late(*_: object) -> None:
        raise TimeoutError(f"not expanded after {seconds:g} s")

    signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def _expand(request: Mapping[str, Any], overlay: Mapping[str, bytes] | None) -> dict[str, Any]:
    from urdfcal.robot.xacro_text import expand

    path = Path(request["path"])
    try:
        text, files = expand(path, request["xacro_args"], tuple(map(Path, request["package_dirs"])), overlay)
    except MemoryError:
        return {"error": str(RobotError(f"xacro: takes more than {request['gigabytes']:g} GB of memory{_WAY_OUT}", path))}
    except RobotError as error:
        return {"error": str(error)}
    if len(text) > DESCRIPTION:
        return {"error": str(RobotError(f"xacro: expands to more than {DESCRIPTION >> 20} MB, which no robot needs", path))}
    return {"text": base64.b64encode(text).decode(), "files": [str(file) for file in files]}
