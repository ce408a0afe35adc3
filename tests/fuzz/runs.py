"""Targets: messages, and what lies in the folders of runs."""

import json
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from readygo.apps.capture.truth import read_truth
from readygo.apps.drive.trials import read_trials
from readygo.apps.learn.curve import load_curve
from readygo.apps.learn.plan import read_state
from readygo.apps.learn.training import read_history, read_training
from readygo.apps.monitor.gate import judge, parse_head
from readygo.common.dataset import Dataset
from readygo.common.dataset.index import build_index, index_path, load_index, map_file, read_index
from readygo.common.dataset.places import own_folders
from readygo.common.dataset.provenance import provenance_from_strings, provenance_to_strings
from readygo.common.dataset.records import chunk_spans, is_intact, iter_messages
from readygo.common.dataset.validate import validate
from readygo.common.errors import MessageError
from readygo.common.messages import EpisodeKey, Outcome, decode, encode, topics
from readygo.common.messages.live import LivePlan
from readygo.common.robot import load_robot
from readygo.runs.config import load_run_config
from readygo.runs.folder import RunFolder
from readygo.runs.training import make_config
from readygo.services.coordinator.ledger import Ledger
from readygo.services.evaluator.results import SETTINGS_FILE, open_results
from readygo.services.planner.humans.scenario_file import load_scenarios
from readygo.services.reconstructor.training.checkpoint import CHECKPOINT_FILE, load_checkpoint, save_checkpoint
from tests.apps.drive.test_trials import write_trial
from tests.common.dataset.episodes import PROVENANCE, write_shard
from tests.common.messages.examples import MESSAGES, message
from tests.common.messages.run_specs import SPEC
from tests.fuzz import mutate
from tests.fuzz.files import ROOT, in_folder, of_file
from tests.fuzz.run import Seed, Target

LIVE = [each.message_type for each in vars(topics).values() if isinstance(each, topics.Live)]


def _messages(classes: list[type]) -> list[Seed]:
    return [Seed(encode(_plan() if cls is LivePlan else message(cls)), cls) for cls in classes]


def _plan() -> LivePlan:
    way = np.zeros((3, 3), np.float32)
    return LivePlan(
        episode=message(EpisodeKey),
        outcome=Outcome.SUCCESS,
        goal_xy_m=(0.0, 0.0),
        robot_xyyaw=way,
        replanned=np.zeros(3, np.bool_),
        humans_xy_m=(way[:, :2],),
    )


def _decode(data: bytes, cls: Any, folder: Path) -> None:
    decode(cls, data)


def _shards(folder: Path) -> Path:
    write_shard(folder, [0, 1], sample_count=3)
    write_shard(folder, [2], number=1, sample_count=2, outputs=("depth",))
    return folder


SHARD = "shard-r0-00000.mcap"


def _read_shards(folder: Path) -> None:
    """As `readygo validate` and a training do."""
    index_path(folder / SHARD).unlink(missing_ok=True)
    validate(folder)
    with closing(Dataset(folder)) as dataset:
        for k in range(min(len(dataset), 3)):
            dataset.decode(k)
            dataset.calibration(k)


def _read_one_shard(folder: Path) -> None:
    """The shard's own index, as a recorder or a reader makes it that finds none."""
    with map_file(folder / SHARD) as view:
        build_index(view, folder / SHARD)


def _walk(data: bytes, about: Any, folder: Path) -> None:
    view = memoryview(data)
    for chunk in chunk_spans(view):
        is_intact(view, chunk)
        for _ in iter_messages(view, chunk.body, chunk.end):
            pass


def _shard_bytes(folder: Path) -> list[Seed]:
    return [Seed(write_shard(folder / "walked", [0], sample_count=2).read_bytes())]


def _indexes(folder: Path) -> list[Path]:
    paths = []
    for outputs in ((), ("depth",)):
        shard = write_shard(folder / f"s{len(outputs)}", [0, 1], sample_count=2, outputs=outputs)
        load_index(shard)
        paths.append(folder / f"{len(outputs)}.index")
        paths[-1].write_bytes(index_path(shard).read_bytes())
    return paths


