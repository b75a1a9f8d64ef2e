"""The page's stop button: an emergency stop for every axis of the cell, repeated until each shows it."""

import asyncio

from starlette.requests import Request
from starlette.responses import JSONResponse

from forefeel.common.bus import Bus, Publisher
from forefeel.common.clock import Clock
from forefeel.common.messages import EmergencyStop, SafetyState
from forefeel.common.topics import EMERGENCY_STOP
from forefeel.common.transport.port import Transport
from forefeel.dashboard.cell_view import CellView
from forefeel.dashboard.sources import LiveCell

PATH = "/stop"
_EVERY_S, _TIMES = 0.020, 100  # as often and as long as a master repeats its stop (`master/stop.py`)


class StopButton:
    """Sends what the viewer's certificate may send: anyone but a recorder may stop."""

    def __init__(self, transport: Transport, cell: str, live: LiveCell, clock: Clock) -> None:
        self._transport, self._cell, self._live, self._clock = transport, cell, live, clock
        self._publishers: dict[str, Publisher] = {}

    async def press(self, asked: Request) -> JSONResponse:
        """Answers with the axes that do not show the stop; none: the cell has stopped."""
        reason = f"page, from {asked.client.host if asked.client else 'unknown'}"
        running: list[str] = []
        for _ in range(_TIMES):
            running = self._live.look(_running)
            if not running:
                break
            for axis in running:
                self._send(axis, reason)
            await asyncio.sleep(_EVERY_S)
        return JSONResponse({"heard": bool(self._live.look(_axes)), "running": running})

    def _send(self, axis: str, reason: str) -> None:
        if axis not in self._publishers:
            bus = Bus(self._transport, self._cell, axis, self._clock)
            self._publishers[axis] = bus.publisher(EMERGENCY_STOP)
        publisher = self._publishers[axis]
        header = publisher.header(0, self._clock.now_ns())
        publisher.send(EmergencyStop(**header, source="dashboard", reason=reason))


def _axes(cell: CellView, now_ns: int) -> list[str]:
    del now_ns
    return list(cell.axes)


def _running(cell: CellView, now_ns: int) -> list[str]:
    del now_ns
    slaves = {axis: view.newest.slave for axis, view in cell.axes.items()}
    return [axis for axis, slave in slaves.items() if slave is None or slave.state != SafetyState.ESTOPPED]
