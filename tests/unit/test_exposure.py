"""What may be open to a network, over every combination of what the rule looks at."""

from itertools import product

import pytest

from forefeel.common.errors import EndpointError
from forefeel.common.transport.endpoints import check_endpoint
from forefeel.common.transport.exposure import check_exposure, on_loopback

ENDPOINTS = {
    ("inside", "plain"): "tcp/127.0.0.1:7447",
    ("inside", "tls"): "tls/localhost:7447",
    ("outside", "plain"): "tcp/0.0.0.0:7447",
    ("outside", "tls"): "tls/10.0.0.1:7447",
}
KINDS = [(), *((kind,) for kind in ENDPOINTS), *product(ENDPOINTS, repeat=2)]
FLAGS = [False, True]
Kinds = tuple[tuple[str, str], ...]


def expected(listen: Kinds, connect: Kinds, secured: bool, insecure: bool, real: bool) -> str:
    """`quiet`, `loud` or `refused`, from the words of the rule."""
    protocols = {protocol for _, protocol in listen}
    if len(protocols) == 2 or (secured and "plain" in protocols | {protocol for _, protocol in connect}):
        return "refused"
    if not secured and "tls" in protocols | {protocol for _, protocol in connect}:
        return "refused"
    if secured or all(place == "inside" for place, _ in (*listen, *connect)):
        return "quiet"
    return "loud" if insecure and not real else "refused"


def found(listen: Kinds, connect: Kinds, secured: bool, insecure: bool, real: bool) -> str:
    endpoints = [[ENDPOINTS[kind] for kind in kinds] for kinds in (listen, connect)]
    try:
        line = check_exposure(*endpoints, secured=secured, insecure=insecure, real_stage=real)
    except EndpointError as error:
        assert str(error).startswith("endpoint '")
        assert "expected" in str(error) or "--insecure" in str(error)
        return "refused"
    assert "\n" not in line
    return "loud" if line else "quiet"


def test_every_combination() -> None:
    cases = list(product(KINDS, KINDS, FLAGS, FLAGS, FLAGS))
    assert len(cases) == 21 * 21 * 8
    outcomes = {case: (found(*case), expected(*case)) for case in cases}
    assert {case: pair for case, pair in outcomes.items() if pair[0] != pair[1]} == {}
    assert {pair[0] for pair in outcomes.values()} == {"quiet", "loud", "refused"}


HERE = [
    "tcp/127.0.0.1:1", "tcp/127.8.9.1:1", "udp/[::1]:1", "tcp/localhost:1", "tcp/LOCALHOST:1",
    "tcp/127.0.0.1:1?rel=0", "tcp/[::1]:7447?prio=1-3;rel=1#iface=lo", "tcp/[::ffff:127.0.0.1]:1",
]  # fmt: skip
ELSEWHERE = [
    "tcp/0.0.0.0:1", "tcp/[::]:1", "tcp/10.0.0.1:1", "tcp/[fe80::1%eth0]:1", "tcp/localhost.example:1",
    "tcp/slave-host:1", "tcp/127.1:1", "tcp/0:1", "tcp/[::ffff:10.0.0.1]:1",
    "tcp/10.0.0.1:1#bind=127.0.0.1:2",
]  # fmt: skip


@pytest.mark.parametrize("endpoint", [*HERE, *ELSEWHERE])
def test_endpoint_stays_on_this_host(endpoint: str) -> None:
    assert on_loopback(endpoint) is (endpoint in HERE)


@pytest.mark.parametrize(
    "options", ["enable_mtls=false", "iface=lo;enable_mtls=false", "root_ca_certificate=/tmp/mine.crt"]
)
def test_an_endpoint_can_not_undo_the_security_that_was_configured(options: str) -> None:
    for listen, connect in ((["tls/10.0.0.1:1#" + options], []), ([], ["tls/10.0.0.1:1#" + options])):
        with pytest.raises(EndpointError, match="after #; expected one of bind"):
            check_exposure(listen, connect, secured=True, insecure=True, real_stage=False)
    allowed = ["tls/10.0.0.1:1?rel=1#iface=eth0"]
    assert check_exposure(allowed, [], secured=True, insecure=False, real_stage=True) == ""


@pytest.mark.parametrize("endpoint", ["udp/0.0.0.0:1?rel=0", "quic/[::1]:65535#dscp=0x08", *HERE])
def test_good_endpoints(endpoint: str) -> None:
    check_endpoint(endpoint)


@pytest.mark.parametrize(
    "endpoint",
    [
        "", "tcp", "tcp/", "tcp/127.0.0.1", "127.0.0.1:7447", "tcp://127.0.0.1:7447", "tcp/127.0.0.1:abc",
        "tcp/127.0.0.1:0", "tcp/127.0.0.1:65536", "http/127.0.0.1:7447", "tcp/::1:7447", "tcp/a b:7447",
        "tcp/127.0.0.1:7447 ",
    ],
)  # fmt: skip
def test_malformed_endpoints_are_named(endpoint: str) -> None:
    with pytest.raises(EndpointError) as caught:
        check_endpoint(endpoint)
    assert str(caught.value).startswith(f"endpoint {endpoint!r}: expected protocol/host:port")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("host", ["no-such-host.invalid", "256.0.0.1", "a..b"])
def test_hosts_that_do_not_resolve_are_named(host: str) -> None:
    with pytest.raises(EndpointError, match=f"host '{host}' does not resolve"):
        check_endpoint(f"tcp/{host}:7447")
