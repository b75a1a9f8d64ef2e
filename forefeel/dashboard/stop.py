"""The page's stop button: an emergency stop for every axis of the cell, repeated until each shows it."""

import asyncio

from starlette.requests import Request
from starlette.responses import JSONResponse

from forefeel.common.clock import Clock
from forefeel.common.messages import SafetyState
from forefeel.common.transport.port import Transport
from forefeel.local.stop import EVERY_S, FOR_S, Stopper

PATH = "/stop"


class StopButton:
    """Sends what the viewer's certificate may send: anyone but a recorder may stop."""

    def __init__(self, transport: Transport, cell: str, clock: Clock) -> None:
        self._clock = clock
        # zenoh 1.10 keeps some 250 bytes of each message that two subscriptions of a session take (measured)
        self._stopper = Stopper(transport, cell, (), "dashboard", "", listens=False)
        self.hear = self._stopper.hear

    async def press(self, asked: Request) -> JSONResponse:
        """Answers with the axes that do not acknowledge the stop; none: the cell has stopped."""
        stopper = self._stopper
        stopper.reason = f"page, from {asked.client.host if asked.client else 'unknown'}"
        for _ in range(round(FOR_S / EVERY_S)):
            stopper.say(
                self._clock.now_ns()
            )  # once in any case: what was heard last may be of an earlier run
            await asyncio.sleep(EVERY_S)
            outcome = stopper.outcome()
            if outcome.done or not outcome.axes:
                break
        running = [axis for axis, state in outcome.axes.items() if state != SafetyState.ESTOPPED.value]
        return JSONResponse({"heard": bool(outcome.axes), "running": running})
