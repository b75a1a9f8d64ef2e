"""The local socket: who may speak, what it bears, and what stop and clear say to a person."""

import asyncio
import json
import os
import socket
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from pathlib import Path

import pytest

from forefeel.common.clock import MonotonicClock
from forefeel.common.messages import SafetyState
from forefeel.common.state.folder import SOCKET
from forefeel.local import handlers, protocol, server
from forefeel.local.client import NobodyThereError, ask
from forefeel.local.protocol import Answer, Request
from forefeel.local.server import LocalServer
from tests.unit.slave_cell import Book, Cell

Run = Callable[[Sequence[str]], int]
SLAVE = "role: slave\nstate: {directory: st}\ntransport: {listen: ['tcp/127.0.0.1:7447']}\n"


async def act(request: Request, by: str) -> Answer:
    return Answer(done=True, text=(f"{request.do} by {by}",), role="slave")


def serving(folder: Path, talk: Callable[[], Awaitable[None]]) -> None:
    async def main() -> None:
        with LocalServer(folder, "slave") as local:
            async with local.serving(act):
                await talk()

    asyncio.run(main())


def raw(folder: Path, data: bytes) -> bytes:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as asking:
        asking.settimeout(5)
        asking.bind("")
        asking.sendto(data, os.path.relpath(folder / SOCKET))
        return asking.recv(65536)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    deep = tmp_path / ("d" * 100) / ("e" * 100)  # longer than the path of a socket may be
    deep.mkdir(parents=True)
    return deep


def test_a_request_is_answered_and_nothing_stays(folder: Path) -> None:
    (folder / SOCKET).touch()  # of a daemon that was killed

    async def talk() -> None:
        assert (folder / SOCKET).stat().st_mode & 0o777 == 0o600
        answer = await asyncio.to_thread(ask, folder, Request(do="state"))
        assert answer.text == (f"state by uid {os.getuid()}",)

    serving(folder, talk)
    assert list(folder.iterdir()) == []
    with pytest.raises(NobodyThereError):
        ask(folder, Request(do="state"))


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\n",
        b"{}\n",
        b"stop\n",
        b'{"do":"format"}\n',
        b'{"do":"clear","axis":5}\n',
        b"\xff\xfe\n",
        b"x" * 100_000,
    ],
    ids=["nothing", "empty", "no act", "text", "unknown", "wrong type", "bytes", "endless"],
)
def test_what_is_no_request_is_refused_and_the_next_is_served(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, data: bytes
) -> None:
    monkeypatch.chdir(tmp_path)

    async def talk() -> None:
        said = json.loads(await asyncio.to_thread(raw, tmp_path, data))
        assert not said["done"] and said["text"][0].startswith("not understood: ")
        assert (await asyncio.to_thread(ask, tmp_path, Request(do="state"))).done

    serving(tmp_path, talk)


def test_another_user_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = protocol.received

    def from_another(bound: socket.socket) -> tuple[bytes, int, str | bytes]:
        data, _, asker = real(bound)
        return data, 12345, asker

    monkeypatch.setattr(server, "received", from_another)

    async def talk() -> None:
        answer = await asyncio.to_thread(ask, tmp_path, Request(do="clear"))
        assert not answer.done and "user 12345 may not" in answer.text[0]

    serving(tmp_path, talk)


def test_what_is_asked_before_the_daemon_serves_is_heeded_when_it_does(tmp_path: Path) -> None:
    async def main() -> Answer:
        with LocalServer(tmp_path, "slave") as local:
            asked = asyncio.ensure_future(asyncio.to_thread(ask, tmp_path, Request("estop")))
            await asyncio.sleep(0.05)
            assert not asked.done()
            async with local.serving(act):
                return await asked

    assert asyncio.run(main()).text[0].startswith("estop by uid ")


def test_who_does_not_listen_to_the_answer_holds_nobody_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    request = json.dumps(Request("state")._asdict()).encode()

    async def talk() -> None:
        with (
            socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as deaf,
            socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as nameless,
        ):
            deaf.bind("")
            for _ in range(100):
                for each in (deaf, nameless):
                    each.setblocking(False)
                    with suppress(BlockingIOError):
                        each.sendto(request, SOCKET)
                await asyncio.sleep(0)
            assert (await asyncio.to_thread(ask, tmp_path, Request(do="state"))).done

    serving(tmp_path, talk)


