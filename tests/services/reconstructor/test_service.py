import threading
import time
from pathlib import Path

import pytest

from readygo.common.bus import InProcessBus
from readygo.common.errors import RunError, SceneError
from readygo.common.messages import ReconstructionClaim, ReconstructionProgress, topics
from readygo.common.messages.reconstruction import RECONSTRUCTOR
from readygo.services.reconstructor import service
from readygo.services.reconstructor.config import ReconstructorConfig
from readygo.services.reconstructor.desk import Desk
from readygo.services.reconstructor.reconstruct import STAGES, Job
from readygo.services.reconstructor.stages import Say, StageProgress

JOB = Job(source=Path("v.mp4"), out=Path("lobby"), work=Path("lobby.work"))


def worked(
    monkeypatch: pytest.MonkeyPatch, do: object, stop: threading.Event, messages: int = 0
) -> tuple[Desk, list[ReconstructionProgress]]:
    monkeypatch.setattr(service, "reconstruct_scene", do)
    here = InProcessBus()
    there = InProcessBus(here)
    desk = Desk(JOB, ReconstructorConfig())
    heard: list[ReconstructionProgress] = []
    service.attach(here, desk)
    here.subscribe(topics.RECONSTRUCTION, heard.append)
    service.pull_jobs(there, "r0", stop)
    end_s = time.monotonic() + 5.0
    while len(heard) < messages and time.monotonic() < end_s:
        time.sleep(0.01)
    there.close()
    here.close()
    return desk, heard


def test_worker_does_the_job_and_shows_each_picture_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    picture = tmp_path / "1.png"
    picture.write_bytes(b"PNG")

    def do(job: Job, config: ReconstructorConfig, say: Say) -> dict[str, str]:
        say(StageProgress(stage=STAGES[0]))
        for share in (0.5, 0.6):
            say(StageProgress(stage="gaussians", share=share, words="23 dB", picture=picture))
        return {"scene": job.out.name}

    desk, heard = worked(monkeypatch, do, threading.Event(), messages=3)
    assert desk.wait(0.0) == {"scene": "lobby"}
    assert [(each.stage, each.share, each.picture) for each in heard] == [
        (STAGES[0], 0.0, b""),
        ("gaussians", 0.5, b"PNG"),
        ("gaussians", 0.6, b""),
    ]
    assert (heard[1].number, heard[1].stages) == (STAGES.index("gaussians") + 1, len(STAGES))


def test_what_the_user_must_mend_comes_back_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    def do(*_: object) -> dict[str, str]:
        raise SceneError("no video")

    desk, _ = worked(monkeypatch, do, threading.Event())
    with pytest.raises(RunError, match="no video"):
        desk.wait(0.0)


def test_worker_that_is_told_to_stop_leaves_the_job_to_others(monkeypatch: pytest.MonkeyPatch) -> None:
    stop = threading.Event()

    def do(job: Job, config: ReconstructorConfig, say: Say) -> dict[str, str]:
        stop.set()
        say(StageProgress(stage=STAGES[0]))
        return {}

    desk, _ = worked(monkeypatch, do, stop)
    assert desk.wait(0.0) is None


@pytest.mark.parametrize(("role", "attempt"), [(RECONSTRUCTOR, 2), ("renderer", 0)])
def test_job_is_free_again_when_the_reconstructor_that_has_it_leaves_and_no_other_of_its_name(
    role: str, attempt: int
) -> None:
    here = InProcessBus()
    there = InProcessBus(here)
    desk = Desk(JOB, ReconstructorConfig())
    service.attach(here, desk)
    there.announce(role, "r0")
    assert there.request(topics.RECONSTRUCTION_CLAIM, ReconstructionClaim(worker="r0")).attempt == 1
    there.close()
    # Closing waits for what is to be heard.
    here.close()
    assert desk.claim(ReconstructionClaim(worker="r1")).attempt == attempt
