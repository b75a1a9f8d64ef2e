"""zenoh-ros2-sdk at the Zenoh wire: `zenoh_reader.py OUT PORT`; its own definitions, hashes and decoder."""

import json
import os
import re
import sys
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rosbags.typesys import Stores, get_typestore
from zenoh_ros2_sdk import ROS2Subscriber
from zenoh_ros2_sdk.utils import get_type_hash

from tests.peers.ros_wires import AXIS, CELL, DOMAIN, TOPICS

stamps: defaultdict[str, list[int]] = defaultdict(list)
store = get_typestore(Stores.ROS2_KILTED)


def note(topic: str) -> Callable[[Any], None]:
    return lambda message: stamps[topic].append(
        message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
    )


def definition(kind: str) -> tuple[str, str]:
    """(definition, hash) of a type, which the sdk would fetch from the network."""
    text = store.generate_msgdef(kind, ros_version=2)[0]
    first, *rest = re.split(r"^=+\nMSG: (\S+)\n", text, flags=re.MULTILINE)
    others = {name.replace("/", "/msg/"): body for name, body in zip(rest[::2], rest[1::2], strict=True)}
    return text, get_type_hash(kind, msg_definition=first, dependencies=others)


if __name__ == "__main__":
    out, port = Path(sys.argv[1]), int(sys.argv[2])
    for topic, kind in TOPICS.items():
        text, type_hash = definition(kind)
        ROS2Subscriber(
            f"/{CELL}/{AXIS}/{topic}", kind, note(topic), text, domain_id=DOMAIN, router_port=port,
            type_hash=type_hash,
        )  # fmt: skip
    print("zenoh-ros2-sdk listens", flush=True)
    sys.stdin.read(1)
    out.write_text(json.dumps(stamps))
    os._exit(0)  # its session has no end
