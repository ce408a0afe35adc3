import threading
import time
from pathlib import Path
from typing import Any

import pytest

from readygo.apps.fleet.reconstruction import ask_worker
from readygo.apps.fleet.worker import WorkerOptions, worker
from readygo.common.bus.zenoh_bus import free_endpoint
from readygo.common.errors import BusError
from readygo.services.reconstructor import service
from readygo.services.reconstructor.config import ReconstructorConfig
from readygo.services.reconstructor.reconstruct import STAGES, Job
from readygo.services.reconstructor.stages import Say, StageProgress


class Heard:
    def __init__(self) -> None:
        self.stages: list[str] = []

    def say(self, progress: StageProgress) -> None:
        self.stages.append(progress.stage)


def test_worker_that_joins_does_the_job(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def do(job: Job, config: ReconstructorConfig, say: Say) -> dict[str, Any]:
        # The stream is lossy: who has only just joined may not be heard yet.
        for _ in range(100):
            say(StageProgress(stage=STAGES[0]))
            if heard.stages:
                break
            time.sleep(0.05)
        return {"scene": str(job.out)}

    monkeypatch.setattr(service, "reconstruct_scene", do)
    monkeypatch.setattr("readygo.apps.fleet.process.signal.signal", lambda *_: None)
    endpoint, heard = free_endpoint(), Heard()
    job = Job(source=tmp_path / "v.mp4", out=tmp_path / "lobby", work=tmp_path / "work")
    replies: list[dict[str, Any]] = []
    asker = threading.Thread(target=lambda: replies.append(ask_worker(job, ReconstructorConfig(), endpoint, heard.say)))
    asker.start()
    _join(endpoint)
    asker.join(timeout=20.0)
    assert replies == [{"scene": str(tmp_path / "lobby")}]
    assert set(heard.stages) == {STAGES[0]}


def _join(endpoint: str) -> None:
    """As `readygo worker` is started again while no router answers."""
    for _ in range(100):
        try:
            return worker(WorkerOptions(role="reconstructor", connect=endpoint, run="reconstruct-lobby"))
        except BusError:
            time.sleep(0.1)