def _provenances(folder: Path) -> list[Seed]:
    return [Seed(json.dumps(provenance_to_strings(PROVENANCE)).encode())]


def _read_provenance(data: bytes, about: Any, folder: Path) -> None:
    """The strings of a shard's metadata, each of them JSON."""
    try:
        strings = json.loads(data.decode("utf-8", "replace"))
    except (ValueError, RecursionError):
        strings = {"format": data.decode("utf-8", "replace")}
    if not isinstance(strings, dict):
        strings = {"format": json.dumps(strings)}
    plain = {key: value if isinstance(value, str) else json.dumps(value) for key, value in strings.items()}
    provenance = provenance_from_strings(plain)
    assert provenance.sensor is not None


def _run(folder: Path) -> Path:
    run = RunFolder(folder)
    run.state.mkdir(parents=True)
    run.save(SPEC, 4)
    (run.state / "endpoint").write_text("tcp/127.0.0.1:7447\n0123456789abcdef\n")
    ledger = Ledger(run.ledger, SPEC.stages)
    ledger.open_episodes(4)
    ledger.close()
    (folder / "recorders.json").write_text(json.dumps({"rec1": "/mnt/a", "rec2": "/mnt/b"}))
    return folder


def _read_ledger(folder: Path) -> None:
    ledger = Ledger(RunFolder(folder).ledger, SPEC.stages)
    try:
        ledger.check()
        ledger.wanted_min()
        ledger.retired_recorders()
        ledger.policies.all()
        ledger.open_episodes(5)
    finally:
        ledger.close()


def _learned(folder: Path) -> Path:
    folder.mkdir(parents=True)
    entry = {"step": 5, "samples": 40, "train_loss": 0.5, "validation_loss": None, "success_rate": None}
    offer = {"folder": "p", "sha256": "ab"}
    progress: dict[str, Any] = {
        "state": "learning",
        "fraction": 0.5,
        "minutes": 1.0,
        "samples": 40,
        "history": [entry],
        "offers": [offer],
    }
    progress["success"] = {"static": {"rate": 0.5}}
    (folder / "progress.json").write_text(json.dumps(progress))
    (folder / "learn.json").write_text(json.dumps({"format": "readygo-learn/1", "runs": {"room": "a"}, "minutes": 1.0}))
    (folder / "curve.json").write_text(
        json.dumps({"points": [{"minutes": 1.0, "recorded": 3, "learned": 90, "policies": 1}]})
    )
    (folder / "truth.json").write_text(json.dumps({"format": "readygo capture truth 1", "frames": []}))
    return folder


def _read_learned(folder: Path) -> None:
    read_training(folder)
    read_history(folder)


def _evaluated(folder: Path) -> Path:
    folder.mkdir(parents=True)
    with open_results(folder, {"seed": 1, "methods": {"expert": "ab"}, "episode": {"a": 1.0}}):
        pass
    return folder


def _read_settings(folder: Path) -> None:
    with open_results(folder, {"seed": 1, "methods": {"expert": "ab"}, "episode": {"a": 1.0}}):
        pass


def _trained(folder: Path) -> Path:
    folder.mkdir(parents=True)
    save_checkpoint(folder, "a", {"step": 7}, {"x": np.arange(3.0)})
    return folder


def _trials(folder: Path) -> Path:
    folder.mkdir(parents=True)
    write_trial(folder / "a.mcap")
    (folder / "labels.toml").write_text('"a.mcap" = "static_collision"\n')
    return folder


def _robots(folder: Path) -> list[Path]:
    return sorted((ROOT / "examples" / "robots").glob("*.toml"))


def _configs(folder: Path) -> list[Path]:
    return [ROOT / "examples" / "run.toml"]


def _scenarios(folder: Path) -> list[Path]:
    return [ROOT / "examples" / "scenarios.toml"]