def test_more_than_a_few_at_a_time_are_refused(tmp_path: Path) -> None:
    async def slow(request: Request, by: str) -> Answer:
        await asyncio.sleep(0.2)
        return await act(request, by)

    async def main() -> list[Answer]:
        with LocalServer(tmp_path, "slave") as local:
            asked = [asyncio.to_thread(ask, tmp_path, Request(do="state")) for _ in range(12)]
            async with local.serving(slow):
                return await asyncio.gather(*asked)

    answers = asyncio.run(main())
    assert {answer.text[0] for answer in answers if not answer.done} <= {"8 others are speaking"}
    assert sum(answer.done for answer in answers) >= 8


# --- a stop that the disk does not take ---


class Forgetful(Book):
    """An event sink beside a latch that can not be written."""

    def kept(self, axis: str) -> bool:
        del axis
        return False


def test_a_stop_and_a_clearing_that_are_not_on_the_disk_are_not_acknowledged(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for limit in ("_STOPS_S", "_LASTS_S"):
        monkeypatch.setattr(handlers, limit, 0.0)
    cell = Cell()
    event_sink = Forgetful()
    for axis in cell.daemon.axes:
        axis.emergency_stop("pressed")
        monkeypatch.setattr(axis, "_event_sink", event_sink)
    cell.step()
    asked = handlers.SlaveHandlers(cell.daemon, event_sink, MonotonicClock())
    answer = asyncio.run(asked(Request("estop"), "nurse"))
    assert not answer.done
    assert answer.text[0] == (
        "axis insertion: estopped, pressed; NOT KEPT OVER A NEW START: it is not written yet"
    )
    assert cell.states() == [SafetyState.ESTOPPED, SafetyState.ESTOPPED]


class Slow(Book):
    """An event sink beside a latch that is on the disk only after it was asked for `left` times."""

    def __init__(self, left: int) -> None:
        super().__init__()
        self.left = left

    def kept(self, axis: str) -> bool:
        del axis
        self.left -= 1
        return self.left < 0


@pytest.mark.parametrize(("asks", "done"), [(10, True), (1_000_000, False)], ids=["slow disk", "lost disk"])
def test_a_clearing_waits_for_a_slow_disk(monkeypatch: pytest.MonkeyPatch, asks: int, done: bool) -> None:
    monkeypatch.setattr(handlers, "_LASTS_S", 0.0)
    monkeypatch.setattr(handlers, "_DISK_S", 0.2)
    cell = Cell()
    for axis in cell.daemon.axes:
        axis.emergency_stop("pressed")
        monkeypatch.setattr(axis, "_event_sink", Slow(asks))
    cell.step()
    asked = handlers.SlaveHandlers(cell.daemon, Book(), MonotonicClock())

    async def talk() -> Answer:
        answer = asyncio.ensure_future(asked(Request("clear"), "nurse"))
        await asyncio.sleep(0)
        cell.step()
        return await answer

    answer = asyncio.run(talk())
    assert answer.done is done
    assert answer.text[0] == "axis insertion: cleared estopped: pressed"
    lost = "axis insertion: the clearing is not on the disk: latched again after a new start"
    assert (lost in answer.text) is not done


# --- the commands, with nobody there ---


@pytest.fixture
def slave(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "slave.yaml").write_text(SLAVE)
    (tmp_path / "st").mkdir()
    return tmp_path


def said(capsys: pytest.CaptureFixture[str]) -> str:
    return capsys.readouterr().err.strip().splitlines()[-1]


def test_clear_without_slave_fails(slave: Path, run: Run) -> None:
    del slave
    assert run(["clear", "--config", "slave.yaml"]) == 1


def test_a_master_clears_nothing(slave: Path, run: Run, capsys: pytest.CaptureFixture[str]) -> None:
    (slave / "master.yaml").write_text("role: master\n")
    assert run(["clear", "--config", "master.yaml"]) == 2
    assert "expected the slave's file" in said(capsys)


@pytest.mark.parametrize(
    "words",
    [[], ["--cell", "c"], ["--connect", "tcp/127.0.0.1:1"], ["--config", "slave.yaml", "--cell", "c"]],
)
def test_estop_says_what_it_needs(slave: Path, run: Run, words: list[str]) -> None:
    del slave
    assert run(["estop", *words]) == 2


def test_a_stop_that_nobody_confirms_fails_loudly(
    slave: Path, run: Run, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    del slave
    monkeypatch.setattr("forefeel.local.stop.FOR_S", 0.1)
    assert run(["estop", "--config", "slave.yaml"]) == 1
    assert "EMERGENCY STOP NOT CONFIRMED by cell cell" in said(capsys)
