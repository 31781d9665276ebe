"""The same work for many things, in one process or in several: dask's local cluster, or one that exists.

Workers have one BLAS thread each, since matrices are small, and none of dask's own observers: its profiler and its clock, which look
at a worker a hundred times a second, had cost a fifth of the time of a fit.
Their processes are copies of one that has loaded what the work wants, which goes on while dask itself is loaded here.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from importlib import import_module
from multiprocessing import forkserver
from typing import Any, TypeVar

from urdfcal.base.errors import UsageError
from urdfcal.base.garbage import look_seldom

Item = TypeVar("Item")
Made = TypeVar("Made")

_BATCHES = 8  # a worker, where there are few things
_LARGEST = 4  # what is in flight is lost where a worker dies, and the last batch is waited for
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
_DASK = {
    "distributed.worker.multiprocessing-method": None,  # that of `multiprocessing`: dask's own fork server wants pandas loaded here
    "distributed.scheduler.allowed-failures": 1,
    "distributed.scheduler.worker-saturation": 1.0,  # none waits at a worker, to be blamed where that dies
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "2s",
    "distributed.admin.tick.limit": "1h",
    "distributed.admin.system-monitor.interval": "10s",
}


@dataclass(frozen=True)
class Lost:
    """What came of something whose process ended.

    Attributes:
        why: In a line.
    """

    why: str


def spread(
    work: Callable[[Item], Made],
    items: Sequence[Item],
    workers: int | None = None,
    scheduler: str | None = None,
    *,
    loading: Sequence[str] = (),
) -> Iterator[tuple[int, Made | Lost]]:
    """What a function makes of each, as it comes, with its place among them.

    Args:
        work: What is done; it is sent to other processes, as are the items.
        items: What it is done with.
        workers: Processes; by default one a core. One is this one.
        scheduler: Address of a dask scheduler that is there, `tcp://host:8786`.
        loading: Modules that the work loads, by their names.

    Raises:
        UsageError: several processes are wanted where dask is not installed or cannot start them, or the scheduler does not answer.
        Exception: what the work raises.
    """
    count = workers or os.cpu_count() or 1
    if scheduler is None and (count == 1 or len(items) < 2):
        yield from ((place, work(item)) for place, item in enumerate(items))
        return
    with ExitStack() as stack:
        client, distributed = _client(stack, min(count, len(items)), scheduler, loading)
        batches = {
            client.submit(_each, work, [items[place] for place in batch], pure=False): batch for batch in _batches(len(items), count)
        }
        for task in distributed.as_completed(list(batches)):
            made = _made(task, distributed)
            yield from zip(batches[task], [made] * len(batches[task]) if isinstance(made, Lost) else made, strict=True)


def _each(work: Callable[[Item], Made], items: Sequence[Item]) -> list[Made]:
    look_seldom()
    return [work(item) for item in items]


def _batches(count: int, workers: int) -> list[range]:
    size = max(1, min(_LARGEST, count // (workers * _BATCHES)))
    return [range(start, min(start + size, count)) for start in range(0, count, size)]


def _client(stack: ExitStack, workers: int, scheduler: str | None, loading: Sequence[str]) -> tuple[Any, Any]:
    try:
        if scheduler is None:
            _copied(stack, ("distributed", *loading))
        return _connected(stack, workers, scheduler)
    except ImportError:
        raise UsageError("several processes want dask: pip install 'urdfcal[fleet]', or use --workers 1") from None
    except (OSError, ValueError, TimeoutError, RuntimeError) as error:
        said = " ".join(str(error).split()) or type(error).__name__
        if scheduler is not None:
            raise UsageError(f"--scheduler {scheduler}: does not answer: {said}") from None
        raise UsageError(f"{workers} processes cannot be started here: {said}; --workers 1 does without") from None


def _copied(stack: ExitStack, loading: Sequence[str]) -> None:
    """Have processes begin as copies of one that has loaded some modules, and have that one begin now."""
    os.environ.update(_ONE_THREAD)  # before it loads its matrices
    stack.callback(multiprocessing.set_start_method, multiprocessing.get_start_method(), force=True)
    multiprocessing.set_start_method("forkserver", force=True)
    multiprocessing.set_forkserver_preload(list(loading))
    forkserver.ensure_running()


def _connected(stack: ExitStack, workers: int, scheduler: str | None) -> tuple[Any, Any]:
    dask, distributed = import_module("dask"), import_module("distributed")
    stack.enter_context(dask.config.set(_DASK))
    seen = {"dashboard": False, "dashboard_address": "127.0.0.1:0"}  # any port, so that two fleets do not meet at one
    own = {"n_workers": workers, "threads_per_worker": 1, "scheduler_kwargs": seen, "silence_logs": logging.CRITICAL}
    cluster = stack.enter_context(distributed.LocalCluster(**own)) if scheduler is None else None
    return stack.enter_context(distributed.Client(cluster or scheduler, timeout="10s")), distributed


def _made(task: Any, distributed: Any) -> Any:
    """A batch's results; lost where its process ended."""
    try:
        return task.result()
    except (distributed.scheduler.KilledWorker, distributed.client.FutureCancelledError) as error:
        return Lost(" ".join(str(error).split())[:200])
