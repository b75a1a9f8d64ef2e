"""Tests with real processes on the wall clock of a machine that others use, too."""

from pathlib import Path

import pytest

_HANG_S = 240
"""Of processes that take half a minute to start on a machine that has other work."""


# first: xdist reads the groups in the same hook, before a conftest.py that was named on the command line
@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """They run one after the other, beside nothing (`realtime`) but a browser, which mostly waits for its
    frames.
    """
    for item in items:
        if item.path.is_relative_to(Path(__file__).parent):
            watches = item.path.name == "test_dashboard.py"
            item.add_marker(pytest.mark.xdist_group("a browser" if watches else "one after the other"))
            item.add_marker(pytest.mark.realtime)
            if item.get_closest_marker("timeout") is None:
                item.add_marker(pytest.mark.timeout(_HANG_S))
