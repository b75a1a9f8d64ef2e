"""With CI=1 a skip fails the run unless .ci/allowed-skips.txt names the test with its reason."""

import os
from pathlib import Path

import pytest

ALLOWED = Path(__file__).parents[1] / ".ci/allowed-skips.txt"


class StrictSkips:
    """`allowed`: a test id, or the beginning of some, a blank, and the reason, one a line."""

    def __init__(self, allowed: str) -> None:
        lines = [line for line in allowed.splitlines() if line.strip() and not line.startswith("#")]
        self._allowed = tuple(line.split(maxsplit=1)[0] for line in lines)
        self._refused: list[str] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.skipped and not hasattr(report, "wasxfail") and not report.nodeid.startswith(self._allowed):
            self._refused.append(report.nodeid)

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if self._refused and session.exitstatus == pytest.ExitCode.OK:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        for nodeid in self._refused:
            terminalreporter.write_line(f"FAILED skip is not on the list of allowed skips: {nodeid}")


def pytest_configure(config: pytest.Config) -> None:
    if os.environ.get("CI") == "1":
        config.pluginmanager.register(StrictSkips(ALLOWED.read_text(encoding="utf-8")), "strict-skips")
