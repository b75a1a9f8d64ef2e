"""Certificates for tests, and Zenoh sessions that use them: ours, and those of somebody with bad intent."""

import json
import shutil
import socket
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from datetime import datetime, timedelta
from pathlib import Path
from typing import Literal

import zenoh

from forefeel.common.clock import MonotonicClock, now_utc
from forefeel.common.transport.pki import AUTHORITY
from forefeel.common.transport.security import Party, PartyFiles, PartyRole, secured
from forefeel.common.transport.settings import TransportSettings
from forefeel.common.transport.zenoh_bus import ZenohTransport, open_session
from forefeel.common.transport.zenoh_config import FIXED
from forefeel.pki.folder import init_folder

CELL = "cell"


def make_pki(
    folder: Path,
    cells: Sequence[str] = (CELL,),
    hosts: Mapping[str, Sequence[str]] | None = None,
    now: datetime | None = None,
    days: int = 2,
) -> Path:
    """The folder with an authority and all roles, in some milliseconds; localhost is in every certificate.

    All roles of a cell lie side by side, as where one host has them all: in the folder itself where there is
    one cell, else in CELL; the router's at the top.
    """
    words = [f"{role}={','.join(names)}" for role, names in (hosts or {}).items()]
    init_folder(folder, cells, words, days, now or now_utc())
    for place in [folder / "router", *(folder / cell for cell in cells)]:
        together = folder if len(cells) == 1 or place.name == "router" else place
        for path in [*place.glob("*.*"), *place.glob("*/*.*")]:
            shutil.copy2(path, together)
    return folder


def expired_pki(folder: Path) -> Path:
    """One whose certificates of roles expired yesterday, while the authority is valid."""
    return make_pki(folder, now=now_utc() - timedelta(days=3))


def identity(pki: Path, role: PartyRole, authority: Path | None = None) -> PartyFiles:
    """The files of a role; `authority`: whom it trusts, where that is not its own."""
    return PartyFiles(authority or pki / AUTHORITY, pki / f"{role}.crt", pki / f"{role}.key")


@contextmanager
def deaf_address() -> Iterator[str]:
    """Host and port of this host that answer no packet, as those of a host that is off: a full backlog."""
    with ExitStack() as stack:
        listener = stack.enter_context(socket.create_server(("127.0.0.1", 0), backlog=0))
        for _ in range(2):
            waiting = stack.enter_context(socket.socket())
            waiting.setblocking(False)
            waiting.connect_ex(listener.getsockname())
        yield f"127.0.0.1:{listener.getsockname()[1]}"


class Secured:
    """Sessions with the certificates of a folder; closed at the end, the last first."""

    def __init__(self) -> None:
        self.faults: list[Exception] = []
        self._stack = ExitStack()

    def open(
        self,
        pki: Path,
        role: PartyRole,
        listen: Sequence[str] = (),
        connect: Sequence[str] = (),
        mode: Literal["peer", "client"] = "peer",
        cell: str = CELL,
    ) -> ZenohTransport:
        """A transport of ours in that role."""
        settings = TransportSettings(mode=mode, listen=tuple(listen), connect=tuple(connect), pki=pki)
        transport = ZenohTransport.open(settings, MonotonicClock(), self.faults.append, Party(role, (cell,)))
        self._stack.callback(transport.close)
        return transport

    def router(self, pki: Path, endpoint: str, cells: Sequence[str]) -> zenoh.Session:
        """A router of ours."""
        settings = TransportSettings(listen=(endpoint,), pki=pki)
        party = Party("router", tuple(cells))
        session, _ = open_session(settings, "router", party, insecure=False, real_stage=False)
        return self._stack.enter_context(session)

    def attacker(
        self, connect: str, pki: Path | None = None, role: PartyRole = "viewer", authority: Path | None = None
    ) -> zenoh.Session:
        """A bare session with a certificate, or none, that follows no rule of ours: what it may not do, the
        other end has to refuse. Without `pki` and `authority` it is not encrypted.
        """
        return self._stack.enter_context(zenoh.open(bare_config(connect, pki, role, authority)))

    def close(self) -> None:
        self._stack.close()


@contextmanager
def sessions() -> Iterator[Secured]:
    """For a fixture, or a `with`."""
    opened = Secured()
    try:
        yield opened
    finally:
        opened.close()


def connected(session: zenoh.Session) -> bool:
    return bool(session.info.transports())


def bare_config(connect: str, pki: Path | None, role: PartyRole, authority: Path | None) -> zenoh.Config:
    """TLS without access control of its own; `authority`: whom it trusts, where that is not its own."""
    config = zenoh.Config()
    paths = {**FIXED, "mode": "peer", "connect/endpoints": [connect]}
    paths |= {"connect/timeout_ms": 0, "connect/exit_on_failure": False}
    if pki is not None:
        ours = secured(Party(role, (CELL,)), identity(pki, role, authority))
        paths["transport/link/tls"] = ours["transport/link/tls"]
    elif authority is not None:
        paths["transport/link/tls"] = {"root_ca_certificate": str(authority)}
    for path, value in paths.items():
        config.insert_json5(path, json.dumps(value))
    return config
