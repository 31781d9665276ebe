"""What libraries in C and C++ print past Python."""

from __future__ import annotations

import contextlib
import os
import sys
import tempfile
from collections.abc import Iterator


@contextlib.contextmanager
def native_stderr() -> Iterator[list[str]]:
    """Collect what native readers print straight to file descriptor 2."""
    said = [""]
    try:
        saved = os.dup(2)
    except OSError:  # there is no stderr to keep clean
        yield said
        return
    sys.stderr.flush()
    with tempfile.TemporaryFile() as sink:
        os.dup2(sink.fileno(), 2)
        try:
            yield said
        finally:
            os.dup2(saved, 2)
            os.close(saved)
            sink.seek(0)
            said[0] = sink.read().decode(errors="replace")
