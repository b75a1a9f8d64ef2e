import pytest

from forefeel.common.errors import EndpointError
from forefeel.common.transport.endpoints import check_endpoint


@pytest.mark.parametrize(
    "endpoint",
    [
        "tcp/127.0.0.1:7447",
        "tls/localhost:7447",
        "udp/0.0.0.0:1?rel=0",
        "quic/[::1]:65535#dscp=0x08",
        "tcp/[::]:7447?prio=1-3;rel=1#iface=lo",
    ],
)
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
