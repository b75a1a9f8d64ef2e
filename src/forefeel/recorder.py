"""The recorder: a session of its own that writes all of a cell to a file; it can not slow a daemon down.

`forefeel record` runs it until Ctrl-C.
"""

import threading
from collections import deque
from collections.abc import Mapping
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from forefeel.common.bus import M, observed
from forefeel.common.clock import MonotonicClock
from forefeel.common.errors import CodecError, RunError
from forefeel.common.events.text import gap
from forefeel.common.messages import MasterState, Message, SlaveState
from forefeel.common.recording.mcap_writer import RunWriter
from forefeel.common.runtime.service_manager import service_watchdog
from forefeel.common.runtime.threads import in_thread
from forefeel.common.slots import BoundedQueue
from forefeel.common.topics import Topic, parse_key
from forefeel.common.transport.endpoints import address
from forefeel.common.transport.security import Party
from forefeel.common.transport.settings import TransportSettings
from forefeel.common.transport.zenoh_bus import ZenohTransport
from forefeel.interrupt import at_last, ends_in_order, signal_flag
from forefeel.terminal import say

if TYPE_CHECKING:
    from forefeel.network_settings import ObserverSettings

_QUEUE_MESSAGES = 100_000  # messages that wait for the disk: half a minute of an axis, three streams at 1 kHz
# a killed recorder loses that, and what its batches wait at the sender (`BATCH_NS`); less compresses worse
_WRITE_EVERY_S = 0.1
_POLL_S = 0.1
_SILENCES = 100  # lines that wait to be shown
_FLUSH_ROUNDS = 10  # between two flushes: a host without power loses a second


class Missing:
    """Counts messages that were sent and not heard, by the numbers of those that were.

    Attributes:
        count: of all streams.
    """

    def __init__(self) -> None:
        self.count = 0
        self._newest: dict[str, Message] = {}

    def hear(self, stream: str, message: Message) -> None:
        """Adds what lies between two messages of a session; a daemon that starts anew begins with 1."""
        before = self._newest.get(stream)
        if before and before.session_id == message.session_id:
            self.count += max(0, message.sequence - before.sequence - 1)
        self._newest[stream] = message


class Recorder:
    """Records one cell to an MCAP file, from when it is made until `close`.

    Attributes:
        newest: newest payload of each key, for whoever shows progress.
        silences: of an end between two of its states, in words; whoever shows them takes them out.
        rounds: how often it has looked for what to write; stands when the disk does.
        transport: the session; its `notice` is what the user must be told loudly, or empty.
    """

    def __init__(
        self,
        path: Path,
        cell: str,
        transport: TransportSettings,
        run: Mapping[str, str],
        party: Party | None = None,
        insecure: bool = False,
    ) -> None:
        """`run`: metadata, what was asked for. `party`, `insecure`: as for a transport.

        Raises RecordingError when the file can not be made, EndpointError when an endpoint can not be used.
        """
        self.path, self._cell = path, cell
        self.newest: dict[str, bytes] = {}
        self.rounds = 0
        self.silences: deque[str] = deque(maxlen=_SILENCES)
        self._states: dict[str, Message] = {}
        self._missing = Missing()
        self._error: BaseException | None = None
        self._queue: BoundedQueue[tuple[str, bytes, int]] = BoundedQueue(_QUEUE_MESSAGES)
        self._closing = threading.Event()
        opening = partial(
            ZenohTransport.open, transport, MonotonicClock(), self._fail, party, insecure=insecure
        )
        self.transport = in_thread(opening, "zenoh open").result()  # which a signal need not wait for
        try:
            self._writer = RunWriter(path)
        except BaseException:
            self.transport.close()
            raise
        self._writer.add_metadata("run", run)
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()
        self.transport.subscribe_all(f"forefeel/{cell}", self._hear)

    @property
    def written(self) -> int:
        return self._writer.written

    @property
    def missed(self) -> dict[str, int]:
        """Messages that are not in the file, by reason: `lost` of the 1 kHz topics on their way or in the
        queue, `malformed` as received.
        """
        return {"lost": self._missing.count, "malformed": self._writer.malformed}

    def latest(self, topic: Topic[M], axis: str) -> M | None:
        """The newest message of a topic; None where none was heard, or it is malformed."""
        payload = self.newest.get(topic.key(self._cell, axis))
        try:
            return None if payload is None else observed(topic, payload, 0)[-1][0]
        except (CodecError, IndexError):
            return None

    def close(self) -> None:
        """Writes what has arrived, closes the file, leaves the network; idempotent.

        Raises:
            RunError: recording failed on the way, for example because the disk is full.
        """
        if self._closing.is_set():
            return
        self._closing.set()
        self.transport.close()
        self._thread.join()
        self.check()

    def check(self) -> None:
        """Raises RunError as soon as recording has failed."""
        if self._error is not None:
            raise RunError(f"recording failed: {self._error}") from self._error

    def _hear(self, key: str, payload: bytes, receive_ns: int) -> None:
        self.newest[key] = payload
        self._queue.put((key, payload, receive_ns))

    def _fail(self, error: BaseException) -> None:
        self._error = self._error or error

    def _run(self) -> None:
        """Runs in the recorder's thread until `close`: writes every 0.1 s what has come, to the disk once a
        second; at the end the counts of what was missed. Keeps the first error for `check`.
        """
        try:
            with self._writer:
                while not self._closing.wait(_WRITE_EVERY_S):
                    self._write_batch()
                    self._writer.end_chunk()
                    self.rounds += 1
                    if self.rounds % _FLUSH_ROUNDS == 0:
                        self._writer.flush()
                self._write_batch()
                self._writer.add_metadata("recorder", {k: str(n) for k, n in self.missed.items()})
        except Exception as error:  # noqa: BLE001 - the thread's last line: `check` and `close` raise it
            self._fail(error)

    def _write_batch(self) -> None:
        """Writes the messages of every queued payload; skips topics that are not recorded, counts malformed
        payloads and missing messages. Adds a line to `silences` for a gap between two states of an end.
        """
        for key, payload, receive_ns in self._queue.drain():
            parsed = parse_key(key)
            if parsed is None or not parsed[2].recorded:
                continue
            try:
                entries = observed(parsed[2], payload, receive_ns)
            except CodecError:
                self._writer.malformed += 1
                continue
            for message, message_ns in entries:
                if isinstance(message, SlaveState | MasterState):
                    if silence := gap(parsed[2], self._states.get(key), message):
                        self.silences.append(silence)
                    self._states[key] = message
                if parsed[2].batched:  # of others an injected impairment may have taken some before
                    self._missing.hear(key, message)
                self._writer.write_message(key, message, message_ns)


