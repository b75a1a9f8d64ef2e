"""The bytes and hashes of ROS messages are those of rosbags' type stores; what is no command is refused."""

from dataclasses import asdict
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from forefeel.common.errors import CodecError
from forefeel.ros import cdr

_ROS2 = [store for store in Stores if store.name.startswith("ROS2_")]
DISTRIBUTIONS = _ROS2[_ROS2.index(Stores.ROS2_HUMBLE) :]
HEADER = cdr.RosHeader(1_764_345_678_123_456_789, "cathlab/insertion")
TYPES = (cdr.WRENCH_STAMPED, cdr.JOINT_STATE, cdr.DIAGNOSTIC_ARRAY, cdr.OPERATING_STATE, cdr.STRING_STAMPED)
CRTK = {
    cdr.OPERATING_STATE.name: "std_msgs/Header header\nstring state\nbool is_homed\nbool is_busy\n",
    cdr.STRING_STAMPED.name: "std_msgs/Header header\nstring string\n",
}
"""crtk_msgs/msg, which no distribution holds."""


def typestore(which: Stores) -> Typestore:
    store = get_typestore(which)
    for name, text in CRTK.items():
        store.register(get_types_from_msg(text, name))
    return store


STORE = typestore(Stores.LATEST)


def decoded(payload: bytes, kind: cdr.RosType, store: Typestore = STORE) -> dict[str, Any]:
    """Fields as rosbags reads them; the bytes are those that it writes of them."""
    message = store.deserialize_cdr(payload, kind.name)
    assert bytes(store.serialize_cdr(message, kind.name)) == payload
    return asdict(message)  # type: ignore[call-overload, no-any-return]


@given(
    frame=st.text(max_size=9), name=st.text(max_size=9), state=st.text(max_size=9),
    position=st.floats(allow_nan=False), velocity=st.none() | st.floats(allow_nan=False), flag=st.booleans(),
)  # fmt: skip
def test_lengths_of_texts_and_missing_values_move_what_follows_as_rosbags_does(
    frame: str, name: str, state: str, position: float, velocity: float | None, flag: bool
) -> None:
    header = cdr.RosHeader(HEADER.stamp_ns, frame)
    joint = decoded(cdr.joint_state(header, name, position, velocity), cdr.JOINT_STATE)
    assert joint["position"][0] == position
    assert list(joint["velocity"]) == ([] if velocity is None else [velocity])
    operating = decoded(cdr.operating_state(header, state, flag, not flag), cdr.OPERATING_STATE)
    assert (operating["is_homed"], operating["is_busy"]) == (flag, not flag)
    assert operating["state"] == state.replace("\0", "?")
    statuses = [
        cdr.DiagnosticStatus(level, name, state, frame, [(name, state)] * level) for level in range(3)
    ]
    array = decoded(cdr.diagnostic_array(HEADER.stamp_ns, statuses), cdr.DIAGNOSTIC_ARRAY)
    assert [len(status["values"]) for status in array["status"]] == [0, 1, 2]


@pytest.mark.parametrize("which", DISTRIBUTIONS, ids=lambda which: which.name)
def test_messages_names_and_hashes_are_those_of_every_distribution(which: Stores) -> None:
    store = typestore(which)
    for kind in TYPES:
        assert store.hash_rihs01(kind.name) == kind.hash
        package, _, name = kind.name.split("/")
        assert kind.dds_name == f"{package}::msg::dds_::{name}_"
    joint = decoded(cdr.joint_state(HEADER, "insertion", 0.01, -0.2), cdr.JOINT_STATE, store)
    assert (joint["name"], *map(list, (joint["position"], joint["velocity"], joint["effort"]))) == (
        ["insertion"], [0.01], [-0.2], [],
    )  # fmt: skip
    stamp = joint["header"]["stamp"]
    assert (stamp["sec"], stamp["nanosec"]) == divmod(HEADER.stamp_ns, 10**9)
    wrench = decoded(cdr.wrench_stamped(HEADER, 0.25), cdr.WRENCH_STAMPED, store)
    assert wrench["header"]["frame_id"] == "cathlab/insertion"
    assert [wrench["wrench"]["force"][axis] for axis in "xyz"] == [0.0, 0.0, 0.25]


def written(kind: cdr.RosType, *fields: Any) -> bytes:  # noqa: ANN401 - any field
    """Message with a header as rosbags writes it."""
    stamp = STORE.types["builtin_interfaces/msg/Time"](sec=1, nanosec=2)
    header = STORE.types["std_msgs/msg/Header"](stamp=stamp, frame_id="abc")
    return bytes(STORE.serialize_cdr(STORE.types[kind.name](header, *fields), kind.name))


def servo(names: list[str], *sequences: list[float]) -> bytes:
    return written(cdr.JOINT_STATE, names, *(np.array(sequence, float) for sequence in sequences))


def string_stamped(text: str) -> bytes:
    return written(cdr.STRING_STAMPED, text)


def test_commands_are_read() -> None:
    assert cdr.read_joint_state(servo(["insertion"], [0.3], [0.1], [])) == (0.3, 0.1)
    assert cdr.read_joint_state(servo([], [0.3], [], [])) == (0.3, 0.0)
    assert cdr.read_string_stamped(string_stamped("pause")) == "pause"


@pytest.mark.parametrize(
    "payload",
    [
        servo([], [0.3, 0.4], [], []),
        servo([], [], [], []),
        servo([], [0.3], [0.1, 0.2], []),
        servo(["a"], [0.3], [], [])[:40],
        b"\0\0" + servo([], [0.3], [], [])[2:],
        string_stamped("x" * 5000),
        b"",
    ],
    ids=["two joints", "none", "two velocities", "cut", "big-endian", "long", "empty"],
)
def test_what_is_no_position_of_one_joint_is_refused(payload: bytes) -> None:
    with pytest.raises(CodecError):
        cdr.read_joint_state(payload)


@given(tail=st.binary(max_size=120))
def test_any_bytes_are_a_command_or_refused(tail: bytes) -> None:
    for read in cdr.read_joint_state, cdr.read_string_stamped:
        try:
            read(b"\0\1\0\0" + tail)
        except CodecError as error:
            assert "\n" not in str(error)
