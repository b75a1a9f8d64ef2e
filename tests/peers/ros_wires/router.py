"""A Zenoh router."""

import json

import zenoh


def router(port: int) -> zenoh.Session:
    """A router as rmw_zenohd is one."""
    config = zenoh.Config()
    fixed = {"mode": "router", "listen/endpoints": [f"tcp/127.0.0.1:{port}"]}
    for key, value in {**fixed, "scouting/multicast/enabled": False}.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)
