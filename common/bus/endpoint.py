"""Where a router listens, as users write it."""

import re

from readygo.common.errors import ConfigError

PORT_MAX = 65535
_ENDPOINT = re.compile(r"[a-z][a-z0-9_-]*/[^\s/]\S*")
_WITH_PORT = re.compile(r"(tcp|tls|udp|quic|ws)/[^\s?#]+?(:(?P<port>[0-9]+))?([?#]\S*)?")


def check_endpoint(endpoint: str, option: str = "An endpoint") -> None:
    """See whether an endpoint is written as Zenoh wants it; what Zenoh reaches by other ways than ports, it checks.

    Args:
        endpoint: Such as "tcp/127.0.0.1:7447".
        option: What names it, for the error.

    Raises:
        ConfigError: If it is not.
    """
    of_port = _WITH_PORT.fullmatch(endpoint)
    port_is_there = of_port is None or (of_port["port"] is not None and 1 <= int(of_port["port"]) <= PORT_MAX)
    if not (_ENDPOINT.fullmatch(endpoint) and endpoint.isprintable() and port_is_there):
        raise ConfigError(
            f"{option} must be of the form tcp/HOST:PORT or tls/HOST:PORT, PORT 1..{PORT_MAX}, got {endpoint!r}."
        )
