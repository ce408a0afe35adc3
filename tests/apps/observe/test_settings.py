import sys

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


@pytest.mark.parametrize(
    ("observing", "module", "missing"),
    [
        (Observing(metrics="127.0.0.1:9464"), "prometheus_client", "--metrics needs prometheus-client; run: .*pip"),
        (Observing(traces="spans"), "opentelemetry", "--traces needs OpenTelemetry; run: .*pip install"),
        (
            Observing(traces="http://collector:4318"),
            "opentelemetry",
            "--traces needs OpenTelemetry; run: .*pip install",
        ),
    ],
)
def test_missing_packages_are_said_before_anything_is_made(
    observing: Observing, module: str, missing: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [name for name in sys.modules if name.split(".")[0] == module]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ConfigError, match=missing):
        observing.check_installed()
    NOTHING.check_installed()
