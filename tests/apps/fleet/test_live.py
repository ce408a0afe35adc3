"""A run that learns: policies come while it goes on, and what is recorded can be made again."""

import dataclasses
import queue
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from readygo.apps.commands.generate import GenerateOptions, RecordingOptions, generate
from readygo.apps.fleet.fleet import Fleet
from readygo.apps.fleet.roles import places
from readygo.apps.fleet.worker import make_coordinator, make_recorder
from readygo.common.bus import Bus, InProcessBus
from readygo.common.bus.identity import ALL
from readygo.common.bus.zenoh_bus import Router, ZenohBus, free_endpoint
from readygo.common.dataset import Dataset, committed_episodes, validate
from readygo.common.episode import EpisodeConfig
from readygo.common.errors import PeerError
from readygo.common.fleet import Worker, claim_any
from readygo.common.messages import (
    ClaimStatus,
    CommittedEpisode,
    DriverKind,
    OfferReply,
    OfferRequest,
    PolicyFile,
    Split,
    StatusRequest,
    encode,
    topics,
)
from readygo.runs.config import RunConfig
from readygo.runs.folder import RunFolder
from readygo.runs.identity import numeric_class
from readygo.runs.policy import with_offers
from readygo.runs.scene_argument import open_scene
from readygo.runs.spec import make_spec
from readygo.runs.stages import stage_works
from readygo.runs.world import World
from readygo.services import coordinator as coordination
from readygo.services.coordinator import Ledger
from readygo.services.driver import DriverConfig
from readygo.services.recorder import attach as attach_recorder
from readygo.services.renderer import RendererConfig
from tests.common.policy.artifacts import ROBOT, write_goal_policy, write_policy

EPISODES = 9
CONFIG = RunConfig(
    robot=ROBOT,
    episode=EpisodeConfig(goal_distance_max_m=4.0, time_limit_s=4.0),
    driver=DriverConfig(disturbed=0.5),
)


@pytest.fixture(scope="module")
def scene(embedded_bundle: Path) -> str:
    return str(embedded_bundle)


def _folder(scene: str, path: Path, config: RunConfig) -> RunFolder:
    """Of a run that takes policies."""
    spec = make_spec(open_scene(scene), None, config, seed=0, split=Split.TRAIN, static=True)
    folder = RunFolder(path)
    with folder.lock():
        folder.save(with_offers(spec, config, 0.5), EPISODES)
    return folder


@pytest.fixture
def folder(scene: str, tmp_path: Path) -> RunFolder:
    return _folder(scene, tmp_path / "data", CONFIG)


def _offer(
    bus: Bus, folder: Path, note: str, write: Callable[[Path], Path] = write_policy, **changes: str
) -> OfferReply:
    """Offer a policy that differs from others by its note."""
    spec = write(folder / note) / "policy.toml"
    text = spec.read_text()
    for old, new in changes.items():
        text = text.replace(old, new)
    spec.write_text(f"{text}\n[training.{note}]\n")
    files = tuple(PolicyFile(name=path.name, data=path.read_bytes()) for path in sorted(spec.parent.iterdir()))
    return bus.request(topics.OFFER, OfferRequest(files=files), timeout_s=20.0)


@contextmanager
def _in_process(folder: RunFolder) -> Iterator[tuple[Bus, Worker]]:
    bus = InProcessBus()
    coordinator = make_coordinator(folder)
    coordination.attach(bus, coordinator)
    world = World(coordinator.spec, bus)
    recorder = make_recorder(bus, "rec0", folder, world)
    attach_recorder(bus, recorder)
    made_by = numeric_class(world.config, world.spec.policy, world.spec.teacher)
    yield bus, Worker(name="w", numeric_class=made_by, works=stage_works(world, bus))
    recorder.close()
    coordinator.ledger.close()
    bus.close()


def _work_until(bus: Bus, worker: Worker, committed: int) -> None:
    while bus.request(topics.STATUS, StatusRequest()).committed < committed:
        assert claim_any(bus, worker) is ClaimStatus.LEASE


def _policies(folder: RunFolder) -> list[str]:
    ledger = Ledger(folder.ledger, folder.load()[0].stages)
    driven_by = ledger.census.driven_by()
    ledger.close()
    return [*driven_by.values()]


