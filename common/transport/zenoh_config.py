"""The Zenoh configuration of a session, from our settings; what is fixed in it, and what a file may add."""

import json
from collections.abc import Mapping
from typing import Literal

import zenoh

from forefeel.common.codec import MAX_MESSAGE_BYTES
from forefeel.common.errors import ConfigurationError
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


def chosen(settings: TransportSettings, mode: Mode) -> dict[str, object]:
    """What the settings say, by path. Zenoh counts in ms."""
    open_timeout_ms = round(settings.open_timeout_s * 1000)
    return {
        "mode": mode,
        "listen/endpoints": list(settings.listen),
        "connect/endpoints": list(settings.connect),
        "connect/retry": {
            "period_init_ms": round(settings.retry_min_s * 1000),
            "period_max_ms": round(settings.retry_max_s * 1000),
            "period_increase_factor": 2,
        },
        "transport/unicast/open_timeout": open_timeout_ms,
        "transport/unicast/accept_timeout": open_timeout_ms,
        "transport/link/tx/lease": round(settings.lease_s * 1000),
    }


def configuration(settings: TransportSettings, mode: Mode, added: Mapping[str, object]) -> zenoh.Config:
    """That of the file, where there is one, overruled by the settings, this module and `added`.

    Raises:
        ConfigurationError: `zenoh_file` is missing or not a Zenoh configuration.
    """
    config = zenoh.Config() if settings.zenoh_file is None else from_file(str(settings.zenoh_file))
    for key, value in {**FIXED, **chosen(settings, mode), **added}.items():
        config.insert_json5(key, json.dumps(value))
    return config


def from_file(path: str) -> zenoh.Config:
    """A Zenoh JSON5 file.

    Raises:
        ConfigurationError: missing, or none.
    """
    try:
        return zenoh.Config.from_file(path)
    except zenoh.ZError as error:
        raise ConfigurationError(
            f"{path}: {str(error).partition(' at /')[0]}; expected a Zenoh JSON5 file"
        ) from error


def secured_by_file(settings: TransportSettings) -> bool:
    """Whether `zenoh_file` asks for certificates on both ends and refuses what it does not name."""
    if settings.zenoh_file is None:
        return False
    config = from_file(str(settings.zenoh_file))
    wanted = {
        "transport/link/tls/enable_mtls": True,
        "access_control/enabled": True,
        "access_control/default_permission": "deny",
    }
    return all(json.loads(config.get_json(key)) == value for key, value in wanted.items())
