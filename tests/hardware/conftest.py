"""Emulated devices keep their time, as real ones do, although other tests want the processor."""

import os
from collections.abc import Iterator

import pytest

_PRIORITY = 1
"""Of SCHED_RR: ahead of all work without a priority. The threads of a test inherit it."""


@pytest.fixture(autouse=True)
def ahead_of_other_work() -> Iterator[None]:
    """Where it is granted; elsewhere the machine has to be idle enough."""
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(_PRIORITY))
    except PermissionError:
        yield
        return
    yield
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
