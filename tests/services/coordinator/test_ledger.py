import itertools
from collections.abc import Iterator
from pathlib import Path

import pytest

from readygo.common.messages import FileRef, PolicyRef, Stage, VerdictStatus
from readygo.common.messages.stages import ANIMATE, HUMAN_PLAN, RENDER, ROBOT_PLAN
from readygo.services.coordinator import Ledger, Written
from readygo.services.coordinator.protocol import Holder

BEFORE_RENDER = (HUMAN_PLAN, ANIMATE, ROBOT_PLAN)


@pytest.fixture
def ledger(tmp_path: Path) -> Iterator[Ledger]:
    """Three episodes, the first of which waits to be rendered."""
    ledger = Ledger(tmp_path / "ledger.sqlite")
    ledger.open_episodes(3)
    for stage in BEFORE_RENDER:
        lease = ledger.claim(stage, Holder(worker="w"), 10.0)
        assert lease is not None
        assert ledger.advance(stage, lease.index, lease.attempt, f"hash of {stage.name}")
    yield ledger
    ledger.close()


def _render(ledger: Ledger) -> int:
    lease = ledger.claim(RENDER, Holder(worker="w"), 10.0, "rec0")
    assert lease is not None
    assert lease.index == 0
    return lease.attempt


def _written(
    attempt: int, recorder: str = "rec0", shard: str = "shard", samples: int = 10, policy: str = ""
) -> Written:
    return Written(recorder=recorder, attempt=attempt, shard=shard, samples=samples, policy=policy)


def test_lost_after_done_leaves_the_episode_durable(ledger: Ledger) -> None:
    attempt = _render(ledger)
    assert ledger.grant(0, attempt, "rec0") is VerdictStatus.OK
    assert ledger.commit(0, _written(attempt)) is not None
    assert not ledger.take_back(0, "rec0", attempt)
    assert ledger.census.committed_counts() == (1, 10)
    assert ledger.claim(RENDER, Holder(worker="w"), 20.0) is None


def test_grant_is_taken_back_by_its_own_recorder_only(ledger: Ledger) -> None:
    attempt = _render(ledger)
    ledger.take_back(0, "rec0", attempt)
    assert ledger.renew(0, attempt, 30.0), "a lease is no grant"
    ledger.grant(0, attempt, "rec0")
    assert not ledger.take_back(0, "rec1", attempt)
    assert not ledger.take_back(0, "rec0", attempt - 1)
    assert ledger.census.granted_attempts("rec0") == {0: attempt}
    assert ledger.take_back(0, "rec0", attempt)
    assert ledger.census.granted_attempts("rec0") == {}
    again = ledger.claim(RENDER, Holder(worker="w"), 20.0)
    assert again is not None
    assert again.attempt == attempt + 1


def test_inputs_are_the_earlier_results_in_the_order_of_the_stages(ledger: Ledger) -> None:
    lease = ledger.claim(RENDER, Holder(worker="w"), 10.0)
    assert lease is not None
    assert lease.inputs == tuple(f"hash of {stage.name}" for stage in BEFORE_RENDER)


def test_commit_hands_back_what_nobody_needs_any_more(ledger: Ledger) -> None:
    attempt = _render(ledger)
    ledger.grant(0, attempt, "rec0")
    hashes = ledger.commit(0, _written(attempt))
    assert sorted(hashes or []) == sorted(f"hash of {stage.name}" for stage in BEFORE_RENDER)
    assert ledger.census.results() == set()
    assert ledger.commit(0, _written(attempt)) == []
    assert ledger.commit(0, _written(attempt, "rec1", "other")) is None


@pytest.mark.parametrize("order", [*itertools.permutations(range(3))])
def test_commit_hands_back_no_result_that_an_earlier_or_a_later_episode_needs(
    ledger: Ledger, order: tuple[int, ...]
) -> None:
    names = {0: [f"hash of {stage.name}" for stage in BEFORE_RENDER]}
    names |= {1: ["of two", names[0][1], "own"], 2: [names[0][0], names[0][1], "of two"]}
    for index in (1, 2):
        for stage, name in zip(BEFORE_RENDER, names[index], strict=True):
            lease = ledger.claim(stage, Holder(worker="w"), 10.0, "rec0")
            assert lease is not None
            assert ledger.advance(stage, index, lease.attempt, name)
    for done, index in enumerate(order, 1):
        needed = set().union(*(names[other] for other in order[done:]))
        ledger.entrust(index, "rec0")
        assert set(ledger.commit(index, _written(3)) or []) == set(names[index]) - needed
        assert ledger.census.results() == needed


