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
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from forefeel.__main__ import main as run_command_line
from forefeel.devices.emulation import bench
from forefeel.devices.emulation.bench import Surroundings
from forefeel.devices.emulation.sensing import EmulatedSensor
from forefeel.devices.zaber import emulator
from forefeel.emulate import run

ROW = struct.Struct("<qdd")
OnMotion = Callable[[float, float, float, float], None]
_MOST_STEPS = 100
"""10 mm/s of 0.1 um, in a ms."""


def provoke(faults: list[str]) -> bytearray:
    """Lets the next of them happen at each SIGUSR1; the rows of the motion, as they come."""
    waiting, lies, rows = list[str](), ["honest"], bytearray()
    signal.signal(signal.SIGUSR1, lambda *_: waiting.append(faults.pop(0)))
    step, measure = emulator.ZaberAxis.step, EmulatedSensor.measure
    moved, obey = bench.moved, run.obey_stdin

    def slowed_step(axis: emulator.ZaberAxis) -> None:
        before = axis.position
        step(axis)
        if lies[-1] == "slow":
            axis.position = before + max(-_MOST_STEPS, min(_MOST_STEPS, axis.position - before))

    def signed_measure(sensor: EmulatedSensor, t_s: float) -> float:
        return measure(sensor, t_s) * (-1.0 if lies[-1] == "reversed" else 1.0)

    def noted_motion(around: Surroundings, sign: int, leave: ExitStack) -> OnMotion:
        inner = moved(around, sign, leave)

        def on_motion(t_s: float, x_m: float, v_m_s: float, a_m_s2: float) -> None:
            inner(t_s, x_m, v_m_s, a_m_s2)
            rows.extend(ROW.pack(time.monotonic_ns(), sign * x_m, sign * v_m_s))

        return on_motion

    def obey_signals_too(living: run.Living, load: bench.Load | None) -> None:
        while waiting:
            if (fault := waiting.pop(0)) in ("slow", "reversed", "honest"):
                lies.append(fault)
            else:
                living.provoke(fault)
        obey(living, load)

    for place, name, replacement in (
        (emulator.ZaberAxis, "step", slowed_step),
        (EmulatedSensor, "measure", signed_measure),
        (emulator, "moved", noted_motion),
        (run, "obey_stdin", obey_signals_too),
    ):
        setattr(place, name, replacement)
    return rows


def main() -> None:
    rows = provoke(sys.argv.pop(1).split(","))
    sys.argv.insert(1, "emulate")
    try:
        run_command_line()
    finally:
        if rows:
            with Path(os.environ["FOREFEEL_MOTION"]).open("ab") as file:
                file.write(rows)


if __name__ == "__main__":
    main()
