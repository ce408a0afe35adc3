"""A toy run in one process, with everything shown that can be shown."""

import json
import re
import urllib.request
from dataclasses import dataclass
from pathlib import Path

import pytest

from readygo.apps.fleet.run import run_in_process
from readygo.apps.observe.observer import ProcessObserver
from readygo.apps.observe.settings import Observing
from readygo.common.bus import InProcessBus
from readygo.common.dataset import Dataset, Provenance
from readygo.common.messages import StatusReply
from readygo.runs.stages import Entry
from readygo.services.recorder import Recorder, RecorderConfig
from tests.apps.fleet.toy_line import DRAW, FILM, make_folder

pytest.importorskip("prometheus_client", reason="prometheus-client (the extra `metrics`) is not installed")
LINE: tuple[Entry, ...] = (DRAW, FILM)


@dataclass(frozen=True)
class Shown:
    """What a run has shown."""

    page: str
    """Metrics, when all episodes but the last were done."""
    content_hash: str
    targets_after: list[Path]


def run(data: Path, observing: Observing) -> Shown:
    folder = make_folder(data, LINE, wanted=3)
    pages: list[str] = []

    def look(status: StatusReply) -> None:
        for target in (folder.state / "targets").glob("*.json"):
            (entry,) = json.loads(target.read_text())
            assert entry["labels"] == {"run": "run-test", "service": "launcher", "worker": "launcher"}
            pages.append(urllib.request.urlopen(f"http://{entry['targets'][0]}/metrics").read().decode())

    assert run_in_process(folder, look, LINE, observing).finished
    after = list((folder.state / "targets").glob("*.json"))
    return Shown(pages[-1] if pages else "", Dataset([data]).content_hash, after)


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Shown:
    folder = tmp_path_factory.mktemp("observed")
    return run(folder / "data", Observing(metrics="127.0.0.1:0"))


def test_samples_are_the_same_whoever_looks(shown: Shown, tmp_path: Path) -> None:
    assert run(tmp_path / "data", Observing()).content_hash == shown.content_hash


@pytest.mark.parametrize(
    "line",
    [
        "readygo_episodes_wanted 3.0",
        'readygo_episodes_waiting{stage="film"} 0.0',
        'readygo_stage_seconds_count{outcome="done",stage="draw"} 3.0',
        'readygo_request_seconds_count{topic="coord/film/claim"}',
        'readygo_handle_seconds_count{topic="coord/rec/grant"} 3.0',
        "readygo_episode_seconds_count 3.0",
        'readygo_workers{role="painter"} 0.0',
        "readygo_run_trouble 0.0",
    ],
)
def test_page_shows(shown: Shown, line: str) -> None:
    assert re.search(rf"^{re.escape(line)}", shown.page, re.MULTILINE)


def test_disk_and_memory_are_on_the_page(shown: Shown) -> None:
    for name in ("readygo_disk_free_bytes", "readygo_memory_private_bytes", "process_cpu_seconds_total"):
        (value,) = re.findall(rf"^{name} (\S+)$", shown.page, re.MULTILINE)
        assert float(value) > 0


def test_targets_are_there_while_the_run_is(shown: Shown) -> None:
    assert shown.targets_after == []


def test_prometheus_of_another_user_gets_through_to_the_targets(tmp_path: Path) -> None:
    state = tmp_path / ".readygo"
    state.mkdir(mode=0o700)
    with ProcessObserver(Observing(metrics="127.0.0.1:0"), run="r", role="all", name="w", state=state):
        assert state.stat().st_mode & 0o777 == 0o711
        assert (state / "targets").stat().st_mode & 0o055 == 0o055
        assert (state / "targets" / "w.json").stat().st_mode & 0o044 == 0o044


def test_recorders_of_several_runs_are_told_apart_and_gone_after_their_runs(tmp_path: Path) -> None:
    with ProcessObserver(Observing(metrics="127.0.0.1:0"), run="", role="recorder", name="rec0") as observer:
        recorders = {
            run: Recorder(tmp_path / run, "rec0", InProcessBus(), Provenance(), RecorderConfig(fsync=False))
            for run in ("one", "two")
        }
        forget = {run: observer.recorder(recorder, run) for run, recorder in recorders.items()}
        for left in (["one", "two"], ["two"], []):
            page = urllib.request.urlopen(f"http://{observer.metrics_at}/metrics").read().decode()
            assert re.findall(r'^readygo_recorder_episodes{run="(\w+)"} 0.0', page, re.MULTILINE) == left
            if left:
                forget[left[0]]()
        for recorder in recorders.values():
            recorder.leave()
