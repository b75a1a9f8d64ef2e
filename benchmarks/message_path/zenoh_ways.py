"""Zenoh bare, and what the product makes of it."""

import asyncio
import sys
import time
from abc import abstractmethod
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

import zenoh

from benchmarks.gated import gated
from benchmarks.message_path.ends import Stopwatch, Way, input_ended, paced
from forefeel.common.clock import MonotonicClock
from forefeel.common.topics import COMMAND, FORCE, Qos
from forefeel.common.transport.port import Put
from forefeel.common.transport.security import Party
from forefeel.common.transport.settings import TransportSettings
from forefeel.common.transport.zenoh_bus import ZenohTransport

_CELL, _AXIS = "cell", "bench"
_THERE, _HERE = COMMAND.taken_key(_CELL, _AXIS), FORCE.taken_key(_CELL, _AXIS)
_CLOCK = MonotonicClock()


class _ZenohWay(Way):
    """The measuring end is the same for all: Zenoh's own callback. `secured`: by mTLS and access control."""

    secured = False

    def version(self) -> str:
        return f"eclipse-zenoh {version('eclipse-zenoh')}"

    def _open(self, listens: bool) -> ZenohTransport:
        endpoint = (f"{'tls' if self.secured else 'tcp'}/127.0.0.1:{self.port}",)
        settings = TransportSettings(
            listen=endpoint if listens else (),
            connect=() if listens else endpoint,
            pki=self.pki if self.secured else None,
        )
        party = Party("slave" if listens else "master", (_CELL,))
        return ZenohTransport.open(settings, _CLOCK, _raise, party)

    def measure(self, warm: int, count: int) -> list[float]:
        transport, watch = self._open(listens=False), Stopwatch()
        subscriber = _bare(transport).declare_subscriber(
            _HERE, lambda sample: watch.answered(sample.payload.to_bytes())
        )
        put = transport.publisher(_THERE, Qos.STREAM)
        while not watch.times_us:  # until both ends know each other
            watch.restart()
            put(watch.ask())
            time.sleep(0.2)
        paced(put, watch, warm)
        watch.restart()
        paced(put, watch, count)
        subscriber.undeclare()
        transport.close()
        return list(watch.times_us)


class _CallbackWay(_ZenohWay):
    """What `answer` makes of a sample is done in Zenoh's callback thread."""

    @abstractmethod
    def answer(self, put: Put) -> Callable[[zenoh.Sample], None]:
        """What is done with each sample before it is put back."""

    def echo(self, ready: Callable[[], None]) -> None:
        transport = self._open(listens=True)
        answer = self.answer(transport.publisher(_HERE, Qos.STREAM))
        subscriber = _bare(transport).declare_subscriber(_THERE, answer)
        ready()
        sys.stdin.read()
        subscriber.undeclare()
        transport.close()


class BareZenoh(_CallbackWay):
    """A callback that puts the payload back."""

    name = "Zenoh, bare callbacks"

    def answer(self, put: Put) -> Callable[[zenoh.Sample], None]:
        return lambda sample: put(sample.payload.to_bytes())


class GatedInCallback(_CallbackWay):
    """Decoded, validated and gated in Zenoh's callback thread."""

    name = "forefeel's gate in Zenoh's callback"

    def answer(self, put: Put) -> Callable[[zenoh.Sample], None]:
        admit = gated(put)
        return lambda sample: admit(sample.payload.to_bytes(), _CLOCK.now_ns())


class Own(_ZenohWay):
    """As the daemons do it: the ring, its thread, decoding, validation and the gate."""

    name = "forefeel"

    def echo(self, ready: Callable[[], None]) -> None:
        transport = self._open(listens=True)
        transport.subscribe(_THERE, gated(transport.publisher(_HERE, Qos.STREAM)))
        ready()
        sys.stdin.read()
        transport.close()


class SecuredZenoh(BareZenoh):
    name = "Zenoh, bare callbacks, mTLS"
    secured = True


class SecuredOwn(Own):
    name = "forefeel, mTLS"
    secured = True


class OwnAsyncio(_ZenohWay):
    """Hands messages to asyncio as the daemons do with what is not urgent."""

    name = "forefeel, on asyncio"

    def echo(self, ready: Callable[[], None]) -> None:
        asyncio.run(self._echo(ready))

    async def _echo(self, ready: Callable[[], None]) -> None:
        loop, transport = asyncio.get_running_loop(), self._open(listens=True)
        admit = gated(transport.publisher(_HERE, Qos.STREAM))
        transport.subscribe(
            _THERE, lambda payload, at_ns: (loop.call_soon_threadsafe(admit, payload, at_ns), None)[1]
        )
        ready()
        await input_ended()
        transport.close()


def _bare(transport: ZenohTransport) -> Any:  # noqa: ANN401 - its `undeclare` is not typed
    return getattr(transport, "_session")  # noqa: B009 - below the product's own rings


def _raise(error: BaseException) -> None:
    raise error
