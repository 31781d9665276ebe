"""What is said to the user: results to stdout, progress and warnings to stderr."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import RenderableType


def show(machine: Mapping[str, Any] | None, blocks: Iterable[RenderableType]) -> None:
    """Print a command's result: JSON if there is any, else the blocks."""
    if machine is not None:
        print(json.dumps(machine, indent=2))
        return
    from urdfcal.base.terminal import as_text

    print(as_text(blocks), end="")


def finish(machine: Mapping[str, Any] | None, text: str, quiet: bool) -> None:
    """What a command that prints no table says at its end."""
    if machine is not None:
        print(json.dumps(machine, indent=2))
    else:
        say(not quiet, text, sys.stdout)


def say(wanted: bool, text: str, stream: Any = None) -> None:
    """One line to stderr, or to `stream`, if it is wanted."""
    if wanted:
        print(text, file=stream or sys.stderr)


def asked_quiet() -> bool:
    """Whether the command line asks for no warnings, for what is said before or after its options are known."""
    return bool({"-q", "--quiet"} & set(sys.argv))


def warn(lines: Iterable[str], quiet: bool) -> None:
    """Warnings to stderr, each on a line of its own."""
    for line in lines:
        say(not quiet, f"urdfcal: warning: {' '.join(line.split())}")


class ProgressBar:
    """A progress bar on stderr, where somebody looks at it."""

    def __init__(self, what: str, total: int, quiet: bool) -> None:
        self.what, self.total, self.quiet = what, total, quiet or not sys.stderr.isatty()

    def __enter__(self) -> Callable[[], None]:
        if self.quiet:
            return lambda: None
        from rich.console import Console
        from rich.progress import Progress

        from urdfcal.cli.streams import raw

        self.bar = Progress(console=Console(file=raw(sys.stderr)), transient=True)
        self.bar.start()
        task = self.bar.add_task(self.what, total=self.total)
        return lambda: self.bar.advance(task)

    def __exit__(self, *_: object) -> None:
        if not self.quiet:
            self.bar.stop()
