"""Several calls at a time: processes of this machine, or the workers of a dask cluster."""

import os
import re
import signal
import socket
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from importlib import import_module
from itertools import islice
from multiprocessing import active_children, get_context, resource_tracker
from typing import TypeVar

from forefeel.child_process import die_with_parent
from forefeel.common.errors import ConfigurationError, EndpointError, RunError
from forefeel.interrupt import SIGNALS

_PATIENCE_S = 10  # s for the scheduler's answer
_LOOK_S = 0.1  # s between two looks for an end
_AHEAD = 2  # tasks for each worker that are handed out; more would only fill the memory with results
_ADDRESS = re.compile(r"(?:(?:tcp|tls)://)?(?P<host>[^/]+):(?P<port>\d+)")
_EXPECTED = "expected the address of a dask scheduler, such as tcp://10.0.0.2:8786"


T = TypeVar("T")
R = TypeVar("R")


def in_parallel(
    function: Callable[[T], R],
    tasks: Sequence[T],
    jobs: int,
    scheduler: str | None,
    check: Callable[[], None] = lambda: None,
) -> Generator[R, None, None]:
    """Yields each result as soon as it is there, in any order; what still runs ends with the iterator. `jobs`
    processes of this machine, or the workers of the dask cluster `scheduler`.

    Workers read the recordings and hand the results back: only this process writes. `check` is called many
    times a second; what it raises, or `function`, ends all.

    Raises:
        ConfigurationError: a scheduler without the extra `forefeel[cluster]`.
        EndpointError: no dask scheduler at that address, or one without workers.
        RunError: a worker has died.
    """
    workers = _processes(max(1, min(jobs, len(tasks)))) if scheduler is None else _cluster(scheduler)
    with workers as (executor, count):
        waiting, running = iter(tasks), set[Future[R]]()
        try:
            while True:
                with _signals_blocked():
                    wanted = islice(waiting, _AHEAD * count - len(running))
                    running |= {executor.submit(function, task) for task in wanted}
                if not running:
                    return
                done, running = wait(running, _LOOK_S, FIRST_COMPLETED)
                check()
                for future in done:
                    yield future.result()
        except BrokenExecutor as error:
            raise RunError(
                "a process of the diagnosis was killed; expected memory for each of --jobs"
            ) from error


@contextmanager
def _processes(count: int) -> Iterator[tuple[Executor, int]]:
    """Yields a pool of spawned processes, for a fork with threads may hang, and their number. The end of the
    body kills them, with every other child of multiprocessing, and waits for the pool.
    """
    with _signals_blocked():  # with it begins the process that tracks its semaphores
        context, parent = get_context("spawn"), (signal.SIGKILL, os.getpid())
        processes = ProcessPoolExecutor(count, context, die_with_parent, parent)
    try:
        yield processes, count
    finally:
        for child in active_children():
            child.kill()
        # Waits for the pool's own thread: a process that ends while it removes semaphores leaves one behind.
        processes.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _signals_blocked() -> Iterator[None]:
    """Blocks signals for what the body starts, and restores the mask after it: a terminal sends them to all,
    and this process decides.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        resource_tracker.ensure_running()  # before Python 3.13 its start unblocks two of them
        signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _cluster(scheduler: str) -> Iterator[tuple[Executor, int]]:
    """Yields an executor on a dask cluster, and the number of its cores. Raises ConfigurationError: dask is
    not installed; EndpointError: no scheduler at that address, or one without workers.
    """
    try:
        distributed = import_module("distributed")
    except ImportError as error:
        raise ConfigurationError("--scheduler: needs dask: pip install 'forefeel[cluster]'") from error
    _check_scheduler(scheduler)
    try:
        client = distributed.Client(scheduler, timeout=_PATIENCE_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise EndpointError(f"--scheduler {scheduler}: what answers is no dask scheduler") from error
    with client:
        cores = sum(client.ncores().values())
        if not cores:
            raise EndpointError(f"--scheduler {scheduler}: it has no workers; expected at least one")
        executor = client.get_executor(pure=False)
        try:
            yield executor, cores
        finally:
            executor.shutdown(wait=False)


def _check_scheduler(scheduler: str) -> None:
    """Raises EndpointError for a malformed address, and at once where nothing listens; dask would try again
    and again.
    """
    match = _ADDRESS.fullmatch(scheduler)
    if match is None:
        raise EndpointError(f"--scheduler {scheduler!r}: {_EXPECTED}")
    try:
        socket.create_connection((match["host"].strip("[]"), int(match["port"])), _PATIENCE_S).close()
    except (OSError, OverflowError) as error:
        raise EndpointError(f"--scheduler {scheduler}: {error}; {_EXPECTED}") from error
