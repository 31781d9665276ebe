"""Python in a process of its own, for what may never end, take all memory or crash: how it is started, kept in bounds and ended."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from typing import IO


def started(command: str) -> subprocess.Popen[bytes]:
    """A Python that runs a command, to be written to and read from; it does not look for modules in the current folder.

    Raises:
        OSError: no process can be started.
    """
    return subprocess.Popen(
        [sys.executable, "-P", "-c", command],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )


def module_path() -> list[str]:
    """Where the caller finds its modules, whatever made it so; a child is told of it."""
    return [entry or os.getcwd() for entry in sys.path if isinstance(entry, str)]


def kill(child: subprocess.Popen[bytes]) -> None:
    """End a child with all that it started."""
    with contextlib.suppress(OSError):
        os.killpg(child.pid, signal.SIGKILL)


def ending(code: int) -> str:
    """How a process ended, in words."""
    return f"exit code {code}" if code >= 0 else f"killed by {signal.Signals(-code).name}"


def answers_alone(*silenced: int) -> IO[str]:
    """In the child: what was standard output, for its answers; what others write to these of its streams goes nowhere."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    with open(os.devnull, "r+") as nowhere:
        for stream in silenced:
            os.dup2(nowhere.fileno(), stream)
    return answers


def limit_memory(gigabytes: float) -> None:
    """In the child: bound the memory of this process."""
    import resource

    with contextlib.suppress(ValueError, OSError):  # macOS takes no such limit; the time limit stands there alone
        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        wanted = int(gigabytes * (1 << 30))
        resource.setrlimit(resource.RLIMIT_AS, (wanted if hard == resource.RLIM_INFINITY else min(wanted, hard), hard))
