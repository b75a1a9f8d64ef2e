"""The transport over Zenoh."""

import os
import threading
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Self, cast

import zenoh
from zenoh import CongestionControl, Locality, Priority, Reliability

from forefeel.common.clock import Clock, now_utc
from forefeel.common.codec import Codec
from forefeel.common.errors import EndpointError, NoRouterError, RunError
from forefeel.common.topics import Qos
from forefeel.common.transport.endpoints import check_endpoint, explain
from forefeel.common.transport.exposure import check_exposure
from forefeel.common.transport.pki import read_identity
from forefeel.common.transport.port import MOST_POLLED, Handler, KeyedHandler, OnFault, Poll, Put
from forefeel.common.transport.security import Party, secured
from forefeel.common.transport.settings import MOST_CONNECTIONS, TransportSettings
from forefeel.common.transport.zenoh_config import Mode, configuration

_Receive = Callable[[zenoh.Sample], None]

_WORKERS = 2 * MOST_CONNECTIONS
"""Threads of each of Zenoh's runtimes. Closing a link of TCP or TLS blocks one until the other end has
acknowledged all, or for 10 s; with Zenoh's one or two nobody receives meanwhile: at 300 ms the end of a
refused second master stopped the stage of the first one, five times of five. Closing in order did not help.
"""

_WAITING_SAMPLES = 4096
"""Samples that a lagging subscriber keeps: 4 s of a 1 kHz stream; older samples make room."""

WAITING_OBSERVED = 65_536
"""The same of who hears all of a cell, more than 4000 samples a second: a recorder that waits its turn for
some seconds on a busy machine loses nothing."""

# Never BLOCK: a put that waits for a frozen peer keeps the dead link from being given up and opened anew
# (in 8 of 10 trials; with DROP none). What must arrive is repeated by its sender.
# Events have a queue of their own, of 1 MB: one is dropped only where the link is dead, or where a busy host
# does not send a burst in time (of 200 at once, beside two busy loops on two cores, some were lost).
_QOS: Mapping[Qos, tuple[CongestionControl, Priority, Reliability, bool]] = {
    Qos.STREAM: (CongestionControl.DROP, Priority.REAL_TIME, Reliability.BEST_EFFORT, True),
    Qos.STATE: (CongestionControl.DROP, Priority.DATA, Reliability.RELIABLE, False),
    Qos.EVENT: (CongestionControl.DROP, Priority.INTERACTIVE_HIGH, Reliability.RELIABLE, True),
}


class Publication:
    """A declared publisher: `put` sends by it."""

    def __init__(self, put: Put, publisher: zenoh.Publisher) -> None:
        self.put = put
        self._publisher = publisher

    def has_subscriber(self) -> bool:
        """True if a session that is connected now subscribes to it; False once it is undeclared."""
        try:
            # The stub says bool; it is an object that is always true.
            return cast(zenoh.MatchingStatus, self._publisher.matching_status).matching
        except zenoh.ZError:
            return False


