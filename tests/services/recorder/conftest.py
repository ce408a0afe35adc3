from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from readygo.services.recorder import Recorder, RecorderConfig
from tests.common.dataset.episodes import PROVENANCE
from tests.services.recorder.coordinator import FakeCoordinator

MakeRecorder = Callable[..., Recorder]


@pytest.fixture
def coordinator() -> FakeCoordinator:
    return FakeCoordinator()


@pytest.fixture
def make_recorder(tmp_path: Path, coordinator: FakeCoordinator) -> Iterator[MakeRecorder]:
    def make(name: str = "r0", **settings: object) -> Recorder:
        config = RecorderConfig(**{"fsync": False, "episodes_per_shard": 3, **settings})
        return Recorder(tmp_path, name, coordinator.bus, PROVENANCE, config)

    return make
