"""A run whose coordinator is at work, reached over Zenoh."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from readygo.apps.fleet.worker import make_coordinator
from readygo.common.bus.zenoh_bus import Router, ZenohBus, free_endpoint
from readygo.runs.folder import RunFolder
from readygo.services.coordinator import Coordinator, attach
from tests.common.messages.run_specs import SPEC


@pytest.fixture
def folder(tmp_path: Path) -> RunFolder:
    folder = RunFolder(tmp_path / "data")
    with folder.lock():
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
