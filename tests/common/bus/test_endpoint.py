import pytest

from readygo.common.bus.endpoint import check_endpoint
from readygo.common.errors import ConfigError


@pytest.mark.parametrize(
    "endpoint",
    [
        "tcp/127.0.0.1:7447",
        "tls/lab1:7447",
        "tcp/[::1]:1",
        "tcp/0.0.0.0:65535",
        "udp/lab1:7447#iface=eth0",
        "tcp/lab1:7447?rel=1",
        "unixsock-stream/run/zenoh",
    ],
)
def test_endpoint_of_zenoh_passes(endpoint: str) -> None:
    check_endpoint(endpoint)


@pytest.mark.parametrize(
    "endpoint",
    [
        "",
        "foo",
        "tcp",
        "tcp/",
        "tcp/127.0.0.1",
        "tcp/127.0.0.1:",
        "tcp/127.0.0.1:0",
        "tcp/127.0.0.1:99999",
        "tcp/127.0.0.1:-1",
        "tcp/127.0.0.1:7447x",
        "127.0.0.1:7447",
        "http://127.0.0.1:7447",
        "tcp/a b:7447",
        "tcp/\x1b[2J:7447",
        "tcp/127.0.0.1:7447\n",
    ],
)
def test_anything_else_is_refused_in_a_line(endpoint: str) -> None:
    with pytest.raises(ConfigError, match=r"--listen must be of the form tcp/HOST:PORT or tls/HOST:PORT") as error:
        check_endpoint(endpoint, "--listen")
    assert str(error.value).isprintable()