def _train_configs(folder: Path) -> list[Path]:
    (folder / "train.toml").write_text('minutes = 5.0\nseed = 3\n[network]\ngoal = "point"\n')
    return [folder / "train.toml"]


def _requests(folder: Path) -> list[Seed]:
    heads = (
        b"GET / HTTP/1.1\r\nHost: localhost:8080\r\nOrigin: http://localhost:8080\r\nConnection: close\r\n\r\n",
        b"GET /a?token=abc&x=1 HTTP/1.1\r\nHost: [::1]:8080\r\nCookie: a=b; readygo-monitor-80=abc\r\n\r\n",
    )
    return [Seed(head) for head in heads]


def _judge(data: bytes, about: Any, folder: Path) -> None:
    request = parse_head(data)
    for token in ("", "abc"):
        answer = judge(request, token, "readygo-monitor-80") if request else None
        if answer is not None:
            answer.to_bytes()


TARGETS = [
    Target(
        name="messages",
        seeds=lambda folder: _messages(MESSAGES),
        read=_decode,
        mutate=mutate.message_pack,
        refusals=(MessageError,),
    ),
    Target(
        name="live messages",
        seeds=lambda folder: _messages(LIVE),
        read=_decode,
        mutate=mutate.message_pack,
        refusals=(MessageError,),
    ),
    in_folder("shards, validated and read", _shards, SHARD, _read_shards, mutate.mcap),
    in_folder("shard, indexed", _shards, SHARD, _read_one_shard, mutate.mcap),
    Target(name="shard, walked", seeds=_shard_bytes, read=_walk, mutate=mutate.mcap),
    of_file(".index", _indexes, read_index, mutate.zipped(mutate.npy)),
    Target(name="provenance", seeds=_provenances, read=_read_provenance, mutate=mutate.json_text),
    in_folder("spec.msgpack", _run, ".readygo/spec.msgpack", lambda path: RunFolder(path).load(), mutate.message_pack),
    in_folder("wanted", _run, ".readygo/wanted", lambda path: RunFolder(path).load(), mutate.text),
    in_folder("endpoint", _run, ".readygo/endpoint", lambda path: RunFolder(path).fleet_endpoint(), mutate.text),
    in_folder("recorders.json", _run, "recorders.json", own_folders, mutate.json_text),
    in_folder("ledger", _run, ".readygo/ledger.sqlite", _read_ledger, mutate.binary),
    in_folder("progress.json", _learned, "progress.json", _read_learned, mutate.json_text),
    in_folder(
        "learn.json",
        _learned,
        "learn.json",
        lambda path: read_state(SimpleNamespace(state_file=path / "learn.json")),
        mutate.json_text,
    ),  # type: ignore[arg-type]
    in_folder("curve.json", _learned, "curve.json", lambda path: load_curve(path / "curve.json"), mutate.json_text),
    in_folder("truth.json", _learned, "truth.json", lambda path: read_truth(path / "truth.json"), mutate.json_text),
    in_folder("evaluation settings.json", _evaluated, SETTINGS_FILE, _read_settings, mutate.json_text),
    in_folder(
        "training checkpoint .npz",
        _trained,
        CHECKPOINT_FILE,
        lambda path: load_checkpoint(path, "a"),
        mutate.zipped(mutate.npy),
    ),
    in_folder("trial log", _trials, "a.mcap", read_trials, mutate.mcap),
    in_folder("trial labels.toml", _trials, "labels.toml", read_trials, mutate.text),
    of_file("robot.toml", _robots, load_robot, mutate.text),
    of_file("run config", _configs, load_run_config, mutate.text),
    of_file("training config", _train_configs, lambda path: make_config("fast", path), mutate.text),
    of_file("scenarios.toml", _scenarios, load_scenarios, mutate.text),
    Target(name="requests to the monitor", seeds=_requests, read=_judge, mutate=mutate.lines_of_http),
]
