"""An emulated device that fails when told: `python -m tests.system.net.provoked FAULTS DEVICE OPTIONS...`.

`forefeel emulate DEVICE OPTIONS...`, to which the next one of FAULTS (`unplug,plug`) happens at SIGUSR1;
besides those of the device `slow` (the stage makes 10 mm/s at most), `reversed` (so is the cell's sign) and
`honest`. What the stage really does is told in the file that FOREFEEL_MOTION names: a row of (CLOCK_MONOTONIC
ns, position m, velocity m/s) for each millisecond that it lived through, whatever becomes of its host; it is
written at the end, for a device waits for no disk.
"""

import os
import signal
import struct
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from forefeel.__main__ import main as run_command_line
from forefeel.devices.emulation import bench
from forefeel.devices.emulation.bench import Surroundings
from forefeel.devices.emulation.sensing import EmulatedSensor
from forefeel.devices.zaber import emulator
from forefeel.emulate import run

ROW = struct.Struct("<qdd")
OnMotion = Callable[[float, float, float, float], None]


@contextmanager
def told(path: Path) -> Iterator[None]:
    """The motion of the stage that is made meanwhile is added to the file at the end."""
    original, rows = bench.moved, bytearray()

    def moved(around: Surroundings, sign: int, leave: ExitStack) -> OnMotion:
        inner = original(around, sign, leave)

        def on_motion(t_s: float, x_m: float, v_m_s: float, a_m_s2: float) -> None:
            inner(t_s, x_m, v_m_s, a_m_s2)
            rows.extend(ROW.pack(time.monotonic_ns(), sign * x_m, sign * v_m_s))

        return on_motion

    setattr(emulator, "moved", moved)  # noqa: B010 - what `build` looks up
    try:
        yield
    finally:
        setattr(emulator, "moved", original)  # noqa: B010
        if rows:
            with path.open("ab") as file:
                file.write(rows)


LIES = "slow", "reversed", "honest"
_MOST_STEPS = 100
"""10 mm/s of 0.1 um, in a ms."""


class Lying:
    """Every emulated stage and load cell of this process, as the last lie has it."""

    lie = "honest"

    def __init__(self) -> None:
        step, measure = emulator.ZaberAxis.step, EmulatedSensor.measure

        def stepped(axis: emulator.ZaberAxis) -> None:
            before = axis.position
            step(axis)
            if self.lie == "slow":
                axis.position = before + max(-_MOST_STEPS, min(_MOST_STEPS, axis.position - before))

        def measured(sensor: EmulatedSensor, t_s: float) -> float:
            return measure(sensor, t_s) * (-1.0 if self.lie == "reversed" else 1.0)

        setattr(emulator.ZaberAxis, "step", stepped)  # noqa: B010
        setattr(EmulatedSensor, "measure", measured)  # noqa: B010


def main() -> None:
    lying = Lying()
    faults = sys.argv.pop(1).split(",")
    sys.argv.insert(1, "emulate")
    waiting, original = list[str](), run.obey_stdin

    def obey(living: run.Living, load: bench.Load | None) -> None:
        while waiting:
            if (fault := waiting.pop(0)) in LIES:
                lying.lie = fault
            else:
                living.provoke(fault)
        original(living, load)

    setattr(run, "obey_stdin", obey)  # noqa: B010 - what the emulator looks up
    signal.signal(signal.SIGUSR1, lambda *_: waiting.append(faults.pop(0)))
    with told(Path(os.environ["FOREFEEL_MOTION"])):
        run_command_line()


if __name__ == "__main__":
    main()
