"""The service on two hosts whose cable delays and loses packets below Zenoh.

Slave and master run the world and the operator of `forefeel loopback`. Nothing is injected into their
messages: certificates, retransmission and congestion control meet delay and loss as on a real network.
"""

import re
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import yaml

from forefeel.common.recording.mcap_reader import Run
from forefeel.common.transport.settings import ImpairmentSettings
from forefeel.loopback.plan import LoopbackOptions, make_plan
from forefeel.loopback.real import run_real
from forefeel.report.model import RunReport
from forefeel.report.summary import summarise
from forefeel.terminal import bar
from tests.secured import make_pki
from tests.system.net.hosts import ADDRESSES, MEASURING, Hosts, TunCable, inside, joined_by_tun

End = Literal["slave", "master"]
ENDS: tuple[End, End] = ("slave", "master")

PKI = "pki"
_NEAR_PORT = 7480
"""Where both ends listen for the recorder, on the second cable."""
_START_S = 60.0
"""Longest time from the start of a daemon until it listens; compiling and a busy machine are in it."""
SESSION_S = 60.0
"""How long an opening session is waited for before it counts as none."""
_WAITING = {"slave": "waiting for a master", "master": "waiting for the slave"}
_OPEN, _OPEN_AGAIN = "session open;", "session open again"
_WAYS = {"there": "ba", "back": "ab"}
"""The cable's names of the directions: the slave is on its first host."""
_CONGESTION = Path("/proc/sys/net/ipv4/tcp_congestion_control")


@dataclass(frozen=True, slots=True)
class Link:
    """What joins master and slave.

    Attributes:
        protocol: of the endpoint on which the slave listens.
        connections: `transport.connections` of the master; None: its default.
    """

    protocol: str
    connections: int | None = None

    @property
    def secured(self) -> bool:
        """Whether it has certificates and access control."""
        return self.protocol in ("tls", "quic")

    @property
    def endpoint(self) -> str:
        """Where the slave listens and the master connects to."""
        return f"{self.protocol}/{ADDRESSES[0]}:7447"


LINKS: Mapping[str, Link] = {
    "default": Link("tls"),
    "tls": Link("tls", 1),
    "tls-4": Link("tls", 4),
    "tls-8": Link("tls", 8),
    "quic": Link("quic", 1),
    "udp": Link("udp", 1),
}
"""By name: what `deploy/config` gives, and what the documentation compares it with. The number is that of the
connections; `udp` has no certificates.
"""


@dataclass(frozen=True, slots=True)
class Route:
    """What the cable does to packets from the master to the slave (`there`) and from the slave (`back`)."""

    there: ImpairmentSettings
    back: ImpairmentSettings

    @property
    def round_trip_s(self) -> float:
        """Mean, without what TCP adds."""
        return self.there.delay_s + self.back.delay_s


JITTER_S = 0.005


def route(there_s: float, back_s: float, loss: float = 0.0, jitter_s: float = JITTER_S) -> Route:
    """One-way delays that vary by +-`jitter_s`; `loss` is a share of the packets, each way."""
    return Route(*(ImpairmentSettings(delay_s=s, jitter_s=jitter_s, loss=loss) for s in (there_s, back_s)))


def gate_for(route: Route) -> dict[str, float]:
    """Settings of the slave's gate for that route: the default limit of 700 ms leaves 600 ms no margin."""
    return {"max_round_trip_s": 1.0} if route.round_trip_s >= 0.6 else {}


def injected_run(folder: Path, route: Route, duration_s: float, seed: int) -> RunReport:
    """Both daemons on this host, as `forefeel loopback` runs them: their messages are delayed and lost."""
    plan = make_plan(LoopbackOptions(seed=seed, duration_s=duration_s))
    axis = plan.slave["axes"][0] | {"gate": gate_for(route)}
    slave, master = (
        {"impairment": {"inbound": way.model_dump(mode="json"), "seed": seed}}
        for way in (route.there, route.back)
    )
    plan = replace(plan, slave=plan.slave | slave | {"axes": [axis]}, master=plan.master | master)
    run_real(plan, folder, bar(duration_s), {})
    return summarise(Run(folder / "recording.mcap"))