def test_policies_drive_the_episodes_after_their_offer_and_the_run_can_be_made_again(
    folder: RunFolder, tmp_path: Path
) -> None:
    heard: queue.SimpleQueue[CommittedEpisode] = queue.SimpleQueue()
    with _in_process(folder) as (bus, worker):
        bus.subscribe(topics.COMMITTED, heard.put)
        _work_until(bus, worker, 3)
        first = _offer(bus, tmp_path, "first")
        _work_until(bus, worker, 6)
        second = _offer(bus, tmp_path, "second")
        _work_until(bus, worker, EPISODES)
        published = [heard.get(timeout=5.0) for _ in range(EPISODES)]
        assert bus.request(topics.STATUS, StatusRequest()).policies == 2
    entries = Dataset(folder.path).episodes
    assert _policies(folder) == [entry.policy for entry in entries]
    assert {entry.policy for entry in entries[:3]} == {""}
    assert {entry.policy for entry in entries[3:6]} == {"", first.sha256}
    assert {entry.policy for entry in entries[6:]} == {"", second.sha256}
    assert all((entry.driver is DriverKind.POLICY) is bool(entry.policy) for entry in entries)
    assert validate(folder.path).ok
    stored = [*committed_episodes(folder.path)]
    assert [encode(episode.header) for episode in stored] == [encode(episode.header) for episode in published]
    for episode, other in zip(stored, published, strict=True):
        assert [sample.image for sample in episode.samples] == [sample.image for sample in other.samples]
        assert [s.expert_commands for s in episode.samples] == [s.expert_commands for s in other.samples]
    generate(
        GenerateOptions(out=tmp_path / "again", workers=0, json=True, recording=RecordingOptions(again=folder.path))
    )
    assert Dataset(tmp_path / "again").content_hash == Dataset(folder.path).content_hash
    assert _policies(RunFolder(tmp_path / "again")) == _policies(folder)


def test_policies_that_are_shown_their_goals_drive_from_their_offers_on_and_the_run_can_be_made_again(
    scene: str, tmp_path: Path
) -> None:
    config = dataclasses.replace(CONFIG, renderer=RendererConfig(goal_image=True))
    folder = _folder(scene, tmp_path / "data", config)
    with _in_process(folder) as (bus, worker):
        _work_until(bus, worker, 2)
        first = _offer(bus, tmp_path, "first", write_goal_policy)
        _work_until(bus, worker, 5)
        second = _offer(bus, tmp_path, "second")
        _work_until(bus, worker, 7)
        third = _offer(bus, tmp_path, "third", write_goal_policy)
        _work_until(bus, worker, EPISODES)
    dataset = Dataset(folder.path)
    drove = [entry.policy for entry in dataset.episodes]
    assert [first.sha256 in drove[2:5], second.sha256 in drove[5:7], third.sha256 in drove[7:]] == [True, True, True]
    assert len(set(drove) - {""}) == 3
    assert dataset.has_goal_images
    generate(
        GenerateOptions(out=tmp_path / "again", workers=0, json=True, recording=RecordingOptions(again=folder.path))
    )
    assert Dataset(tmp_path / "again").content_hash == dataset.content_hash


def test_stopped_run_is_made_again_as_far_as_it_came(folder: RunFolder, tmp_path: Path) -> None:
    with _in_process(folder) as (bus, worker):
        _offer(bus, tmp_path, "first")
        _work_until(bus, worker, 2)
    for _ in range(2):
        generate(
            GenerateOptions(out=tmp_path / "again", workers=0, json=True, recording=RecordingOptions(again=folder.path))
        )
        assert Dataset(tmp_path / "again").content_hash == Dataset(folder.path).content_hash


def test_policy_of_another_robot_or_broken_is_refused_with_the_reason(folder: RunFolder, tmp_path: Path) -> None:
    with _in_process(folder) as (bus, _):
        with pytest.raises(PeerError, match=r"another robot: v_max_mps 0\.5 \(the run's: 1\.0"):
            _offer(bus, tmp_path, "other", **{"v_max_mps = 1.0": "v_max_mps = 0.5"})
        with pytest.raises(PeerError, match=r"the offered policy holds no policy\.toml"):
            bus.request(topics.OFFER, OfferRequest(files=(PolicyFile(name="a", data=b"b"),)))
        assert bus.request(topics.STATUS, StatusRequest()).policies == 0


def test_killed_driver_costs_nothing_and_the_data_are_those_of_the_policies(folder: RunFolder, tmp_path: Path) -> None:
    spec, _ = folder.load()
    router = Router(free_endpoint())
    fleet = Fleet(connect=router.endpoint, run=spec.run, data=folder.path, logs=folder.logs)
    bus = ZenohBus(router.endpoint, spec.run)
    try:
        for role, name in places(spec, ("rec0",), 1, together=True):
            fleet.add(role, name)
        driver = next(member for member in fleet.members if member.role == ALL)
        done = dict.fromkeys(("offered", "killed"), False)
        deadline_s = time.monotonic() + 60.0
        while not (status := bus.request(topics.STATUS, StatusRequest(), timeout_s=20.0)).finished:
            assert time.monotonic() < deadline_s
            assert status.failed == ""
            fleet.check()
            if status.committed >= 1 and not done["offered"]:
                done["offered"] = bool(_offer(bus, tmp_path, "first").version)
            if status.committed >= 3 and not done["killed"] and driver.process:
                driver.process.kill()
                done["killed"] = True
            time.sleep(0.05)
    finally:
        fleet.stop()
        bus.close()
        router.close()
    assert driver.restarts == 1
    assert len(Dataset(folder.path).episodes) == EPISODES
    generate(
        GenerateOptions(out=tmp_path / "again", workers=0, json=True, recording=RecordingOptions(again=folder.path))
    )
    assert Dataset(tmp_path / "again").content_hash == Dataset(folder.path).content_hash
