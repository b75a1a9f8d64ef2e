"""Real processes on a machine that others use, too: the timeout is for a hang alone."""

import pytest

HANG_S = 400


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if "tests/process/" in item.nodeid:
            item.add_marker(pytest.mark.timeout(HANG_S))