class LinkedDaemons:
    """A slave on the first host and a master on the second; both may be started again and again."""

    def __init__(
        self,
        hosts: Hosts,
        cable: TunCable,
        link: Link,
        seed: int,
        gate: Mapping[str, float],
    ) -> None:
        self.hosts = hosts
        self.cable = cable
        self._link = link
        self._consent = () if link.secured else ("--insecure",)
        self._processes: dict[str, Any] = {}
        self._configure(seed, dict(gate))

    def shape(self, route: Route) -> None:
        """From now on the cable does that."""
        self.cable.shape(_WAYS["there"], **route.there.model_dump())
        self.cable.shape(_WAYS["back"], **route.back.model_dump())

    def record(self) -> None:
        """Records both ends to run.mcap, over a second cable that does nothing to packets."""
        words = ("forefeel", "record", "--config", "recorder.yaml", "--out", "run.mcap", *self._consent)
        self._processes["recorder"] = self.hosts.run(0, "recorder.log", *words)

    def open(self, order: Sequence[End] = ENDS) -> float:
        """Starts both, the second when the first one waits; the time until the session is open, in s.

        It counts from when the second one has said that it waits, too.

        Raises:
            AssertionError: no session within `SESSION_S`, or a process has ended.
        """
        for role in order:
            self._start(role)
        start_s = time.monotonic()
        self._await(lambda: self.count("master", _OPEN), SESSION_S, "session")
        return time.monotonic() - start_s

    def cut(self, cut_s: float) -> float:
        """Cuts the cable for that long, and until the master knows; the time from mending to a session, in s.

        Raises:
            AssertionError: no session within `SESSION_S`, or a process has ended.
        """
        lost, again = self.count("master", _WAITING["master"]), self.count("master", _OPEN_AGAIN)
        self.cable.cut()
        time.sleep(cut_s)
        self._await(lambda: self.count("master", _WAITING["master"]) > lost, SESSION_S, "lost session")
        mended_s = self.cable.mend() * 1e-9
        self._await(lambda: self.count("master", _OPEN_AGAIN) > again, SESSION_S, "session after the cut")
        return time.monotonic() - mended_s

    def state(self) -> str:
        """The slave's safety state as its terminal shows it."""
        changes = re.findall(r" \w+ -> (\w+)", self._said("slave"))
        return changes[-1] if changes else "idle"

    def wait_armed(self, timeout_s: float = 20.0) -> None:
        """Until the slave follows the operator."""
        self._await(lambda: self.state() == "armed", timeout_s, "armed slave")

    def congestion(self) -> str:
        """TCP's congestion control of the slave's host; that of the master's is the same."""
        with inside(self.hosts.names[0]):
            return _CONGESTION.read_text().strip()

    def count(self, role: str, text: str) -> int:
        """How often a process has said that since it was started."""
        return self._said(role).count(text)

    def end(self) -> None:
        """Ends both in order: the slave when the operator's release has reached it.

        Raises:
            AssertionError: one did not end well.
        """
        for role in ("master", "slave", "recorder"):
            process = self._processes.pop(role, None)
            if process is None:
                continue
            code = self.hosts.end(process)
            assert code == 0, f"the {role} ended with code {code}: {self.hosts.last_words()}"
            if role == "master":
                self._await(lambda: self.state() not in ("engaging", "armed"), 2.0, "release")

    # --- settings and logs ---

    def _configure(self, seed: int, gate: dict[str, float]) -> None:
        plan = make_plan(LoopbackOptions(seed=seed))
        cell = plan.slave["cell"]
        if self._link.secured:
            addresses: dict[str, list[str]] = {
                role: [ADDRESSES[number], MEASURING[number]] for number, role in enumerate(ENDS)
            }
            make_pki(self.hosts.folder / PKI, [cell], addresses)
        slave_axis = plan.slave["axes"][0] | {"gate": gate}
        own: dict[str, dict[str, Any]] = {
            "slave": plan.slave | {"axes": [slave_axis], "state": {"directory": "state-slave"}},
            "master": plan.master | {"state": {"directory": "state-master"}},
            "recorder": {"cell": cell},
        }
        for role, transport in self._transports().items():
            settings = own[role] | {"role": role, "transport": transport}
            (self.hosts.folder / f"{role}.yaml").write_text(yaml.safe_dump(settings))

    def _transports(self) -> dict[str, dict[str, Any]]:
        """By role. The recorder connects to both ends over the second cable."""
        link = self._link
        near = [f"{'tls' if link.secured else 'tcp'}/{address}:{_NEAR_PORT}" for address in MEASURING]
        common = {"pki": PKI} if link.secured else {}
        several = {} if link.connections is None else {"connections": link.connections}
        return {
            "slave": {"listen": [link.endpoint, near[0]], **common},
            "master": {"connect": [link.endpoint], "listen": [near[1]], **several, **common},
            "recorder": {"connect": near, **common},
        }

    def _start(self, role: End) -> None:
        (self.hosts.folder / f"{role}.log").unlink(missing_ok=True)
        words = ("forefeel", role, "--config", f"{role}.yaml", *self._consent)
        self._processes[role] = self.hosts.run(ENDS.index(role), f"{role}.log", *words)
        self._await(lambda: self.count(role, _WAITING[role]), _START_S, f"{role} that waits")

    def _said(self, role: str) -> str:
        path = self.hosts.folder / f"{role}.log"
        return path.read_text(errors="replace") if path.exists() else ""

    def _await(self, condition: Callable[[], object], timeout_s: float, what: str) -> None:
        """As `Hosts.wait_until`; what it raises ends with the master's last line, which tells the cause."""
        try:
            self.hosts.wait_until(condition, timeout_s, what)
        except AssertionError as error:
            lines = (self._said("master") or self._said("slave")).splitlines() or ["nothing said"]
            why = str(error).partition(":")[0]
            raise AssertionError(f"no {what} in {timeout_s:g} s ({why}): {lines[-1]}") from error


