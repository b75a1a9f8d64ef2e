"""Fails a run that skipped a test without it being named and justified in the file FOREFEEL_ALLOWED_SKIPS."""

import os
from pathlib import Path

import pytest


class StrictSkips:
    """Collects the skipped tests; those that the file does not name fail the session."""

    def __init__(self, file: Path) -> None:
        lines = [text.strip() for text in file.read_text(encoding="utf-8").splitlines()]
        named = [line for line in lines if line and not line.startswith("#")]
        self._allowed = tuple(line.split(maxsplit=1)[0] for line in named)
        self._refused: list[str] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Notes a skip that is not allowed."""
        if report.skipped and not hasattr(report, "wasxfail") and not report.nodeid.startswith(self._allowed):
            self._refused.append(report.nodeid)

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Turns a passed session into a failed one."""
        if self._refused and session.exitstatus == pytest.ExitCode.OK:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Says which."""
        for nodeid in self._refused:
            terminalreporter.write_line(f"FAILED skip is not on the list of allowed skips: {nodeid}")


def pytest_configure(config: pytest.Config) -> None:
    """Active only where the variable is set."""
    file = os.environ.get("FOREFEEL_ALLOWED_SKIPS")
    if file:
        config.pluginmanager.register(StrictSkips(Path(file)), "strict-skips")
