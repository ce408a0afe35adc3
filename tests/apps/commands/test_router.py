from pathlib import Path

import pytest

from readygo.apps.commands import router as module
from readygo.apps.commands.router import RouterCommandOptions, router
from readygo.apps.fleet.access import join
from readygo.apps.fleet.token import TOKEN_VARIABLE
from readygo.common.bus.zenoh_bus import free_endpoint
from readygo.common.errors import BusError, CertificateError, RunError


def test_router_lets_in_who_has_the_token_until_it_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(TOKEN_VARIABLE, "secret")
    endpoint, runs = free_endpoint(), ("one", "two")

    class Ended:
        def wait(self) -> None:
            buses = [join(endpoint, run, "all") for run in runs]
            for bus in buses:
                bus.announce("all", "w")
                bus.close()
            with pytest.raises(BusError, match="No router answers"):
                join(endpoint, "one", "all", token="guessed")
            raise KeyboardInterrupt

    monkeypatch.setattr(module.threading, "Event", Ended)
    with pytest.raises(KeyboardInterrupt):
        router(RouterCommandOptions(listen=endpoint))
    monkeypatch.undo()
    with pytest.raises(BusError, match="No router answers"):
        join(endpoint, "one", "all", token="secret")


def test_router_without_a_secret_or_certificates_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv(TOKEN_VARIABLE, raising=False)
    with pytest.raises(RunError, match=r"^Who may join\? Give .* a secret, as READYGO_TOKEN, or certificates\.$"):
        router(RouterCommandOptions(listen=free_endpoint()))
    with pytest.raises(CertificateError, match="needs certificates: pass --certs"):
        router(RouterCommandOptions(listen="tls/127.0.0.1:1"))