def test_leases_end_by_time_and_grants_do_not(ledger: Ledger) -> None:
    attempt = _render(ledger)
    other = ledger.claim(HUMAN_PLAN, Holder(worker="w"), 12.0)
    assert other is not None
    assert ledger.requeue_expired(9.0) == 0
    ledger.grant(0, attempt, "rec0")
    assert ledger.requeue_expired(11.0) == 0
    assert ledger.requeue_expired(13.0) == 1
    assert ledger.census.granted_attempts("rec0") == {0: attempt}
    assert not ledger.renew(other.index, other.attempt, 20.0)


def test_failed_episode_begins_at_the_first_stage_and_its_failures_add_up(ledger: Ledger) -> None:
    attempt = _render(ledger)
    assert ledger.fail(RENDER, 0, attempt) == 1
    assert ledger.fail(RENDER, 0, attempt) is None
    lease = ledger.claim(HUMAN_PLAN, Holder(worker="w"), 10.0)
    assert lease is not None
    assert lease.index == 0
    assert ledger.advance(HUMAN_PLAN, 0, lease.attempt, "h")
    lease = ledger.claim(ANIMATE, Holder(worker="w"), 10.0)
    assert lease is not None
    assert ledger.fail(ANIMATE, 0, lease.attempt) == 2


def test_durable_episodes_of_a_lost_shard_begin_anew_and_those_of_a_damaged_one_are_asked_for(ledger: Ledger) -> None:
    for index in range(3):
        ledger.adopt(index, _written(1, shard="lost" if index == 0 else "damaged", samples=10 + index))
    assert ledger.census.shards() == {"lost": {0: 10}, "damaged": {1: 11, 2: 12}}
    assert ledger.census.committed_counts() == (3, 33)
    ledger.miss([0])
    ledger.doubt("damaged")
    assert ledger.census.granted_attempts("rec0") == {1: 0, 2: 0}
    assert ledger.commit(1, _written(0, shard="saved", samples=11)) is not None
    assert ledger.take_back(2, "rec0", 0)
    assert ledger.census.waiting() == {"human-plan": 2}
    assert ledger.census.shards() == {"saved": {1: 11}}
    assert ledger.census.committed_counts() == (1, 11)


@pytest.mark.parametrize(("wanted", "waiting"), [(4, {"human-plan": 2}), (3, {"human-plan": 2}), (2, {})])
def test_ledger_made_anew_opens_what_is_unknown_unless_all_was_recorded(
    tmp_path: Path, wanted: int, waiting: dict[str, int]
) -> None:
    ledger = Ledger(tmp_path / "new.sqlite")
    for index in (1, 3):
        ledger.adopt(index, _written(1))
    ledger.fill_gaps(3, wanted)
    assert ledger.census.waiting() == waiting
    assert ledger.census.committed_counts() == (2, 20)
    assert ledger.wanted_min() == min(wanted, 4)
    ledger.drop_episodes(wanted)
    assert ledger.census.committed_counts() == (2, 20), "whatever was rejected before them, these are durable"
    ledger.close()


def test_shortest_run_reaches_to_the_last_durable_episode(tmp_path: Path) -> None:
    ledger = Ledger(tmp_path / "ledger.sqlite")
    ledger.open_episodes(5)
    assert ledger.wanted_min() == 0
    ledger.adopt(1, _written(1))
    ledger.adopt(3, _written(1))
    assert ledger.wanted_min() == 4
    ledger.drop_episodes(2)
    assert ledger.census.waiting() == {"human-plan": 3}
    ledger.drop_episodes(4)
    assert ledger.census.waiting() == {"human-plan": 2}
    ledger.close()


def _policy(sha256: str) -> PolicyRef:
    return PolicyRef(path="", files=(FileRef(path="graph", sha256=sha256 * 64, size=4),), mix=0.5)


def test_assigned_policy_goes_before_the_newest(tmp_path: Path) -> None:
    film = Stage(name="film", role="camera", records=True)
    ledger = Ledger(tmp_path / "ledger.sqlite", (film,))
    old, new = ledger.policies.offer(_policy("a"), 1), ledger.policies.offer(_policy("b"), 2)
    ledger.assign({0: old.sha256, 3: ""})
    ledger.assign({0: new.sha256, 3: new.sha256})
    ledger.open_episodes(3)
    leases = [ledger.claim(film, Holder(worker="w"), 10.0) for _ in range(3)]
    assert [(lease.index, lease.policy) for lease in leases if lease] == [(0, old.sha256), (3, ""), (4, new.sha256)]
    ledger.close()
