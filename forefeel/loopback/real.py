"""Both daemons as processes over a real Zenoh session; this one records, shows progress and ends them."""

import time
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from forefeel.common.bus import M, observed
from forefeel.common.errors import CodecError, RunError
from forefeel.common.messages import FOLLOWING
from forefeel.common.topics import COMMAND, SLAVE_STATE, Topic
from forefeel.common.transport.settings import TransportSettings
from forefeel.interrupt import Stop, signal_flag
from forefeel.loopback.child import Child, free_endpoints
from forefeel.loopback.hardware import Emulators
from forefeel.loopback.plan import AXIS, STATE, Plan
from forefeel.loopback.viewer import DashboardProcess
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
    viewer: DashboardProcess | None,
) -> None:
    """Runs both daemons to the end and leaves out/recording.mcap; `progress` is entered when the daemons have
    started, and shown (seconds done, what happens). Writes settings and logs into `out`.

    The master starts first, for it takes longest. The recorder listens before the slave starts, so that it
    hears all that both say to each other. The emulated devices are there before the daemons, and longer. A
    dashboard connects to both daemons, and they do not wait for it.

    Raises:
        RunError: a process or the recording failed, or the user ended the run; the recording stays.
        InputError: a process ended with exit code 2.
    """
    recorder_at, slave_at = free_endpoints(2)
    master_at: list[str] = []
    if viewer is not None:
        slave_at, *master_at = viewer.endpoints
    plan = with_state(_with_endpoints(plan, slave_at, recorder_at, *master_at), out)
    with signal_flag() as stop:
        paths = plan.write(out)
        ends = () if plan.duration_s is None else ("--duration", f"{plan.duration_s}")
        slave = Child("slave", ("slave", "--config", str(paths[0])), out)
        master = Child("master", ("master", "--config", str(paths[1]), *ends), out)
        devices = [Child(name, ("emulate", *words), out) for name, words in emulators.items()]
        recorder: Recorder | None = None
        try:
            if _start_all(devices, master, stop):
                from forefeel import recorder as recording  # noqa: PLC0415 - the master starts meanwhile

                transport = TransportSettings(listen=(recorder_at,))
                path = out / "recording.mcap"
                recorder = recording.Recorder(path, plan.slave["cell"], transport, plan.recorded())
                slave.start()
                with progress as show:
                    _watch(slave, master, recorder, plan, show, stop)
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


def _start_all(devices: Sequence[Child], master: Child, stop: Stop) -> bool:
    """Starts the devices, each once the one before can be opened, then the master; False as soon as a signal
    came, the rest not started.
    """
    for child in (*devices, master):
        if stop.wanted():
            return False
        child.start()
        if child in devices:
            _await_output(child, stop)
    return True


def _await_output(device: Child, stop: Stop) -> None:
    """Waits until the device has written to its log, as it does when it can be opened, or a signal came.
    RunError, or InputError for exit code 2: it ended before, or wrote nothing within `_START_S`; then it is
    ended.
    """
    end_s = time.monotonic() + _START_S
    while not (device.log.stat().st_size or stop.wanted()):
        if not device.running or time.monotonic() > end_s:
            device.end()
            device.check()
            raise RunError(f"the emulated {device.name} did not appear (see {device.log})")
        time.sleep(0.01)


def _watch(slave: Child, master: Child, recorder: "Recorder", plan: Plan, show: Show, stop: Stop) -> None:
    """Shows s done and the slave's state until the master ends by itself, whose release is waited for, or a
    signal came. RunError: recording failed, no session within `_START_S`, or the slave ended; InputError:
    with code 2.
    """
    start_s, ready_s = time.monotonic(), None
    key = f"forefeel/{plan.slave['cell']}/{AXIS}"
    while master.running and slave.running:
        if stop.wanted():
            return
        recorder.check()
        now_s = time.monotonic()
        state = _newest(recorder, f"{key}/{SLAVE_STATE.name}", SLAVE_STATE)
        if ready_s is None and state is not None and state.session_id:
            ready_s = now_s
        if ready_s is None and now_s - start_s > _START_S:
            raise RunError(f"no session between master and slave within {_START_S:g} s (see the logs)")
        done_s = 0.0 if ready_s is None else now_s - ready_s
        if plan.duration_s is None:
            command = _newest(recorder, f"{key}/{COMMAND.name}", COMMAND)
            done_s = (command.recording_time_s if command is not None else None) or 0.0
        show(done_s, state.state.value if state is not None else "starting")
        time.sleep(_POLL_S)
    if not slave.running:
        slave.check()
        raise RunError("the slave ended before the master")
    _await_release(recorder, f"{key}/{SLAVE_STATE.name}")


def _await_release(recorder: "Recorder", key: str) -> None:
    """Waits until the slave has received the release, 1 s at most; else it would count a stop."""
    for _ in range(int(_RELEASE_S / _POLL_S)):
        state = _newest(recorder, key, SLAVE_STATE)
        if state is None or state.state not in FOLLOWING:
            return
        time.sleep(_POLL_S)


def _newest(recorder: "Recorder", key: str, topic: Topic[M]) -> M | None:
    payload = recorder.newest.get(key)
    try:
        return None if payload is None else observed(topic, payload, 0)[-1][0]
    except (CodecError, IndexError):
        return None


def _with_endpoints(plan: Plan, slave: str, recorder: str, *master: str) -> Plan:
    """Connects the master to the slave, both to the recorder; `master`: where it listens, for a viewer."""
    return replace(
        plan,
        slave={**plan.slave, "transport": {"listen": [slave], "connect": [recorder]}},
        master={**plan.master, "transport": {"listen": list(master), "connect": [slave, recorder]}},
    )


def with_state(plan: Plan, out: Path) -> Plan:
    """Puts the event logs and flight records of both ends beside the results."""
    slave, master = ({"directory": str((out / STATE / role).absolute())} for role in ("slave", "master"))
    return replace(plan, slave={**plan.slave, "state": slave}, master={**plan.master, "state": master})