@contextmanager
def linked(
    folder: Path,
    link: Link,
    route: Route,
    *,
    seed: int = 1,
    gate: Mapping[str, float] | None = None,
    congestion: str | None = None,
) -> Iterator[LinkedDaemons]:
    """Both daemons, not yet started, on two hosts that are joined so; nothing of them is left afterwards.

    Args:
        folder: an empty one.
        link: see `LINKS`.
        route: what the cable does to packets.
        seed: of the operator, the world and the cable.
        gate: settings of the slave's gate that differ from their defaults; None: `gate_for` that route.
        congestion: TCP's congestion control of both hosts; None: as this machine has it.
    """
    with joined_by_tun(folder, seed) as (hosts, cable):
        for name in hosts.names if congestion is not None else ():
            with inside(name):  # the file is that of the namespace of the thread that opens it
                _CONGESTION.write_text(congestion or "")
        daemons = LinkedDaemons(hosts, cable, link, seed, gate_for(route) if gate is None else gate)
        daemons.shape(route)
        yield daemons


@dataclass(frozen=True, slots=True)
class LinkRun:
    """What became of a run.

    Attributes:
        open_s: see `LinkedDaemons.open`.
        report: of the whole run, as `forefeel report` has it.
        packets: their fate with the session open, by `there` and `back`, as `Way` of the forwarder counts.
        duration_s: how long the session was watched.
        congestion: TCP's congestion control of both hosts.
    """

    open_s: float
    report: RunReport
    packets: Mapping[str, Mapping[str, int]]
    duration_s: float
    congestion: str

    def packets_s(self, way: str) -> float:
        """Packets per second that were sent that way."""
        return self.packets[way]["offered"] / self.duration_s


def link_run(
    folder: Path,
    link: Link,
    route: Route,
    duration_s: float,
    seed: int = 1,
    congestion: str | None = None,
) -> LinkRun:
    """Runs the service for `duration_s` after its session has opened; see `linked`.

    Raises:
        AssertionError: no session, or a daemon did not end well.
    """
    with linked(folder, link, route, seed=seed, congestion=congestion) as daemons:
        daemons.record()
        open_s = daemons.open()
        before = daemons.cable.count()
        time.sleep(duration_s)
        after = daemons.cable.count()
        daemons.end()
        packets = {name: Counter(after[way]) - Counter(before[way]) for name, way in _WAYS.items()}
        report = summarise(Run(folder / "run.mcap"))
        return LinkRun(open_s, report, packets, duration_s, daemons.congestion())
