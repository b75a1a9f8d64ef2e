"""What keeps the other end from being heard, looked for and said every 5 s while it is waited for."""

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from datetime import datetime
from pathlib import Path

from forefeel.common.clock import now_utc
from forefeel.common.errors import ConfigurationError
from forefeel.common.events.text import span
from forefeel.common.runtime.threads import in_thread
from forefeel.common.transport.endpoints import address
from forefeel.common.transport.pki import read_certificate, read_identity, renewal
from forefeel.common.transport.security import Party, PartyFiles
from forefeel.common.transport.settings import TransportSettings
from forefeel.reaching import Obstacle, reach, when

EVERY_NS = 5_000_000_000
"""The cause is looked for and said this often: soon enough for who waits, seldom enough for the other end."""


class Obstacles:
    """What is in the way of connections to the endpoints in `transport.connect`.

    Args:
        transport: names the endpoints, and our certificates, which a session reads once, when it opens.
        party: whose certificates they are.
        other: who is expected at the endpoints, in a word.

    Raises:
        ConfigurationError: a file of `transport.pki` is missing or not what it should be.
    """

    def __init__(self, transport: TransportSettings, party: Party, other: str) -> None:
        self._transport, self._other = transport, other
        self._identity: PartyFiles | None = None
        self._ends: dict[Path, datetime] = {}
        if transport.pki is not None:
            self._identity = read_identity(transport.pki, party, now_utc()).identity
            files = Path(self._identity.certificate), Path(self._identity.authority)
            self._ends = {path: read_certificate(path).not_valid_after_utc for path in files}

    def find(self) -> list[Obstacle]:
        """Our own certificate, or one for each endpoint that can not be reached. Blocks for some seconds."""
        found = [self._expired(path, end) for path, end in self._ends.items() if end < now_utc()]
        if found:
            return found
        for endpoint in self._transport.connect:
            reached = reach(endpoint, self._identity, self._other)
            if reached.obstacle is not None:
                found.append(reached.obstacle)
            elif not reached.tried:
                found.append(Obstacle(f"no answer from {address(endpoint)}", "", silent=True))
        return found

    def _expired(self, path: Path, end: datetime) -> Obstacle:
        now, renewed = now_utc(), False
        with suppress(ConfigurationError):
            renewed = read_certificate(path).not_valid_after_utc > now
        what = f"our certificate expired {when(end, now)} ({path})"
        return Obstacle(
            what, "it was renewed: start anew" if renewed else f"{renewal(path)}, then start anew"
        )


def unheard(transport: TransportSettings, connected: bool, missing: str) -> str:
    """What is wrong where nothing is in the way: no Zenoh there, or not who is missing."""
    where = ", ".join(map(address, transport.connect or transport.listen))
    if connected:
        return f"{where} is connected, but {missing}"
    if transport.connect:
        return f"{where} accepts connections, but none of Zenoh opens"
    return f"nobody has connected to {where}"


def in_words(found: Sequence[Obstacle], waited: str) -> str:
    """The obstacles, what to do, and for how long they have been in the way."""
    texts = [f"{each.what} for {waited}" if each.silent else f"{each.what}: {each.advice}" for each in found]
    timed = all(each.silent for each in found)
    return "; ".join(texts) if timed else f"{'; '.join(texts)} ({waited})"


class Waiting:
    """One wait after the other for somebody, and what is told meanwhile.

    The endpoints are tried in a thread, one trial at a time, so that `look` never blocks.

    Args:
        obstacles: what may be in the way.
        unheard: what is wrong where nothing is in the way, in words.
        tell: takes the cause, in words, every 5 s.

    Attributes:
        found: the cause that a trial found last; empty before, and when the cause is known without one.
    """

    def __init__(self, obstacles: Obstacles, unheard: Callable[[], str], tell: Callable[[str], None]) -> None:
        self._obstacles, self._unheard, self._tell = obstacles, unheard, tell
        self._since_ns: int | None = None
        self._due_ns = 0
        self._trial: Future[list[Obstacle]] | None = None
        self._awaited = False
        self.found = ""

    def look(self, now_ns: int, known: str = "") -> None:
        """Goes on waiting; many times a second. `known`: the cause, where no trial is needed to know it."""
        if self._since_ns is None:
            self._since_ns, self._due_ns = now_ns, now_ns + EVERY_NS
        if known:
            self.found, self._awaited = "", False
        if self._trial is not None and self._trial.done():
            trial, self._trial = self._trial, None
            if self._awaited:
                self.found = self._in_words(trial.result(), now_ns)
                self._tell(self.found)
        if now_ns < self._due_ns:
            return
        self._due_ns = now_ns + EVERY_NS
        if known:
            self._tell(f"{known} ({self._waited(now_ns)})")
        elif self._trial is None:
            self._awaited, self._trial = True, in_thread(self._obstacles.find, "trial of endpoints")

    def over(self) -> None:
        """Somebody is heard; a trial under way is not told any more."""
        self._since_ns, self._awaited, self.found = None, False, ""

    def try_now(self, now_ns: int) -> str:
        """The cause, in words. Blocks for some seconds at most."""
        return self._in_words(self._obstacles.find(), now_ns)

    def _in_words(self, found: Sequence[Obstacle], now_ns: int) -> str:
        waited = self._waited(now_ns)
        return in_words(found, waited) if found else f"{self._unheard()} ({waited})"

    def _waited(self, now_ns: int) -> str:
        return span(0.0 if self._since_ns is None else (now_ns - self._since_ns) * 1e-9)
