"""Both daemons in virtual time: the same gates and impairment on the memory bus, bit for bit repeatable."""

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random

from forefeel.common.bus import observed
from forefeel.common.codec import Codec, Objects
from forefeel.common.messages import Message
from forefeel.common.recording.mcap_writer import RunWriter
from forefeel.common.runtime.virtual import VirtualRuntime
from forefeel.common.topics import parse_key
from forefeel.common.transport.memory import MemoryBus
from forefeel.loopback.plan import Plan
from forefeel.master.daemon import MasterDaemon
from forefeel.slave.daemon import SlaveDaemon

_SECOND_NS = 1_000_000_000  # ns in a second
# s of virtual time beyond twice the expected ones, after which a motion that does not end is cut off
_GRACE_S = 60.0


class VirtualLoopback:
    """One run in virtual time.

    Attributes:
        messages: every recorded one, (key, message, stamp_ns), in the order in which it was put.
    """

    def __init__(self, plan: Plan, seed: int, codec: type[Codec] = Objects) -> None:
        """`codec`: `Codec` to write and read bytes as over a network."""
        self.runtime = VirtualRuntime()
        self.messages: list[tuple[str, Message, int]] = []
        bus = MemoryBus(codec)
        self._codec = codec
        recorder = bus.session(self.runtime.clock)
        recorder.subscribe_all("forefeel", self._record)
        ids = Random(f"sessions {seed}")

        def new_id() -> int:
            return ids.getrandbits(62) | 1

        clock = self.runtime.clock
        self.slave = SlaveDaemon(plan.slave_settings(), bus.session(clock), self.runtime, new_id)
        self.master = MasterDaemon(plan.master_settings(), bus.session(clock), self.runtime, new_id)
        self._plan, self._ended = plan, False

    def run(self, progress: Callable[[float], None]) -> None:
        """Runs both daemons until the master has finished or the time is over (`duration_s`, or twice the
        expected and 60 s), then brings them to rest and closes them. `progress` gets s since the start; it
        may raise.
        """
        start_ns = self.runtime.clock.now_ns()
        limit_s = self._plan.duration_s or 2 * self._plan.expected_s + _GRACE_S

        def go_on(now_ns: int) -> bool:
            progress((now_ns - start_ns) * 1e-9)
            return not (self.master.finished or self._ended)

        gc.disable()  # what is made stays, as recorded messages: collecting would find nothing
        try:
            self.runtime.run(int(limit_s * _SECOND_NS), go_on)
            self._come_to_rest()
        finally:
            gc.enable()

    def end(self) -> None:
        """Ends the run at the next tick; for `progress`."""
        self._ended = True

    def _come_to_rest(self) -> None:
        """Shuts the master down, then the slave, at rest or after 1 s of virtual time; closes both."""
        self.master.shut_down()
        self.runtime.run(_SECOND_NS, lambda _now_ns: not self.slave.at_rest)
        self.slave.shut_down()
        self.runtime.run(_SECOND_NS // 10)
        now_ns = self.runtime.clock.now_ns()
        self.master.close(now_ns)
        self.slave.close(now_ns)

    def write(self, path: Path) -> None:
        with self.recording(path):
            pass

    @contextmanager
    def recording(self, path: Path) -> Iterator[Callable[[], None]]:
        """Opens the recording at `path` for the length of the block; gives a function that writes the
        messages that are not written yet. The end of the block calls it, too, whatever ends it.
        """
        with RunWriter(path) as writer:
            writer.add_metadata("run", self._plan.recorded())

            def write_on() -> None:
                for key, message, stamp_ns in self.messages[writer.written :]:
                    writer.write_message(key, message, stamp_ns)

            try:
                yield write_on
            finally:
                write_on()

    def _record(self, key: str, payload: bytes, receive_ns: int) -> None:
        parsed = parse_key(key)
        if parsed is not None and parsed[2].recorded:
            entries = observed(parsed[2], payload, receive_ns, self._codec)
            self.messages += [(key, message, message_ns) for message, message_ns in entries]
