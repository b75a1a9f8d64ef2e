"""rclpy (Fast DDS) at the DDS wire: `rclpy_reader.py OUT`; reliable readers of depth 100."""

import json
import sys
import threading
from collections import defaultdict
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy

from tests.peers.ros_wires import AXIS, CELL, DOMAIN, TOPICS

stamps: defaultdict[str, list[int]] = defaultdict(list)


def note(topic: str) -> Callable[[Any], None]:
    return lambda message: stamps[topic].append(
        message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
    )


def main(out: Path) -> None:
    rclpy.init(domain_id=DOMAIN)
    node = rclpy.create_node("listener")
    profile = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
    for topic, kind in TOPICS.items():
        package, _, name = kind.partition("/msg/")
        message = getattr(import_module(f"{package}.msg"), name)
        node.create_subscription(message, f"/{CELL}/{AXIS}/{topic}", note(topic), profile)
    print(f"rclpy listens by {rclpy.get_rmw_implementation_identifier()}", flush=True)
    reading = threading.Thread(target=sys.stdin.read, args=(1,), daemon=True)
    reading.start()
    while reading.is_alive():
        rclpy.spin_once(node, timeout_sec=0.1)
    out.write_text(json.dumps(stamps))
    for topic in TOPICS:
        publishers = node.get_publishers_info_by_topic(f"/{CELL}/{AXIS}/{topic}")
        qos = [(info.topic_type, info.qos_profile.reliability.name) for info in publishers]
        print(f"{topic}: {len(stamps[topic])} heard of {qos}", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
