import pytest

from readygo.apps.observe.settings import NOTHING, Observing, address
from readygo.common.errors import ConfigError


def test_members_are_asked_for_the_same_at_ports_of_their_own() -> None:
    observing = Observing(metrics="127.0.0.1:9464", log_format="json", traces="spans")
    given = ["--log-format", "json", "--metrics", "127.0.0.1:0", "--traces", "spans"]
    assert observing.of_member() == given
    assert NOTHING.of_member() == []


@pytest.mark.parametrize("text", ["9464", ":9464", "localhost:", "localhost:http", "localhost:70000"])
def test_address_that_is_none_is_said_in_one_line(text: str) -> None:
    with pytest.raises(ConfigError, match="--metrics must be HOST:PORT"):
        Observing(metrics=text)


def test_address_of_ipv6() -> None:
    assert address("[::1]:9464") == ("::1", 9464)
