"""Rights to put and to receive, as Zenoh configuration: mutual TLS, and access control by certificate name.

Pure: what it is built from is the topic table. Every end enforces it against whom it is connected to, so that
two daemons need no router between them, and a router enforces it for each of its cells.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import PurePath
from typing import Literal, get_args

from forefeel.common.codec import MAX_MESSAGE_BYTES
from forefeel.common.messages import Message
from forefeel.common.topics import PUBLISHED, Topic, direct, numbered

PartyRole = Literal["slave", "master", "recorder", "viewer", "router"]
ROLES: tuple[PartyRole, ...] = get_args(PartyRole)
CELL_ROLES: tuple[PartyRole, ...] = ("slave", "master", "recorder", "viewer")
_STOPS: frozenset[PartyRole] = frozenset({"slave", "master", "viewer"})
_ROUTER = "forefeel-router"


@dataclass(frozen=True, slots=True)
class Party:
    """Identity of a session: its role, and its cell (of a router: the cells that it serves)."""

    role: PartyRole
    cells: tuple[str, ...]

    @property
    def name(self) -> str:
        return common_name(self.role, self.cells[0] if self.cells else "")


@dataclass(frozen=True, slots=True)
class PartyFiles:
    """The files of a party: the authority that it trusts, its certificate, its key."""

    authority: PurePath
    certificate: PurePath
    key: PurePath


def common_name(role: PartyRole, cell: str) -> str:
    """The name in the certificate of a role; Zenoh compares it as a whole. A router has no cell."""
    return _ROUTER if role == "router" else f"forefeel-{cell}-{role}"


def publishes(role: PartyRole, topic: Topic[Message]) -> bool:
    """True if the role may put that topic. Anyone but a recorder may stop."""
    return topic.publisher == role or (topic.publisher == "any" and role in _STOPS)


def hears(role: PartyRole, topic: Topic[Message]) -> bool:
    """True if the role receives that topic: observers all, master and slave what the other end sends them."""
    if role in {"recorder", "viewer"}:
        return True
    return role in {"slave", "master"} and topic.crosses and topic.publisher != role


def secured(party: Party, identity: PartyFiles) -> dict[str, object]:
    """Zenoh configuration, by path, that a session with certificates adds: tls and quic only, mutual TLS with
    the files of `identity`, access control for `party`, a limit on the size of messages.
    """
    return {
        "transport/link/protocols": ["tls", "quic"],
        "transport/link/tls": {
            "root_ca_certificate": str(identity.authority),
            "listen_private_key": str(identity.key),
            "listen_certificate": str(identity.certificate),
            "connect_private_key": str(identity.key),
            "connect_certificate": str(identity.certificate),
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "close_link_on_expiration": False,  # an expiry must not end what runs; nobody new comes in
        },
        "access_control": access_control(party),
        "low_pass_filter": [
            {
                "id": "size",
                "flows": ["ingress", "egress"],
                "messages": ["put", "delete", "query", "reply"],
                "key_exprs": ["**"],
                "size_limit": MAX_MESSAGE_BYTES,
            }
        ],
    }


def access_control(party: Party) -> dict[str, object]:
    """Zenoh's access control for a session of `party`, as a list of what is allowed to each role by the name
    in its certificate; all else is denied.
    """
    rules: list[dict[str, object]] = []
    subjects, policies = [], []
    routes = party.role == "router"
    remotes = CELL_ROLES if routes else [role for role in ROLES if role != party.role]
    for cell, remote in product(party.cells if routes else (party.cells[0],), remotes):
        allowed = _router_rules(remote, cell) if routes else _rules(party.role, remote, cell)
        if not allowed:
            continue
        name = common_name(remote, cell)
        ids = [f"{name} {flow} {message}" for flow, message in allowed]
        rules += [
            {
                "id": rule,
                "permission": "allow",
                "flows": [flow],
                "messages": [message],
                "key_exprs": list(keys),
            }
            for rule, ((flow, message), keys) in zip(ids, allowed.items(), strict=True)
        ]
        subjects.append({"id": name, "cert_common_names": [name]})
        policies.append({"rules": ids, "subjects": [name]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


_Allowed = Mapping[tuple[str, str], Sequence[str]]
"""By (flow, message): the key expressions."""


def _rules(role: PartyRole, remote: PartyRole, cell: str) -> _Allowed:
    """Key expressions that a session of `role` allows in its exchange with a session of `remote`, by flow and
    message: puts and subscriptions, in and out. Empty where the two have nothing to exchange. With a router:
    all that `role` hears and publishes.
    """
    through = remote == "router"
    inbound = [topic for topic in PUBLISHED if hears(role, topic) and (through or publishes(remote, topic))]
    outbound = [topic for topic in PUBLISHED if publishes(role, topic) and (through or hears(remote, topic))]
    asked = _every(cell) if through else _subscriptions(remote, cell)
    ends = through or {role, remote} == {"slave", "master"}
    return _flows(
        ingress_put=_keys(inbound, cell, ends),
        egress_put=_keys(outbound, cell, ends),
        ingress_declare_subscriber=asked if outbound else [],
        egress_declare_subscriber=_subscriptions(role, cell) if inbound else [],
    )


def _router_rules(remote: PartyRole, cell: str) -> _Allowed:
    """Key expressions that a router allows in its exchange with one party of a cell, by flow and message:
    what it takes from it and gives to it, and the subscriptions for that.
    """
    inbound = [topic for topic in PUBLISHED if publishes(remote, topic)]
    outbound = [topic for topic in PUBLISHED if hears(remote, topic)]
    end = remote in {"slave", "master"}
    return _flows(
        ingress_put=_keys(inbound, cell, end),
        egress_put=_keys(outbound, cell, end),
        ingress_declare_subscriber=_subscriptions(remote, cell),
        egress_declare_subscriber=_every(cell) if inbound else [],
    )


def _flows(**keys: Sequence[str]) -> _Allowed:
    """Key expressions by (flow, message), from arguments named `flow_message`; without the empty ones."""
    parts = {name.partition("_"): expressions for name, expressions in keys.items() if expressions}
    return {(flow, message): expressions for (flow, _, message), expressions in parts.items()}


def _subscriptions(role: PartyRole, cell: str) -> list[str]:
    """Key expressions to which a role may subscribe: an observer to the whole cell, an end to its topics."""
    if role in {"recorder", "viewer"}:
        return [_whole(cell)]
    return _keys([topic for topic in PUBLISHED if hears(role, topic)], cell, ends=True)


def _keys(topics: Iterable[Topic[Message]], cell: str, ends: bool) -> list[str]:
    """Key expressions of topics, for every axis of the cell; with `ends` also those under which batched
    topics go directly between slave and master, and the numbered ones of what takes turns.
    """
    listed = list(topics)
    keys = [topic.key(cell, "*") for topic in listed]
    if ends:
        keys += [topic.taken_key(cell, "*") for topic in listed if topic.crosses and topic.batched]
        keys += [numbered("*", topic.taken_key(cell, "*")) for topic in listed if topic.takes_turns]
    return keys


def _every(cell: str) -> list[str]:
    """Key expressions to which the ends and the observers of a cell subscribe."""
    whole = _whole(cell)
    return [whole, direct(whole), numbered("*", whole), numbered("*", direct(whole))]


def _whole(cell: str) -> str:
    return f"forefeel/{cell}/**"
