"""Settings of the network and of what is injected into it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from forefeel.common.config import Settings, beside_the_file
from forefeel.common.transport.exposure import on_loopback

Share = Annotated[float, Field(ge=0, lt=1)]
Seconds = Annotated[float, Field(ge=0, le=10)]


MOST_CONNECTIONS = 16
"""Parallel connections to one other end: at 1 % loss and 600 ms each stands still for a third of the time."""


class TransportSettings(Settings):
    """Zenoh endpoints of this process, as `tls/host:port`; `tcp/`, `quic/` and `udp/` too.

    A `peer` waits for whoever it connects to. A `client` speaks to a router: slave and master wait for it,
    others end when it does not answer. `pki` is the folder of certificates that `forefeel pki init` made;
    with it every endpoint is tls/ or quic/, and each role may do its own only.

    Attributes:
        connections: how many connections a daemon opens to each endpoint in `connect`; the streams take
            turns between them, so that a lost packet holds up one of them only. null: 16 where a tcp/ or tls/
            endpoint in `connect` is on another host, else 1.
    """

    mode: Literal["peer", "client"] = "peer"
    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    connections: Annotated[int, Field(ge=1, le=MOST_CONNECTIONS)] | None = None
    pki: Annotated[Path, AfterValidator(beside_the_file)] | None = None

    @model_validator(mode="after")
    def _client_connects(self) -> Self:
        if self.mode == "client" and (self.listen or not self.connect):
            raise ValueError("mode 'client': expected at least one endpoint in connect and none in listen")
        return self

    @property
    def parallel_connections(self) -> int:
        """Number of connections: `connections`, or for null 16 where a tcp/ or tls/ endpoint in `connect` is
        on another host, else 1; always 1 for a process that connects to nobody.
        """
        if not self.connect:
            return 1
        if self.connections is not None:
            return self.connections
        in_order = [endpoint for endpoint in self.connect if endpoint.startswith(("tcp/", "tls/"))]
        return 1 if all(map(on_loopback, in_order)) else MOST_CONNECTIONS


class ImpairmentSettings(Settings):
    """Impairment of the messages of one direction of a link. In YAML a preset's name, or a mapping.

    A mapping may start from a preset: `{preset: paper, loss: 0.05}`.

    Attributes:
        delay_s: mean one-way delay.
        jitter_s: half-width of its variation: normal with sigma = jitter_s / 2, clipped to +-jitter_s.
        jitter_correlation_s: time constant of the variation (Ornstein-Uhlenbeck); 0: each message on its own.
        loss: probability that a message is lost, independent of the others.
        burst_loss: further share of messages lost in bursts (Gilbert's two-state chain).
        burst_length: mean length of a burst in messages.
        reorder: probability that a message is held back and overtaken; all others keep their order.
        reorder_hold_s: by how much it is held back.
        duplicate: probability that a message arrives twice.
        stalls_per_s: mean number of stalls per second of free link, at random times.
        stall_s: duration of a stall: what comes meanwhile enters the link in one burst at its end.
    """

    delay_s: Seconds = 0.0
    jitter_s: Seconds = 0.0
    jitter_correlation_s: Seconds = 0.1
    loss: Share = 0.0
    burst_loss: Share = 0.0
    burst_length: Annotated[float, Field(ge=1, le=10_000)] = 10.0
    reorder: Share = 0.0
    reorder_hold_s: Seconds = 0.005
    duplicate: Share = 0.0
    stalls_per_s: Annotated[float, Field(ge=0, le=100)] = 0.0
    stall_s: Seconds = 0.1

    @model_validator(mode="before")
    @classmethod
    def _from_preset(cls, data: object) -> object:
        """Replaces `preset` by the values of the preset, over which other given values win; returns data
        without a preset unchanged. A text is the name of one. Raises ValueError for an unknown preset.
        """
        if isinstance(data, str):
            data = {"preset": data}
        if not isinstance(data, Mapping) or "preset" not in data:
            return data
        given = dict(data)
        name = given.pop("preset")
        if not isinstance(name, str) or name not in _PRESETS:
            raise ValueError(f"preset {name!r} is unknown, expected one of {', '.join(_PRESETS)}")
        return _PRESETS[name] | given

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        """Raises ValueError for a jitter beyond the delay, or a burst loss beyond what its length gives."""
        if self.jitter_s > self.delay_s:
            raise ValueError(f"jitter_s = {self.jitter_s:g}: expected at most delay_s = {self.delay_s:g}")
        limit = self.burst_length / (self.burst_length + 1)
        if self.burst_loss > limit:
            raise ValueError(
                f"burst_loss = {self.burst_loss:g}: expected at most {limit:.3g} with this burst_length"
            )
        return self

    @property
    def transparent(self) -> bool:
        return not any(
            (self.delay_s, self.loss, self.burst_loss, self.reorder, self.duplicate, self.stalls_per_s)
        )


# One way. Time constants are long against 1 ms, so that jitter hardly touches the order of a 1 kHz stream.
_PRESETS: dict[str, dict[str, float]] = {
    "none": {},
    "lan": {"delay_s": 0.0003, "jitter_s": 0.0001, "jitter_correlation_s": 0.01},
    "wan": {"delay_s": 0.040, "jitter_s": 0.005, "loss": 0.001},
    "lte": {
        "delay_s": 0.035,
        "jitter_s": 0.015,
        "jitter_correlation_s": 0.5,
        "burst_loss": 0.01,
        "burst_length": 10,
    },
    "5g": {"delay_s": 0.012, "jitter_s": 0.004, "loss": 0.003},
    "satellite": {"delay_s": 0.290, "jitter_s": 0.015, "jitter_correlation_s": 0.5, "loss": 0.01},
    "paper": {"delay_s": 0.150, "jitter_s": 0.010, "jitter_correlation_s": 0.2, "loss": 0.01},
}

PRESETS: Mapping[str, ImpairmentSettings] = {
    name: ImpairmentSettings(**values) for name, values in _PRESETS.items()
}
