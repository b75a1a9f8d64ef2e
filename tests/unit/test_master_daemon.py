"""The master's daemon when something fails: every handle is let go, whatever becomes of another one."""

import pytest

from forefeel.common.errors import RunError
from forefeel.common.runtime.virtual import VirtualRuntime
from forefeel.common.transport.memory import MemoryBus
from forefeel.master.daemon import MasterDaemon
from forefeel.master.settings import MasterAxisSettings, MasterSettings
from tests.unit.failing import refusing
from tests.unit.rigs import Book, FakeHandle

AXES = ("insertion", "rotation", "tilt")


class Bench:
    """A master of three axes whose handles a test breaks."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.handles = [FakeHandle() for _ in AXES]
        left = iter(self.handles)
        monkeypatch.setattr("forefeel.master.daemon.make_handle", lambda *_: next(left))
        self.runtime, self.book = VirtualRuntime(), Book()
        self.network = MemoryBus()
        self.session = self.network.session(self.runtime.clock)

    def opened(self) -> list[bool]:
        return [handle.opened for handle in self.handles]

    def start(self) -> MasterDaemon:
        settings = MasterSettings(axes=tuple(MasterAxisSettings(name=name) for name in AXES))
        return MasterDaemon(settings, self.session, self.runtime, lambda: 7, self.book)


@pytest.fixture(name="bench")
def with_fake_handles(monkeypatch: pytest.MonkeyPatch) -> Bench:
    return Bench(monkeypatch)


@pytest.mark.parametrize("broken", range(len(AXES)))
def test_a_handle_that_breaks_at_a_fault_leaves_no_force_on_the_others(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, broken: int
) -> None:
    daemon = bench.start()
    monkeypatch.setattr(bench.handles[broken], "render", refusing(OSError("port gone")))
    with pytest.raises(OSError, match="port gone"):
        daemon.fail(ValueError("torn cable"))
    others = [handle for number, handle in enumerate(bench.handles) if number != broken]
    assert [handle.felt_n for handle in others] == [[0.0], [0.0]]
    assert bench.book.of("thread_fault") == [{"reason": "ValueError: torn cable"}]


def test_no_handle_stays_open_without_a_report(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("forefeel.master.daemon.Reports", refusing(RunError("the session is closed")))
    with pytest.raises(RunError, match="the session is closed"):
        bench.start()
    assert bench.opened() == [False] * 3


def test_a_session_that_is_broken_keeps_no_handle_open(bench: Bench) -> None:
    daemon = bench.start()
    assert bench.opened() == [True] * 3
    others = bench.network.session(bench.runtime.clock)  # whoever hears raises where it is put
    others.subscribe_all("forefeel", refusing(RunError("the session is closed")))
    with pytest.raises(RunError, match="the session is closed"):
        daemon.close(bench.runtime.clock.now_ns())
    assert bench.opened() == [False] * 3
    assert bench.session.peers() == 0 and others.peers() == 0
