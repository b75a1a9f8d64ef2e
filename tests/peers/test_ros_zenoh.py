"""The Zenoh wire, beside a plain session that speaks as rmw_zenoh_cpp's source has it (tokens of 13 parts,
attachments of two int64 and 16 bytes), through a router; `make ros` has a stranger's own reader in its place.
"""

import struct
from collections.abc import Iterator
from contextlib import closing

import pytest
import zenoh

from forefeel.ros import cdr
from forefeel.ros.zenoh_wire import ZenohWire
from tests.live_cell import free_port
from tests.peers.ros_wires.router import router
from tests.unit.test_ros_cdr import HEADER
from tests.waiting import PATIENCE_S, wait_until

TOPIC = "/cathlab/insertion/measured_js"
HASH = "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e"
JOINT = "sensor_msgs::msg::dds_::JointState_"
VOLATILE, TRANSIENT_LOCAL = "::,100:,:,:,,", ":1:,10:,:,:,,"


@pytest.fixture
def port() -> Iterator[int]:
    port = free_port()
    with router(port):
        yield port


@pytest.fixture
def node(port: int) -> Iterator[zenoh.Session]:
    """A session as a node has one: a peer that is connected to the router."""
    config = zenoh.Config()
    config.insert_json5("connect/endpoints", f'["tcp/127.0.0.1:{port}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config) as session:
        yield session


def wire_at(port: int, humble: bool = False) -> "closing[ZenohWire]":
    return closing(ZenohWire(f"tcp/127.0.0.1:{port}", 61, humble, insecure=False))


@pytest.mark.parametrize(("humble", "type_hash"), [(False, HASH), (True, "TypeHashNotSupported")])
def test_keys_tokens_and_attachments_are_those_of_rmw_zenoh(
    port: int, node: zenoh.Session, humble: bool, type_hash: str
) -> None:
    samples = node.declare_subscriber(f"61{TOPIC}/{JOINT}/{type_hash}", zenoh.handlers.FifoChannel(10))
    with wire_at(port, humble) as wire:
        send = wire.publisher(TOPIC, cdr.JOINT_STATE)
        payload = cdr.joint_state(HEADER, "insertion", 0.1, 0.2)
        send(payload, HEADER.stamp_ns)
        wait_until(lambda: bool(send(payload, HEADER.stamp_ns) or samples.try_recv()), what="a sample")
        sample = samples.recv()
        assert sample.payload.to_bytes() == payload
        assert sample.attachment is not None
        number, stamp_ns, length, gid = struct.unpack("<qqB16s", sample.attachment.to_bytes())
        assert (stamp_ns, length) == (HEADER.stamp_ns, 16)
        assert number > 1 and any(gid)
        zid = str(wire._session.info.zid())
        tokens = {str(reply.ok.key_expr) for reply in node.liveliness().get("@ros2_lv/61/**") if reply.ok}
    assert tokens == {
        f"@ros2_lv/61/{zid}/0/0/NN/%/%/forefeel",
        f"@ros2_lv/61/{zid}/0/1/MP/%/%/forefeel/%cathlab%insertion%measured_js/{JOINT}/{type_hash}/{VOLATILE}",
    }


def reader(node: zenoh.Session, type_hash: str = HASH, qos: str = VOLATILE) -> zenoh.LivelinessToken:
    """Token of a subscription of the node `rviz`."""
    topic = TOPIC.replace("/", "%")
    key = f"@ros2_lv/61/{node.info.zid()}/0/7/MS/%/%/rviz/{topic}/{JOINT}/{type_hash}/{qos}"
    return node.liveliness().declare_token(key)


@pytest.mark.parametrize(
    ("type_hash", "qos", "number", "remarks"),
    [
        (HASH, VOLATILE, 1, []),
        (HASH, TRANSIENT_LOCAL, 1, ["node rviz asks", "transient local"]),
        ("TypeHashNotSupported", VOLATILE, 0, ["node rviz can not read", "--humble"]),
        ("RIHS01_other", VOLATILE, 0, ["node rviz can not read", "another message"]),
    ],
)
def test_readers_are_counted_and_told_what_they_do_not_get(
    port: int, node: zenoh.Session, type_hash: str, qos: str, number: int, remarks: list[str]
) -> None:
    before = reader(node, type_hash, qos)
    with wire_at(port) as wire:
        wire.publisher(TOPIC, cdr.JOINT_STATE)
        wait_until(lambda: bool(wire.readers() or wire._readers), what="the token")
        assert wire.readers() == number
        text = " ".join(wire.remarks())
        assert all(remark in text for remark in remarks) and bool(text) is bool(remarks)
        assert wire.remarks() == []
        odd = [
            node.liveliness().declare_token(f"@ros2_lv/61/a/0/1/MS{tail}") for tail in ("", "/%/%/n/%t/T/h/q")
        ]
        wait_until(lambda: bool(wire.readers() == number and len(wire._readers) == 2), what="an odd token")
        assert wire.remarks() == [] and len(odd) == 2
        odd.clear()
        before.undeclare()  # type: ignore[no-untyped-call]
        wait_until(lambda: not wire.readers() and not wire._readers, what="the end of the token")


def test_commands_come_with_the_number_of_their_writer(port: int, node: zenoh.Session) -> None:
    taken: list[tuple[bytes, bytes]] = []
    with wire_at(port) as wire:
        wire.subscribe("/a/b/servo_jp", cdr.JOINT_STATE, lambda *command: taken.append(command))
        attachment = struct.pack("<qqB16s", 1, 2, 16, b"g" * 16)

        def sent() -> bool:
            node.put(f"61/a/b/servo_jp/{JOINT}/{HASH}", b"x", attachment=attachment)
            return bool(taken)

        wait_until(sent, PATIENCE_S, "the command")
    assert taken[0] == (b"x", b"g" * 16)
