import dataclasses
import random
from pathlib import Path

from readygo.apps.fleet.worker import make_coordinator, make_recorder
from readygo.benchmarks.fleet.hostile import send_lies
from readygo.common.bus.zenoh_bus import Router, ZenohBus, free_endpoint
from readygo.common.messages import ClaimRequest, ClaimStatus, StatusRequest, topics
from readygo.runs.world import World
from readygo.services.coordinator import attach
from readygo.services.recorder import attach as attach_recorder
from tests.apps.fleet.toy_line import DRAW, FILM, make_folder


def test_no_lie_is_believed_and_nothing_changes(tmp_path: Path) -> None:
    folder, router = make_folder(tmp_path / "data", (DRAW, FILM), wanted=3), Router(free_endpoint())
    buses = [ZenohBus(router.endpoint, "run-test") for _ in range(3)]
    coordinator = make_coordinator(folder)
    attach(buses[0], coordinator)
    recorder = make_recorder(buses[1], "rec0", folder, World(coordinator.spec))
    attach_recorder(buses[1], recorder)
    honest = ClaimRequest(worker="honest", numeric_class="the first one that is named")
    assert buses[2].request(topics.claim(DRAW.stage.name), honest).status is ClaimStatus.LEASE
    before = buses[2].request(topics.STATUS, StatusRequest())
    for seed in range(3):
        words = send_lies(buses[2], coordinator.spec, random.Random(seed))
        assert "BELIEVED" not in words
        assert "0 unanswered" in words
    after = buses[2].request(topics.STATUS, StatusRequest())
    assert dataclasses.replace(after, cpu_s={}) == before
    recorder.close()
    assert list(folder.path.glob("shard-*")) == []
    for closable in (*reversed(buses), coordinator.ledger, router):
        closable.close()
