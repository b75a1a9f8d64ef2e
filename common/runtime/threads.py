"""Work that is done beside a loop that must not wait for it."""

from collections.abc import Callable
from concurrent.futures import Future
from threading import Thread
from typing import TypeVar

T = TypeVar("T")


def in_thread(work: Callable[[], T], name: str) -> "Future[T]":
    """Runs `work` in a daemon thread.

    A process that ends does not wait for it, as it does for the threads of an executor, and of
    asyncio.to_thread. The thread inherits the scheduling of the one that calls this (docs/decisions/0008).
    """
    future: Future[T] = Future()
    future.set_running_or_notify_cancel()  # from here on whoever no longer waits can not disturb the thread

    def run() -> None:
        try:
            future.set_result(work())
        except BaseException as error:  # noqa: BLE001 - raised where the result is asked for
            future.set_exception(error)

    Thread(target=run, name=name, daemon=True).start()
    return future
