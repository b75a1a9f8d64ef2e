"""Tests with real processes on the wall clock of a machine that others use, too."""

from pathlib import Path

import pytest
from xdist.remote import Producer
from xdist.scheduler import LoadScopeScheduling

_HANG_S = 240
"""Of processes that take half a minute to start on a machine that has other work."""


_CELLS = (
    "emergency_stop", "emulated_loopback", "faults", "links", "processes", "record", "service_watchdog",
    "stop_with_certificates", "two_hosts", "waiting",
)  # fmt: skip
"""With daemons at a priority of real time, which take the processor from all else."""
_FIRST = "test_signals.py"
"""Takes longest, so that nothing is left to do beside it at the end."""


class _OneCellAtATime(LoadScopeScheduling):  # type: ignore[misc]  # xdist is not typed
    """Whole cells one after the other; beside them the others, file by file.

    Groups by marks (`--dist loadgroup`) are lost without a word in pytest 9.2 (pytest-xdist issue 1386).
    """

    def _split_scope(self, nodeid: str) -> str:
        file = nodeid.partition("::")[0]
        return "a cell" if any(f"/test_{name}.py" in file for name in _CELLS) else file


def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> LoadScopeScheduling:
    """For `--dist loadscope` of this folder alone."""
    return _OneCellAtATime(config, log)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Marks what runs on the wall clock, and puts first what takes longest."""
    items.sort(key=lambda item: item.path.name != _FIRST)
    for item in items:
        if item.path.is_relative_to(Path(__file__).parent):
            item.add_marker(pytest.mark.realtime)
            if item.get_closest_marker("timeout") is None:
                item.add_marker(pytest.mark.timeout(_HANG_S))