class ZenohTransport:
    """One Zenoh session. See the port for the contract.

    Each subscription has a ring of samples, and a thread of its own that empties it and calls the handler,
    unless it is polled. Zenoh's own callbacks and channels block the session when one of them lags: a slow
    handler would hold up every other topic, commands included. Here it loses the oldest of its own samples
    (seen as a gap in their sequence) and holds up nobody.

    Attributes:
        notice: what the user must be told loudly about this session, or empty.
    """

    codec = Codec

    def __init__(self, session: zenoh.Session, clock: Clock, on_fault: OnFault) -> None:
        self._session = session
        self._now_ns = clock.now_ns
        self._on_fault = on_fault
        self._closed = False
        self._declared = ExitStack()
        self._declared.enter_context(session)
        self._threads: list[threading.Thread] = []
        self.notice, self._mode = "", "peer"

    @classmethod
    def open(
        cls,
        settings: TransportSettings,
        clock: Clock,
        on_fault: OnFault,
        party: Party | None = None,
        *,
        insecure: bool = False,
        real_stage: bool = False,
    ) -> Self:
        """Opens a session. A peer that is not up yet is waited for in the background.

        Args:
            settings: endpoints, and certificates.
            clock: of the receive stamps.
            on_fault: takes what a handler raised.
            party: whose certificate it is, needed with `settings.pki`.
            insecure: the user consents to endpoints outside this host without certificates.
            real_stage: a real stage is configured, for which that consent does not count.

        Raises:
            EndpointError: an endpoint is taken, malformed, not resolvable, or needs certificates; or no
                router answers a client.
            ConfigurationError: a file of `pki` is missing or not what it should be.
        """
        session, notice = open_session(
            settings, settings.mode, party, insecure=insecure, real_stage=real_stage
        )
        transport = cls(session, clock, on_fault)
        transport.notice, transport._mode = notice, settings.mode
        return transport

    def publisher(self, key: str, qos: Qos) -> Put:
        """Declares a publisher; its `Put` raises RunError when the session broke down."""
        return self.publication(key, qos).put

    def publication(self, key: str, qos: Qos) -> "Publication":
        """Declares a publisher of the priority and congestion control of `qos`, closed with the session."""
        congestion, priority, reliability, express = _QOS[qos]
        publisher = self._session.declare_publisher(
            key,
            congestion_control=congestion,
            priority=priority,
            reliability=reliability,
            express=express,
            allowed_destination=Locality.REMOTE,
        )
        return Publication(self._sender(key, self._declared.enter_context(publisher)), publisher)

    def _sender(self, key: str, publisher: zenoh.Publisher) -> Put:
        """Makes a `Put`: raises RunError where the session broke down, does nothing once it is closed."""
        put = publisher.put

        def send(payload: bytes) -> None:
            try:
                put(payload)
            except zenoh.ZError as error:
                if not self._closed:
                    raise RunError(f"{key}: {error}") from error

        return send

    def subscribe(self, key: str, handler: Handler) -> None:
        self._subscribe(key, lambda sample: handler(sample.payload.to_bytes(), self._now_ns()))

    def polled(self, key: str, handler: Handler, most: int = MOST_POLLED) -> Poll:
        """Subscribes without a thread; the returned poll hands up to `most` waiting payloads to `handler`,
        stamped then. The newest 4096 wait; an exception of the handler is reported as a fault.
        """
        subscriber = self._session.declare_subscriber(key, zenoh.handlers.RingChannel(_WAITING_SAMPLES))
        self._declared.enter_context(subscriber)
        take, now_ns = subscriber.handler.try_recv, self._now_ns

        def receive(sample: zenoh.Sample) -> None:
            handler(sample.payload.to_bytes(), now_ns())

        def poll() -> None:
            for _ in range(most):
                if self._closed or (sample := take()) is None:
                    return
                self._deliver(sample, receive)

        return poll

    def subscribe_all(self, prefix: str, handler: KeyedHandler, waiting: int = WAITING_OBSERVED) -> None:
        """Subscribes `handler` to what other sessions put to `prefix` or below it, called in a thread of its
        own; the newest `waiting` are kept for it.
        """
        self._subscribe(
            f"{prefix}/**",
            lambda sample: handler(str(sample.key_expr), sample.payload.to_bytes(), self._now_ns()),
            waiting,
        )

    def peers(self) -> int:
        return 0 if self._closed else len(self._session.info.transports())

    @property
    def hint(self) -> str:
        """Hint that a peer is connected to a router, which joins no two peers; else, or closed, empty."""
        if self._closed or self._mode != "peer":
            return ""
        transports = self._session.info.transports()
        routed = any(transport.whatami == zenoh.WhatAmI.ROUTER for transport in transports)
        hint = "a router answers there, and joins no two peers; expected mode: client (--through-router)"
        return hint if routed else ""

    def close(self) -> None:
        """Undeclares, closes the session, waits for running handlers; not to be called from one."""
        if self._closed:
            return
        self._closed = True
        self._declared.close()  # newest first, the session last: a publisher alive then leaks a descriptor
        for thread in self._threads:
            thread.join()

    def _subscribe(self, key: str, receive: _Receive, waiting: int = _WAITING_SAMPLES) -> None:
        """Subscribes, with a thread that calls `receive` for each sample; the newest `waiting` are kept."""
        subscriber = self._session.declare_subscriber(key, zenoh.handlers.RingChannel(waiting))
        # A daemon thread, so that a process that dies without `close` does not hang on it.
        thread = threading.Thread(
            target=self._run, args=(subscriber.handler, receive), name=f"zenoh {key}", daemon=True
        )
        self._declared.enter_context(subscriber)
        self._threads.append(thread)
        thread.start()

    def _run(self, samples: zenoh.Handler[zenoh.Sample], receive: _Receive) -> None:
        """Body of a subscription's thread; `samples` ends when the subscriber is undeclared."""
        for sample in samples:
            if self._closed:
                return
            self._deliver(sample, receive)

    def _deliver(self, sample: zenoh.Sample, receive: _Receive) -> None:
        """Hands a sample to `receive`, whose exception is a fault; drops one put to a key with a wildcard."""
        if "*" in str(sample.key_expr):  # Zenoh delivers a put to `forefeel/**` to each of us
            return
        try:
            receive(sample)
        except Exception as error:  # noqa: BLE001 - the edge to the transport
            self._on_fault(error)


def set_workers(number: int) -> None:
    """Sets `ZENOH_RUNTIME`, where it is unset, to so many threads of each runtime; before the first
    session.
    """
    runtimes = ", ".join(f"{name}: (worker_threads: {number})" for name in ("rx", "tx", "net"))
    os.environ.setdefault("ZENOH_RUNTIME", f"({runtimes})")


def open_session(
    settings: TransportSettings, mode: Mode, party: Party | None, *, insecure: bool, real_stage: bool
) -> tuple[zenoh.Session, str]:
    """Checks the endpoints and opens a bare Zenoh session; returns it with a warning for the user, or an
    empty text. Sets `ZENOH_RUNTIME` where it is unset.

    Raises:
        ValueError: `pki` without a party.
        EndpointError, ConfigurationError: see `ZenohTransport.open`; NoRouterError where no router answers.
    """
    for endpoint in settings.listen + settings.connect:
        check_endpoint(endpoint)
    added: dict[str, object] = {}
    if settings.pki is not None:
        if party is None:
            raise ValueError("a session with certificates needs a party: whose are they?")
        added = secured(party, read_identity(settings.pki, party, now_utc()).identity)
    notice = check_exposure(
        settings.listen,
        settings.connect,
        secured=bool(added),
        insecure=insecure,
        real_stage=real_stage,
    )
    set_workers(_WORKERS)
    try:
        return zenoh.open(configuration(settings, mode, added)), notice
    except zenoh.ZError as error:
        kind = NoRouterError if "Unable to connect" in str(error) else EndpointError
        raise kind(explain(str(error), settings.listen, settings.connect)) from error
