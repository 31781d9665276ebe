"""The same work in one process and in several."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from urdfcal.base.errors import UsageError
from urdfcal.fleet.spread import Lost, spread

ROOT = Path(__file__).parents[2]


def squared(number: int) -> tuple[int, int, str, bool]:
    """A square, which process made it, how many threads its matrices may have, and whether something was loaded there before."""
    if number == 13:
        os.kill(os.getpid(), signal.SIGKILL)
    return number**2, os.getpid(), os.environ.get("OPENBLAS_NUM_THREADS", ""), "colorsys" in sys.modules


def test_one_process_is_this_one() -> None:
    """What is made comes in order, without dask."""
    assert [(place, made) for place, made in spread(lambda number: number**2, [3, 1, 2], workers=1)] == [(0, 9), (1, 1), (2, 4)]


def test_several_processes_make_the_same_and_what_dies_is_named_alone() -> None:
    """Every place has its square, made elsewhere with one thread; the batch in which a process is killed is lost, and nothing else."""
    pytest.importorskip("distributed")
    numbers, method = [*range(10), 13, *range(20, 26)], multiprocessing.get_start_method()
    made = dict(spread(squared, numbers, workers=2))
    assert sorted(made) == list(range(len(numbers)))
    lost = [numbers[place] for place, own in made.items() if isinstance(own, Lost)]
    assert lost == [13]
    squares = [own for own in made.values() if not isinstance(own, Lost)]
    assert sorted(own[0] for own in squares) == sorted(number**2 for number in numbers if number != 13)
    assert {own[2] for own in squares} == {"1"}
    assert multiprocessing.get_start_method() == method
    assert os.getpid() not in {own[1] for own in squares}


def test_processes_are_copies_of_one_that_has_loaded_what_the_work_wants() -> None:
    """Also the process that comes for one that was killed; asked in a new process, since one fork server serves all of a process's life."""
    pytest.importorskip("distributed")
    asked = (
        "from tests.fleet.test_spread import squared; from urdfcal.fleet.spread import Lost, spread\n"
        "if __name__ == '__main__':\n"
        "    made = dict(spread(squared, [*range(10), 13, *range(20, 26)], workers=2, loading=('colorsys',)))\n"
        "    print([own[3] for own in made.values() if not isinstance(own, Lost)])"
    )
    done = subprocess.run([sys.executable, "-c", asked], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[0] == str([True] * 16)


def test_a_scheduler_that_is_none_is_named() -> None:
    """With its address, before any work is done."""
    pytest.importorskip("distributed")
    with pytest.raises(UsageError, match="--scheduler nowhere://x: does not answer"):
        list(spread(squared, [1, 2], scheduler="nowhere://x"))
