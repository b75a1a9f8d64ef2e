"""`forefeel metrics`: a viewer with a port for Prometheus until Ctrl-C."""

import threading
import time
from collections.abc import Iterator
from contextlib import closing
from wsgiref.simple_server import WSGIServer

from prometheus_client import CollectorRegistry, start_http_server
from prometheus_client.core import Metric
from prometheus_client.registry import Collector

from forefeel.common.clock import MonotonicClock
from forefeel.common.errors import EndpointError, RunError
from forefeel.common.transport.security import Party
from forefeel.common.transport.zenoh_bus import ZenohTransport
from forefeel.interrupt import Stop, heeded
from forefeel.metrics.cell import CellMetrics
from forefeel.network_settings import ObserverSettings
from forefeel.terminal import say

_POLL_S = 0.2  # s between two looks for an end; chosen, not measured: a signal is heeded as late


class CellCollector(Collector):
    """Asked by Prometheus' client at each scrape, from a thread of its own."""

    def __init__(self, clock: MonotonicClock) -> None:
        self.cell = CellMetrics()
        self._clock, self._lock = clock, threading.Lock()

    def hear(self, key: str, payload: bytes, receive_ns: int) -> None:
        """A payload from the network."""
        with self._lock:
            self.cell.hear(key, payload, receive_ns)

    def collect(self) -> Iterator[Metric]:
        """See `Collector`."""
        with self._lock:
            return iter(list(self.cell.families(self._clock.now_ns())))


def serve(collector: Collector, address: str, port: int) -> tuple[WSGIServer, threading.Thread]:
    """The port; `shutdown` of the server ends it.

    Raises:
        EndpointError: it can not be opened.
    """
    registry = CollectorRegistry(auto_describe=False)
    registry.register(collector)
    try:
        return start_http_server(port, address, registry)
    except OSError as error:
        raise EndpointError(f"--port {port} at {address}: {error.strerror}; expected a free one") from error


def run_metrics(
    settings: ObserverSettings, address: str, port: int, duration_s: float | None, insecure: bool = False
) -> None:
    """Serves until SIGINT, SIGTERM, SIGHUP or the duration.

    Raises:
        InputError: an endpoint, a certificate or the port can not be used.
        RunError: the network failed.
    """
    clock, failed = MonotonicClock(), list[Exception]()
    collector = CellCollector(clock)
    server, thread = serve(collector, address, port)
    try:
        party = Party("viewer", (settings.cell,))
        transport = ZenohTransport.open(settings.transport, clock, failed.append, party, insecure=insecure)
        with heeded() as stop, closing(transport):
            transport.subscribe_all(f"forefeel/{settings.cell}", collector.hear)
            if transport.notice:
                say(transport.notice)
            say(f"metrics of cell {settings.cell} at http://{address}:{port}/metrics; Ctrl-C ends")
            _wait(failed, duration_s, stop)
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def _wait(failed: list[Exception], duration_s: float | None, stop: Stop) -> None:
    start_s = time.monotonic()
    while not (failed or stop.wanted()) and (duration_s is None or time.monotonic() - start_s < duration_s):
        time.sleep(_POLL_S)
    if failed:
        raise RunError(f"metrics: the network failed: {type(failed[0]).__name__}: {failed[0]}") from failed[0]
