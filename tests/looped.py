"""A loopback in virtual time, run to its end."""

from pathlib import Path

from forefeel.common.recording.mcap_reader import Run
from forefeel.loopback.plan import Plan
from forefeel.loopback.virtual import VirtualLoopback


def looped(plan: Plan, seed: int = 1) -> VirtualLoopback:
    loop = VirtualLoopback(plan, seed)
    loop.run(lambda _done_s: None)
    return loop


def recorded(plan: Plan, path: Path, seed: int = 1) -> Run:
    """What was recorded of it, in that file."""
    looped(plan, seed).write(path)
    return Run(path)
