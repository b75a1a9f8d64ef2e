"""The faults."""

import signal
import time
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from tests.faults import required as r
from tests.faults.audit import Expected, heard, says, stopped
from tests.faults.scene import SECOND, Fault, Incident, Scene

_FAULT_S = 2.0
_NS = 1e-9
EMULATED: dict[str, Any] = {"emulated": {}}


def _killed(role: str, scene: Scene) -> Incident:
    """SIGKILL; started again after 2 s."""
    speed_m_s = scene.service.wait_moving()
    at_s = scene.strike(role, signal.SIGKILL)
    time.sleep(_FAULT_S)
    over_s = time.monotonic()
    _start(role, scene)
    scene.rearmed()
    return Incident(at_s, over_s, speed_m_s, gone=role == "master")


def _restarted(role: str, scene: Scene) -> Incident:
    """SIGTERM, as a service manager does; a new process, a new session."""
    speed_m_s = scene.service.wait_moving()
    at_s = time.monotonic()
    assert scene.hosts.end(scene.service.processes[role]) == 0, scene.hosts.last_words()
    over_s = time.monotonic()
    _start(role, scene)
    scene.rearmed()
    return Incident(at_s, over_s, speed_m_s)


def _start(role: str, scene: Scene) -> None:
    if role == "slave":
        scene.service.start_slave()
    else:
        scene.service.start_master()


def _frozen(role: str, frozen_s: float, scene: Scene) -> Incident:
    """SIGSTOP, and SIGCONT."""
    speed_m_s = scene.service.wait_moving()
    at_s = scene.strike(role, signal.SIGSTOP)
    time.sleep(frozen_s)
    over_s = scene.strike(role, signal.SIGCONT)
    time.sleep(0.5)
    scene.rearmed()
    return Incident(at_s, over_s, speed_m_s, frozen=role == "master", stood=role == "slave")


def _cut(scene: Scene) -> Incident:
    speed_m_s = scene.service.wait_moving()
    at_s = scene.cable.cut() * _NS
    time.sleep(_FAULT_S)
    over_s = scene.cable.mend() * _NS
    scene.rearmed()
    return Incident(at_s, over_s, speed_m_s)


def stalled(stall_s: float, scene: Scene) -> Incident:
    """Everything is held, then comes in one burst: old commands to the slave, old forces to the master."""
    speed_m_s = scene.service.wait_moving()
    at_s = scene.cable.stall(stall_s) * _NS
    time.sleep(stall_s + 0.5)
    scene.rearmed()
    return Incident(at_s, at_s + stall_s, speed_m_s)


def _lossy(scene: Scene) -> Incident:
    """30 % of all packets for 4 s; what runs above retransmits."""
    speed_m_s = scene.service.wait_moving()
    at_s = scene.cable.shape(**r.WAY, loss=0.3) * _NS
    time.sleep(4.0)
    over_s = scene.cable.shape(**r.WAY) * _NS
    scene.rearmed()
    return Incident(at_s, over_s, speed_m_s)


def _router_killed(scene: Scene) -> Incident:
    speed_m_s = scene.service.wait_moving()
    at_s = scene.strike("router", signal.SIGKILL)
    time.sleep(_FAULT_S)
    over_s = time.monotonic()
    scene.service.start_router()
    scene.rearmed()
    return Incident(at_s, over_s, speed_m_s)


def _clock_set(role: str, scene: Scene) -> Incident:
    """A daemon whose clock goes back ends; it is started again, as a service manager does."""
    speed_m_s = scene.service.wait_moving()
    at_s = scene.strike(role, signal.SIGUSR1)
    process = scene.service.processes[role]
    scene.hosts.expected_ends.add(process.pid)
    time.sleep(_FAULT_S)
    over_s = at_s
    recovery = f"by itself: {'a new session' if role == 'slave' else 'clocks compared anew'}"
    if process.poll() is not None:
        assert process.returncode == 1, scene.hosts.last_words()
        over_s, recovery = time.monotonic(), "ended by the fault; started again"
        _start(role, scene)
    elif scene.service.state() == "fault":
        over_s, recovery = scene.cleared(), "forefeel clear"
    scene.rearmed()
    return Incident(at_s, over_s, speed_m_s, recovery=recovery)


def _recorder_struck(number: signal.Signals, scene: Scene) -> Incident:
    """A second recorder goes away; the first shows that nobody cares."""
    path = scene.service.folder / f"{SECOND}.mcap"
    scene.service.start_second_recorder(SECOND, path.name)
    scene.hosts.wait_until(lambda: path.exists() and path.stat().st_size > 500_000, 60.0, "a recording")
    speed_m_s = scene.service.wait_moving()
    at_s = scene.strike(SECOND, number)
    time.sleep(_FAULT_S)
    if number is signal.SIGSTOP:
        assert scene.hosts.end(scene.service.processes[SECOND]) == 0
    time.sleep(1.0)
    return Incident(at_s, time.monotonic(), speed_m_s)


