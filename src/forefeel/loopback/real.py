"""Both daemons as processes over a real Zenoh session; this one records, shows progress and ends them."""

import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from forefeel.child_process import ChildProcess, free_endpoints
from forefeel.common.errors import RunError
from forefeel.common.messages import FOLLOWING
from forefeel.common.topics import COMMAND, SLAVE_STATE
from forefeel.common.transport.settings import TransportSettings
from forefeel.interrupt import Stop, signal_flag
from forefeel.loopback.hardware import Emulators
from forefeel.loopback.plan import AXIS, STATE, Plan
from forefeel.terminal import Show

if TYPE_CHECKING:
    from forefeel.recorder import Recorder

_POLL_S = 0.1  # s between two looks at the processes
_START_S = 60.0
"""A daemon that ends is noticed at once. One is ready after a second, or half a minute on a busy host."""
_RELEASE_S = 1.0  # s that the release may take to reach the slave


def run_real(
    plan: Plan,
    out: Path,
    progress: AbstractContextManager[Show],
    emulators: Emulators,
    viewed_at: Sequence[str] = (),
    on_end: Callable[[], object] = lambda: None,
) -> None:
    """Runs both daemons to the end and leaves out/recording.mcap; `progress` is entered when the daemons have
    started, and shown (seconds done, what happens). Writes settings and logs into `out`. `viewed_at`: where
    slave and master listen for a dashboard; `on_end` is called before the daemons are ended.

    The master starts first, for it takes longest. The recorder listens before the slave starts, so that it
    hears all that both say to each other. The emulated devices are there before the daemons, and longer. A
    dashboard connects to both daemons, and they do not wait for it.

    Raises:
        RunError: a process or the recording failed, or the user ended the run; the recording stays.
        InputError: a process ended with exit code 2.
    """
    recorder_at, free_at = free_endpoints(2)
    slave_at, *master_at = viewed_at or [free_at]
    plan = with_state(plan, out)
    plan.slave["transport"] = {"listen": [slave_at], "connect": [recorder_at]}
    plan.master["transport"] = {"listen": master_at, "connect": [slave_at, recorder_at]}
    with signal_flag() as stop:
        configs = plan.write(out)
        ends = () if plan.duration_s is None else ("--duration", f"{plan.duration_s}")
        slave = ChildProcess("slave", ("slave", "--config", str(configs[0])), out)
        master = ChildProcess("master", ("master", "--config", str(configs[1]), *ends), out)
        devices = [ChildProcess(name, ("emulate", *words), out) for name, words in emulators.items()]
        recorder: Recorder | None = None
        try:
            for device in devices:
                _start_device(device, stop)
            stop.check()
            master.start()
            from forefeel import recorder as recording  # noqa: PLC0415 - the master starts meanwhile

            path, transport = out / "recording.mcap", TransportSettings(listen=(recorder_at,))
            recorder = recording.Recorder(path, plan.slave["cell"], transport, plan.recorded())
            slave.start()
            with progress as show:
                _watch(slave, master, recorder, plan, show, stop)
            on_end()
        except KeyboardInterrupt:  # of `stop.check`: an error of what ends now goes first
            pass
        finally:
            for child in (master, slave, *reversed(devices)):
                child.end()
            if recorder is not None:
                recorder.close()
        if stop.wanted():
            what = f"the recording is {recorder.path}" if recorder else "nothing was recorded"
            raise RunError(f"interrupted; both ends stopped in order; {what}")
    for child in (slave, master, *devices):
        child.check()


def _start_device(device: ChildProcess, stop: Stop) -> None:
    """Starts the device and waits until it has written to its log, as it does when it can be opened.
    KeyboardInterrupt: a signal came. RunError, or InputError for exit code 2: it ended before, or wrote
    nothing within `_START_S`; then it is ended.
    """
    stop.check()
    device.start()
    for _ in stop.polls(_START_S, 0.01):
        if device.log.stat().st_size:
            return
        if not device.running:
            break
    stop.check()
    device.end()
    device.check()
    raise RunError(f"the emulated {device.name} did not appear (see {device.log})")


def _watch(
    slave: ChildProcess, master: ChildProcess, recorder: "Recorder", plan: Plan, show: Show, stop: Stop
) -> None:
    """Shows the seconds done and the slave's state until the master ends by itself, then waits until the
    slave follows no more, 1 s at most: else it would count a stop. KeyboardInterrupt: a signal came.
    RunError: recording failed, no session within `_START_S`, or the slave ended; InputError: it did with code
    2.
    """
    start_s, ready_s = time.monotonic(), None
    while master.running and slave.running:
        stop.check()
        recorder.check()
        now_s, state = time.monotonic(), recorder.latest(SLAVE_STATE, AXIS)
        if ready_s is None and state is not None and state.session_id:
            ready_s = now_s
        if ready_s is None and now_s - start_s > _START_S:
            raise RunError(f"no session between master and slave within {_START_S:g} s (see the logs)")
        done_s = 0.0 if ready_s is None else now_s - ready_s
        if plan.duration_s is None:
            command = recorder.latest(COMMAND, AXIS)
            done_s = (command.recording_time_s if command is not None else None) or 0.0
        show(done_s, state.state.value if state is not None else "starting")
        time.sleep(_POLL_S)
    if not slave.running:
        slave.check()
        raise RunError("the slave ended before the master")
    for _ in range(int(_RELEASE_S / _POLL_S)):
        state = recorder.latest(SLAVE_STATE, AXIS)
        if state is None or state.state not in FOLLOWING:
            return
        time.sleep(_POLL_S)


def with_state(plan: Plan, out: Path) -> Plan:
    """Copy of the plan with event logs and flight records of both ends beside the results."""
    slave, master = ({"directory": str((out / STATE / role).absolute())} for role in ("slave", "master"))
    return replace(plan, slave={**plan.slave, "state": slave}, master={**plan.master, "state": master})
