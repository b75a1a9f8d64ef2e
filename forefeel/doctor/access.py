"""Does the access control that this host's certificate meets really work? Zenoh sessions on loopback try it.

One listens with the rules that the other end would enforce; one connects with this host's certificate and
says, first, what its role may, then what it may not. A third listens with this host's own rules, which let
nobody in but the other roles: there, even the first is refused.
"""

import queue
import socket
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import zenoh

from forefeel.common.topics import COMMAND, FORCE, Role
from forefeel.common.transport.security import Party, PartyFiles, secured
from forefeel.common.transport.settings import TransportSettings
from forefeel.common.transport.zenoh_config import configuration
from forefeel.doctor.findings import Finding

GROUP = "access control"
_AXIS = "doctor"
# s in which what is allowed has to come through; chosen, not measured: shorter fails on a busy host
_PATIENCE_S = 3.0
# s in which what is refused must not come through; chosen, not measured: loopback takes far less
_SILENCE_S = 0.3
_OTHER: Mapping[Role, Role] = {"slave": "master", "master": "slave"}
_OWN = {"slave": FORCE, "master": COMMAND}


@dataclass(frozen=True, slots=True)
class Tried:
    """What came through. `error`: why nothing could be tried."""

    own_passes: bool = False
    forbidden_passes: bool = False
    stranger_passes: bool = False
    error: str = ""


def try_access(role: Role, cell: str, identity: PartyFiles) -> Tried:
    """Tries it; about a second; never raises for what Zenoh does."""
    other = _OTHER[role]
    allowed, forbidden = (_OWN[each].key(cell, _AXIS) for each in (role, other))
    try:
        with _heard(secured(Party(other, (cell,)), identity), identity, cell) as (say, heard):
            passes = _comes_through(say, heard, allowed, _PATIENCE_S)
            refused_passes = _comes_through(say, heard, forbidden, _SILENCE_S)
        with _heard(secured(Party(role, (cell,)), identity), identity, cell) as (say, heard):
            stranger = _comes_through(say, heard, allowed, _SILENCE_S)
    except (zenoh.ZError, OSError) as error:
        return Tried(error=" ".join(str(error).split())[:200])
    return Tried(passes, refused_passes, stranger)


class _Say:
    """Puts to any key of one session."""

    def __init__(self, session: zenoh.Session) -> None:
        self.session = session

    def __call__(self, key: str) -> None:
        self.session.put(key, b"doctor")


@contextmanager
def _heard(
    rules: Mapping[str, object], identity: PartyFiles, cell: str
) -> Iterator[tuple[_Say, "queue.SimpleQueue[str]"]]:
    """A listening session with those rules, and one that is connected with our certificate and none."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        endpoint = f"tls/127.0.0.1:{probe.getsockname()[1]}"
    heard: queue.SimpleQueue[str] = queue.SimpleQueue()
    plain = {key: value for key, value in secured(Party("viewer", (cell,)), identity).items() if "tls" in key}
    with ExitStack() as opened:
        listener = _open(TransportSettings(listen=(endpoint,)), rules)
        opened.callback(listener.close)
        for topic in _OWN.values():
            subscriber = listener.declare_subscriber(
                topic.key(cell, _AXIS), lambda sample: heard.put(str(sample.key_expr))
            )
            opened.callback(subscriber.undeclare)
        talker = _open(TransportSettings(connect=(endpoint,)), plain)
        opened.callback(talker.close)
        _wait_for_link(talker)
        yield _Say(talker), heard


def _open(settings: TransportSettings, added: Mapping[str, object]) -> zenoh.Session:
    return zenoh.open(configuration(settings, "peer", added))


def _wait_for_link(session: zenoh.Session) -> None:
    deadline_s = time.monotonic() + _PATIENCE_S
    while not session.info.transports():
        if time.monotonic() > deadline_s:
            raise TimeoutError(f"the two sessions were not connected within {_PATIENCE_S:g} s")
        time.sleep(0.02)


def _comes_through(say: _Say, heard: "queue.SimpleQueue[str]", key: str, patience_s: float) -> bool:
    """Says it again and again until it is heard or the patience ends."""
    deadline_s = time.monotonic() + patience_s
    while time.monotonic() < deadline_s:
        say(key)
        try:
            if heard.get(timeout=0.02) == key:
                return True
        except queue.Empty:
            pass
    return False


def judge_access(found: Tried, role: Role) -> list[Finding]:
    """Red: a rule does not do what it should; amber: it could not be tried."""
    if found.error:
        advice = "correct the certificates first, then try again"
        return [Finding(GROUP, f"{role}, self-test", "amber", f"not tried: {found.error}", advice)]
    own, other = _OWN[role].name, _OWN[_OTHER[role]].name
    report = "do not run it outside of loopback; report this with the versions below"
    rows = (
        (
            f"{role} says {own}",
            found.own_passes,
            "passes",
            "is refused",
            "files of one forefeel pki init",
        ),
        (f"{role} says {other}", not found.forbidden_passes, "is refused", "passes", report),
        (f"another {role} speaks to it", not found.stranger_passes, "is refused", "passes", report),
    )
    return [
        Finding(GROUP, subject, "green" if good else "red", right if good else wrong, "" if good else advice)
        for subject, good, right, wrong, advice in rows
    ]