def _recorder_disk_full(scene: Scene) -> Incident:
    """The second recorder writes to a disk that becomes full: it says so and ends, the others go on."""
    second, path = f"{SECOND}.mcap", scene.disk.folder / f"{SECOND}.mcap"
    scene.service.start_second_recorder(SECOND, str(path), scene.disk.within)
    process = scene.service.processes[SECOND]
    scene.hosts.expected_ends.add(process.pid)
    scene.hosts.wait_until(lambda: scene.disk.free_bytes() < 4096, 30.0, "the disk full")
    at_s = time.monotonic()
    scene.hosts.wait_until(lambda: process.poll() is not None, 10.0, "the end of the recorder")
    assert process.returncode == 1, scene.hosts.last_words()
    assert scene.hosts.says(f"{SECOND}.log", "No space left"), scene.hosts.last_words()
    (scene.service.folder / second).write_bytes((scene.disk.seen / second).read_bytes())
    speed_m_s = scene.service.wait_moving()
    time.sleep(1.0)
    return Incident(at_s, time.monotonic(), speed_m_s)


def _state_disk_full(scene: Scene) -> Incident:
    """The slave can not write its audit log and flight records any more; nothing clears that but room."""
    speed_m_s = scene.service.wait_moving()
    at_s = time.monotonic()
    scene.disk.fill()
    scene.hosts.wait_until(lambda: scene.service.state() == "fault", 5.0, "a fault")
    time.sleep(1.0)
    assert scene.service.clear() == 1, "cleared while the disk is full"
    scene.disk.free()
    over_s = scene.cleared()
    scene.rearmed()
    return Incident(at_s, over_s, speed_m_s)


def _device(name: str, wait_s: float, lasts: bool, scene: Scene) -> Incident:
    """A device fails and is repaired; the fault is latched until it is cleared. `lasts`: it can not be
    cleared before.
    """
    speed_m_s = scene.service.wait_moving()
    at_s = scene.strike(name, signal.SIGUSR1)
    time.sleep(wait_s)
    assert scene.service.state() == "fault", scene.service.seen()
    if lasts:
        assert scene.service.clear() == 1, "cleared while the device is away"
    scene.strike(name, signal.SIGUSR1)
    time.sleep(0.2)
    over_s = scene.cleared()
    scene.rearmed()
    return Incident(at_s, over_s, speed_m_s)


_SESSION_LOST = says("slave", "session_lost"), says("master", "session_lost")
_KILLED = {role: says(role, "previous_not_closed") for role in ("slave", "master")}
_WATCHDOG = stopped("watchdog", "no valid command .*")
_STOOD_STILL = stopped("watchdog", "the control loop stood still .*")
_LATE = says("slave", "refused", name="late")
_FUTURE = says("slave", "refused", name="future")
_BOTH = "slave", "master"


def _failed(reason: str, device: str = "") -> tuple[Expected, ...]:
    """A device's fault, latched and cleared."""
    named = (says("slave", "device_fault", name=device, reason=reason),) if device else ()
    cleared = stopped("clear", "cleared at the slave"), says("slave", "clear", cleared="True")
    return *named, stopped("fault", reason), heard("fault"), *cleared


def _emulated(
    name: str, device: str, fault: str, rest_s: float, reason: str, wait_s: float = _FAULT_S
) -> Fault:
    """Of an emulated device; `stage` and `cell` are its process."""
    lasts = fault == "unplug"
    return Fault(
        name,
        partial(_device, device, wait_s, lasts),
        "repaired; forefeel clear",
        rest_s,
        faded_s=rest_s + r.FADED_S,
        service={"emulated": {device: f"{fault},{'plug' if lasts else 'free'}"}},
        audit=_failed(reason, ({"cell": "load_cell"}.get(device, device)) if lasts else ""),
        flights=_BOTH,
    )


def _recorder(what: str, act: Callable[[Scene], Incident], recovery: str) -> Fault:
    return Fault(f"recorder {what}", act, recovery, faded_s=None, strikes=True)


def _clock(role: str, step_s: float) -> Fault:
    back = step_s < 0.0
    audit: tuple[Expected, ...] = (_WATCHDOG, _SESSION_LOST[0] if back else _FUTURE)
    if role == "slave":
        audit = (stopped("fault", ".*"),) if back else (stopped("watchdog"),)
    if back:
        audit = *audit, says(role, "thread_fault", reason=".*")
    return Fault(
        f"clock step {step_s:+g} s, {role}",
        partial(_clock_set, role),
        "",
        r.BY_WATCHDOG_S,
        # what an emulated cell measured is attached to the wrong tick for some ms after a clock went back
        service={"stepped": {role: step_s}} | (EMULATED if role == "slave" and not back else {}),
        ends=role == "slave" and back,
        step=(role, step_s),
        audit=audit,
        flights=("slave",),
    )


def faults() -> Iterable[Fault]:
    """All of them, by what they strike."""
    yield from _of_master()
    yield from _of_slave()
    yield from _of_recorder_and_disk()
    yield from _of_network()
    yield from (_clock(role, step_s) for role in ("master", "slave") for step_s in (1.0, -1.0))
    yield from _of_devices()


