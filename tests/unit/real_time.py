"""For tests of loops on the wall clock, in this process."""

import asyncio
import sys
from collections.abc import Callable, Iterator

import pytest

from forefeel.common.runtime import real
from tests.waiting import PATIENCE_S


def as_it_is(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Locked memory, a frozen heap and a short interval would last for the rest of the test run."""
    monkeypatch.setattr(real, "prepare_process", lambda: "memory as it was")
    interval_s = sys.getswitchinterval()
    yield
    sys.setswitchinterval(interval_s)


async def until(condition: Callable[[], object]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not condition():  # noqa: ASYNC110 - what is waited for happens in another thread
            await asyncio.sleep(0.001)
