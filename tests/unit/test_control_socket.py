"""The control socket: who may ask, what is no request, and what stop and clear answer, in stepped time."""

import asyncio
import json
import socket
from collections.abc import Awaitable, Callable, Sequence
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import pytest

from forefeel.common.errors import RunError
from forefeel.common.messages import SafetyState
from forefeel.common.state.folder import SOCKET
from forefeel.control_socket import ControlSocket, SlaveRequests
from forefeel.estop.client import Answer, Request, ask
from forefeel.slave.daemon import Clearing
from tests.stepped import SteppedHost
from tests.unit.failing import refusing
from tests.unit.rigs import Book, Cell

Run = Callable[[Sequence[str]], int]
STOPPED, IDLE = SafetyState.ESTOPPED, SafetyState.IDLE


async def act(request: Request) -> Answer:
    return Answer(True, (request.do,), "slave")


class Asker:
    """A socket of somebody who asks, without waiting; the folder is the working one."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.setblocking(False)
        self.socket.bind("")

    def send(self, data: bytes) -> None:
        self.socket.sendto(data, SOCKET)

    async def receive(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(await asyncio.get_running_loop().sock_recv(self.socket, 65536))
        return found


ESTOP = json.dumps(Request("estop")._asdict()).encode()


def serving(folder: Path, talk: Callable[[Asker, ControlSocket], Awaitable[None]]) -> None:
    async def main() -> None:
        with ControlSocket(folder, "slave") as control:
            asker = Asker()
            with asker.socket:
                await talk(asker, control)

    SteppedHost().run(main())


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_request_is_answered_and_nothing_stays(folder: Path) -> None:
    (folder / SOCKET).touch()  # of a daemon that was killed

    async def talk(asker: Asker, control: ControlSocket) -> None:
        asker.send(ESTOP)  # before the daemon serves
        assert (folder / SOCKET).stat().st_mode & 0o777 == 0o600
        async with control.serving(act):
            assert (await asker.receive())["text"] == ["estop"]

    serving(folder, talk)
    assert list(folder.iterdir()) == []
    with pytest.raises(RunError):
        ask(folder, Request("estop"))


def test_socket_in_deep_folder_is_reached(tmp_path: Path) -> None:
    deep = tmp_path / ("d" * 100) / ("e" * 100)  # longer than the path of a socket may be
    deep.mkdir(parents=True)
    with ControlSocket(deep, "slave"), pytest.raises(RunError, match="no daemon answers"):
        ask(deep, Request("estop"), timeout_s=0.01)


@pytest.mark.parametrize(
    "data",
    [b"", b"{}", b"stop", b'{"do":"format"}', b'{"do":"clear","axis":5}', b"\xff\xfe", b"x" * 100_000],
    ids=["nothing", "empty", "text", "unknown", "wrong type", "bytes", "endless"],
)
def test_invalid_request_is_refused_and_next_is_served(folder: Path, data: bytes) -> None:
    async def talk(asker: Asker, control: ControlSocket) -> None:
        async with control.serving(act):
            asker.send(data)
            assert not (await asker.receive())["done"]
            asker.send(ESTOP)
            assert (await asker.receive())["done"]

    serving(folder, talk)


def test_asker_that_does_not_read_holds_nobody_up(folder: Path) -> None:
    async def talk(asker: Asker, control: ControlSocket) -> None:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as nameless:
            async with control.serving(act):
                for _ in range(100):
                    nameless.sendto(ESTOP, SOCKET)
                    asker.send(ESTOP)
                    await asyncio.sleep(0.01)
                for _ in range(3):
                    assert (await asker.receive())["done"]

    serving(folder, talk)


@pytest.fixture(name="cell")
def stopped_cell() -> Cell:
    cell = Cell()
    cell.daemon.axes[0].emergency_stop("pressed")
    cell.step()
    assert cell.states() == [STOPPED, STOPPED]
    return cell


def asked(cell: Cell, *requests: Request, step: bool = True, sink: Book | None = None) -> list[Answer]:
    """The answers; the control loop ticks once they were asked for."""
    requested = SlaveRequests(cell.daemon, sink or cell.book, cell.runtime.clock)

    async def main() -> list[Answer]:
        tasks = [asyncio.create_task(requested(each)) for each in requests]
        await asyncio.sleep(0)
        if step:
            cell.step()
        return await asyncio.gather(*tasks)

    return SteppedHost().run(main())


CLEAR = Request("clear")


def test_clear_is_answered_to_everyone_who_asked(cell: Cell) -> None:
    answers = asked(cell, CLEAR, CLEAR)
    assert [answer.done for answer in answers] == [True, True]
    assert "axis insertion: cleared estopped: pressed" in answers[0].text
    assert [noted["cleared"] for noted in cell.book.of("clear")] == [True, True]
    assert cell.states() == [IDLE, IDLE]


def test_clear_without_ticks_clears_nothing_later(cell: Cell) -> None:
    (answer,) = asked(cell, CLEAR, step=False)
    assert not answer.done
    cell.step()
    assert cell.states() == [STOPPED, STOPPED]


def test_cancelled_clear_clears_nothing(cell: Cell) -> None:
    async def ask_and_go() -> None:
        requests = SlaveRequests(cell.daemon, cell.book, cell.runtime.clock)
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(requests(CLEAR), 0.001)

    SteppedHost().run(ask_and_go())
    cell.step()
    assert cell.states() == [STOPPED, STOPPED]


def test_clear_in_a_hanging_tick_is_perhaps_done(cell: Cell, monkeypatch: pytest.MonkeyPatch) -> None:
    begun = Future[list[Clearing]]()
    begun.set_running_or_notify_cancel()
    monkeypatch.setattr(cell.daemon, "clear", lambda _: begun)
    (answer,) = asked(cell, CLEAR)
    assert not answer.done and "perhaps" in answer.text[0]


def test_clear_in_the_last_tick_tells_what_it_did(cell: Cell, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cell.daemon.axes[1], "tick", refusing(ZeroDivisionError("torn")))
    cleared = cell.daemon.clear()
    with pytest.raises(ZeroDivisionError):
        cell.step(1)
    assert [each.still for each in cleared.result(0)] == ["", "axis insertion is halted"]


def test_named_axis_takes_with_it_what_stopped_for_it_also_twice_between_two_ticks(cell: Cell) -> None:
    assert [each.axis for each in cell.clear("rotation")] == ["rotation"]
    cell.step()
    assert cell.states() == [STOPPED, STOPPED]  # the other one is still halted
    first, second = cell.daemon.clear("rotation"), cell.daemon.clear("insertion")
    cell.step(1)
    assert [each.axis for each in first.result(0)] == ["rotation"]
    assert [each.axis for each in second.result(0)] == ["insertion", "rotation"]
    assert cell.states() == [IDLE, IDLE]


class SlowLatch(Book):
    """An event sink whose latch is on the disk only after it was asked for `left` times."""

    def __init__(self, left: int) -> None:
        super().__init__()
        self.left = left

    def is_persisted(self, axis: str, stopped: bool) -> bool:
        del axis, stopped
        self.left -= 1
        return self.left < 0


@pytest.mark.parametrize("request_", [Request("estop"), CLEAR], ids=["estop", "clear"])
@pytest.mark.parametrize(("asks", "done"), [(10, True), (1_000_000, False)], ids=["slow disk", "lost disk"])
def test_answer_waits_for_the_disk(
    cell: Cell, monkeypatch: pytest.MonkeyPatch, request_: Request, asks: int, done: bool
) -> None:
    for axis in cell.daemon.axes:
        monkeypatch.setattr(axis, "_event_sink", SlowLatch(asks))
    (answer,) = asked(cell, request_)
    assert answer.done is done
    assert cell.states() == ([IDLE, IDLE] if request_ is CLEAR else [STOPPED, STOPPED])


@pytest.mark.parametrize(("role", "code"), [("slave", 1), ("master", 2)])
def test_clear_without_daemon_fails(folder: Path, run: Run, role: str, code: int) -> None:
    (folder / "st").mkdir()
    (folder / "f.yaml").write_text(f"role: {role}\nstate: {{directory: st}}\n")
    assert run(["clear", "--config", "f.yaml"]) == code
