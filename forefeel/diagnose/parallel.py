"""Several diagnoses at a time: processes of this machine, or the workers of a dask cluster."""

import re
import signal
import socket
import warnings
from collections.abc import Generator, Iterator, Sequence
from contextlib import AbstractContextManager, closing, contextmanager, suppress
from dataclasses import dataclass, replace
from importlib import import_module
from multiprocessing import resource_tracker

import joblib
from joblib.externals.loky import get_reusable_executor

from common.errors import ConfigurationError, EndpointError, InputError, RunError
from forefeel.diagnose.examine import Result, Task, examine

_PATIENCE_S = 10
_ADDRESS = re.compile(r"(?:(?:tcp|tls)://)?(?P<host>[^/]+):(?P<port>\d+)")
_EXPECTED = "expected the address of a dask scheduler, such as tcp://10.0.0.2:8786"


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a task: its result, or in one line why it was skipped or failed."""

    task: Task
    result: Result | None = None
    skipped: str | None = None
    failed: str | None = None


def outcomes(
    tasks: Sequence[Task], jobs: int, scheduler: str | None
) -> AbstractContextManager[Iterator[Outcome]]:
    """Each outcome as soon as it is there, in any order; what still runs ends with the context.

    Workers read the recordings and hand the texts back: only this process writes.

    Raises:
        ConfigurationError: a scheduler without the extra `forefeel[cluster]`.
        EndpointError: no dask scheduler at that address, or one without workers.
    """
    return _local(tasks, jobs) if scheduler is None else _on_cluster(tasks, scheduler)


def attempt(task: Task) -> Outcome:
    """A task that never raises what belongs to its recording only."""
    try:
        return Outcome(task, examine(task))
    except InputError as error:
        return Outcome(task, skipped=" ".join(str(error).split()))
    except RunError as error:
        return Outcome(task, failed=" ".join(str(error).split()))


@contextmanager
def _local(tasks: Sequence[Task], jobs: int) -> Iterator[Iterator[Outcome]]:
    try:
        with closing(_started(tasks, jobs)) as found:
            yield found
    except RuntimeError as error:
        if _of_an_interrupt(error):
            raise KeyboardInterrupt from error
        raise
    finally:
        with suppress(RuntimeError):  # of an executor that was interrupted while it started
            get_reusable_executor().shutdown()  # joblib would keep its workers for another five minutes


def _of_an_interrupt(error: BaseException | None) -> bool:
    """Whether an error came while an interrupt was on its way: joblib stumbles when it is starting."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__context__
    return error is not None


def _started(tasks: Sequence[Task], jobs: int) -> Generator[Outcome, None, None]:
    parallel = joblib.Parallel(
        n_jobs=max(1, min(jobs, len(tasks))), return_as="generator_unordered", batch_size=1
    )
    found: Generator[Outcome, None, None] | None = None
    try:
        with _interrupts_later():
            found = parallel(joblib.delayed(attempt)(task) for task in tasks)
        yield from found
    finally:
        if found is not None:  # closed here and now: left to itself it warns after the last word
            with warnings.catch_warnings(action="ignore", category=UserWarning):
                found.close()


@contextmanager
def _interrupts_later() -> Iterator[None]:
    """Workers that are started here inherit it and are ended by us alone: where a terminal interrupts them,
    too, they say so, and the pool stumbles over what they say.
    """
    resource_tracker.ensure_running()  # before Python 3.13 its start unblocks SIGINT, whatever was before
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _on_cluster(tasks: Sequence[Task], scheduler: str) -> Iterator[Iterator[Outcome]]:
    try:
        distributed = import_module("distributed")
    except ImportError as error:
        raise ConfigurationError("--scheduler: needs dask: pip install forefeel[cluster]") from error
    _prove_listening(scheduler)
    try:
        client = distributed.Client(scheduler, timeout=_PATIENCE_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise EndpointError(f"--scheduler {scheduler}: what answers is no dask scheduler") from error
    with client:
        if not client.ncores():
            raise EndpointError(f"--scheduler {scheduler}: it has no workers; expected at least one")
        absolute = [replace(task, file=task.file.resolve()) for task in tasks]
        with joblib.parallel_config(backend="dask", client=client), _local(absolute, len(tasks)) as found:
            yield found


def _prove_listening(scheduler: str) -> None:
    """At once, where dask would try again and again."""
    found = _ADDRESS.fullmatch(scheduler)
    if found is None:
        raise EndpointError(f"--scheduler {scheduler!r}: {_EXPECTED}")
    try:
        socket.create_connection((found["host"].strip("[]"), int(found["port"])), _PATIENCE_S).close()
    except (OSError, OverflowError) as error:
        raise EndpointError(f"--scheduler {scheduler}: {error}; {_EXPECTED}") from error
