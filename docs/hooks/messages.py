"""The page of every topic and message, from the topic table and the models of the wire."""

from enum import Enum

from docs.hooks.markdown import NOTE, code, prose, table
from docs.hooks.units import unit_of
from docs.hooks.values import default, values
from forefeel.common import messages as m
from forefeel.common.bus import BATCH_NS
from forefeel.common.topics import TOPICS, Qos

_HEAD = f"""{NOTE}
# Messages and topics

Every message on the network, from `common/topics.py` and `common/messages.py`; the wire is msgpack. A key
expression is `forefeel/CELL/AXIS/TOPIC`. Topics of service `stream` stand there in arrays of what was sent in
{BATCH_NS // 1_000_000} ms; the other end takes each message at once under `direct/forefeel/CELL/AXIS/TOPIC`
([decision 0029](../decisions/0029-a-loop-takes-its-own-messages.md)). Messages are frozen: unknown fields,
and numbers out of their range, are refused. A rotation axis uses the tangential equivalents
([decision 0003](../decisions/0003-rotation-as-tangential.md)).

Protocol version {m.PROTOCOL_VERSION}.
"""
_TOPIC = ["topic", "message", "from", "rate, Hz", "service", "stale after, s", "other end", "recorded"]


def page() -> str:
    """The page as Markdown."""
    kinds = list(dict.fromkeys(topic.message for topic in TOPICS))
    enums = [each for each in vars(m).values() if isinstance(each, type) and issubclass(each, Enum)]
    return "\n".join(
        [_HEAD, _topics(), _services(), "## Messages\n", _common(), *map(_message, kinds)]
        + [_enumeration(each) for each in enums if each.__module__ == m.__name__]
    )


def link(kind: type) -> str:
    """To the section of that message or enumeration."""
    return f"[{kind.__name__}](#{kind.__name__})"


def _topics() -> str:
    rows = [
        [
            code(topic.name),
            link(topic.message),
            topic.publisher,
            "on occasion" if topic.rate_hz is None else f"{topic.rate_hz:g}",
            topic.qos.name.lower(),
            "never" if topic.stale_after_s is None else f"{topic.stale_after_s:g}",
            _whither(topic.crosses, topic.published),
            "yes" if topic.recorded else "no",
        ]
        for topic in TOPICS
    ]
    return f"## Topics\n\n{table(_TOPIC, rows)}"


def _whither(crosses: bool, published: bool) -> str:
    if not published:
        return "not sent: flight records only"
    return "takes it" if crosses else "for recorders and viewers"


def _services() -> str:
    rows = [[code(qos.name.lower()), qos.value] for qos in Qos]
    return f"## Service\n\nNo message ever blocks its sender.\n\n{table(['service', ''], rows)}"


def _common() -> str:
    return (
        f"### What every message carries {{ #Message }}\n\n{prose(m.Message.__doc__)}\n\n{_fields(m.Message)}"
    )


def _message(kind: type[m.Message]) -> str:
    most = f"At most {kind.most_bytes} bytes, {kind.most_items} items in an array or map."
    return f"### {kind.__name__} {{ #{kind.__name__} }}\n\n{prose(kind.__doc__)}\n\n{most}\n\n{_fields(kind)}"


def _fields(kind: type[m.Message]) -> str:
    own = kind is m.Message
    rows = [
        [code(name), unit_of(name), values(field.annotation, field.metadata, link), default(field)]
        for name, field in kind.model_fields.items()
        if own or name not in m.Message.model_fields
    ]
    return table(["field", "unit", "values", "default"], rows)


def _enumeration(kind: type[Enum]) -> str:
    listed = ", ".join(code(each.value) for each in kind)
    return f"### {kind.__name__} {{ #{kind.__name__} }}\n\n{prose(kind.__doc__)}\n\n{listed}\n"
