"""`forefeel estop` beside a daemon, whose answer is put in the place of its control socket."""

import io
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from forefeel.__main__ import main
from forefeel.common.codec import Codec
from forefeel.common.errors import RunError
from forefeel.common.settings import DaemonSettings
from forefeel.common.state.folder import state_path
from forefeel.daemon_settings import load_any
from forefeel.estop import command
from forefeel.estop.client import Answer, Request
from tests.commands.command_line import group
from tests.unit.failing import refusing

Run = Callable[[Sequence[str]], int]
SLAVE = "role: slave\nstate: {directory: st}\ntransport: {listen: ['tcp/127.0.0.1:1']}\n"
BESIDE = ["estop", "--config", "slave.yaml"]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "slave.yaml").write_text(SLAVE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("forefeel.estop.network.FOR_S", 0.05)
    return tmp_path


class Daemon:
    """Answers in place of a daemon; None: none runs."""

    def __init__(self) -> None:
        self.done: bool | None = True
        self.asked: list[tuple[Path, Request]] = []

    def ask(self, folder: Path, request: Request, timeout_s: float) -> Answer:
        assert timeout_s <= 2.0, "a daemon that hangs must not keep the network waiting"
        self.asked.append((folder, request))
        if self.done is None:
            raise RunError("no daemon answers")
        return Answer(self.done, ("axis insertion: estopped, pressed",), "slave")


@pytest.fixture
def daemon(monkeypatch: pytest.MonkeyPatch) -> Daemon:
    made = Daemon()
    monkeypatch.setattr(command, "ask", made.ask)
    return made


def test_stop_asks_the_daemon_and_says_its_answer(
    daemon: Daemon, folder: Path, run: Run, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run([*BESIDE, "--reason", "--kinks"]) == 0
    assert daemon.asked == [(folder / "st", Request("estop", "--kinks"))]
    shown = capsys.readouterr()
    assert shown.out.splitlines()[0] == "slave: axis insertion: estopped, pressed"
    assert "stopped in" in shown.out and shown.err == "next: forefeel clear --config slave.yaml\n"


def test_full_stdout_takes_the_words_and_not_the_stop(
    daemon: Daemon, run: Run, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    full: Any = io.StringIO()
    monkeypatch.setattr(full, "flush", refusing(OSError(28, "No space left on device")), raising=False)
    monkeypatch.setattr(sys, "stdout", full)
    assert run(BESIDE) == 0
    assert len(daemon.asked) == 1
    assert "axis insertion: estopped" in capsys.readouterr().err


def test_file_that_is_wrong_elsewhere_stops_all_the_same(daemon: Daemon, folder: Path, run: Run) -> None:
    (folder / "slave.yaml").write_text(f"{SLAVE}axes: [{{name: insertion, gate: {{watchdog_s: soon}}}}]\n")
    assert run(BESIDE) == 0
    daemon.done = None
    assert run(BESIDE) == 2


@pytest.mark.parametrize("done", [False, None], ids=["can not", "nobody"])
def test_stop_that_nobody_confirms_fails_loudly(
    daemon: Daemon, run: Run, capsys: pytest.CaptureFixture[str], done: bool | None
) -> None:
    daemon.done = done
    opened = list[str]()

    class Silent:
        """A network on which nobody answers."""

        notice, codec = "", Codec

        def publisher(self, *_: object) -> Callable[[bytes], None]:
            return lambda _: None

        def subscribe(self, *_: object) -> None: ...

        def subscribe_all(self, *_: object) -> None: ...

        def close(self) -> None:
            opened.append("closed")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("forefeel.estop.network.ZenohTransport.open", lambda *_, **__: Silent())
        assert run(BESIDE) == 1
    why, failed = capsys.readouterr().err.splitlines()
    assert "over the network" in why and "NOT CONFIRMED" in failed
    assert opened == ["closed"]


@pytest.mark.parametrize(
    "words",
    [
        ["--config", "none.yaml"],
        ["--config", "slave.yaml", "--connect", "tcp/127.0.0.1:1"],
        ["--config", "slave.yaml", "--pki", "pki"],
        [],
        ["--cell", "c"],
        ["--config", "slave.yaml", "--cell", "c"],
        ["--config"],
        ["--nothing"],
        ["slave.yaml"],
    ],
)
def test_wrong_usage_is_one_line_and_stops_nothing(
    daemon: Daemon, run: Run, capsys: pytest.CaptureFixture[str], words: list[str]
) -> None:
    assert run(["estop", *words]) == 2
    shown = capsys.readouterr()
    assert (shown.out, daemon.asked) == ("", [])
    assert len(shown.err.splitlines()) == 1


@pytest.mark.parametrize(
    "text",
    [
        "role: slave",
        "role: master\ncell: lab",
        "{role: slave, cell: 'a.b'}",
        "role: slave\nstate:\n  directory: ../st",
        "role: slave\nstate: {directory: /var/lib/x}",
        "role: slave\nstate: {directory: }",
        "role: slave\nstate: {flight_records: 5}\ncell: 'é'",
    ],
)
def test_state_folder_is_that_of_the_daemon(folder: Path, text: str) -> None:
    path = folder / "some.yaml"
    path.write_text(text)
    settings = load_any(path)
    assert isinstance(settings, DaemonSettings)
    role = settings.model_dump(include={"role"})["role"]
    assert command.state_folder(path) == state_path(settings, role, os.environ)


@pytest.mark.parametrize(
    "text", ["role: viewer", "role: 5", "cell: a", "role: slave\nstate: 5", "role: slave\ncell: 5"]
)
def test_file_of_no_daemon_has_no_state_folder(folder: Path, text: str) -> None:
    path = folder / "some.yaml"
    path.write_text(text)
    assert command.state_folder(path) is None


def test_typer_has_every_option_of_the_parser() -> None:
    known = {each.get_opt_string(): each.help for each in command.PARSER.option_list}
    shown = {each.opts[0]: each.help for each in group(["estop"]).params}
    assert {**known, "--help": ""} == {**shown, "--help": ""}


@pytest.mark.parametrize(("command", "expected"), [("estop", [(os.SCHED_FIFO, 25)]), ("clear", [])])
@pytest.mark.parametrize("permitted", [True, False])
def test_stop_goes_before_other_programs(
    monkeypatch: pytest.MonkeyPatch, command: str, expected: list[tuple[int, int]], permitted: bool
) -> None:
    asked: list[tuple[int, int]] = []

    def schedule(_process: int, policy: int, parameter: os.sched_param) -> None:
        asked.append((policy, parameter.sched_priority))
        if not permitted:
            raise PermissionError

    monkeypatch.setattr("os.sched_setscheduler", schedule)
    monkeypatch.setattr(sys, "argv", ["forefeel", command, "--help"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code in (0, None)
    assert asked == expected
