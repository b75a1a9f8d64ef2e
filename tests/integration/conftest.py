"""Tests with real processes on the wall clock of a machine that others use, too."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from forefeel.__main__ import main


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """They run alone (`realtime`). A failed one runs twice more: a fault stays, a stolen second does not."""
    for item in items:
        if item.path.is_relative_to(Path(__file__).parent):
            item.add_marker(pytest.mark.realtime)
            item.add_marker(pytest.mark.flaky(reruns=2))


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Callable[[Sequence[str]], int]:
    """Runs the command line in this process as the installed script does; its exit code."""
    # what a daemon asks of the operating system would stay with this process
    monkeypatch.setattr("common.runtime.real.prepare_process", lambda: "left alone")

    def run(arguments: Sequence[str]) -> int:
        monkeypatch.setattr(sys, "argv", ["forefeel", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code if isinstance(ended.value.code, int) else 0

    return run
