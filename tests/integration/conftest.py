"""Tests with real processes on the wall clock of a machine that others use, too."""

from pathlib import Path

import pytest
from xdist.remote import Producer
from xdist.scheduler import LoadScopeScheduling

_HANG_S = 240
"""Of processes that take half a minute to start on a machine that has other work."""


_BESIDE = "/test_dashboard.py", "/test_signals.py"
"""What needs little of the processor, or no punctuality of its own."""


class _OneAfterTheOther(LoadScopeScheduling):  # type: ignore[misc]  # xdist is not typed
    """What runs on the wall clock, beside nothing but `_BESIDE`.

    Groups by marks (`--dist loadgroup`) are lost without a word in pytest 9.2 (pytest-xdist issue 1386).
    """

    def _split_scope(self, nodeid: str) -> str:
        return "beside" if any(name in nodeid for name in _BESIDE) else "one after the other"


def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> LoadScopeScheduling:
    """For `--dist loadscope` of this folder alone."""
    return _OneAfterTheOther(config, log)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Marks what runs on the wall clock."""
    for item in items:
        if item.path.is_relative_to(Path(__file__).parent):
            item.add_marker(pytest.mark.realtime)
            if item.get_closest_marker("timeout") is None:
                item.add_marker(pytest.mark.timeout(_HANG_S))
