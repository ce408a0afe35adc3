import dataclasses
import json
from contextlib import nullcontext

import pytest

from readygo.apps.commands import status as module
from readygo.apps.commands.control import ControlOptions, cancel
from readygo.apps.commands.status import StatusOptions, status
from readygo.apps.fleet import runs
from readygo.apps.fleet.options import JoinOptions
from readygo.apps.fleet.token import TOKEN_VARIABLE
from readygo.apps.observe.status import Observed, RunStatus
from readygo.common.bus.zenoh_bus import ZenohBus
from readygo.common.errors import BusError
from readygo.common.fleet.repeat import repeating
from readygo.common.messages import StatusRequest, topics
from readygo.runs.folder import RunFolder
from readygo.services.coordinator import Coordinator, Written, handle_status
from tests.apps.commands.run_at_work import coordinator, folder

__all__ = ["coordinator", "folder"]


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LISTEN_S", 0.1)
    monkeypatch.setattr(module, "REFRESH_S", 0.1)


def test_status_says_how_far_the_run_is(
    folder: RunFolder, coordinator: Coordinator, capsys: pytest.CaptureFixture[str]
) -> None:
    coordinator.ledger.adopt(0, Written(recorder="rec0", attempt=1, shard="shard", samples=40))
    status(StatusOptions(data=folder.path))
    said = capsys.readouterr().out
    assert "1 of 3 episodes, 40 samples" in said
    assert [line.split() for line in said.splitlines() if line.startswith("human-plan")] == [
        ["human-plan", "2", "0", "0.0", "0.0"]
    ]


def test_status_as_json(folder: RunFolder, coordinator: Coordinator, capsys: pytest.CaptureFixture[str]) -> None:
    status(StatusOptions(data=folder.path, json=True))
    reply = json.loads(capsys.readouterr().out)
    assert (reply["committed"], reply["waiting"], reply["finished"]) == (0, {"human-plan": 3}, False)
    assert reply["fleet"]["stages"][0] == "human-plan"


def test_table_that_is_watched_ends_with_the_run(
    folder: RunFolder, coordinator: Coordinator, capsys: pytest.CaptureFixture[str]
) -> None:
    cancel(ControlOptions(data=folder.path))
    status(StatusOptions(data=folder.path, watch=True))
    assert "ended: The run was cancelled" in capsys.readouterr().out


@pytest.mark.parametrize("answered", [0, 2])
def test_table_that_is_watched_ends_well_when_the_run_is_gone_before_it_is_asked_again(
    answered: int,
    folder: RunFolder,
    coordinator: Coordinator,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    left = [answered]
    now = RunStatus.now

    def now_or_never(look: RunStatus) -> Observed:
        left[0] -= 1
        if left[0] < 0:
            raise BusError("No participant answered.")
        return now(look)

    monkeypatch.setattr(RunStatus, "now", now_or_never)
    with nullcontext() if answered else pytest.raises(BusError, match="No coordinator leads run"):
        status(StatusOptions(data=folder.path, watch=True))
    assert ("Nothing answers for the run any more: it has ended" in capsys.readouterr().out) is bool(answered)


def test_runs_of_a_router_are_listed_the_most_urgent_first(
    folder: RunFolder, coordinator: Coordinator, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    endpoint, token = folder.fleet_endpoint()
    monkeypatch.setenv(TOKEN_VARIABLE, token)
    other = handle_status(coordinator, StatusRequest())
    told = [dataclasses.replace(other, run="later", paused=True), dataclasses.replace(other, run="first", priority=2)]
    bus = ZenohBus(endpoint, "any", token)
    try:
        with repeating(lambda: [bus.publish(topics.PROGRESS, each) for each in told], every_s=0.05, name="runs"):
            status(StatusOptions(fleet=JoinOptions(connect=endpoint)))
            table = [line.split() for line in capsys.readouterr().out.splitlines()[1:]]
            status(StatusOptions(json=True, fleet=JoinOptions(connect=endpoint)))
            listed = json.loads(capsys.readouterr().out)
    finally:
        bus.close()
    assert table == [
        ["first", "2", "0", "of", "3", "0", "0", "running"],
        ["later", "0", "0", "of", "3", "0", "0", "paused"],
    ]
    assert [(each["run"], each["priority"]) for each in listed] == [("first", 2), ("later", 0)]


def test_run_that_nobody_leads_is_told_with_those_that_there_are(
    folder: RunFolder, coordinator: Coordinator, monkeypatch: pytest.MonkeyPatch
) -> None:
    endpoint, token = folder.fleet_endpoint()
    monkeypatch.setenv(TOKEN_VARIABLE, token)
    monkeypatch.setattr(runs, "HEAR_S", 0.1)
    fleet = JoinOptions(connect=endpoint, run="other")
    words = rf"^No coordinator leads run other at {endpoint} \(there"
    with pytest.raises(BusError, match=words):
        status(StatusOptions(fleet=fleet))
    with pytest.raises(BusError, match=words):
        cancel(ControlOptions(fleet=fleet))
