from collections.abc import Iterator
from pathlib import Path

import pytest

from readygo.common.errors import RunError
from readygo.common.messages import FileRef, PolicyRef, Stage, VerdictStatus
from readygo.common.messages.stages import ANIMATE, HUMAN_PLAN, RENDER, ROBOT_PLAN
from readygo.services.coordinator import Ledger

BEFORE_RENDER = (HUMAN_PLAN, ANIMATE, ROBOT_PLAN)


@pytest.fixture
def ledger(tmp_path: Path) -> Iterator[Ledger]:
    """Three episodes, the first of which waits to be rendered."""
    ledger = Ledger(tmp_path / "ledger.sqlite")
    ledger.open_episodes(3)
    for stage in BEFORE_RENDER:
        lease = ledger.claim(stage, "w", 10.0)
        assert lease is not None
        assert ledger.advance(stage, lease.index, lease.attempt, f"hash of {stage.name}")
    yield ledger
    ledger.close()


def _render(ledger: Ledger) -> int:
    lease = ledger.claim(RENDER, "w", 10.0)
    assert lease is not None
    assert lease.index == 0
    return lease.attempt


def test_lost_after_done_leaves_the_episode_durable(ledger: Ledger) -> None:
    attempt = _render(ledger)
    assert ledger.grant(0, attempt, "rec0") is VerdictStatus.OK
    assert ledger.commit(0, "rec0", "shard", 10) is not None
    ledger.take_back(0, "rec0")
    assert ledger.committed() == (1, 10)
    assert ledger.claim(RENDER, "w", 20.0) is None


def test_grant_is_taken_back_by_its_own_recorder_only(ledger: Ledger) -> None:
    attempt = _render(ledger)
    ledger.take_back(0, "rec0")
    assert ledger.renew(0, attempt, 30.0), "a lease is no grant"
    ledger.grant(0, attempt, "rec0")
    ledger.take_back(0, "rec1")
    assert ledger.granted("rec0") == (0,)
    ledger.take_back(0, "rec0")
    assert ledger.granted("rec0") == ()
    again = ledger.claim(RENDER, "w", 20.0)
    assert again is not None
    assert again.attempt == attempt + 1


def test_inputs_are_the_earlier_results_in_the_order_of_the_stages(ledger: Ledger) -> None:
    lease = ledger.claim(RENDER, "w", 10.0)
    assert lease is not None
    assert lease.inputs == tuple(f"hash of {stage.name}" for stage in BEFORE_RENDER)


def test_commit_hands_back_what_nobody_needs_any_more(ledger: Ledger) -> None:
    attempt = _render(ledger)
    ledger.grant(0, attempt, "rec0")
    hashes = ledger.commit(0, "rec0", "shard", 10)
    assert sorted(hashes or []) == sorted(f"hash of {stage.name}" for stage in BEFORE_RENDER)
    assert ledger.results() == set()
    assert ledger.commit(0, "rec0", "shard", 10) == []
    assert ledger.commit(0, "rec1", "other", 10) is None


def test_leases_end_by_time_and_grants_do_not(ledger: Ledger) -> None:
    attempt = _render(ledger)
    other = ledger.claim(HUMAN_PLAN, "w", 12.0)
    assert other is not None
    assert ledger.requeue_expired(9.0) == 0
    ledger.grant(0, attempt, "rec0")
    assert ledger.requeue_expired(11.0) == 0
    assert ledger.requeue_expired(13.0) == 1
    assert ledger.granted("rec0") == (0,)
    assert not ledger.renew(other.index, other.attempt, 20.0)


def test_failed_episode_begins_at_the_first_stage_and_its_failures_add_up(ledger: Ledger) -> None:
    attempt = _render(ledger)
    assert ledger.fail(RENDER, 0, attempt) == 1
    assert ledger.fail(RENDER, 0, attempt) is None
    lease = ledger.claim(HUMAN_PLAN, "w", 10.0)
    assert lease is not None
    assert lease.index == 0
    assert ledger.advance(HUMAN_PLAN, 0, lease.attempt, "h")
    lease = ledger.claim(ANIMATE, "w", 10.0)
    assert lease is not None
    assert ledger.fail(ANIMATE, 0, lease.attempt) == 2


def test_durable_episodes_of_a_lost_shard_begin_anew_and_those_of_a_damaged_one_are_asked_for(ledger: Ledger) -> None:
    for index in range(3):
        ledger.commit(index, "rec0", "lost" if index == 0 else "damaged", 10 + index)
    assert ledger.shards() == {"lost": {0: 10}, "damaged": {1: 11, 2: 12}}
    assert ledger.committed() == (3, 33)
    ledger.miss([0])
    ledger.doubt("damaged")
    assert ledger.granted("rec0") == (1, 2)
    assert ledger.commit(1, "rec0", "saved", 11) is not None
    assert ledger.take_back(2, "rec0")
    assert ledger.waiting() == {"human-plan": 2}
    assert ledger.shards() == {"saved": {1: 11}}
    assert ledger.committed() == (1, 11)


