"""The transport over Zenoh."""

import json
import threading
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Self

import zenoh
from zenoh import CongestionControl, Locality, Priority, Reliability

from common.clock import Clock
from common.errors import ConfigurationError, EndpointError, RunError
from common.topics import Qos
from common.transport.endpoints import check_endpoint, explain
from common.transport.port import Handler, KeyedHandler, OnFault, Put
from common.transport.settings import TransportSettings

_Receive = Callable[[zenoh.Sample], None]

_WAITING_SAMPLES = 4096
"""What a subscriber that lags keeps: 4 s of a 1 kHz stream; older samples make room."""

_FIXED: Mapping[str, object] = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "transport/shared_memory/enabled": False,
    "transport/unicast/open_timeout": 500,
    "transport/unicast/accept_timeout": 500,
    "transport/link/tx/queue/size/interactive_high": 16,
    # Opening returns at once; the other end may come later.
    "open/return_conditions": {"connect_scouted": False, "declares": False},
    "connect/retry": {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 2},
}
# Never BLOCK: a put that waits for a frozen peer keeps the dead link from being given up and opened anew.
# Events have a queue of their own, of 1 MB: one is dropped only where thousands wait on a dead link.
_QOS: Mapping[Qos, tuple[CongestionControl, Priority, Reliability, bool]] = {
    Qos.STREAM: (CongestionControl.DROP, Priority.REAL_TIME, Reliability.BEST_EFFORT, True),
    Qos.STATE: (CongestionControl.DROP, Priority.DATA, Reliability.RELIABLE, False),
    Qos.EVENT: (CongestionControl.DROP, Priority.INTERACTIVE_HIGH, Reliability.RELIABLE, True),
}


class ZenohTransport:
    """One Zenoh session. See the port for the contract.

    Each subscription has a thread of its own that empties a ring of samples and calls the handler. Zenoh's
    own callbacks and channels block the session when one of them lags: a slow handler would hold up every
    other topic, commands included. Here it loses the oldest of its own samples (seen as a gap in their
    sequence) and holds up nobody.

    Attributes:
        handler_faults: exceptions that handlers raised; each went to `on_fault`.
    """

    def __init__(self, session: zenoh.Session, clock: Clock, on_fault: OnFault) -> None:
        self._session = session
        self._now_ns = clock.now_ns
        self._on_fault = on_fault
        self._closed = False
        self._declared = ExitStack()
        self._declared.enter_context(session)
        self._threads: list[threading.Thread] = []
        self.handler_faults = 0

    @classmethod
    def open(cls, settings: TransportSettings, clock: Clock, on_fault: OnFault) -> Self:
        """Opens a session. A peer that is not up yet is waited for in the background.

        Raises:
            EndpointError: an endpoint is taken, malformed, not resolvable; or no router answers a client.
            ConfigurationError: `zenoh_file` is missing or not a Zenoh configuration.
        """
        for endpoint in settings.listen + settings.connect:
            check_endpoint(endpoint)
        try:
            session = zenoh.open(_config(settings))
        except zenoh.ZError as error:
            raise EndpointError(explain(str(error), settings.listen, settings.connect)) from error
        return cls(session, clock, on_fault)

    def publisher(self, key: str, qos: Qos) -> Put:
        """Declares a publisher; its `Put` raises RunError when the session broke down."""
        congestion, priority, reliability, express = _QOS[qos]
        publisher = self._session.declare_publisher(
            key,
            congestion_control=congestion,
            priority=priority,
            reliability=reliability,
            express=express,
            allowed_destination=Locality.REMOTE,
        )
        put = self._declared.enter_context(publisher).put

        def send(payload: bytes) -> None:
            try:
                put(payload)
            except zenoh.ZError as error:
                if not self._closed:
                    raise RunError(f"{key}: {error}") from error

        return send

    def subscribe(self, key: str, handler: Handler) -> None:
        """Delivers what other sessions put to `key`."""
        self._receive(key, lambda sample: handler(sample.payload.to_bytes(), self._now_ns()))

    def subscribe_all(self, prefix: str, handler: KeyedHandler) -> None:
        """Delivers what other sessions put to `prefix` or below it."""
        self._receive(
            f"{prefix}/**",
            lambda sample: handler(str(sample.key_expr), sample.payload.to_bytes(), self._now_ns()),
        )

    def peers(self) -> int:
        """How many other sessions are connected now."""
        return 0 if self._closed else len(self._session.info.transports())

    def close(self) -> None:
        """Undeclares, closes the session, waits for running handlers; not to be called from one."""
        if self._closed:
            return
        self._closed = True
        self._declared.close()  # newest first, the session last: a publisher alive then leaks a descriptor
        for thread in self._threads:
            thread.join()

    def _receive(self, key: str, receive: _Receive) -> None:
        subscriber = self._session.declare_subscriber(key, zenoh.handlers.RingChannel(_WAITING_SAMPLES))
        # A daemon thread, so that a process that dies without `close` does not hang on it.
        thread = threading.Thread(
            target=self._run, args=(subscriber.handler, receive), name=f"zenoh {key}", daemon=True
        )
        self._declared.enter_context(subscriber)
        self._threads.append(thread)
        thread.start()

    def _run(self, samples: zenoh.Handler[zenoh.Sample], receive: _Receive) -> None:
        """The thread of one subscription; `samples` ends when the subscriber is undeclared."""
        for sample in samples:
            if self._closed:
                return
            try:
                receive(sample)
            except Exception as error:  # noqa: BLE001 - the edge of the thread
                self.handler_faults += 1
                self._on_fault(error)


def _config(settings: TransportSettings) -> zenoh.Config:
    """That of the file, where there is one, overruled by the settings and this module."""
    config = zenoh.Config() if settings.zenoh_file is None else _from_file(str(settings.zenoh_file))
    chosen = {
        "mode": settings.mode,
        "listen/endpoints": settings.listen,
        "connect/endpoints": settings.connect,
        "transport/link/tx/lease": round(settings.lease_s * 1000),
    }
    for key, value in {**_FIXED, **chosen}.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _from_file(path: str) -> zenoh.Config:
    try:
        return zenoh.Config.from_file(path)
    except zenoh.ZError as error:
        raise ConfigurationError(
            f"{path}: {str(error).partition(' at /')[0]}; expected a Zenoh JSON5 file"
        ) from error
