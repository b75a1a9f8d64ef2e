"""The service over a cable that impairs packets, so that what lies below Zenoh answers as it does.

`python -m tests.net.prediction [LINK] [SECONDS]`: the report's own figures; LINK is one of `LINKS`.
"""

import sys
import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import yaml

from common.clock import now_utc
from common.recording.mcap_reader import read_run
from forefeel.pki.folder import make_folder
from forefeel.report.summary import RunReport, summarise
from tests.net.cable import ADDRESSES, MEASURING
from tests.net.hosts import Hosts, Process, joined_by_tun
from tests.net.namespaces import inside
from tests.net.service import CELL, Service

CABLE: dict[str, Any] = {"delay_s": 0.050, "jitter_s": 0.005, "loss": 0.005}
"""One way."""
_AT = f"{ADDRESSES[0]}:7447"


@dataclass(frozen=True, slots=True)
class Link:
    """What joins master and slave.

    Attributes:
        endpoints: those of the slave, which the master connects to; `AT` stands for host and port.
        watchdog_s: `gate.watchdog_s` of the slave, None: as in deploy/config.
        max_links: how many links Zenoh opens between two sessions.
        strands: over how many connections the streams take turns.
        congestion: TCP's congestion control, None: as the machine has it.
    """

    endpoints: tuple[str, ...]
    watchdog_s: float | None = None
    max_links: int = 1
    strands: int = 1
    congestion: str | None = None

    @property
    def secured(self) -> bool:
        """With certificates and access control."""
        return self.endpoints[0].startswith(("tls", "quic"))

    @property
    def at(self) -> list[str]:
        """The endpoints."""
        return [endpoint.replace("AT", _AT) for endpoint in self.endpoints]


LINKS = {
    "tcp": Link(("tcp/AT",)),
    "udp": Link(("udp/AT",)),
    "tls": Link(("tls/AT",)),
    "tls-150": Link(("tls/AT",), watchdog_s=0.15),
    "tls-200": Link(("tls/AT",), watchdog_s=0.2),
    "tls-300": Link(("tls/AT",), watchdog_s=0.3),
    "tls-x4": Link(("tls/AT",), strands=4),
    "tls-x8": Link(("tls/AT",), strands=8),
    "tls-reno": Link(("tls/AT",), congestion="reno"),
    "tls-x8-reno": Link(("tls/AT",), strands=8, congestion="reno"),
    "tls-x16-reno": Link(("tls/AT",), strands=16, congestion="reno"),
    "quic": Link(("quic/AT?multistream=0",)),
    "quic-streams": Link(("quic/AT",)),
    "quic-datagrams": Link(("quic/AT?rel=0",)),
    "quic-mixed": Link(("quic/AT?mixed_rel=1",)),
    "quic-and-tls": Link(("quic/AT?rel=0", "tls/AT"), max_links=2),
}
"""By name. `quic` is one stream, `quic-streams` one for each priority; `quic-mixed` sends what is best effort
in datagrams and the rest in streams of one connection. A number is the slave's watchdog in ms, after an x the
number of strands.
"""


def scored(
    folder: Path,
    link: str | Link,
    duration_s: float,
    seed: int = 1,
    **cable: Any,  # noqa: ANN401
) -> tuple[RunReport, dict[str, Any]]:
    """The report of a run over that cable, and what became of its packets."""
    chosen = LINKS[link] if isinstance(link, str) else link
    with joined_by_tun(folder, seed) as (hosts, tun):
        service = Service(hosts, insecure=not chosen.secured)
        _connect(folder, chosen)
        _control(hosts, chosen.congestion)
        service.start_slave()
        service.processes["slave-record"] = _record(folder, hosts, chosen)
        tun.shape(**cable)
        service.start_master()
        hosts.wait_until(lambda: hosts.says("master.log", "session open"), 60, "a session")
        time.sleep(duration_s)
        packets = tun.count()
        service.close()
        return summarise(read_run(folder / "run.mcap")), packets


def _control(hosts: Hosts, congestion: str | None) -> None:
    """Of each namespace; it is that of the thread that opens the file."""
    for name in hosts.names if congestion is not None else ():
        with inside(name):
            Path("/proc/sys/net/ipv4/tcp_congestion_control").write_text(congestion or "")


def _connect(folder: Path, link: Link) -> None:
    """Master and slave over that link, both open to the recorder over the other one."""
    if link.secured:
        hosts = {"slave": [ADDRESSES[0], MEASURING[0]], "master": [ADDRESSES[1], MEASURING[1]]}
        make_folder(folder / "own-pki", [CELL], hosts, 2, now_utc())
    common: dict[str, Any] = {"strands": link.strands} | ({"pki": "own-pki"} if link.secured else {})
    if link.max_links > 1:
        (folder / "zenoh.json5").write_text(f"{{transport: {{unicast: {{max_links: {link.max_links}}}}}}}")
        common["zenoh_file"] = "zenoh.json5"
    ends: dict[str, dict[str, Any]] = {
        "slave": {"listen": [*link.at, _near(link, 0)]},
        "master": {"connect": link.at, "listen": [_near(link, 1)]},
    }
    for role, transport in ends.items():
        path = folder / f"{role}.yaml"
        settings = yaml.safe_load(path.read_text())
        settings["transport"] = transport | common
        settings["state"] = {"directory": f"state-{role}"}
        if role == "master":
            settings["axes"][0]["handle"] = {"driver": "operator"}
        elif link.watchdog_s is not None:
            settings["axes"][0]["gate"] = settings["axes"][0]["gate"] | {"watchdog_s": link.watchdog_s}
        path.write_text(yaml.safe_dump(settings))


def _near(link: Link, host: int) -> str:
    return f"{'tls' if link.secured else 'tcp'}/{MEASURING[host]}:7480"


def _record(folder: Path, hosts: Hosts, link: Link) -> Process:
    """The recorder beside the slave, on the other link."""
    ends = [_near(link, 0), _near(link, 1)]
    transport: dict[str, Any] = {"connect": ends, "strands": link.strands}
    if link.secured:
        transport["pki"] = "own-pki"
    settings = {"role": "recorder", "cell": CELL, "transport": transport}
    (folder / "recorder.yaml").write_text(yaml.safe_dump(settings))
    words = ("--config", "recorder.yaml", "--out", "run.mcap", *(() if link.secured else ("--insecure",)))
    return hosts.run(0, "record.log", "forefeel", "record", *words)


def main() -> None:
    """See the module."""
    link, duration_s = (sys.argv[1:] + ["udp", "20"][len(sys.argv) - 1 :])[:2]
    with TemporaryDirectory(prefix="ff-") as folder:
        report, packets = scored(Path(folder), link, float(duration_s), **CABLE)
    ratio, settled = report.ratio.rms, report.settled.ratio.rms
    print(
        f"{link}: prediction {report.prediction.rms_n} N rms, hold {report.hold.rms_n} N rms, "
        f"ratio {ratio}, settled {settled}; scored {report.commands.scored} of {report.commands.sent}; "
        f"delay {report.delay_s}; armed {report.armed_share}, stops {report.stops}; {packets}"
    )


if __name__ == "__main__":
    main()
