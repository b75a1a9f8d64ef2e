"""ROS topics over Zenoh as rmw_zenoh_cpp lays them out: keys, liveliness tokens, attachments."""

import struct
from hashlib import blake2b
from itertools import count

import zenoh

from forefeel.common.transport.settings import TransportSettings
from forefeel.common.transport.zenoh_bus import open_session
from forefeel.ros.cdr import RosType
from forefeel.ros.crtk import DEPTH, Send, Take

NODE = "forefeel"
_NO_HASH = "TypeHashNotSupported"  # stands in Humble's keys
_TRANSIENT_LOCAL = "1"  # RMW_QOS_POLICY_DURABILITY_TRANSIENT_LOCAL
_QOS = f"::,{DEPTH}:,:,:,,"  # reliable and volatile, which are rmw_zenoh's defaults; keep last
_MOST_TOKENS = 1024  # of a graph, whose nodes are strangers


class ZenohWire:
    """A node of its own, a client of the router that rmw_zenoh's nodes use, for a router joins no two peers.

    Attributes:
        name: for a person.
        notice: what the user must be told loudly about this session, or empty.
    """

    def __init__(self, endpoint: str, domain: int, humble: bool, insecure: bool) -> None:
        """Raises EndpointError: no router answers, or the endpoint is outside this host without consent."""
        settings = TransportSettings(mode="client", connect=(endpoint,))
        self._session, self.notice = open_session(
            settings, "client", None, insecure=insecure, real_stage=False
        )
        self.name = f"Zenoh ({endpoint})"
        self._endpoint, self._domain, self._humble = endpoint, domain, humble
        self._zid, self._ids = str(self._session.info.zid()), count(1)
        self._topics: dict[str, str] = {}  # hash by mangled name
        self._readers: set[str] = set()
        self._reported: set[str] = set()
        self._declared: list[object] = []  # undeclared with the last reference
        self._token("0/0/NN", "")
        self._tokens = self._session.liveliness().declare_subscriber(
            f"@ros2_lv/{domain}/*/*/*/MS/*/*/*/*/*/*/*",
            zenoh.handlers.RingChannel(_MOST_TOKENS),
            history=True,
        )

    def publisher(self, topic: str, kind: RosType) -> Send:
        """Declares a publisher with its token; returns the function that sends CDR bytes by it."""
        key, token = self._entity("MP", topic, kind)
        self._topics[_mangled(topic)] = self._hash(kind)
        publisher = self._session.declare_publisher(
            key,
            congestion_control=zenoh.CongestionControl.DROP,  # a reader that hangs holds up nobody
            priority=zenoh.Priority.INTERACTIVE_HIGH,  # its queue holds a burst, see `zenoh_config.FIXED`
        )
        gid, numbers = blake2b(token.encode(), digest_size=16).digest(), count(1)

        def send(payload: bytes, stamp_ns: int) -> None:
            attachment = struct.pack("<qqB", next(numbers), stamp_ns, len(gid)) + gid
            publisher.put(payload, attachment=attachment)

        return send

    def subscribe(self, topic: str, kind: RosType, take: Take) -> None:
        """Declares a subscriber with its token; a thread of Zenoh calls `take` (CDR bytes, writer's id)."""

        def receive(sample: zenoh.Sample) -> None:
            attachment = sample.attachment.to_bytes() if sample.attachment else b""
            take(sample.payload.to_bytes(), attachment[17:])

        key, _ = self._entity("MS", topic, kind)
        self._declared.append(self._session.declare_subscriber(key, receive))

    def readers(self) -> int:
        """Takes in the tokens that came or went; returns the number of subscriptions in the graph to topics
        of ours, with the type that we send.
        """
        while (sample := self._tokens.try_recv()) is not None:
            token = str(sample.key_expr)
            if sample.kind == zenoh.SampleKind.DELETE:
                self._readers.discard(token)
            elif len(self._readers) < _MOST_TOKENS:
                self._readers.add(token)
        return sum(self._topics.get(token.split("/")[9]) == token.split("/")[11] for token in self._readers)

    def remarks(self) -> list[str]:
        """Lines, each once, on readers that expect another type, or ask for transient local."""
        lines = []
        for token in self._readers:
            *_, node, topic, _, type_hash, qos = token.split("/")
            name, expected = topic.replace("%", "/"), self._topics.get(topic)
            if expected is None:
                continue
            if type_hash != expected:
                humble = type_hash == _NO_HASH
                advice = "expected --humble here" if humble else "its package defines another message"
                lines.append(f"node {node} can not read {name}: type hash {type_hash}; {advice}")
            elif qos.partition(":")[2].startswith(_TRANSIENT_LOCAL):
                lines.append(f"node {node} asks {name} for transient local: it hears what comes from now on")
        new = [line for line in lines if line not in self._reported and len(self._reported) < _MOST_TOKENS]
        self._reported.update(new)
        return new

    @property
    def silence(self) -> str:
        """Text on why nobody may be reading: the router is gone, else what nodes need to be set to."""
        if not self._session.info.transports():
            return f"the router at {self._endpoint} is gone"
        return (
            f"no ROS node hears us over Zenoh: expected there RMW_IMPLEMENTATION=rmw_zenoh_cpp, "
            f"ROS_DOMAIN_ID={self._domain}, and this router ({self._endpoint})"
        )

    def close(self) -> None:
        self._session.close()  # type: ignore[no-untyped-call]

    def _entity(self, letters: str, topic: str, kind: RosType) -> tuple[str, str]:
        """Declares the token of a publisher (MP) or subscriber (MS); returns the key of the topic, and it."""
        typed = f"{kind.dds_name}/{self._hash(kind)}"
        token = self._token(f"0/{next(self._ids)}/{letters}", f"/{_mangled(topic)}/{typed}/{_QOS}")
        return f"{self._domain}{topic}/{typed}", token

    def _hash(self, kind: RosType) -> str:
        return _NO_HASH if self._humble else kind.hash

    def _token(self, entity: str, of_topic: str) -> str:
        key = f"@ros2_lv/{self._domain}/{self._zid}/{entity}/%/%/{NODE}{of_topic}"
        self._declared.append(self._session.liveliness().declare_token(key))
        return key


def _mangled(topic: str) -> str:
    return topic.replace("/", "%")