@pytest.mark.parametrize(("wanted", "waiting"), [(4, {"human-plan": 2}), (3, {"human-plan": 2}), (2, {})])
def test_ledger_made_anew_opens_what_is_unknown_unless_all_was_recorded(
    tmp_path: Path, wanted: int, waiting: dict[str, int]
) -> None:
    ledger = Ledger(tmp_path / "new.sqlite")
    for index in (1, 3):
        ledger.adopt(index, "rec0", "s", 10, "")
    ledger.fill_gaps(3, wanted)
    assert ledger.waiting() == waiting
    assert ledger.committed() == (2, 20)
    assert ledger.wanted_min() == min(wanted, 4)
    ledger.drop_episodes(wanted)
    assert ledger.committed() == (2, 20), "whatever was rejected before them, these are durable"
    ledger.close()


def test_turns_rise_whatever_the_clock_says(ledger: Ledger) -> None:
    assert [ledger.next_turn(least) for least in (70, 50, 90)] == [70, 71, 90]


def test_damaged_ledger_is_found(tmp_path: Path) -> None:
    path = tmp_path / "ledger.sqlite"
    ledger = Ledger(path)
    ledger.open_episodes(3000)
    ledger.check()
    ledger.close()
    data = bytearray(path.read_bytes())
    data[8192:20000] = bytes(20000 - 8192)
    path.write_bytes(data)
    with pytest.raises(RunError, match=r"ledger\.sqlite"):
        Ledger(path).check()


def test_counters_add_up_and_survive(tmp_path: Path) -> None:
    path = tmp_path / "ledger.sqlite"
    for amount in (1.5, 2.0):
        ledger = Ledger(path)
        ledger.add("cpu_s", amount)
        ledger.close()
    ledger = Ledger(path)
    assert ledger.counters() == {"cpu_s": 3.5}
    ledger.close()


def test_shortest_run_reaches_to_the_last_durable_episode(tmp_path: Path) -> None:
    ledger = Ledger(tmp_path / "ledger.sqlite")
    ledger.open_episodes(5)
    assert ledger.wanted_min() == 0
    ledger.commit(1, "rec0", "s", 10)
    ledger.commit(3, "rec0", "s", 10)
    assert ledger.wanted_min() == 4
    ledger.drop_episodes(2)
    assert ledger.waiting() == {"human-plan": 3}
    ledger.drop_episodes(4)
    assert ledger.waiting() == {"human-plan": 2}
    ledger.close()


def test_file_that_is_no_ledger_is_said_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "ledger.sqlite").write_bytes(b"something else " * 100)
    with pytest.raises(RunError, match=r"ledger\.sqlite cannot be used: file is not a database"):
        Ledger(tmp_path / "ledger.sqlite")


def test_full_disk_is_said_in_one_line_and_undoes_the_step(tmp_path: Path) -> None:
    ledger = Ledger(tmp_path / "ledger.sqlite")
    ledger.open_episodes(3)
    (pages,) = ledger._db.execute("PRAGMA page_count").fetchone()
    ledger._db.execute(f"PRAGMA max_page_count = {pages}")
    with pytest.raises(RunError, match="database or disk is full; if the disk is full, free some space"):
        ledger.open_episodes(10_000)
    assert ledger.waiting() == {"human-plan": 3}
    ledger.close()


def _policy(sha256: str) -> PolicyRef:
    return PolicyRef(path="", files=(FileRef(path="head", sha256=sha256, size=4),), mix=0.5)


def test_offers_are_numbered_and_say_when_they_came(ledger: Ledger) -> None:
    first, second = ledger.offer(_policy("a"), 10), ledger.offer(_policy("b"), 20)
    assert ledger.offer(_policy("a"), 30) == first
    assert ledger.policies() == (first, second)
    assert (first.version, first.files, first.wall_ns) == (1, _policy("a").files, 10)
    assert (second.version, second.sha256) == (2, _policy("b").sha256)


def test_files_of_a_policy_are_idle_when_no_episode_names_it_and_there_is_a_newer_one(tmp_path: Path) -> None:
    film = Stage(name="film", role="camera", records=True)
    ledger = Ledger(tmp_path / "ledger.sqlite", (film,))
    assigned = ledger.offer(_policy("a"), 1)
    assert ledger.idle_policy_files() == set(), "it is the newest"
    ledger.assign({0: assigned.sha256, 1: ""})
    for name in ("b", "c"):
        ledger.offer(_policy(name), 2)
    assert ledger.idle_policy_files() == {"b"}
    ledger.close()


def test_assigned_policy_goes_before_the_newest(tmp_path: Path) -> None:
    film = Stage(name="film", role="camera", records=True)
    ledger = Ledger(tmp_path / "ledger.sqlite", (film,))
    old, new = ledger.offer(_policy("a"), 1), ledger.offer(_policy("b"), 2)
    ledger.assign({0: old.sha256, 3: ""})
    ledger.assign({0: new.sha256, 3: new.sha256})
    ledger.open_episodes(3)
    leases = [ledger.claim(film, "w", 10.0) for _ in range(3)]
    assert [(lease.index, lease.policy) for lease in leases if lease] == [(0, old.sha256), (3, ""), (4, new.sha256)]
    ledger.close()


def test_what_is_done_together_is_done_whole_or_not_at_all(ledger: Ledger) -> None:
    def fail_in_the_middle() -> None:
        with ledger.together():
            ledger.add("first", 1.0)
            with ledger.together():
                ledger.note("second", "yes")
            raise KeyError

    with pytest.raises(KeyError):
        fail_in_the_middle()
    assert (ledger.counters(), ledger.note("second")) == ({}, "")
    with ledger.together():
        ledger.add("first", 1.0)
        ledger.note("second", "yes")
    assert (ledger.counters(), ledger.note("second")) == ({"first": 1.0}, "yes")
