"""A run whose coordinator answers in this process."""

from pathlib import Path

from readygo.apps.fleet.worker import make_coordinator
from readygo.common.bus import InProcessBus
from readygo.common.messages import RunSpec
from readygo.runs.folder import RunFolder
from readygo.services.coordinator import attach


def served(spec: RunSpec, tmp_path: Path) -> InProcessBus:
    """The bus of a run of one episode with its data in `tmp_path`."""
    folder = RunFolder(tmp_path / "data")
    with folder.lock():
        folder.save(spec, 1)
    bus = InProcessBus()
    attach(bus, make_coordinator(folder))
    return bus
