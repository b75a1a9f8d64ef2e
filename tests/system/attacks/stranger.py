"""Who attacks over real Zenoh: a bare session that restricts itself in nothing, with whatever certificate."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path

import zenoh

from forefeel.common.clock import now_utc
from forefeel.common.transport.pki import AUTHORITY
from forefeel.common.transport.security import common_name
from forefeel.pki.authority import certificate_pem, key_pem, new_key
from forefeel.pki.folder import init_folder, read_authority
from tests.live_cell import CELL
from tests.secured import make_pki

PAPERS = (
    "no certificate", "a certificate of another authority", "an expired certificate",
    "another cell's master", "viewer", "recorder",
)  # fmt: skip
HEARING = frozenset({"viewer", "recorder"})
CONNECTED = HEARING | {"another cell's master"}
"""Of these the authority is the right one: access control is what keeps them out."""


@dataclass(frozen=True, slots=True)
class Stranger:
    session: zenoh.Session

    def put(self, key: str, payload: bytes) -> None:
        self.session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK, express=True)

    @property
    def connected(self) -> bool:
        return bool(self.session.info.transports())


@contextmanager
def stranger(endpoint: str, tls: dict[str, object] | None = None) -> Iterator[Stranger]:
    config = zenoh.Config()
    settings: dict[str, object] = {
        "mode": "peer", "connect/endpoints": [endpoint], "listen/endpoints": [],
        "scouting/multicast/enabled": False, "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
        "connect/exit_on_failure": False, "connect/timeout_ms": 0,
        "open/return_conditions": {"connect_scouted": False, "declares": False},
        **({} if tls is None else {"transport/link/tls": tls}),
    }  # fmt: skip
    for path, value in settings.items():
        config.insert_json5(path, json.dumps(value))
    with zenoh.open(config) as session:
        yield Stranger(session)


def tls_of(papers: str, pki: Path, folder: Path) -> dict[str, object]:
    """TLS of an attacker with such papers, who trusts the right authority."""
    trusted: dict[str, object] = {
        "root_ca_certificate": str(pki / AUTHORITY), "verify_name_on_connect": False,
    }  # fmt: skip
    role, own = "master", folder / "own"
    match papers:
        case "no certificate":
            return trusted
        case "a certificate of another authority":
            make_pki(own, [CELL])
        case "an expired certificate":
            _expired(pki, own)
        case "another cell's master":
            init_folder(pki, ["other"], [], 30, now_utc())
            own = pki / "other" / "master"
        case _:
            role, own = papers, pki
    key, certificate = (str(own / f"{role}.{suffix}") for suffix in ("key", "crt"))
    return {
        **trusted, "enable_mtls": True, "connect_private_key": key, "connect_certificate": certificate,
    }  # fmt: skip


def _expired(pki: Path, own: Path) -> None:
    """The master's name, signed by the right authority, too long ago."""
    key, began = new_key(), now_utc() - timedelta(days=40)
    signed = read_authority(pki).sign(common_name("master", CELL), key.public_key(), [], began, 30)
    own.mkdir()
    (own / "master.crt").write_bytes(certificate_pem(signed))
    (own / "master.key").write_bytes(key_pem(key))