def run_record(
    out: Path, settings: "ObserverSettings", duration_s: float | None, insecure: bool = False
) -> None:
    """Records a cell to the new file `out` until SIGINT, SIGTERM, SIGHUP or the duration, and attends
    systemd's watchdog; prints every 5 s why nobody is heard, and at the end what was missed.

    Raises:
        InputError: the file, an endpoint or a certificate can not be used; nothing was written.
        RunError: recording failed, or nothing was recorded; then there is no file.
    """
    cell = settings.cell
    party = Party(settings.role, (cell,))
    where = ", ".join(map(address, settings.transport.connect + settings.transport.listen))
    recorder: Recorder | None = None
    there = out.exists()

    def drop_empty() -> None:
        if not there and not (recorder and recorder.written):
            out.unlink(missing_ok=True)

    with ends_in_order("recording"), at_last(drop_empty):
        recorder = Recorder(out, cell, settings.transport, {"cell": cell}, party, insecure)
        with signal_flag() as stop, closing(recorder):
            if recorder.transport.notice:
                say(recorder.transport.notice)
            say(f"recording cell {cell} to {out}; Ctrl-C ends")
            from forefeel.reachability import cell_watch  # noqa: PLC0415 - a loopback needs none

            look = cell_watch(settings.transport, party, recorder.transport, MonotonicClock())
            attend = service_watchdog(
                lambda: "recording" if recorder.newest else f"nobody heard yet: {look(False)}",
                lambda: recorder.rounds,
            )
            for _ in stop.polls(duration_s, _POLL_S):
                recorder.check()
                attend()
                look(bool(recorder.newest))
                while recorder.silences:
                    say(f"the {recorder.silences.popleft()}")
    if not recorder.written:
        raise RunError(f"{out}: nothing was recorded, nobody of cell {cell} was heard at {where}")
    counts = {"messages": recorder.written, **recorder.missed}
    say(f"{out}: closed, {', '.join(f'{n} {what}' for what, n in counts.items() if n)}")
    roles = {parsed[2].publisher for key in recorder.newest if (parsed := parse_key(key))}
    for role in sorted({"slave", "master"} - roles):
        say(f"{out}: the {role} was not heard: it does not run, or listens where nobody connects")
