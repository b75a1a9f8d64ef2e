"""A signal while a command is at work, with the end of the process in place of it."""

import ctypes
import os
import signal
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from pathlib import Path

import pytest

from forefeel.commands.pki import init
from forefeel.common.errors import RunError
from forefeel.files import whole
from forefeel.interrupt import SIGNALS, break_off, ends_in_order, leave, signal_flag
from forefeel.pki.folder import router_file


class ExitedError(BaseException):
    """Stands for the end of the process."""


@pytest.fixture(autouse=True)
def exits(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    found: list[int] = []

    def exit_now(code: int) -> None:
        found.append(code)
        raise ExitedError

    monkeypatch.setattr(os, "_exit", exit_now)
    return found


@pytest.fixture(autouse=True)
def signals_of_a_terminal() -> Iterator[None]:
    """A test run under nohup ignores SIGHUP."""
    before = {number: signal.signal(number, signal.SIG_DFL) for number in SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def come(number: signal.Signals = signal.SIGTERM) -> None:
    signal.raise_signal(number)


@pytest.mark.parametrize("number", SIGNALS)
def test_signal_in_a_callback_that_swallows_ends_the_process(
    number: signal.Signals, exits: list[int], capfd: pytest.CaptureFixture[str]
) -> None:
    def callback() -> None:
        try:
            come(number)
        except KeyboardInterrupt:
            exits.append(-1)
        except ExitedError:
            pass

    with ends_in_order("work"):
        ctypes.CFUNCTYPE(None)(callback)()
    assert exits == [1]
    assert "nothing was written" in capfd.readouterr().err


def test_signal_removes_what_is_half_written(tmp_path: Path, exits: list[int]) -> None:
    file = tmp_path / "new" / "out" / "a.txt"
    with pytest.raises(ExitedError), ends_in_order("work", file.parent), whole(file, "the work") as part:
        part.write_text("half")
        come()
    assert exits == [1]
    assert list(tmp_path.iterdir()) == []


def test_signal_waits_for_a_folder_of_certificates(
    tmp_path: Path, exits: list[int], monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def interrupted(cells: Sequence[str]) -> str:
        come()
        return router_file(cells)

    monkeypatch.setattr("forefeel.pki.folder.router_file", interrupted)
    with pytest.raises(ExitedError):
        init(tmp_path / "pki", ["cell"])
    assert exits == [1]
    assert "all certificates in" in capfd.readouterr().err
    assert (tmp_path / "pki" / "router" / "router.json5").exists()


def test_body_that_looks_ends_by_itself(exits: list[int]) -> None:
    with signal_flag() as stop:
        assert not stop.wanted()
        come(signal.SIGHUP)
        come(signal.SIGHUP)  # a terminal that closes sends two
        assert stop.wanted()
    assert exits == []


def test_body_that_does_not_look_is_done_first(exits: list[int], capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ExitedError), ends_in_order("work") as written:
        with signal_flag():
            come()
            written.append("both files")
        exits.append(-1)
    assert exits == [1]
    assert "both files" in capfd.readouterr().err


@pytest.mark.parametrize("told", [False, True], ids=["at once", "never cut"])
def test_second_signal_ends_a_body_that_does_not_look(
    exits: list[int], monkeypatch: pytest.MonkeyPatch, told: bool
) -> None:
    heard: list[int] = []
    at_s = [0.0]
    monkeypatch.setattr("forefeel.interrupt.time.monotonic", lambda: at_s[0])
    ends = nullcontext() if told else pytest.raises(ExitedError)
    with ends, signal_flag((lambda: heard.append(1)) if told else None) as stop:
        come(signal.SIGINT)
        assert exits == []
        at_s[0] = 1.0
        come()
        assert stop.wanted()
    assert (exits, heard) == (([], [1, 1]) if told else ([1], []))


def test_command_under_nohup_stays(exits: list[int]) -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with signal_flag() as stop:
        come(signal.SIGHUP)
        assert not stop.wanted()
    assert exits == []


def test_wait_for_a_person_breaks_off() -> None:
    went_on = False
    with pytest.raises(RunError, match="wait interrupted"), ends_in_order("wait"), signal_flag(break_off):
        come(signal.SIGHUP)
        went_on = True
    assert not went_on


def test_check_ends_a_loop_of_ours_as_a_failed_run() -> None:
    with pytest.raises(RunError, match="work interrupted"), ends_in_order("work"), signal_flag() as stop:
        stop.check()
        come()
        stop.check()


def test_leave_after_a_signal_does_not_take_python_apart(
    exits: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("atexit._run_exitfuncs", lambda: None)
    with signal_flag() as stop:
        with pytest.raises(SystemExit):
            leave(3)
        come()
        assert stop.wanted()
    with pytest.raises(ExitedError):
        leave(3)
    assert exits == [3]
