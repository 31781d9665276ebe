"""What is said to the user: results to stdout, progress and warnings to stderr."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from urdfcal.base.progress import listening

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.progress import TaskID


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
    """One line to stderr, or to `stream`, if it is wanted; a terminal has it broken between words."""
    stream = stream or sys.stderr
    if wanted:
        print(fitting(text, stream), file=stream)


def fitting(text: str, stream: Any) -> str:
    """A text as it is told on a stream: on a terminal broken between words, elsewhere as it is."""
    from urdfcal.base.breaking import between_words

    return "\n".join(between_words(text, shutil.get_terminal_size().columns)) if stream.isatty() else text


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
    """What is being done and how long it has taken so far, on stderr, where somebody looks at it.

    What is counted meanwhile (`base.progress`) stands below it: how many of how many, and the time to go where that is known.
    """

    def __init__(self, what: str, quiet: bool) -> None:
        self.what, self.quiet = what, quiet or not sys.stderr.isatty()

    def __enter__(self) -> None:
        if self.quiet:
            return
        from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

        columns = SpinnerColumn(), TextColumn("{task.description}"), TextColumn("{task.fields[count]}"), TimeElapsedColumn()
        self.bar = Progress(*columns, TextColumn("{task.fields[left]}"), console=_terminal(), transient=True, speed_estimate_period=_LONG)
        self.heard = listening(self)
        self.tasks: dict[Callable[[], None], TaskID] = {}
        self.bar.start()
        self.bar.add_task(self.what, total=None, count="", left="")
        self.heard.__enter__()

    def __exit__(self, *_: object) -> None:
        if not self.quiet:
            self.heard.__exit__(None, None, None)
            self.bar.stop()

    def begin(self, what: str, total: int | None) -> Callable[[], None]:
        """Show a line of something that is counted, below those that it is part of."""
        from urdfcal.cli.pace import Pace

        task = self.bar.add_task(f"{'  ' * (1 + len(self.tasks))}{what}", total=total, count=_count(0, total), left="")
        pace = Pace(what, total or 0)

        def advance() -> None:
            pace.step()
            self.bar.advance(task)
            self.bar.update(task, count=_count(pace.done, total), left=", ".join(filter(None, (pace.rate, pace.left))) if total else "")

        self.tasks[advance] = task
        return advance

    def end(self, advance: Callable[[], None]) -> None:
        """Take the line away."""
        self.bar.remove_task(self.tasks.pop(advance))


@contextmanager
def working_through(what: str, quiet: bool) -> Iterator[None]:
    """The same for what may take hours: a log has a line now and then, with the rate and the time to go."""
    from urdfcal.cli.pace import Logged

    if quiet or sys.stderr.isatty():
        with Working(what, quiet):
            yield
        return
    with listening(Logged(lambda line: say(True, f"urdfcal: {line}"))):
        yield


def _count(done: int, total: int | None) -> str:
    return f"{done} of {total}" if total else str(done)


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
