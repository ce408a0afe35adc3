import json

import pytest

from readygo.apps.commands import status as module
from readygo.apps.commands.control import cancel
from readygo.apps.commands.status import status
from readygo.apps.run.folder import RunFolder
from readygo.services.coordinator import Coordinator
from tests.apps.commands.run_at_work import coordinator, folder

__all__ = ["coordinator", "folder"]


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LISTEN_S", 0.1)
    monkeypatch.setattr(module, "REFRESH_S", 0.1)


def test_status_says_how_far_the_run_is(
    folder: RunFolder, coordinator: Coordinator, capsys: pytest.CaptureFixture[str]
) -> None:
    coordinator.ledger.commit(0, "rec0", "shard", 40)
    status(folder.path)
    said = capsys.readouterr().out
    assert "1 of 3 episodes, 40 samples" in said
    assert [line.split() for line in said.splitlines() if line.startswith("human-plan")] == [
        ["human-plan", "2", "0", "0.0", "0.0"]
    ]


def test_status_as_json(folder: RunFolder, coordinator: Coordinator, capsys: pytest.CaptureFixture[str]) -> None:
    status(folder.path, json=True)
    reply = json.loads(capsys.readouterr().out)
    assert (reply["committed"], reply["waiting"], reply["finished"]) == (0, {"human-plan": 3}, False)
    assert reply["fleet"]["stages"][0] == "human-plan"


def test_table_that_is_watched_ends_with_the_run(
    folder: RunFolder, coordinator: Coordinator, capsys: pytest.CaptureFixture[str]
) -> None:
    cancel(folder.path)
    status(folder.path, watch=True)
    assert "ended: The run was cancelled" in capsys.readouterr().out
