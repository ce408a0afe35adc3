import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from readygo.apps.commands.control import cancel, pause, resume, status
from readygo.apps.fleet.worker import make_coordinator
from readygo.apps.run.folder import RunFolder
from readygo.common.bus.zenoh_bus import Router, ZenohBus, free_endpoint
from readygo.common.errors import BusError, RunError
from readygo.common.messages import PolicyRef
from readygo.services.coordinator import Coordinator, attach
from tests.common.messages.run_specs import SPEC


@pytest.fixture
def folder(tmp_path: Path) -> RunFolder:
    folder = RunFolder(tmp_path / "data")
    with folder.locked():
        folder.save(SPEC, 3)
    return folder


@pytest.fixture
def coordinator(folder: RunFolder) -> Iterator[Coordinator]:
    """The coordinator of a fleet that is at work on the folder."""
    router = Router(free_endpoint(), "secret")
    bus = ZenohBus(router.endpoint, SPEC.run, "secret")
    coordinator = make_coordinator(folder)
    attach(bus, coordinator)
    with folder.reachable(router.endpoint, "secret"):
        yield coordinator
    bus.close()
    router.close()
    coordinator.ledger.close()


def test_run_is_paused_and_resumed_and_cancelled(
    folder: RunFolder, coordinator: Coordinator, monkeypatch: pytest.MonkeyPatch
) -> None:
    pause(folder.path)
    assert coordinator.paused
    endpoint, token = folder.fleet_endpoint()
    with pytest.raises(BusError, match="or it wants the run's token"):
        resume(connect=endpoint, run="run-test")
    monkeypatch.setenv("READYGO_TOKEN", token)
    resume(connect=endpoint, run="run-test")
    assert (coordinator.paused, coordinator.cancelled) == (False, False)
    cancel(folder.path)
    assert coordinator.cancelled


def test_status_says_how_far_the_run_is(
    folder: RunFolder, coordinator: Coordinator, capsys: pytest.CaptureFixture[str]
) -> None:
    coordinator.ledger.commit(0, "rec0", "shard", 40)
    cancel(folder.path)
    status(folder.path)
    assert capsys.readouterr().out == (
        "1 of 3 episodes, 40 samples\n  waiting: 2 human-plan\n"
        "  ended: The run was cancelled; run the same command again to go on.\n"
    )
    status(folder.path, json=True)
    reply = json.loads(capsys.readouterr().out)
    assert (reply["committed"], reply["waiting"], reply["finished"]) == (1, {"human-plan": 2}, False)


def test_status_counts_the_policies_of_a_run_that_learns(
    folder: RunFolder, coordinator: Coordinator, capsys: pytest.CaptureFixture[str]
) -> None:
    coordinator.ledger.offer(PolicyRef(path="", files=(), mix=0.5), 1)
    status(folder.path)
    assert "policies offered: 1" in capsys.readouterr().out


def test_folder_that_no_fleet_works_on_is_said_in_one_line(folder: RunFolder) -> None:
    with pytest.raises(RunError, match=f"No fleet is at work on {folder.path}"):
        pause(folder.path)


def test_run_that_is_not_named_is_said_in_one_line() -> None:
    with pytest.raises(RunError, match="Name the run: its data folder, or --connect ENDPOINT --run RUN"):
        status(connect="tcp/127.0.0.1:7447")
