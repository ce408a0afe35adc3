from pathlib import Path

import pytest

from readygo.common.messages import VerdictStatus
from readygo.common.messages.stages import ANIMATE, HUMAN_PLAN, RENDER, ROBOT_PLAN
from readygo.services.coordinator import Ledger, Written
from readygo.services.coordinator.protocol import Holder


@pytest.fixture
def ledger(tmp_path: Path) -> Ledger:
    """Five episodes: 0 is durable, 1 is leased to be recorded, 2 is rejected, 3 was begun, 4 waits."""
    ledger = Ledger(tmp_path / "ledger.sqlite")
    ledger.open_episodes(5)
    for index in range(2):
        for stage in (HUMAN_PLAN, ANIMATE, ROBOT_PLAN):
            lease = ledger.claim(stage, Holder(worker="w"), 10.0)
            assert lease is not None
            ledger.advance(stage, index, lease.attempt, f"{stage.name} {index}", reason="slow" if index else "")
    ledger.claim(RENDER, Holder(worker="camera"), 10.0, "rec0")
    ledger.grant(0, 4, "rec0")
    ledger.commit(0, Written(recorder="rec0", attempt=4, shard="shard", samples=10, policy="policy"))
    ledger.claim(RENDER, Holder(worker="camera"), 10.0, "rec1")
    ledger.claim(HUMAN_PLAN, Holder(worker="w"), 10.0)
    ledger.reject(HUMAN_PLAN, 2, 1, "no path")
    ledger.claim(HUMAN_PLAN, Holder(worker="w"), 10.0)
    ledger.advance(HUMAN_PLAN, 3, 1, "human-plan 3")
    return ledger


def test_episodes_are_counted_by_where_they_are(ledger: Ledger) -> None:
    census = ledger.census
    assert census.waiting() == {"animate": 1, "human-plan": 1}
    assert (census.waiting_at(ANIMATE), census.waiting_at(RENDER), census.begun_count()) == (1, 0, 2)
    assert (census.leased_by_stage(), census.loads(), census.leases()) == (
        {"render": 1},
        {"rec1": 1},
        [("", "camera", "render", 1, 4)],
    )
    assert (census.committed_counts(), census.shards(), census.driven_by()) == (
        (1, 10),
        {"shard": {0: 10}},
        {0: "policy"},
    )


def test_reasons_are_told_of_what_is_left_out_and_of_what_is_kept(ledger: Ledger) -> None:
    assert ledger.census.rejection_reasons() == {2: "no path"}
    assert ledger.census.continued_by_reason() == {"slow": 1}
    assert ledger.census.aside() == 0
    ledger.set_aside(4, "stage render failed")
    assert (ledger.census.aside(), ledger.census.set_aside()) == (1, {4: "stage render failed"})
    assert ledger.census.rejections() == {"no path": 1, "set aside: stage render failed": 1}


def test_episode_is_asked_for_by_its_index(ledger: Ledger) -> None:
    census = ledger.census
    assert [census.recorder_of(index) for index in (0, 1, 4, 9)] == ["rec0", "rec1", "", ""]
    assert [ledger.holder(1, attempt).worker for attempt in (3, 4)] == ["", "camera"]
    verdicts = [ledger.append_verdict(*episode) for episode in ((0, 4), (1, 4), (1, 3), (2, 1), (9, 1))]
    stale = VerdictStatus.STALE
    assert verdicts == [VerdictStatus.DONE, VerdictStatus.OK, stale, stale, stale]


def test_granted_episodes_are_told_by_recorder(ledger: Ledger) -> None:
    assert (ledger.census.granted_attempts("rec1"), ledger.census.granted_recorders()) == ({}, set())
    ledger.grant(1, 4, "rec1")
    assert (ledger.census.granted_attempts("rec1"), ledger.census.granted_recorders()) == ({1: 4}, {"rec1"})


def test_results_are_those_that_are_needed_yet(ledger: Ledger) -> None:
    assert ledger.census.results() == {"human-plan 1", "animate 1", "robot-plan 1", "human-plan 3"}
