"""The files that users name, read in one place: regular files, of a size that one of their kind can have.

A device gives without end, and a pipe may give nothing for ever; what a command reads twice, or compares with what it wrote, is in a file.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path

from urdfcal.base.errors import InputError

DESCRIPTION, TABLE, YAML, PICTURE = 64 << 20, 256 << 20, 16 << 20, 256 << 20  # [byte] the most that a file of each kind may have
PROGRAM = 64 << 20
_KINDS = (
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)


def content_of(path: str | Path, most: int, error: type[InputError] = InputError) -> bytes:
    """The bytes of a regular file.

    Args:
        path: The file.
        most: How many bytes it may have: one of the sizes above.
        error: What is raised if it is not taken.
    """
    try:
        _refuse_odd(os.stat(path).st_mode, path, error)
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK)  # a pipe put there since would keep us waiting
        with os.fdopen(handle, "rb") as stream:
            _refuse_odd(os.fstat(handle).st_mode, path, error)
            content = stream.read(most + 1)
    except OSError as trouble:
        raise error(f"cannot be read: {trouble.strerror or trouble}", path) from None
    if len(content) > most:
        raise error(f"has more than {most >> 20} MB, which no such file needs", path)
    return content


def _refuse_odd(mode: int, path: str | Path, error: type[InputError]) -> None:
    for is_it, what in _KINDS:
        if is_it(mode):
            raise error(f"is {what}, expected a regular file; write what it gives to a file first", path)
