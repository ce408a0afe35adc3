from pathlib import Path

import pytest

from readygo.apps.commands.coordinator import CoordinatorOptions, coordinator
from readygo.apps.fleet.options import FleetOptions
from readygo.common.bus.zenoh_bus import free_endpoint
from readygo.common.errors import CertificateError, RunError
from readygo.services.coordinator import Ledger, Written
from tests.apps.fleet.toy_line import DRAW, FILM, make_folder


def test_run_that_is_done_is_over_at_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = make_folder(tmp_path / "data", [DRAW, FILM], wanted=1)
    ledger = Ledger(folder.ledger, folder.load()[0].stages)
    ledger.adopt(0, Written(recorder="rec0", attempt=1, shard="shard-rec0-00000.mcap", samples=4))
    ledger.close()
    coordinator(CoordinatorOptions(data=folder.path, fleet=FleetOptions(listen=free_endpoint())))
    said = "1 episodes, 4 samples, in the shards of their recorders."
    assert capsys.readouterr().err.splitlines()[-1] == said
    assert not (folder.state / "endpoint").exists()


def test_what_cannot_be_led_is_said_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="holds no recorded run"):
        coordinator(CoordinatorOptions(data=tmp_path / "nothing", fleet=FleetOptions(listen=free_endpoint())))
    folder = make_folder(tmp_path / "data", [DRAW, FILM], wanted=1)
    with pytest.raises(CertificateError, match="needs certificates: pass --certs"):
        coordinator(CoordinatorOptions(data=folder.path, fleet=FleetOptions(listen="tls/127.0.0.1:7447")))


def test_episodes_that_were_set_aside_are_warned_of_and_fail_a_strict_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = make_folder(tmp_path / "data", [DRAW, FILM], wanted=1)
    ledger = Ledger(folder.ledger, folder.load()[0].stages)
    ledger.open_episodes(1)
    ledger.set_aside(0, "stage film failed: no floor")
    ledger.adopt(1, Written(recorder="rec0", attempt=1, shard="shard-rec0-00000.mcap", samples=4))
    ledger.close()
    warning = "Warning: Episode 0 was set aside, the next index took its place: stage film failed: no floor"
    coordinator(CoordinatorOptions(data=folder.path, fleet=FleetOptions(listen=free_endpoint())))
    assert capsys.readouterr().err.splitlines()[-1] == warning
    with pytest.raises(RunError, match=r"1 episodes of .* were set aside, which --strict does not allow"):
        coordinator(CoordinatorOptions(data=folder.path, strict=True, fleet=FleetOptions(listen=free_endpoint())))
