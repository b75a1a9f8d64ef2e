"""A loop as the daemons run theirs, with nothing in it: what this machine does to a loop.

Prints a histogram of the lateness of each second, as JSON.
"""

import asyncio
import json

from forefeel.common.lateness import Lateness
from forefeel.common.runtime.real import RealRuntime
from forefeel.common.runtime.realtime import prepare_process, prepare_thread
from forefeel.common.settings import TICK_NS, RealtimeSettings


async def beat() -> None:
    """Until it is killed."""
    prepare_process()
    priority = RealtimeSettings().priority
    prepare_thread(priority - 20)
    runtime = RealRuntime(priority)
    lateness: Lateness = runtime.loop("metronome", TICK_NS, lambda _now_ns: None)
    async with runtime:
        before = list(lateness.counts)
        while True:
            await asyncio.sleep(1.0)
            now = list(lateness.counts)
            print(json.dumps([b - a for a, b in zip(before, now, strict=True)]), flush=True)
            before = now


if __name__ == "__main__":
    asyncio.run(beat())
