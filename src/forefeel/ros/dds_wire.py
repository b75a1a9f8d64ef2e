"""ROS topics over DDS, by rosless: no installation of ROS, and no input, for 0.5.0 cannot decode a sequence
of doubles that is empty.
"""

import rosless

from forefeel.ros.cdr import RosType
from forefeel.ros.crtk import DEPTH, Send, Take


class DdsWire:
    """A participant of its own in a domain.

    Attributes:
        name: for a person.
        notice: what the user must be told loudly about it.
    """

    name = "DDS"
    notice = "DDS: not encrypted, not authenticated; whoever is in this network can read what the cell says"

    def __init__(self, domain: int) -> None:
        self._node, self._domain = rosless.Node(domain=domain), domain
        self._publishers: dict[str, rosless.Publisher] = {}
        self._reported: set[str] = set()

    def publisher(self, topic: str, kind: RosType) -> Send:
        """Declares a publisher: reliable, volatile, keep last."""
        publisher = self._publishers[topic] = self._node.advertise(topic, kind.name, depth=DEPTH)
        return lambda payload, _stamp_ns: publisher.send_payload(payload)

    def subscribe(self, topic: str, kind: RosType, take: Take) -> None:
        """Does nothing: nothing is taken over DDS."""

    def readers(self) -> int:
        return sum(publisher.subscriber_count for publisher in list(self._publishers.values()))

    def remarks(self) -> list[str]:
        """Lines, each once, on topics with readers that do not match: they ask for more than they get."""
        lines = []
        for topic in self._node.graph().topics:
            publisher = self._publishers.get(topic.name)
            refused = publisher is not None and topic.subscribers > publisher.subscriber_count
            if refused and topic.name not in self._reported:
                self._reported.add(topic.name)
                lines.append(
                    f"a reader of {topic.name} asks for more than reliable and volatile: it hears nothing"
                )
        return lines

    @property
    def silence(self) -> str:
        """Text on why nobody may be reading."""
        return (
            "no ROS node hears us over DDS: expected there RMW_IMPLEMENTATION=rmw_fastrtps_cpp or "
            f"rmw_cyclonedds_cpp, ROS_DOMAIN_ID={self._domain}, and multicast between the hosts"
        )

    def close(self) -> None:
        for publisher in self._publishers.values():
            publisher.close()
