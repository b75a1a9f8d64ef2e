"""A running cell from outside: what it says, and a stop.

with ff.connect("master.yaml") as cell:
    if cell.wait():
        print(cell.state.state, cell.force.force_n, cell.prediction.predicted_n)
    print(cell.stop("enough"))
"""

from collections.abc import Collection, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from threading import Condition
from typing import Any

from forefeel.common.bus import observed
from forefeel.common.clock import MonotonicClock
from forefeel.common.codec import Codec
from forefeel.common.errors import CodecError, ConfigurationError
from forefeel.common.messages import ForceSample, HapticSample, SlaveState
from forefeel.common.topics import FORCE, HAPTICS, SLAVE_STATE, parse_key
from forefeel.common.transport.security import Party
from forefeel.common.transport.zenoh_bus import ZenohTransport
from forefeel.estop.network import StopSender, sender_of, stop_over_network

_FIELDS = {SLAVE_STATE.name: "state", FORCE.name: "force", HAPTICS.name: "prediction"}


@dataclass(frozen=True, slots=True)
class Axis:
    """The newest messages of an axis; None before any has come."""

    state: SlaveState | None = None
    force: ForceSample | None = None
    prediction: HapticSample | None = None


class Cell:
    """The newest messages of a cell; `stop` stops it."""

    def __init__(self, sender: StopSender, fields: Collection[str]) -> None:
        self._sender, self._fields, self._came = sender, fields, Condition()
        self._newest: dict[str, dict[str, Any]] = {}

    def hear(self, key: str, payload: bytes, receive_ns: int) -> None:
        """Stores the last message of a payload, without its stamp, as the newest of its axis and topic, and
        wakes `wait`; ignores a malformed key or payload, and topics that are not in `_FIELDS`.
        """
        parsed = parse_key(key)
        if parsed is None or parsed[2].name not in _FIELDS:
            return
        try:
            *_, (message, _) = observed(parsed[2], payload, receive_ns, Codec)
        except (CodecError, ValueError):
            return
        with self._came:
            self._newest.setdefault(parsed[1], {})[_FIELDS[parsed[2].name]] = message
            self._came.notify_all()

    @property
    def axes(self) -> Mapping[str, Axis]:
        """Newest messages by axis, of the axes that have sent any."""
        with self._came:
            newest = {name: dict(messages) for name, messages in self._newest.items()}
        return {name: Axis(**messages) for name, messages in newest.items()}

    @property
    def state(self) -> SlaveState | None:
        """State of the first axis by name, as `force` and `prediction`; None before it has come."""
        return self._first.state

    @property
    def force(self) -> ForceSample | None:
        return self._first.force

    @property
    def prediction(self) -> HapticSample | None:
        return self._first.prediction

    @property
    def _first(self) -> Axis:
        return next(iter(sorted(self.axes.items())), ("", Axis()))[1]

    def wait(self, timeout_s: float = 5.0) -> bool:
        """Waits until every axis has sent all that this end may receive; False: something is missing."""
        with self._came:
            return self._came.wait_for(self._complete, timeout_s)

    def _complete(self) -> bool:
        axes = self._sender.axes or tuple(self._newest)
        return bool(axes) and all(self._newest.get(axis, {}).keys() >= set(self._fields) for axis in axes)

    def stop(self, reason: str = "asked for by a program") -> Mapping[str, str]:
        """Repeats an emergency stop until every axis confirms it, 2 s at most; returns each axis' state.

        `estopped` is a stop that is confirmed. Anything else is none: use the stop of the machine itself.
        """
        return stop_over_network(self._sender, tuple(sorted({*self._sender.axes, *self.axes})), reason)


@contextmanager
def connect(config: str | Path, *, insecure: bool = False) -> Iterator[Cell]:
    """Connects to a running cell for the length of the block, by the settings file of its master or of a
    viewer; gives the Cell.

    Args:
        config: the YAML file. With certificates only a viewer receives predictions, and the master has to
            `listen` for it.
        insecure: goes without certificates outside this host.

    Raises:
        InputError: the file is a slave's, or it, a certificate or an endpoint can not be used.
    """
    sender, faults = sender_of(Path(config), insecure), list[Exception]()
    if sender.role == "slave":
        raise ConfigurationError(f"{config}: role = 'slave': expected the file of a master or a viewer")
    hears_all = sender.role == "viewer" or sender.transport.pki is None
    fields = _FIELDS.values() if hears_all else ("state", "force")
    cell, party = Cell(sender, fields), Party(sender.role, (sender.cell,))
    opened = ZenohTransport.open(sender.transport, MonotonicClock(), faults.append, party, insecure=insecure)
    with closing(opened):
        if hears_all:
            opened.subscribe_all(f"forefeel/{sender.cell}", cell.hear)
        else:  # certificates let an end hear what comes from the other one
            for topic, axis in product((SLAVE_STATE, FORCE), sender.axes):
                key = topic.key(sender.cell, axis)
                opened.subscribe(key, partial(cell.hear, key))
        yield cell