def _of_master() -> Iterable[Fault]:
    yield Fault(
        "master SIGKILL", partial(_killed, "master"), "started again", r.BY_WATCHDOG_S,
        audit=(_WATCHDOG, _SESSION_LOST[0], _KILLED["master"]), flights=("slave",),
    )  # fmt: skip
    yield Fault(
        "master SIGSTOP 2 s", partial(_frozen, "master", 2.0), "SIGCONT: a new session", r.BY_WATCHDOG_S,
        audit=(_WATCHDOG, *_SESSION_LOST), flights=_BOTH,
    )  # fmt: skip
    yield Fault(
        "master SIGSTOP 0.3 s", partial(_frozen, "master", 0.3), "SIGCONT", r.BY_WATCHDOG_S,
        audit=(_WATCHDOG, heard("watchdog")), flights=_BOTH,
    )  # fmt: skip
    yield Fault(
        "master restarted", partial(_restarted, "master"), "new session", r.BY_WATCHDOG_S,
        audit=(stopped("release"), says("master", "stop"), says("master", "start")),
    )  # fmt: skip


def _of_slave() -> Iterable[Fault]:
    yield Fault(
        "slave SIGKILL", partial(_killed, "slave"), "started again", r.BY_DRIVE_S, service=EMULATED,
        audit=(_KILLED["slave"], _SESSION_LOST[1]), flights=("master",),
    )  # fmt: skip
    yield Fault(
        "slave SIGSTOP 2 s", partial(_frozen, "slave", 2.0), "SIGCONT: a new session", r.BY_DRIVE_S,
        service=EMULATED, audit=(_STOOD_STILL, *_SESSION_LOST), flights=_BOTH,
    )  # fmt: skip
    yield Fault(
        "slave SIGSTOP 0.3 s", partial(_frozen, "slave", 0.3), "SIGCONT", r.BY_DRIVE_S, service=EMULATED,
        audit=(_STOOD_STILL, heard("watchdog")), flights=_BOTH,
    )  # fmt: skip
    yield Fault(
        "slave restarted", partial(_restarted, "slave"), "new session", r.BY_DRIVE_S, service=EMULATED,
        audit=(stopped("shutdown"), says("slave", "stop"), _SESSION_LOST[1]),
    )  # fmt: skip


def _of_recorder_and_disk() -> Iterable[Fault]:
    yield _recorder("SIGKILL", partial(_recorder_struck, signal.SIGKILL), "nobody waits for it")
    yield _recorder("SIGSTOP 2 s", partial(_recorder_struck, signal.SIGSTOP), "nobody waits for it")
    yield _recorder("disk full", _recorder_disk_full, "ends and says so; the others go on")
    yield Fault(
        "state folder full", _state_disk_full, "room made; forefeel clear", r.NOTICED_S + r.BY_FAULT_S,
        faded_s=r.NOTICED_S + r.FADED_S, noticed="fault", on_disk=True,
        service={"extra": {"slave": {"state": {"directory": "disk/state"}}}},
        audit=(
            says("slave", "disk_full", what=".*No space left.*"),
            *_failed("audit log: No space left on device"),
            says("slave", "flight_failed", what=".*No space left.*"),
            says("slave", "log_written_again"),
        ),
        flights=("master",),
    )  # fmt: skip


def _of_network() -> Iterable[Fault]:
    yield Fault(
        "link cut 2 s", _cut, "link mended: a new session", r.BY_WATCHDOG_S,
        audit=(_WATCHDOG, *_SESSION_LOST), flights=_BOTH,
    )  # fmt: skip
    yield Fault(
        "stall 2 s, burst", partial(stalled, 2.0), "stall over: a new session", r.BY_WATCHDOG_S,
        audit=(_WATCHDOG, *_SESSION_LOST), flights=_BOTH,
    )  # fmt: skip
    yield Fault(
        "stall 0.3 s, burst", partial(stalled, 0.3), "stall over", r.BY_WATCHDOG_S,
        audit=(_WATCHDOG, _LATE, heard("watchdog")), flights=_BOTH,
    )  # fmt: skip
    yield Fault("30 % loss 4 s", _lossy, "loss over", may_go_on=True, faded_s=None)
    yield Fault(
        "router SIGKILL", _router_killed, "router started again: a new session", r.BY_WATCHDOG_S,
        service={"through_router": True, "emulated": {}},
        audit=(_WATCHDOG, *_SESSION_LOST), flights=_BOTH,
    )  # fmt: skip


def _of_devices() -> Iterable[Fault]:
    blind = "load cell invalid for more than 0.2 s"
    yield _emulated("stage unplugged", "stage", "unplug", r.BY_DRIVE_S, ".*zaber_ascii.*")
    yield _emulated("load cell unplugged", "cell", "unplug", r.BY_SILENCE_S, ".*bota_serial.*gone.*")
    yield _emulated("load cell NaN", "cell", "nan", r.BLIND_S, blind)
    yield _emulated("load cell saturated", "cell", "overrange", r.BLIND_S, blind)
    yield _emulated("load cell stuck", "cell", "stuck", r.STUCK_S, blind, 3.0)
