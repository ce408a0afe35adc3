import json
from pathlib import Path

import pytest

from readygo.common.errors import RunError
from readygo.common.messages import ReconstructionClaim, ReconstructionReport, VerdictStatus
from readygo.services.reconstructor.config import ReconstructorConfig
from readygo.services.reconstructor.desk import Desk, config_of
from readygo.services.reconstructor.frames.config import FramesConfig
from readygo.services.reconstructor.metric.config import MetricConfig
from readygo.services.reconstructor.poses.config import PosesConfig
from readygo.services.reconstructor.reconstruct import Job

CONFIG = ReconstructorConfig(metric=MetricConfig(marker_size_m=0.2, lengths=("a:1,2",)))


@pytest.fixture
def desk() -> Desk:
    return Desk(Job(source=Path("v.mp4"), out=Path("lobby"), work=Path("lobby.work")), CONFIG)


def claimed(desk: Desk, worker: str) -> int:
    return desk.claim(ReconstructionClaim(worker=worker)).attempt


def test_one_worker_has_the_job_until_it_is_gone(desk: Desk) -> None:
    assert claimed(desk, "a") == 1
    assert claimed(desk, "b") == 0
    desk.note_worker("b", alive=False)
    assert claimed(desk, "b") == 0
    desk.note_worker("a", alive=False)
    assert claimed(desk, "b") == 2


def test_only_the_attempt_that_counts_may_report(desk: Desk) -> None:
    claimed(desk, "a")
    desk.note_worker("a", alive=False)
    claimed(desk, "b")
    late = ReconstructionReport(worker="a", attempt=1, report="{}")
    assert desk.report(late).status is VerdictStatus.STALE
    assert desk.wait(0.0) is None
    good = ReconstructionReport(worker="b", attempt=2, report=json.dumps({"scene": "lobby"}))
    assert desk.report(good).status is VerdictStatus.OK
    assert desk.wait(0.0) == {"scene": "lobby"}
    assert desk.claim(ReconstructionClaim(worker="b")).over


def test_job_that_cannot_be_done_ends_with_the_workers_words(desk: Desk) -> None:
    claimed(desk, "a")
    desk.report(ReconstructionReport(worker="a", attempt=1, failed="Film again"))
    with pytest.raises(RunError, match="Film again"):
        desk.wait(0.0)


def test_settings_and_paths_arrive_whole(desk: Desk) -> None:
    job = desk.claim(ReconstructionClaim(worker="a"))
    assert config_of(job) == CONFIG
    assert Path(job.source).is_absolute()


def test_paths_in_settings_are_absolute_and_numbers_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "masks").mkdir()
    (tmp_path / "phone.yml").touch()
    job = Job(source=Path("v.mp4"), out=Path("lobby"), work=Path("lobby.work"))
    for intrinsics, sent in (("phone.yml", str(tmp_path / "phone.yml")), ("9 9 4 3", "9 9 4 3")):
        frames, poses = FramesConfig(masks="masks"), PosesConfig(intrinsics=intrinsics)
        desk = Desk(job, ReconstructorConfig(frames=frames, poses=poses))
        config = config_of(desk.claim(ReconstructionClaim(worker="a")))
        assert (config.frames.masks, config.poses.intrinsics) == (str(tmp_path / "masks"), sent)
