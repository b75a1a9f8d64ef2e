"""The access control that is generated from the topic table, judged rule by rule as Zenoh would."""

import json
from itertools import product
from pathlib import Path
from typing import Any

import pytest
import zenoh

from forefeel.common.topics import PUBLISHED
from forefeel.common.transport import security
from forefeel.pki.folder import router_file

ROOT = Path(__file__).parents[2]
WHOLE = "forefeel/c/**"
MASTER = {topic.name for topic in PUBLISHED if topic.name.startswith("master/")}
SLAVE = {topic.name for topic in PUBLISHED if topic.name.startswith("slave/")}
STOP = {"any/estop"}
CROSSES = {topic.name for topic in PUBLISHED if topic.crosses}
SAYS = {
    "slave": SLAVE | STOP, "master": MASTER | STOP, "viewer": STOP, "recorder": set[str](),
    "router": MASTER | SLAVE | STOP,
}  # fmt: skip
HEARS = {
    "slave": (MASTER | STOP) & CROSSES, "master": (SLAVE | STOP) & CROSSES, "viewer": MASTER | SLAVE | STOP,
    "recorder": MASTER | SLAVE | STOP, "router": MASTER | SLAVE | STOP,
}  # fmt: skip


def allowed(rules: dict[str, Any], name: str, flow: str, message: str, key: str) -> bool:
    """Whether a peer of that certificate may; what is included in an allowed expression is allowed."""
    assert (rules["enabled"], rules["default_permission"]) == (True, "deny")
    subjects = {each["id"] for each in rules["subjects"] if each["cert_common_names"] == [name]}
    ids = {
        rule for policy in rules["policies"] for rule in policy["rules"] if subjects & set(policy["subjects"])
    }
    return any(
        rule["permission"] == "allow"
        and flow in rule["flows"]
        and message in rule["messages"]
        and any(zenoh.KeyExpr(each).includes(zenoh.KeyExpr(key)) for each in rule["key_exprs"])
        for rule in rules["rules"]
        if rule["id"] in ids
    )


@pytest.mark.parametrize("own", security.CELL_ROLES)
def test_an_end_takes_and_gives_what_both_roles_allow(own: security.PartyRole) -> None:
    rules = security.access_control(security.Party(own, ("c",)))
    for remote, topic in product(security.ROLES, PUBLISHED):
        if remote == own:
            continue
        key, name = topic.key("c", "insertion"), security.common_name(remote, "c")
        comes = topic.name in SAYS[remote] & HEARS[own]
        goes = topic.name in SAYS[own] & HEARS[remote]
        assert allowed(rules, name, "ingress", "put", key) == comes, (remote, topic.name)
        assert allowed(rules, name, "egress", "put", key) == goes, (remote, topic.name)


@pytest.mark.parametrize("remote", security.CELL_ROLES)
def test_a_router_takes_and_gives_what_the_role_allows_in_its_own_cell_only(
    remote: security.PartyRole,
) -> None:
    rules = security.access_control(security.Party("router", ("c", "d")))
    for topic, cell in product(PUBLISHED, "cde"):
        key, name = topic.key(cell, "insertion"), security.common_name(remote, "c")
        inside = cell == "c"
        assert allowed(rules, name, "ingress", "put", key) == (inside and topic.name in SAYS[remote])
        assert allowed(rules, name, "egress", "put", key) == (inside and topic.name in HEARS[remote])


BEYOND = ["forefeel/**", "**", "forefeel/*/insertion/master/command", "forefeel/d/**", "@/**"]


@pytest.mark.parametrize("own", security.ROLES)
@pytest.mark.parametrize("key", [*BEYOND, WHOLE])
def test_no_wildcard_is_put_and_none_beyond_the_own_cell_is_subscribed(
    own: security.PartyRole, key: str
) -> None:
    rules = security.access_control(security.Party(own, ("c",)))
    for remote, flow in product(security.ROLES, ("ingress", "egress")):
        name = security.common_name(remote, "c")
        assert not allowed(rules, name, flow, "put", key)
        if key != WHOLE:
            assert not allowed(rules, name, flow, "declare_subscriber", key)


@pytest.mark.parametrize("remote", security.CELL_ROLES)
def test_observers_alone_subscribe_to_a_whole_cell(remote: security.PartyRole) -> None:
    own: security.PartyRole = "master" if remote == "slave" else "slave"
    for party in (security.Party(own, ("c",)), security.Party("router", ("c",))):
        rules, name = security.access_control(party), security.common_name(remote, "c")
        observes = remote in {"recorder", "viewer"}
        assert allowed(rules, name, "ingress", "declare_subscriber", WHOLE) == observes
        heard = next(topic for topic in PUBLISHED if topic.name in HEARS[remote] & SAYS[own])
        key = heard.key("c", "insertion")
        assert allowed(rules, name, "ingress", "declare_subscriber", key)


@pytest.mark.parametrize("own", security.ROLES)
def test_nothing_but_puts_and_subscriptions_is_ever_allowed(own: security.PartyRole) -> None:
    rules: Any = security.access_control(security.Party(own, ("c", "d")))["rules"]
    assert {message for rule in rules for message in rule["messages"]} <= {"put", "declare_subscriber"}
    assert len({rule["id"] for rule in rules}) == len(rules)


def test_nobody_of_another_cell_or_without_a_name_of_ours_is_a_subject() -> None:
    rules: Any = security.access_control(security.Party("slave", ("c",)))
    names = {name for subject in rules["subjects"] for name in subject["cert_common_names"]}
    assert names == {security.common_name(role, "c") for role in ("master", "recorder", "viewer", "router")}
    assert not any("*" in name for name in names)


def test_a_common_name_tells_role_and_cell_apart() -> None:
    cells = ["c", "c-slave", "router", "slave", "c-master"]
    names = [security.common_name(role, cell) for role, cell in product(security.CELL_ROLES, cells)]
    assert len({*names, security.common_name("router", "")}) == len(names) + 1


def test_zenoh_takes_all_of_it() -> None:
    files = security.PartyFiles(Path("ca"), Path("crt"), Path("key"))
    for role in security.ROLES:
        config = zenoh.Config()
        for path, value in security.secured(security.Party(role, ("c", "d")), files).items():
            config.insert_json5(path, json.dumps(value))
        assert json.loads(config.get_json("transport/link/tls/enable_mtls")) is True


def test_committed_router_file_is_what_the_command_writes() -> None:
    assert (ROOT / "deploy" / "zenoh" / "router.json5").read_text() == router_file(["cathlab"])
