"""Peers with a broker between the ends: MQTT, NATS and Redis, on asyncio where the library has it."""

import asyncio
import sys
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

from benchmarks.message_path.brokers import broker_version
from benchmarks.message_path.ends import BACK, TO, AsyncWay, Stopwatch, Way, input_ended, paced


class Mqtt(Way):
    """paho-mqtt with its network thread, quality of service 0, through mosquitto."""

    name = "MQTT (mosquitto)"

    def version(self) -> str:
        return f"paho-mqtt {version('paho-mqtt')}, {broker_version('mosquitto')}"

    def echo(self, ready: Callable[[], None]) -> None:
        client = self._client()
        client.on_message = lambda _client, _data, message: client.publish(BACK, message.payload)
        client.subscribe(TO)
        ready()
        sys.stdin.read()
        client.loop_stop()

    def measure(self, warm: int, count: int) -> list[float]:
        client, watch = self._client(), Stopwatch()
        client.on_message = lambda _client, _data, message: watch.answered(message.payload)
        client.subscribe(BACK)

        def send(payload: bytes) -> None:
            client.publish(TO, payload)

        paced(send, watch, warm)
        watch.restart()
        paced(send, watch, count)
        client.loop_stop()
        return list(watch.times_us)

    def _client(self) -> Any:  # noqa: ANN401 - of an extra
        from paho.mqtt.client import Client  # noqa: PLC0415
        from paho.mqtt.enums import CallbackAPIVersion  # noqa: PLC0415

        client = Client(CallbackAPIVersion.VERSION2)
        client.connect("127.0.0.1", self.port)
        client.loop_start()
        return client


class Nats(AsyncWay):
    """nats-py through nats-server."""

    name = "NATS, asyncio"

    def version(self) -> str:
        return f"nats-py {version('nats-py')}, {broker_version('nats-server')}"

    def echo(self, ready: Callable[[], None]) -> None:
        asyncio.run(self._echo(ready))

    async def _echo(self, ready: Callable[[], None]) -> None:
        client = await self._client()

        async def heard(message: Any) -> None:  # noqa: ANN401 - of an extra
            await client.publish(BACK, message.data)

        await client.subscribe(TO, cb=heard)
        await client.flush()
        ready()
        await input_ended()
        await client.close()

    def measure(self, warm: int, count: int) -> list[float]:
        return asyncio.run(self._measure(warm, count))

    async def _measure(self, warm: int, count: int) -> list[float]:
        client, watch = await self._client(), Stopwatch()

        async def heard(message: Any) -> None:  # noqa: ANN401 - of an extra
            watch.answered(message.data)

        await client.subscribe(BACK, cb=heard)
        await client.flush()
        times_us = await self.warmed(lambda payload: client.publish(TO, payload), watch, warm, count)
        await client.close()
        return times_us

    async def _client(self) -> Any:  # noqa: ANN401 - of an extra
        import nats  # noqa: PLC0415

        return await nats.connect(f"nats://127.0.0.1:{self.port}")


class Redis(AsyncWay):
    """Publish and subscribe of redis-py's asyncio."""

    name = "Redis, asyncio"

    def version(self) -> str:
        return f"redis-py {version('redis')}, {broker_version('redis-server')}"

    def echo(self, ready: Callable[[], None]) -> None:
        asyncio.run(self._echo(ready))

    async def _echo(self, ready: Callable[[], None]) -> None:
        client, heard = await self._ends(TO)

        async def serve() -> None:
            async for message in heard.listen():
                if message["type"] == "message":
                    await client.publish(BACK, message["data"])

        serving = asyncio.create_task(serve())
        ready()
        await input_ended()
        serving.cancel()

    def measure(self, warm: int, count: int) -> list[float]:
        return asyncio.run(self._measure(warm, count))

    async def _measure(self, warm: int, count: int) -> list[float]:
        (client, heard), watch = await self._ends(BACK), Stopwatch()

        async def hear() -> None:
            async for message in heard.listen():
                if message["type"] == "message":
                    watch.answered(message["data"])

        hearing = asyncio.create_task(hear())
        times_us = await self.warmed(lambda payload: client.publish(TO, payload), watch, warm, count)
        hearing.cancel()
        return times_us

    async def _ends(self, channel: str) -> tuple[Any, Any]:
        import redis.asyncio  # noqa: PLC0415

        client = redis.asyncio.Redis(port=self.port)
        heard = client.pubsub()
        await heard.subscribe(channel)
        return client, heard
