from readygo.common.bus import InProcessBus
from readygo.common.messages import (
    topics,
)
from readygo.services.recorder import Recorder, RecorderConfig, attach
from tests.common.dataset.episodes import PROVENANCE, append_requests


def test_service_answers_on_its_topic(make_recorder, coordinator) -> None:
    recorder = make_recorder()
    attach(coordinator.bus, recorder)
    replies = [coordinator.bus.request(topics.append("r0"), r).status.value for r in append_requests(0)]
    assert replies == ["ok", "committed"]


def test_service_starts_without_a_coordinator(tmp_path) -> None:
    bus = InProcessBus()
    recorder = Recorder(tmp_path, "r0", bus, PROVENANCE, RecorderConfig(fsync=False))
    attach(bus, recorder)
    assert bus.request(topics.append("r0"), append_requests(0)[0]).status.value == "retry"
    recorder.close()
