"""The Zenoh configuration of a session: our settings, and what is fixed."""

import json
from collections.abc import Mapping
from typing import Literal

import zenoh

from forefeel.common.codec import MAX_MESSAGE_BYTES
from forefeel.common.transport.settings import TransportSettings

Mode = Literal["peer", "client", "router"]

FIXED: Mapping[str, object] = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "transport/shared_memory/enabled": False,
    "transport/link/tx/queue/size/interactive_high": 16,
    "transport/link/tx/batch_size": 4096,  # a message that waits holds on to as much, or to 64 KB
    "transport/link/rx/max_message_size": 4 * MAX_MESSAGE_BYTES,  # put together from fragments; or 1 GB
    # Opening returns at once; the other end may come later.
    "open/return_conditions": {"connect_scouted": False, "declares": False},
}

CONNECTING: dict[str, object] = {
    "connect/retry": {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 2},
    "transport/unicast/open_timeout": 10_000,  # ms; it takes four round trips, a session bears one of 2 s
    "transport/unicast/accept_timeout": 10_000,
    # ms of silence after which a connection is opened anew; the gate has a watchdog and a lease of its own
    "transport/link/tx/lease": 3000,
}


def configuration(settings: TransportSettings, mode: Mode, added: Mapping[str, object]) -> zenoh.Config:
    """Configuration of a session. `added`: what certificates need."""
    endpoints = {"listen/endpoints": list(settings.listen), "connect/endpoints": list(settings.connect)}
    config = zenoh.Config()
    for key, value in {**FIXED, **CONNECTING, "mode": mode, **endpoints, **added}.items():
        config.insert_json5(key, json.dumps(value))
    return config
