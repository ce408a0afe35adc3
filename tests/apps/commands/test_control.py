import pytest

from readygo.apps.commands.control import ControlOptions, cancel, pause, resume
from readygo.apps.fleet.options import JoinOptions
from readygo.common.errors import BusError, RunError
from readygo.runs.folder import RunFolder
from readygo.services.coordinator import Coordinator
from tests.apps.commands.run_at_work import coordinator, folder

__all__ = ["coordinator", "folder"]


def test_run_is_paused_and_resumed_and_cancelled(
    folder: RunFolder, coordinator: Coordinator, monkeypatch: pytest.MonkeyPatch
) -> None:
    pause(ControlOptions(data=folder.path))
    assert coordinator.paused
    endpoint, token = folder.fleet_endpoint()
    with pytest.raises(BusError, match="or it wants the run's token"):
        resume(ControlOptions(fleet=JoinOptions(connect=endpoint, run="run-test")))
    monkeypatch.setenv("READYGO_TOKEN", token)
    resume(ControlOptions(fleet=JoinOptions(connect=endpoint, run="run-test")))
    assert (coordinator.paused, coordinator.cancelled) == (False, False)
    cancel(ControlOptions(data=folder.path))
    assert coordinator.cancelled


def test_folder_that_no_fleet_works_on_is_said_in_one_line(folder: RunFolder) -> None:
    with pytest.raises(RunError, match=f"No fleet is at work on {folder.path}"):
        pause(ControlOptions(data=folder.path))


def test_run_that_is_not_named_is_said_in_one_line() -> None:
    with pytest.raises(RunError, match="Name the run: its data folder, or --connect ENDPOINT --run RUN"):
        pause(ControlOptions(fleet=JoinOptions(connect="tcp/127.0.0.1:7447")))
