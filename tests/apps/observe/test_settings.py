import sys

import pytest

from readygo.apps.observe.settings import NOTHING, Observing, address
from readygo.common.errors import ConfigError


def test_members_are_asked_for_the_same_at_ports_of_their_own() -> None:
    observing = Observing(metrics="127.0.0.1:9464", log_format="json")
    given = ["--log-format", "json", "--metrics", "127.0.0.1:0"]
    assert observing.of_member() == given
    assert NOTHING.of_member() == []


@pytest.mark.parametrize("text", ["9464", ":9464", "localhost:", "localhost:http", "localhost:70000"])
def test_address_that_is_none_is_said_in_one_line(text: str) -> None:
    with pytest.raises(ConfigError, match="--metrics must be HOST:PORT"):
        Observing(metrics=text)


def test_address_of_ipv6() -> None:
    assert address("[::1]:9464") == ("::1", 9464)


def test_missing_package_is_said_before_anything_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.split(".")[0] == "prometheus_client"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "prometheus_client", None)
    with pytest.raises(ConfigError, match=r"--metrics needs prometheus-client; run: .*pip"):
        Observing(metrics="127.0.0.1:9464").check_installed()
    NOTHING.check_installed()
