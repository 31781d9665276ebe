"""Meshes are first read in a process of its own: what ends that one, or takes all its time or memory, is no mesh to be shown.

Assimp is C++ and reads files of strangers. A few broken bytes (an array that states a billion numbers) make it take 12 GB, and others
of its readers have crashed before. The child reads one file after the other, so that it starts once.
"""

from __future__ import annotations

import atexit
import contextlib
import json
import select
import subprocess
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import IO, Any

from urdfcal.base.child import answers_alone, ending, kill, limit_memory, module_path, started

SECONDS, GIGABYTES = 60.0, 3.0  # for one file; the largest that are taken, see mesh_files, need about 5 s and 1 GB
# the caller's path comes first
_COMMAND = "import json, sys; sys.path[:] = json.loads(sys.stdin.readline()); import urdfcal.output.view.mesh_child as m; m.main()"
_running: list[subprocess.Popen[bytes]] = []
_read: dict[tuple[str, int, int], str] = {}  # what was said of a file, by its path, size and time


def faults(paths: Iterable[Path]) -> Mapping[Path, str]:
    """Why meshes cannot be read, by their files; those that can be are not in it."""
    said = {path: _said(path) for path in dict.fromkeys(paths)}
    return {path: fault for path, fault in said.items() if fault}


def _said(path: Path) -> str:
    stat = path.stat()
    key = (str(path), stat.st_size, stat.st_mtime_ns)
    if key not in _read:
        _read[key] = _asked(path)
    return _read[key]


def _asked(path: Path) -> str:
    """What the child says of a file, or how it ended over it."""
    try:
        child = _child()
        assert child.stdin is not None
        assert child.stdout is not None
        child.stdin.write(json.dumps(str(path)).encode() + b"\n")
        child.stdin.flush()
        answer = child.stdout.readline() if select.select([child.stdout], [], [], SECONDS)[0] else None
    except OSError as error:
        _stop()
        return f"no process can read it: {error.strerror or error}"
    if answer is None:
        _stop()
        return f"not read after {SECONDS:g} s"
    if not answer.endswith(b"\n"):
        return f"the process that read it ended ({ending(_stop())})"
    fault = str(json.loads(answer))
    if fault:
        _stop()  # what a reader that gave up has left in its memory is not kept
    return fault


def _child() -> subprocess.Popen[bytes]:
    if not _running:
        atexit.register(_stop)
        child = started(_COMMAND)
        _running.append(child)
        assert child.stdin is not None
        child.stdin.write(json.dumps(module_path()).encode() + b"\n")
    return _running[0]


def _stop() -> int:
    """End the child; its exit code, had it one of its own."""
    atexit.unregister(_stop)
    if not _running:
        return 0
    child = _running.pop()
    with contextlib.suppress(subprocess.TimeoutExpired):
        child.wait(0.2 if _closed(child.stdout) else 0)
    kill(child)
    for stream in (child.stdin, child.stdout):
        with contextlib.suppress(OSError):
            assert stream is not None
            stream.close()
    return child.wait()


def _closed(stream: IO[bytes] | None) -> bool:
    """Whether the other end of a pipe is gone: its process is ending by itself."""
    return stream is not None and bool(select.select([stream], [], [], 0)[0])


def main() -> None:
    """Answer requests, on what was standard output, until there are no more."""
    answer_to = answers_alone(1, 2)
    limit_memory(GIGABYTES)
    for line in sys.stdin:
        answer_to.write(json.dumps(_fault(json.loads(line))) + "\n")
        answer_to.flush()


def _fault(path: str) -> Any:
    import coal
    import numpy as np

    try:
        coal.MeshLoader().load(path, np.ones(3))
    except MemoryError:
        return f"takes more than {GIGABYTES:g} GB of memory"
    except (ValueError, RuntimeError) as error:
        return str(error)
    return ""
