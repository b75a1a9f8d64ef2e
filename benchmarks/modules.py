"""What a force sample and what a setting pass on their way: `python -m benchmarks.modules`.

One cell runs in virtual time with the simulated world. In half a second of it, while the stage follows, every
call of a function of ours is counted: how many modules a reader of that way has before him, their lines, and
the calls of a tick. Compiled kernels and the network's library have no calls of Python.

Then a slave runs in this process for a moment, over Zenoh on the loopback interface. Every call that hands on
an object of settings is counted, once for each pair of caller and called function.
"""

import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FrameType

import forefeel
from forefeel.common.config import Settings
from forefeel.daemons import run_slave
from forefeel.loopback.plan import LoopbackOptions, make_plan
from forefeel.loopback.virtual import VirtualLoopback
from forefeel.slave.settings import SlaveSettings

_FROM_S, _TO_S = 3.0, 3.5  # s of virtual time that are looked at: after the start, while the stage follows
_TICKS = round((_TO_S - _FROM_S) * 1e3)
"""Ticks of each loop in that time: both run at 1 kHz."""
_RUN_S = 0.3  # s that a slave runs to its end
_FOLDERS = "common", "slave", "master"
_PACKAGE = Path(forefeel.__file__).parent
_HARNESS = {"common/runtime/virtual.py", "common/transport/memory.py"}
"""Take the place of the operating system and the network in virtual time."""


def main() -> None:
    """Prints modules by folder, lines, calls a tick; then each module."""
    calls = counted()
    lines = {name: len((_PACKAGE / name).read_text(encoding="utf-8").splitlines()) for name in calls}
    for folder in _FOLDERS:
        names = [name for name in calls if name.startswith(folder)]
        print(f"{folder:>7}: {len(names):3} modules, {sum(lines[each] for each in names):5} lines")
    total = sum(calls.values()) / _TICKS
    print(f"    all: {len(calls):3} modules, {sum(lines.values()):5} lines")
    print(f"{total:.0f} calls a tick of both loops together")
    handed = handed_on()
    print(f"settings: handed on {len(handed)} times through {len({to for _, to in handed})} modules\n")
    for name, count in calls.most_common():
        print(f"{count / _TICKS:8.2f} calls a tick  {lines[name]:4} lines  {name}")


def counted() -> Counter[str]:
    """Calls by module in the time looked at."""
    calls = Counter[str]()
    loop = VirtualLoopback(make_plan(LoopbackOptions(seed=1, duration_s=_TO_S + 0.1)), seed=1)
    loop.run(_looking(calls))
    return calls


def _looking(calls: Counter[str]) -> Callable[[float], None]:
    def note(frame: FrameType, event: str, _argument: object) -> None:
        name = _ours(frame) if event == "call" else None
        if name is not None and name.startswith(_FOLDERS) and name not in _HARNESS:
            calls[name] += 1

    def look(done_s: float) -> None:
        sys.setprofile(note if _FROM_S <= done_s < _TO_S else None)

    return look


def handed_on() -> set[tuple[str, str]]:
    """Where settings are handed on while a slave runs: line of the call, module of the called function."""
    found = set[tuple[str, str]]()

    def note(frame: FrameType, event: str, _argument: object) -> None:
        to = _ours(frame) if event == "call" else None
        caller = frame.f_back
        origin = None if caller is None else _ours(caller)
        if to is None or caller is None or origin is None:
            return
        code = frame.f_code
        handed = set(code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]) - {"self", "cls"}
        if any(isinstance(frame.f_locals.get(name), Settings) for name in handed):
            found.add((f"{origin}:{caller.f_lineno}", to))

    with TemporaryDirectory(prefix="forefeel-") as folder:
        settings = SlaveSettings.model_validate({"state": {"directory": folder}})
        sys.setprofile(note)
        try:
            run_slave(settings, duration_s=_RUN_S)
        finally:
            sys.setprofile(None)
    return found


def _ours(frame: FrameType) -> str | None:
    """The module of a function of ours, as a path within the package."""
    path = Path(frame.f_code.co_filename)
    if not path.is_relative_to(_PACKAGE) or frame.f_code.co_name.startswith("<"):
        return None
    return str(path.relative_to(_PACKAGE))


if __name__ == "__main__":
    main()
