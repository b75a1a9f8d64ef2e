"""Who attacks over real Zenoh: a bare session that restricts itself in nothing, with whatever certificate."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path

import zenoh

from forefeel.common.clock import now_utc
from forefeel.common.transport.security import PartyFiles, common_name
from forefeel.pki.authority import certificate_pem, key_pem, new_key
from forefeel.pki.folder import init_folder, read_authority
from tests.live_cell import CELL

PAPERS = (
    "no certificate", "a certificate of another authority", "an expired certificate",
    "another cell's master", "viewer", "recorder",
)  # fmt: skip
HEARING = frozenset({"viewer", "recorder"})
CONNECTED = HEARING | {"another cell's master"}
"""Of these the authority is the right one: access control is what keeps them out."""


@dataclass(frozen=True, slots=True)
class Stranger:
    """One session at the slave's endpoint."""

    session: zenoh.Session

    def put(self, key: str, payload: bytes) -> None:
        self.session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK, express=True)

    @property
    def connected(self) -> bool:
        return bool(self.session.info.transports())


@contextmanager
def stranger(endpoint: str, identity: PartyFiles | None = None) -> Iterator[Stranger]:
    """A session, with an identity over TLS."""
    config = zenoh.Config()
    chosen: dict[str, object] = {
        "mode": "peer", "connect/endpoints": [endpoint], "listen/endpoints": [],
        "scouting/multicast/enabled": False, "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
        "connect/exit_on_failure": False, "connect/timeout_ms": 0,
        "open/return_conditions": {"connect_scouted": False, "declares": False},
    }  # fmt: skip
    if identity is not None:
        chosen["transport/link/tls"] = _tls(identity)
    for path, value in chosen.items():
        config.insert_json5(path, json.dumps(value))
    with zenoh.open(config) as session:
        yield Stranger(session)


def _tls(identity: PartyFiles) -> dict[str, object]:
    trusted: dict[str, object] = {
        "root_ca_certificate": str(identity.authority),
        "verify_name_on_connect": False,
    }
    if not str(identity.certificate).endswith("none"):
        trusted |= {
            "enable_mtls": True,
            "connect_private_key": str(identity.key),
            "connect_certificate": str(identity.certificate),
        }
    return trusted


def identity(papers: str, pki: Path, folder: Path) -> PartyFiles:
    """The files that such an attacker has; made where there are none yet."""
    authority = pki / "ca.crt"
    match papers:
        case "no certificate":
            return PartyFiles(authority, Path("none"), Path("none"))
        case "a certificate of another authority":
            other = folder / "foreign"
            if not other.exists():
                init_folder(other, [CELL], [], 30, now_utc())
            other = other / CELL / "master"
            return PartyFiles(authority, other / "master.crt", other / "master.key")
        case "an expired certificate":
            return _expired(pki, folder)
        case "another cell's master":
            init_folder(pki, ["other"], [], 30, now_utc())
            other = pki / "other" / "master"
            return PartyFiles(authority, other / "master.crt", other / "master.key")
        case _:
            return PartyFiles(authority, pki / f"{papers}.crt", pki / f"{papers}.key")


def _expired(pki: Path, folder: Path) -> PartyFiles:
    """The master's name, signed by the right authority, too long ago."""
    key = new_key()
    name = common_name("master", CELL)
    signed = read_authority(pki).sign(name, key.public_key(), [], now_utc() - timedelta(days=40), 30)
    files = PartyFiles(pki / "ca.crt", folder / "expired.crt", folder / "expired.key")
    Path(files.certificate).write_bytes(certificate_pem(signed))
    Path(files.key).write_bytes(key_pem(key))
    return files
