"""Waiting for what another thread or process does."""

import time
from collections.abc import Callable

PATIENCE_S = 90.0
"""Bounds a hang, and says nothing of how fast anything has to be."""


def wait_until(
    condition: Callable[[], object], timeout_s: float = PATIENCE_S, what: str = "it", every_s: float = 0.005
) -> float:
    """How long it took, in s; AssertionError when it does not come."""
    start_s = time.monotonic()
    while not condition():
        assert time.monotonic() - start_s < timeout_s, f"not within {timeout_s:g} s: {what}"
        time.sleep(every_s)
    return time.monotonic() - start_s
