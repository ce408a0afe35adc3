"""What the recorder tells those who learn from it."""

import queue
import threading
from pathlib import Path

import pytest

from readygo.common.bus.zenoh_bus import Router, ZenohBus, free_endpoint
from readygo.common.dataset import Dataset, committed_episodes
from readygo.common.messages import CommittedEpisode, topics
from readygo.services.recorder import Recorder, RecorderConfig, attach
from tests.common.dataset.episodes import PROVENANCE, append_requests
from tests.services.recorder.by_hand import send
from tests.services.recorder.coordinator import FakeCoordinator


def test_episode_is_published_once_it_is_durable(make_recorder, coordinator, tmp_path: Path) -> None:
    heard: queue.SimpleQueue[tuple[CommittedEpisode, list[CommittedEpisode]]] = queue.SimpleQueue()
    coordinator.bus.subscribe(topics.COMMITTED, lambda episode: heard.put((episode, [*committed_episodes(tmp_path)])))
    requests = append_requests(3, 20, attempt=2)
    recorder = make_recorder()
    assert send(recorder, requests) == ["ok", "ok", "committed"]
    episode, durable = heard.get(timeout=5.0)
    assert episode.header == durable[0].header == requests[0].header
    assert episode.attempt == 2
    assert episode.samples == tuple(sample for request in requests for sample in request.samples)
    send(recorder, requests)
    assert heard.empty(), "an episode that is sent again is not news"
    recorder.close()


def test_episode_that_is_not_durable_is_not_published(make_recorder, coordinator, monkeypatch) -> None:
    heard: list[CommittedEpisode] = []
    monkeypatch.setattr(coordinator.bus, "publish", lambda stream, message: heard.append(message))
    coordinator.away = {"grant"}
    recorder = make_recorder()
    assert send(recorder, append_requests(0))[-1] == "retry"
    assert heard == []
    coordinator.away = set()
    assert send(recorder, append_requests(0))[-1] == "committed"
    assert len(heard) == 1


def test_recording_goes_on_where_publishing_fails(make_recorder, coordinator, monkeypatch, tmp_path: Path) -> None:
    def broken(stream: object, message: object) -> None:
        raise OSError("the way is gone")

    monkeypatch.setattr(coordinator.bus, "publish", broken)
    recorder = make_recorder()
    assert [send(recorder, append_requests(index))[-1] for index in (0, 1)] == ["committed", "committed"]
    recorder.close()
    assert len(Dataset([tmp_path]).episodes) == 2


@pytest.fixture
def endpoint():
    router = Router(free_endpoint())
    yield router.endpoint
    router.close()


def test_subscriber_that_does_nothing_does_not_hold_up_the_recorder(endpoint: str, tmp_path: Path) -> None:
    buses = [ZenohBus(endpoint, "run-test") for _ in range(4)]
    coordinator, recording, sender, frozen = buses
    FakeCoordinator(coordinator)
    over, heard = threading.Event(), queue.SimpleQueue()

    def sleeps(episode: CommittedEpisode) -> None:
        heard.put(episode.header.episode.index)
        over.wait(timeout=60.0)

    frozen.subscribe(topics.COMMITTED, sleeps)
    recorder = Recorder(tmp_path, "r0", recording, PROVENANCE, RecorderConfig(fsync=False))
    attach(recording, recorder)
    try:
        for index in range(40):
            for request in append_requests(index):
                sender.request(topics.append("r0"), request)
        assert [episode.header.episode.index for episode in committed_episodes(tmp_path)] == [*range(40)]
        heard.get(timeout=5.0)
        assert heard.empty(), "it still sleeps"
    finally:
        over.set()
        recorder.close()
        for bus in reversed(buses):
            bus.close()
