"""What is said to the user: results to stdout, progress and warnings to stderr."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console, RenderableType


def show(machine: Mapping[str, Any] | None, blocks: Iterable[RenderableType]) -> None:
    """Print a command's result: JSON if there is any, else the blocks."""
    if machine is not None:
        print(json.dumps(machine, indent=2))
        return
    from urdfcal.base.terminal import as_text

    print(as_text(blocks, shutil.get_terminal_size().columns if sys.stdout.isatty() else 0), end="")


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


_LONG = 3600.0  # [s] over which the speed of progress is taken; steps may take minutes


def _terminal() -> Console:
    """Where progress is shown."""
    from rich.console import Console

    from urdfcal.cli.streams import raw

    return Console(file=raw(sys.stderr))


class Working:
    """What is being done and how long it has taken so far, on stderr, where somebody looks at it."""

    def __init__(self, what: str, quiet: bool) -> None:
        self.what, self.quiet = what, quiet or not sys.stderr.isatty()

    def __enter__(self) -> None:
        if self.quiet:
            return
        from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

        columns = SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn()
        self.bar = Progress(*columns, console=_terminal(), transient=True)
        self.bar.start()
        self.bar.add_task(self.what, total=None)

    def __exit__(self, *_: object) -> None:
        if not self.quiet:
            self.bar.stop()


class ProgressBar:
    """A progress bar on stderr, where somebody looks at it."""

    def __init__(self, what: str, total: int, quiet: bool) -> None:
        self.what, self.total, self.quiet = what, total, quiet or not sys.stderr.isatty()

    def __enter__(self) -> Callable[[], None]:
        if self.quiet:
            return lambda: None
        from rich.progress import Progress

        self.bar = Progress(console=_terminal(), transient=True, speed_estimate_period=_LONG)
        self.bar.start()
        task = self.bar.add_task(self.what, total=self.total)
        self.bar.advance(task, 0)  # from here the time to go is counted, so that one step is enough to know it
        return lambda: self.bar.advance(task)

    def __exit__(self, *_: object) -> None:
        if not self.quiet:
            self.bar.stop()
