"""`forefeel estop` beside a daemon, whose answer is put in the place of its control socket."""

import io
import os
import sys
from itertools import count
from pathlib import Path
from typing import Any
from unittest.mock import create_autospec

import pytest

from forefeel.__main__ import main
from forefeel.common.codec import Codec, decode, encode
from forefeel.common.errors import RunError
from forefeel.common.messages import EmergencyStop
from forefeel.common.settings import DaemonSettings
from forefeel.common.state.folder import state_path
from forefeel.common.topics import EMERGENCY_STOP, SLAVE_STATE
from forefeel.common.transport.zenoh_bus import ZenohTransport
from forefeel.daemon_settings import load_any
from forefeel.estop import command
from forefeel.estop.client import Answer, Request
from forefeel.estop.network import Stopper
from tests.commands.command_line import group
from tests.commands.conftest import Shell
from tests.messages import usual
from tests.unit.failing import refusing

SLAVE = "role: slave\nstate: {directory: st}\ntransport: {listen: ['tcp/127.0.0.1:1']}\n"
BESIDE = "estop --config slave.yaml"
OF_CELL = "estop --cell cathlab --connect tcp/127.0.0.1:1 --insecure"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "slave.yaml").write_text(SLAVE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("forefeel.estop.network.EVERY_S", 0.0)
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


def test_stop_asks_the_daemon_and_says_its_answer(daemon: Daemon, shell: Shell) -> None:
    shown = shell(f"{BESIDE} --reason --kinks")
    assert shown.code == 0
    assert daemon.asked == [(shell.folder / "st", Request("estop", "--kinks"))]
    assert shown.out.splitlines()[0] == "slave: axis insertion: estopped, pressed"
    assert "stopped in" in shown.out and shown.err == "next: forefeel clear --config slave.yaml\n"


def test_reason_that_is_no_unicode_keeps_no_stop_back(
    daemon: Daemon, shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of an argument with a byte of another encoding, and too long."""
    network = create_autospec(ZenohTransport, instance=True, notice="", codec=Codec)
    monkeypatch.setattr("forefeel.estop.network.ZenohTransport.open", lambda *_, **__: network)
    daemon.done = None
    shell(f"{BESIDE} --reason T\udcfcr{'r' * 300}")
    sent = network.publisher.return_value.call_args.args[0]
    reason = "T?r" + "r" * 253
    assert (daemon.asked[0][1].reason, decode(EmergencyStop, sent).reason) == (reason, reason)


def test_full_stdout_takes_the_words_and_not_the_stop(
    daemon: Daemon, shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    full: Any = io.StringIO()
    monkeypatch.setattr(full, "flush", refusing(OSError(28, "No space left on device")), raising=False)
    monkeypatch.setattr(sys, "stdout", full)
    shown = shell(BESIDE)
    assert (shown.code, len(daemon.asked)) == (0, 1)
    assert "axis insertion: estopped" in shown.err


def test_file_that_is_wrong_elsewhere_stops_all_the_same(daemon: Daemon, shell: Shell) -> None:
    shell.write({"slave.yaml": f"{SLAVE}axes: [{{name: insertion, gate: {{watchdog_s: soon}}}}]\n"})
    assert shell(BESIDE).code == 0
    daemon.done = None
    assert shell(BESIDE).code == 2


@pytest.mark.parametrize("done", [False, None], ids=["can not", "nobody"])
def test_stop_that_nobody_confirms_fails_loudly(
    daemon: Daemon, shell: Shell, monkeypatch: pytest.MonkeyPatch, done: bool | None
) -> None:
    daemon.done = done
    silent = create_autospec(ZenohTransport, instance=True, notice="", codec=Codec)
    monkeypatch.setattr("forefeel.estop.network.ZenohTransport.open", lambda *_, **__: silent)
    shown = shell(BESIDE)
    why, failed = shown.err.splitlines()
    assert shown.code == 1
    assert "over the network" in why and "NOT CONFIRMED" in failed
    silent.close.assert_called_once()


@pytest.mark.parametrize(("axis", "stops"), [("", 11), ("--axis insertion", 1)])
def test_stop_of_a_cell_that_is_stopped_reaches_it_all_the_same(
    shell: Shell, monkeypatch: pytest.MonkeyPatch, axis: str, stops: int
) -> None:
    """Without a named axis it is repeated while others may be heard."""
    monkeypatch.setattr("forefeel.estop.network.FOR_S", 60.0)
    network = create_autospec(ZenohTransport, instance=True, notice="", codec=Codec)
    key, state = SLAVE_STATE.key("cathlab", "insertion"), encode(usual(SLAVE_STATE, state="estopped"))
    put, publish = network.publisher.return_value, Stopper.publish

    def publish_and_link(stopper: Stopper, now_ns: int) -> None:
        """The link is up after the first stop, which is lost."""
        publish(stopper, now_ns)
        if not stopper.states:
            put.reset_mock()
            stopper.hear(key, state, 1)

    monkeypatch.setattr(Stopper, "publish", publish_and_link)
    monkeypatch.setattr("forefeel.estop.network.ZenohTransport.open", lambda *_, **__: network)
    assert shell(f"{OF_CELL} {axis}").code == 0
    assert put.call_count == stops


def test_axis_that_is_heard_after_a_stopped_one_is_stopped_too(
    shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("forefeel.estop.network.FOR_S", 60.0)
    network = create_autospec(ZenohTransport, instance=True, notice="", codec=Codec)
    publish, numbers = Stopper.publish, count()
    states = {0: ("insertion", "estopped"), 8: ("rotation", "armed"), 9: ("rotation", "estopped")}

    def publish_and_hear(stopper: Stopper, now_ns: int) -> None:
        publish(stopper, now_ns)
        axis, state = states.get(next(numbers), ("", ""))
        if axis:
            key = SLAVE_STATE.key("cathlab", axis)
            stopper.hear(key, encode(usual(SLAVE_STATE, state=state)), 1)

    monkeypatch.setattr(Stopper, "publish", publish_and_hear)
    monkeypatch.setattr("forefeel.estop.network.ZenohTransport.open", lambda *_, **__: network)
    shown = shell(OF_CELL)
    assert shown.code == 0
    assert shown.out.splitlines()[:2] == ["axis insertion: estopped", "axis rotation: estopped"]
    keys = [call.args[0] for call in network.publisher.call_args_list]
    assert keys == [EMERGENCY_STOP.key("cathlab", axis) for axis in ("insertion", "rotation")]


@pytest.mark.parametrize(
    "options",
    [
        "--config none.yaml", "--config slave.yaml --connect tcp/127.0.0.1:1", "", "--cell c",
        "--config slave.yaml --pki pki", "--config slave.yaml --cell c", "--config", "--nothing",
        "slave.yaml",
    ],
)  # fmt: skip
def test_wrong_usage_is_one_line_and_stops_nothing(daemon: Daemon, shell: Shell, options: str) -> None:
    shell.refused(f"estop {options}")
    assert daemon.asked == []


@pytest.mark.parametrize(
    "text",
    [
        "role: slave", "role: master\ncell: lab", "{role: slave, cell: 'a.b'}",
        "role: slave\nstate:\n  directory: ../st", "role: slave\nstate: {directory: /var/lib/x}",
        "role: slave\nstate: {directory: }", "role: slave\nstate: {flight_records: 5}\ncell: 'é'",
    ],
)  # fmt: skip
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
