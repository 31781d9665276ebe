"""One road for long studies: a function over seeds, on as many processes as are wanted, taken up again where it was stopped.

    parser.add_argument(...)
    with_jobs(parser)
    runs = over(partial(run, robot), range(seeds), arguments)

What was made of a seed is kept with `--resume FOLDER`, under a hash of urdfcal's code, of the study's and of what the function was given:
a seed of other code or another case is never taken for this one.
"""

from __future__ import annotations

import argparse
import hashlib
import inspect
import os
import pickle
from collections.abc import Callable, Hashable, Sequence
from functools import cache, partial
from pathlib import Path
from typing import TypeVar

import urdfcal
from urdfcal.base.files import write_whole
from urdfcal.base.progress import counted
from urdfcal.cli.console import working_through
from urdfcal.fleet.spread import Lost, spread

Seed = TypeVar("Seed", bound=Hashable)
Made = TypeVar("Made")


def with_jobs(parser: argparse.ArgumentParser) -> None:
    """Options of every long study."""
    parser.add_argument("--jobs", type=int, default=1, help="processes (default 1)")
    parser.add_argument("--resume", type=Path, help="folder of what is made of each seed; what is there is not made again")


def over(work: Callable[[Seed], Made], seeds: Sequence[Seed], arguments: argparse.Namespace) -> list[Made]:
    """What a function makes of each seed, in their order.

    Args:
        work: A function of a module or script, or a `partial` of one; its randomness comes from the seed alone.
        seeds: Each is made once.
        arguments: With `jobs` and `resume`, of `with_jobs`.

    Raises:
        RuntimeError: the process ended in which a seed was at work.
    """
    kept = None if arguments.resume is None else arguments.resume / _name(work)
    made = {} if kept is None else {seed: _read(kept / f"{seed}.pickle") for seed in seeds if (kept / f"{seed}.pickle").is_file()}
    missing = [seed for seed in seeds if seed not in made]
    with working_through("studying", False), counted("seed", len(missing)) as advance:
        for place, own in spread(work, missing, arguments.jobs, loading=("urdfcal.api",)):
            if isinstance(own, Lost):
                raise RuntimeError(f"seed {missing[place]}: the process ended that worked at it: {own.why}")
            made[missing[place]] = own
            if kept is not None:
                kept.mkdir(parents=True, exist_ok=True)
                write_whole(kept / f"{missing[place]}.pickle", pickle.dumps(own))
            advance()
    return [made[seed] for seed in seeds]


def _read(file: Path) -> Made:
    return pickle.loads(file.read_bytes())


def _name(work: Callable[[Seed], Made]) -> str:
    """Of a folder: the function and a hash of all that decides what it makes of a seed."""
    function = work.func if isinstance(work, partial) else work
    given = (work.args, work.keywords) if isinstance(work, partial) else ()
    source = Path(inspect.getfile(function)).read_bytes()
    return f"{function.__name__}-{hashlib.sha256(b''.join((_code(), source, pickle.dumps(given)))).hexdigest()[:12]}"


@cache
def _code() -> bytes:
    files = sorted(Path(os.path.dirname(urdfcal.__file__)).rglob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).digest()
