"""Peers that connect without a broker: ZeroMQ and gRPC, both on asyncio."""

import asyncio
from collections.abc import AsyncIterator, Callable
from importlib.metadata import version
from typing import Any

from benchmarks.message_path.ends import TO, AsyncWay, Stopwatch, input_ended

_METHOD = f"/{TO}/echo"


class ZeroMq(AsyncWay):
    """A pair of sockets of pyzmq's asyncio."""

    name = "ZeroMQ, asyncio"

    def version(self) -> str:
        import zmq  # noqa: PLC0415

        return f"pyzmq {version('pyzmq')}, libzmq {zmq.zmq_version()}"

    def echo(self, ready: Callable[[], None]) -> None:
        asyncio.run(self._echo(ready))

    async def _echo(self, ready: Callable[[], None]) -> None:
        socket = self._socket()
        socket.bind(f"tcp://127.0.0.1:{self.port}")

        async def serve() -> None:
            while True:
                await socket.send(await socket.recv())

        serving = asyncio.create_task(serve())
        ready()
        await input_ended()
        serving.cancel()
        socket.close(0)

    def measure(self, warm: int, count: int) -> list[float]:
        return asyncio.run(self._measure(warm, count))

    async def _measure(self, warm: int, count: int) -> list[float]:
        socket, watch = self._socket(), Stopwatch()
        socket.connect(f"tcp://127.0.0.1:{self.port}")

        async def hear() -> None:
            while True:
                watch.answered(await socket.recv())

        hearing = asyncio.create_task(hear())
        times_us = await self.warmed(socket.send, watch, warm, count)
        hearing.cancel()
        socket.close(0)
        return times_us

    @staticmethod
    def _socket() -> Any:  # noqa: ANN401 - of an extra
        import zmq.asyncio  # noqa: PLC0415

        return zmq.asyncio.Context.instance().socket(zmq.PAIR)


class Grpc(AsyncWay):
    """A stream in both directions of grpc.aio; bytes, so no protobuf is made or read."""

    name = "gRPC stream, asyncio"

    def version(self) -> str:
        return f"grpcio {version('grpcio')}"

    def echo(self, ready: Callable[[], None]) -> None:
        asyncio.run(self._echo(ready))

    async def _echo(self, ready: Callable[[], None]) -> None:
        import grpc  # noqa: PLC0415

        async def serve(requests: AsyncIterator[bytes], _context: object) -> AsyncIterator[bytes]:
            async for payload in requests:
                yield payload

        handler = grpc.stream_stream_rpc_method_handler(serve)
        server = grpc.aio.server()
        server.add_generic_rpc_handlers([grpc.method_handlers_generic_handler(TO, {"echo": handler})])
        server.add_insecure_port(f"127.0.0.1:{self.port}")
        await server.start()
        ready()
        await input_ended()
        await server.stop(0)

    def measure(self, warm: int, count: int) -> list[float]:
        return asyncio.run(self._measure(warm, count))

    async def _measure(self, warm: int, count: int) -> list[float]:
        import grpc  # noqa: PLC0415

        watch = Stopwatch()
        async with grpc.aio.insecure_channel(f"127.0.0.1:{self.port}") as channel:
            stream = channel.stream_stream(_METHOD)()

            async def hear() -> None:
                async for payload in stream:
                    watch.answered(payload)

            hearing = asyncio.create_task(hear())
            times_us = await self.warmed(stream.write, watch, warm, count)
            hearing.cancel()
        return times_us
