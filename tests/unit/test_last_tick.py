"""A control loop that has ended by a fault has no next tick: the safety state, its event and the event log
show the fault all the same.
"""

import asyncio
from collections.abc import Callable

from forefeel.common.messages import SafetyEvent, SafetyState
from forefeel.common.runtime.real import RealRuntime
from forefeel.common.topics import SAFETY_EVENT, SLAVE_STATE
from forefeel.common.transport.memory import MemoryBus
from forefeel.slave.daemon import SlaveDaemon
from forefeel.slave.settings import SlaveAxisSettings, SlaveSettings
from tests.network import Traffic
from tests.stepped import SteppedHost
from tests.unit.failing import refusing
from tests.unit.rigs import Book

FAULT, STOPPED = SafetyState.FAULT, SafetyState.ESTOPPED
AXES = "insertion", "rotation"


class LiveCell:
    """A slave of two axes in stepped time, the second of which ends the control loop at its first tick."""

    def __init__(self, host: SteppedHost) -> None:
        self.runtime, self.book = RealRuntime(host=host), Book()
        network, clock = MemoryBus(), self.runtime.clock
        self.traffic = Traffic(network.session(clock))
        settings = SlaveSettings(axes=tuple(SlaveAxisSettings(name=axis) for axis in AXES))
        self.daemon = SlaveDaemon(settings, network.session(clock), self.runtime, lambda: 7, self.book)
        setattr(self.daemon.axes[1], "tick", refusing(ZeroDivisionError("torn")))  # noqa: B010 - a method

    def events(self) -> list[SafetyEvent]:
        return [event for axis in AXES for event in self.traffic.messages(SAFETY_EVENT, axis)]

    def published(self) -> set[SafetyState]:
        """States that the axes published last."""
        return {state.state for axis in AXES for state in self.traffic.messages(SLAVE_STATE, axis)[-1:]}


def live_cell(meanwhile: Callable[[LiveCell], object] = lambda _: True) -> LiveCell:
    """Runs a cell to the fault, on until `meanwhile` is true, and to the end."""
    host = SteppedHost()

    async def run() -> LiveCell:
        cell = LiveCell(host)
        async with cell.runtime:
            await cell.runtime.stopping.wait()
            while not meanwhile(cell):  # noqa: ASYNC110 - in stepped time
                await asyncio.sleep(0.001)
        cell.daemon.close(cell.runtime.clock.now_ns())
        return cell

    return host.run(run())


def test_the_fault_is_published_and_logged_while_the_daemon_still_runs() -> None:
    cell = live_cell(lambda cell: len(cell.events()) == 2 and cell.published() == {FAULT})
    for event in cell.events():
        assert (event.event, event.after, event.reason) == ("fault", FAULT, "ZeroDivisionError: torn")
    assert {noted["after"] for noted in cell.book.of("safety")} == {"fault"}
    assert len(cell.book.of("safety")) == 2
    assert cell.book.of("thread_fault") == [{"reason": "ZeroDivisionError: torn"}]
    assert cell.published() == {FAULT}


def test_a_stop_is_heeded_though_the_control_loop_has_ended() -> None:
    def stopped(cell: LiveCell) -> bool:
        cell.daemon.axes[0].emergency_stop("pressed", "nurse")
        return cell.daemon.axes[0].state is STOPPED

    cell = live_cell(stopped)
    assert [(each["before"], each["after"]) for each in cell.book.of("safety")][2:] == [("fault", "estopped")]
