import dataclasses
from collections.abc import Callable
from pathlib import Path

import pytest

from readygo.common.errors import DiskError, PeerError, RunError
from readygo.common.fleet import fetch_blob
from readygo.common.messages import (
    ClaimStatus,
    Command,
    ControlRequest,
    DoneRequest,
    ExpectRequest,
    FileRef,
    GrantRequest,
    LostRequest,
    PendingRequest,
    PolicyRef,
    RenewRequest,
    Split,
    Stage,
    TroubleRequest,
    VerdictStatus,
    topics,
)
from readygo.common.messages.stages import ANIMATE, DRIVE, DRIVE_LINE, HUMAN_PLAN, RENDER, ROBOT_PLAN, OnRejection
from readygo.services.coordinator import requeue_lost
from tests.services.coordinator.line import Line


def test_episode_passes_the_stages_in_order_with_the_earlier_results(line: Line) -> None:
    assert line.claim(ANIMATE).status is ClaimStatus.WAIT
    line.plan()
    claim = line.claim(RENDER)
    assert [blob.data for blob in claim.inputs] == [b"human-plan", b"animate", b"robot-plan"]
    assert claim.recorder == "rec0"
    assert claim.episode is not None
    assert (claim.episode.seed, claim.episode.split, claim.episode.index) == (5, Split.TRAIN, 0)


def test_run_is_finished_when_all_wanted_episodes_are_durable(line: Line) -> None:
    for _ in range(3):
        line.plan()
        claim = line.claim(RENDER)
        assert line.grant(claim) is VerdictStatus.OK
        assert line.done(claim) is VerdictStatus.OK
    status = line.status()
    assert (status.finished, status.committed, status.samples) == (True, 3, 30)
    assert line.claim(HUMAN_PLAN).status is ClaimStatus.DONE
    assert list((line.coordinator.blobs._folder).iterdir()) == []


def test_rejected_index_is_replaced_by_the_next_one(line: Line) -> None:
    line.plan(rejected="timeout")
    opened = []
    while (claim := line.claim(HUMAN_PLAN)).status is ClaimStatus.LEASE:
        assert claim.episode is not None
        opened.append(claim.episode.index)
    assert opened == [1, 2, 3]
    assert line.status().rejected == {"timeout": 1}


def test_expired_lease_is_given_to_another_and_late_work_is_stale(line: Line) -> None:
    late = line.claim(HUMAN_PLAN, "slow")
    line.now_s = 100.0
    requeue_lost(line.coordinator)
    fresh = line.claim(HUMAN_PLAN, "fast")
    assert fresh.episode == late.episode
    assert line.complete(HUMAN_PLAN, late, worker="slow", result=b"late") is VerdictStatus.STALE
    assert line.complete(HUMAN_PLAN, fresh, worker="fast", result=b"fresh") is VerdictStatus.OK
    assert line.claim(ANIMATE).inputs[0].data == b"fresh"
    assert line.status().requeued == 1


def test_renewed_lease_does_not_expire(line: Line) -> None:
    claim = line.claim(HUMAN_PLAN)
    line.now_s = 14.0
    renew = RenewRequest(worker="w", index=0, attempt=claim.attempt, lease=claim.lease)
    assert line.bus.request(topics.renew("human-plan"), renew).status is VerdictStatus.OK
    line.now_s = 20.0
    requeue_lost(line.coordinator)
    assert line.complete(HUMAN_PLAN, claim, result=b"x") is VerdictStatus.OK


def test_dead_workers_leases_are_free_at_once(line: Line) -> None:
    line.claim(HUMAN_PLAN, "dead")
    alive = line.claim(HUMAN_PLAN, "alive")
    requeue_lost(line.coordinator, worker="dead")
    again = line.claim(HUMAN_PLAN, "alive")
    assert again.episode is not None
    assert (again.episode.index, again.attempt) == (0, 2)
    assert line.complete(HUMAN_PLAN, alive, worker="alive", result=b"x") is VerdictStatus.OK


def test_grant_is_refused_to_an_attempt_that_lost_its_lease(line: Line) -> None:
    line.plan()
    late = line.claim(RENDER)
    line.now_s = 100.0
    requeue_lost(line.coordinator)
    fresh = line.claim(RENDER)
    assert line.grant(late) is VerdictStatus.STALE
    assert line.grant(fresh) is VerdictStatus.OK
    assert line.grant(fresh) is VerdictStatus.OK
    line.done(fresh)
    assert line.grant(late) is VerdictStatus.DONE


def test_granted_episode_does_not_expire_and_is_listed_as_pending(line: Line) -> None:
    line.plan()
    claim = line.claim(RENDER)
    line.grant(claim)
    line.now_s = 1000.0
    requeue_lost(line.coordinator)
    assert line.claim(RENDER).status is ClaimStatus.WAIT
    assert line.bus.request(topics.PENDING, PendingRequest(recorder="rec0")).indices == (0,)
    line.bus.request(topics.LOST, LostRequest(recorder="rec0", index=0, reason=""))
    assert line.claim(RENDER).status is ClaimStatus.LEASE


def test_restart_keeps_progress_and_frees_leases(tmp_path: Path) -> None:
    first = Line(tmp_path)
    first.plan()
    claim = first.claim(RENDER)
    first.grant(claim)
    first.done(claim)
    late = first.claim(HUMAN_PLAN)
    first.coordinator.ledger.close()
    second = Line(tmp_path, wanted=4)
    assert second.status().committed == 1
    indices = []
    while (claim := second.claim(HUMAN_PLAN)).status is ClaimStatus.LEASE:
        assert claim.episode is not None
        indices.append(claim.episode.index)
    assert indices == [1, 2, 3]
    assert second.complete(HUMAN_PLAN, late, result=b"late") is VerdictStatus.STALE


def _fail(line: Line, stage: Stage, times: int, words: str = "ValueError: no floor") -> None:
    for _ in range(times):
        line.complete(stage, line.claim(stage), failed=words)


def test_failed_episode_begins_anew_and_is_set_aside_with_its_results_in_the_end(line: Line) -> None:
    for _ in range(3):
        line.plan()
        claim = line.claim(RENDER)
        assert claim.episode is not None
        assert claim.episode.index == 0
        line.complete(RENDER, claim, failed="MessageError: is no scenario")
    assert line.aside == [
        (0, "stage render failed: MessageError: is no scenario", ["animate", "human-plan", "robot-plan"])
    ]
    status = line.status()
    assert status.rejected == {"set aside: stage render failed: MessageError: is no scenario": 1}
    assert (status.failed, status.wanted) == ("", 3)
    for _ in range(3):
        line.plan()
        line.record(line.claim(RENDER))
    assert line.status().finished


def test_run_in_which_most_episodes_fail_ends_with_the_workers_words(line: Line) -> None:
    _fail(line, HUMAN_PLAN, 8)
    assert line.status().failed == ""
    _fail(line, HUMAN_PLAN, 1)
    assert line.status().failed == (
        "3 episodes were set aside, the last one is 2: stage human-plan failed: ValueError: no floor"
    )
    assert line.claim(HUMAN_PLAN).status is ClaimStatus.DONE


def test_episode_that_kills_its_workers_is_set_aside(tmp_path: Path) -> None:
    line = Line(tmp_path, deaths_max=2)
    for _ in range(2):
        line.claim(HUMAN_PLAN, "doomed")
        requeue_lost(line.coordinator, worker="doomed")
    assert line.status().rejected == {"set aside: 2 workers ended while they held it": 1}


@pytest.mark.parametrize("damage", [lambda path: path.unlink(), lambda path: path.write_bytes(b"garbage")])
def test_result_that_is_lost_or_damaged_is_made_again(line: Line, damage: Callable[[Path], object]) -> None:
    line.pass_on(HUMAN_PLAN)
    (blob,) = line.coordinator.blobs._folder.iterdir()
    damage(blob)
    assert line.claim(ANIMATE).status is ClaimStatus.WAIT
    line.pass_on(HUMAN_PLAN)
    assert line.claim(ANIMATE).inputs[0].data == b"human-plan"


def test_only_its_holder_can_speak_for_a_lease(line: Line) -> None:
    claim = line.claim(HUMAN_PLAN, "holder")
    renew = RenewRequest(worker="thief", index=0, attempt=claim.attempt)
    verdict = line.bus.request(topics.renew("human-plan"), renew)
    assert (verdict.status, verdict.reason) == (VerdictStatus.STALE, "attempt 1 of episode 0 is held by another worker")
    for forged in ({"rejected": "forged"}, {"failed": "forged"}, {"result": b"forged"}):
        assert line.complete(HUMAN_PLAN, claim, worker="thief", **forged) is VerdictStatus.STALE
        # Names are no secret, what proves a lease is.
        assert line.complete(HUMAN_PLAN, claim, worker="holder", lease="", **forged) is VerdictStatus.STALE
    assert line.complete(HUMAN_PLAN, claim, worker="holder", result=b"true") is VerdictStatus.OK
    assert line.status().rejected == {}


def test_episode_that_is_not_where_its_recorder_says_is_not_durable(line: Line) -> None:
    line.plan()
    claim = line.claim(RENDER)
    line.grant(claim)
    line.missing = {0}
    with pytest.raises(PeerError, match="Episode 0 is not in s of recorder rec0"):
        line.done(claim)
    assert line.status().committed == 0
    line.missing = set()
    assert line.done(claim) is VerdictStatus.OK


def test_samples_are_expected_of_leased_attempts_of_the_run_by_the_episodes_recorder(line: Line) -> None:
    line.plan()
    claim = line.claim(RENDER)
    key = claim.episode
    assert key is not None

    def expect(
        attempt: int = 4, recorder: str = "rec0", lease: str = claim.lease, **changes: object
    ) -> tuple[VerdictStatus, str]:
        episode = dataclasses.replace(key, **changes)
        request = ExpectRequest(recorder=recorder, episode=episode, attempt=attempt, lease=lease)
        verdict = line.bus.request(topics.EXPECT, request)
        return verdict.status, verdict.reason

    assert expect() == (VerdictStatus.OK, "")
    assert expect(10**9) == (VerdictStatus.STALE, "attempt 1000000000 of train-5-000000 is not leased to be recorded")
    assert expect(seed=999) == (VerdictStatus.STALE, "the run has train episodes of seed 5, not train-999-000000")
    assert expect(recorder="mine") == (VerdictStatus.STALE, "the run has no recorder 'mine'")
    assert expect(index=1)[0] is VerdictStatus.STALE
    assert expect(lease="guessed") == (VerdictStatus.STALE, "attempt 4 of episode 0 is held by another worker")
    line.bus.request(topics.GRANT, GrantRequest(recorder="rec0", index=0, attempt=4))
    assert expect() == (VerdictStatus.OK, "")
    grant = GrantRequest(recorder="mine", index=0, attempt=4)
    assert line.bus.request(topics.GRANT, grant).reason == "the run has no recorder 'mine'"


def test_worker_that_does_not_say_its_numeric_class_or_is_not_of_the_runs_is_refused(tmp_path: Path) -> None:
    line = Line(tmp_path, metadata={"numeric_class": "the run's"})
    assert line.claim(HUMAN_PLAN, numeric_class="").status is ClaimStatus.REFUSED
    assert line.claim(HUMAN_PLAN, numeric_class="forged").status is ClaimStatus.REFUSED
    assert line.claim(HUMAN_PLAN, numeric_class="the run's").status is ClaimStatus.LEASE


def test_recorders_trouble_is_told_until_it_is_over(line: Line) -> None:
    for reason in ("No space left.", ""):
        request = TroubleRequest(recorder="rec0", reason=reason)
        assert line.bus.request(topics.TROUBLE, request).status is VerdictStatus.OK
        assert line.status().trouble == reason
    assert line.bus.request(topics.TROUBLE, TroubleRequest(recorder="x", reason="y")).status is VerdictStatus.STALE
    assert line.status().trouble == ""


def test_full_disk_of_the_ledger_is_waited_for(line: Line, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*arguments: object) -> None:
        raise DiskError("The run's ledger cannot be used: disk full.")

    ledger = line.coordinator.ledger
    monkeypatch.setattr(ledger, "claim", full)
    monkeypatch.setattr(ledger.notes, "add", full)
    assert line.claim(HUMAN_PLAN).status is ClaimStatus.WAIT
    requeue_lost(line.coordinator)
    assert "disk full" in line.status().trouble
    monkeypatch.undo()
    requeue_lost(line.coordinator)
    assert line.status().trouble == ""
    assert line.claim(HUMAN_PLAN).status is ClaimStatus.LEASE


def test_scene_in_which_every_index_is_rejected_ends_the_run(tmp_path: Path) -> None:
    line = Line(tmp_path, wanted=2, rejections_max=5)
    while (claim := line.claim(HUMAN_PLAN)).status is ClaimStatus.LEASE:
        line.complete(HUMAN_PLAN, claim, rejected="no path")
    assert line.status().failed == "5 indices were rejected and 0 accepted: no path (5)."


def test_many_rejections_do_not_end_a_run_that_accepts_one_in_twenty(tmp_path: Path) -> None:
    line = Line(tmp_path, wanted=40, rejections_max=5)
    line.plan()
    for _ in range(20):
        line.complete(HUMAN_PLAN, line.claim(HUMAN_PLAN), rejected="no path")
    assert line.status().failed == ""
    line.complete(HUMAN_PLAN, line.claim(HUMAN_PLAN), rejected="no path")
    assert line.status().failed == "21 indices were rejected and 1 accepted: no path (21)."


def test_recorder_that_cannot_write_ends_the_run_with_its_words(line: Line) -> None:
    line.plan()
    line.grant(line.claim(RENDER))
    lost = LostRequest(recorder="rec0", index=0, reason="No space left.")
    assert line.bus.request(topics.LOST, lost).status is VerdictStatus.OK
    assert line.status().failed == "No space left."
    assert line.claim(RENDER).status is ClaimStatus.DONE


def test_episodes_are_dealt_out_to_the_recorders_in_turn(tmp_path: Path) -> None:
    line = Line(tmp_path, recorders=("rec0", "rec1"))
    for _ in range(3):
        line.plan()
    assert [line.claim(RENDER).recorder for _ in range(3)] == ["rec0", "rec1", "rec0"]


def test_results_that_nobody_needs_are_gone_after_a_restart(tmp_path: Path) -> None:
    first = Line(tmp_path)
    first.plan()
    needed = set(first.coordinator.ledger.census.results())
    left_over = first.coordinator.blobs.put(b"of a crash")
    first.coordinator.ledger.close()
    second = Line(tmp_path)
    assert second.coordinator.blobs.get(left_over) is None
    assert all(second.coordinator.blobs.get(sha256) for sha256 in needed)


def test_planning_waits_while_enough_is_planned(tmp_path: Path) -> None:
    line = Line(tmp_path, wanted=5, plan_ahead=2)
    line.plan()
    line.plan()
    assert line.claim(HUMAN_PLAN).status is ClaimStatus.WAIT
    claim = line.claim(RENDER)
    line.grant(claim)
    line.done(claim)
    assert line.claim(HUMAN_PLAN).status is ClaimStatus.LEASE


def test_more_is_planned_for_more_workers(tmp_path: Path) -> None:
    line = Line(tmp_path, wanted=5, plan_ahead=1)
    for name in ("a", "b"):
        line.coordinator.roster.note_presence("all", name, alive=True)
    for _ in range(4):
        line.plan()
    assert line.claim(HUMAN_PLAN).status is ClaimStatus.WAIT


def test_worker_of_another_numeric_class_is_refused(line: Line) -> None:
    assert line.claim(HUMAN_PLAN, numeric_class="numpy-1").status is ClaimStatus.LEASE
    assert line.claim(HUMAN_PLAN, numeric_class="numpy-2").status is ClaimStatus.REFUSED


def test_paused_run_gives_no_work_until_resumed(line: Line) -> None:
    line.bus.request(topics.CONTROL, ControlRequest(command=Command.PAUSE))
    assert line.claim(HUMAN_PLAN).status is ClaimStatus.WAIT
    line.bus.request(topics.CONTROL, ControlRequest(command=Command.RESUME))
    assert line.claim(HUMAN_PLAN).status is ClaimStatus.LEASE
    assert line.status().failed == ""
    line.bus.request(topics.CONTROL, ControlRequest(command=Command.CANCEL))
    assert line.claim(HUMAN_PLAN).status is ClaimStatus.DONE
    assert line.status().failed.startswith("The run was cancelled")


def test_large_result_is_fetched_in_chunks(tmp_path: Path) -> None:
    line = Line(tmp_path, inline_bytes=10, blob_chunk_bytes=7)
    line.complete(HUMAN_PLAN, line.claim(HUMAN_PLAN), result=bytes(range(100)))
    (blob,) = line.claim(ANIMATE).inputs
    assert blob.data == b""
    assert fetch_blob(line.bus, blob.sha256) == bytes(range(100))


def test_second_recorders_copy_of_a_durable_episode_is_stale(line: Line) -> None:
    line.plan()
    claim = line.claim(RENDER)
    line.grant(claim)
    assert line.done(claim) is VerdictStatus.OK
    other = DoneRequest(recorder="rec1", index=0, attempt=1, shard="t", sample_count=10)
    assert line.bus.request(topics.DONE, other).status is VerdictStatus.STALE
    assert line.done(claim) is VerdictStatus.OK


def _indices(line: Line) -> list[int]:
    """The indices that wait for planning; claims them all."""
    indices = []
    while (claim := line.claim(HUMAN_PLAN)).status is ClaimStatus.LEASE:
        assert claim.episode is not None
        indices.append(claim.episode.index)
    return indices


def test_shorter_run_keeps_the_smallest_indices_and_a_longer_one_opens_the_rest_again(tmp_path: Path) -> None:
    first = Line(tmp_path, wanted=6)
    first.plan()
    first.plan(rejected="timeout")
    last = [first.claim(HUMAN_PLAN) for _ in range(4)][-1]
    first.complete(HUMAN_PLAN, last, rejected="no path")
    first.coordinator.ledger.close()
    second = Line(tmp_path, wanted=3)
    assert second.status().rejected == {"timeout": 1}
    assert _indices(second) == [2, 3]
    second.coordinator.ledger.close()
    third = Line(tmp_path, wanted=6)
    assert _indices(third) == [2, 3, 4, 5, 6]


REFEREE = Stage(name="referee", role="referee", needs=("robot-plan",))
FILM = dataclasses.replace(RENDER, needs=("referee", "human-plan"))


def _with_referee(on_rejection: OnRejection) -> tuple[Stage, ...]:
    """The line with a fourth stage before the last one."""
    return (HUMAN_PLAN, ANIMATE, ROBOT_PLAN, dataclasses.replace(REFEREE, on_rejection=on_rejection), FILM)


def test_new_stage_gets_what_it_needs_and_gives_what_others_need(tmp_path: Path) -> None:
    stages = _with_referee(OnRejection.SKIP)
    line = Line(tmp_path, stages=stages, wanted=1)
    line.pass_on(*stages[:3])
    assert line.claim(stages[4]).status is ClaimStatus.WAIT
    judged = line.claim(stages[3])
    assert [blob.data for blob in judged.inputs] == [b"robot-plan"]
    assert judged.recorder == ""
    assert line.complete(stages[3], judged, result=b"fair") is VerdictStatus.OK
    filmed = line.claim(stages[4])
    assert [blob.data for blob in filmed.inputs] == [b"fair", b"human-plan"]
    assert filmed.recorder == "rec0"
    assert line.grant(filmed) is VerdictStatus.OK
    assert line.done(filmed) is VerdictStatus.OK
    assert line.status().finished


def test_rejection_of_a_new_stage_skips_the_index_or_keeps_the_episode(tmp_path: Path) -> None:
    for on_rejection in OnRejection:
        (tmp_path / on_rejection.value).mkdir()
        stages = _with_referee(on_rejection)
        line = Line(tmp_path / on_rejection.value, stages=stages, wanted=1)
        line.pass_on(*stages[:3])
        judged = line.claim(stages[3])
        assert line.complete(stages[3], judged, result=b"foul", rejected="too close") is VerdictStatus.OK
        filmed = line.claim(stages[4])
        if on_rejection is OnRejection.SKIP:
            assert filmed.status is ClaimStatus.WAIT
            assert (line.status().rejected, line.status().kept) == ({"too close": 1}, {})
            assert line.claim(HUMAN_PLAN).status is ClaimStatus.LEASE
        else:
            assert filmed.inputs[0].data == b"foul"
            line.grant(filmed)
            line.done(filmed)
            assert (line.status().rejected, line.status().kept) == ({}, {"too close": 1})
            assert line.status().finished


def test_late_rejection_that_would_be_kept_is_stale(tmp_path: Path) -> None:
    stages = _with_referee(OnRejection.KEEP)
    line = Line(tmp_path, stages=stages)
    line.pass_on(*stages[:3])
    late = line.claim(stages[3])
    line.now_s = 100.0
    requeue_lost(line.coordinator)
    line.claim(stages[3])
    assert line.complete(stages[3], late, result=b"foul", rejected="too close") is VerdictStatus.STALE
    assert line.status().kept == {}


def test_grant_is_for_the_stage_that_records_only(line: Line) -> None:
    assert line.grant(line.claim(HUMAN_PLAN)) is VerdictStatus.STALE


def test_episodes_are_shared_by_the_runs_recorders(tmp_path: Path) -> None:
    line = Line(tmp_path, recorders=("rec0", "rec1"))
    names = []
    for _ in range(3):
        line.plan()
        names.append(line.claim(RENDER).recorder)
    assert names == ["rec0", "rec1", "rec0"]


def test_recorder_that_holds_grants_cannot_be_left_out(tmp_path: Path) -> None:
    first = Line(tmp_path)
    first.plan()
    first.grant(first.claim(RENDER))
    first.coordinator.ledger.close()
    with pytest.raises(RunError, match=r"Recorder 'rec0' was given episodes of this run; name it in \[coordinator\]"):
        Line(tmp_path, recorders=("other",))


def test_result_that_two_episodes_share_stays_until_both_are_durable(line: Line) -> None:
    line.plan()
    line.plan()
    for left in (3, 0):
        claim = line.claim(RENDER)
        assert [blob.data for blob in claim.inputs] == [b"human-plan", b"animate", b"robot-plan"]
        line.grant(claim)
        line.done(claim)
        assert len(list(line.coordinator.blobs._folder.iterdir())) == left


LIVE = PolicyRef(path="", files=(), mix=0.5)


@pytest.fixture
def live(tmp_path: Path) -> Line:
    """A run that takes policies."""
    return Line(tmp_path, stages=DRIVE_LINE, policy=LIVE)


def _driven(line: Line) -> str:
    """The policy that comes with the next episode, which is driven and made durable."""
    line.pass_on(HUMAN_PLAN, ANIMATE)
    claim = line.claim(DRIVE)
    policy = claim.policy.sha256 if claim.policy else ""
    assert line.grant(claim) is VerdictStatus.OK
    assert line.done(claim, policy) is VerdictStatus.OK
    return policy


def test_newest_policy_comes_with_the_episodes_that_are_leased_after_its_offer(live: Line) -> None:
    driven = [_driven(live)]
    first = live.offer(head=b"1", encoder=b"2")
    driven.append(_driven(live))
    second = live.offer(head=b"3", encoder=b"2")
    driven.append(_driven(live))
    assert driven == ["", first.sha256, second.sha256]
    assert (first.version, second.version, live.status().policies) == (1, 2, 2)
    assert live.coordinator.ledger.census.driven_by() == dict(enumerate(driven))
    assert [policy.samples for policy in live.coordinator.ledger.policies.all()] == [10, 20]


def _held(line: Line) -> set[bytes]:
    """What offered files the coordinator has."""
    return {path.read_bytes() for path in line.coordinator.blobs._folder.iterdir() if len(path.read_bytes()) == 1}


def test_policies_that_drove_nothing_go_when_a_newer_one_comes(live: Line) -> None:
    live.offer(head=b"1", encoder=b"s")
    live.offer(head=b"2", encoder=b"s")
    assert _held(live) == {b"2", b"s"}, "the first one drove nothing"
    _driven(live)
    live.offer(head=b"3", encoder=b"s")
    live.pass_on(HUMAN_PLAN, ANIMATE)
    leased = live.claim(DRIVE)
    live.offer(head=b"4", encoder=b"t")
    assert _held(live) == {b"2", b"s", b"3", b"4", b"t"}, "the second drove, the third is leased"
    assert live.grant(leased) is VerdictStatus.OK
    live.offer(head=b"5", encoder=b"t")
    assert _held(live) == {b"2", b"s", b"3", b"5", b"t"}
    assert live.done(leased, "") is VerdictStatus.OK
    assert live.offer(head=b"6", encoder=b"t").version == 6
    assert _held(live) == {b"2", b"s", b"6", b"t"}, "the expert drove in the third one's stead"


def test_policy_travels_by_its_blobs_and_outlives_a_restart(live: Line, tmp_path: Path) -> None:
    offered = live.offer(head=b"1", encoder=b"2")
    live.coordinator.ledger.close()
    again = Line(tmp_path, stages=DRIVE_LINE, policy=LIVE)
    assert again.claim(HUMAN_PLAN).policy is None
    again.now_s = 100.0
    requeue_lost(again.coordinator)
    again.pass_on(HUMAN_PLAN, ANIMATE)
    policy = again.claim(DRIVE).policy
    assert policy is not None
    assert (policy.sha256, policy.path, policy.mix) == (offered.sha256, "", 0.5)
    assert {file.path: fetch_blob(again.bus, file.sha256) for file in policy.files} == {"head": b"1", "encoder": b"2"}


def test_equal_files_are_the_same_policy(live: Line) -> None:
    first, other = live.offer(head=b"1", encoder=b"2"), live.offer(head=b"3", encoder=b"2")
    assert live.offer(encoder=b"2", head=b"1") == first
    assert other.version == 2
    assert live.status().policies == 2


def test_episode_keeps_the_policy_of_its_lease_and_a_later_attempt_gets_the_newest(live: Line) -> None:
    old, _ = live.offer(head=b"1"), live.pass_on(HUMAN_PLAN, ANIMATE)
    late = live.claim(DRIVE)
    new = live.offer(head=b"2")
    assert late.policy is not None
    assert late.policy.sha256 == old.sha256
    live.now_s = 100.0
    requeue_lost(live.coordinator)
    fresh = live.claim(DRIVE)
    assert fresh.policy is not None
    assert fresh.policy.sha256 == new.sha256
    assert live.grant(late) is VerdictStatus.STALE


def test_policy_that_cannot_drive_is_refused_in_words_and_leaves_nothing(live: Line) -> None:
    live.refused = "It was trained for another robot."
    with pytest.raises(PeerError, match="It was trained for another robot"):
        live.offer(head=b"1")
    assert live.status().policies == 0
    assert list(live.coordinator.blobs._folder.iterdir()) == []


def test_run_of_the_expert_or_of_one_policy_takes_no_others(line: Line, tmp_path: Path) -> None:
    with pytest.raises(PeerError, match="Run run-test takes no policies: the expert drives in it"):
        line.offer(head=b"1")
    (tmp_path / "other").mkdir()
    own = PolicyRef(path="p", files=(FileRef(path="head", sha256="a", size=1),), mix=0.5)
    with pytest.raises(PeerError, match="takes no policies: the policy that it began with drives"):
        Line(tmp_path / "other", stages=DRIVE_LINE, policy=own).offer(head=b"1")


def test_result_that_the_disk_does_not_take_is_told_until_it_does(line: Line, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ever again a stage would be done in vain otherwise, and nobody would know why."""
    put = line.coordinator.blobs.put

    def full(data: bytes) -> str:
        raise DiskError("No space left.")

    monkeypatch.setattr(line.coordinator.blobs, "put", full)
    with pytest.raises(PeerError, match="No space left"):
        line.complete(HUMAN_PLAN, line.claim(HUMAN_PLAN), result=b"plan")
    assert "No space left." in line.status().trouble
    monkeypatch.setattr(line.coordinator.blobs, "put", put)
    line.complete(HUMAN_PLAN, line.claim(HUMAN_PLAN), result=b"plan")
    assert line.status().trouble == ""


def _two_recorders(folder: Path) -> Line:
    """A run with four episodes that wait for their images."""
    line = Line(folder, wanted=4, recorders=("rec0", "east"))
    for _ in range(4):
        line.plan()
    return line


def test_recorder_with_the_fewest_episodes_on_their_way_gets_the_next(tmp_path: Path) -> None:
    line = _two_recorders(tmp_path)
    first = line.claim(RENDER)
    assert [first.recorder, line.claim(RENDER).recorder] == ["rec0", "east"]
    line.record(first)
    assert [line.claim(RENDER).recorder, line.claim(RENDER).recorder] == ["rec0", "east"]


def test_recorder_that_is_gone_or_has_trouble_gets_nothing_new_while_there_is_another(tmp_path: Path) -> None:
    line = _two_recorders(tmp_path)
    line.coordinator.note_recorder("east", alive=False)
    assert [line.claim(RENDER).recorder for _ in range(2)] == ["rec0", "rec0"]
    line.bus.request(topics.TROUBLE, TroubleRequest(recorder="rec0", reason="full"))
    assert line.claim(RENDER).recorder in ("rec0", "east"), "all have trouble: whoever is over it first records"
    line.coordinator.note_recorder("east", alive=True)
    assert line.claim(RENDER).recorder == "east"


def test_what_a_full_disk_does_not_take_another_recorder_gets(tmp_path: Path) -> None:
    line = _two_recorders(tmp_path)
    late, other = line.claim(RENDER), line.claim(RENDER)
    assert line.grant(late) is VerdictStatus.OK
    report = TroubleRequest(recorder="rec0", reason="full")
    assert line.bus.request(topics.TROUBLE, report).status is VerdictStatus.DONE
    assert line.grant(late) is VerdictStatus.STALE
    again = line.claim(RENDER)
    assert (again.episode, again.recorder) == (late.episode, "east")
    assert again.inputs == late.inputs
    report = TroubleRequest(recorder="east", reason="full as well")
    assert line.bus.request(topics.TROUBLE, report).status is VerdictStatus.OK, "nobody is left to take them"
    assert line.status().leased == {"render": 2}
    assert other.recorder == "east"


def test_recorder_that_was_given_up_is_no_recorder_any_more(tmp_path: Path) -> None:
    line = _two_recorders(tmp_path)
    line.record(line.claim(RENDER))
    assert line.coordinator.ledger.retire("rec0") == 1
    line.coordinator.ledger.close()
    line = Line(tmp_path, wanted=4, recorders=("rec0", "east"))
    assert (line.status().committed, line.status().waiting) == (0, {"human-plan": 1, "render": 3})
    assert {line.claim(RENDER).recorder for _ in range(3)} == {"east"}
    assert line.bus.request(topics.PENDING, PendingRequest(recorder="rec0")).indices == ()
    with pytest.raises(RunError, match=r"All recorders of this run were given up \(rec0\)"):
        Line(tmp_path, recorders=("rec0",))


def test_paused_run_stays_paused_when_its_coordinator_is_started_again(tmp_path: Path) -> None:
    for command, paused in ((Command.PAUSE, True), (Command.RESUME, False)):
        Line(tmp_path).bus.request(topics.CONTROL, ControlRequest(command=command))
        again = Line(tmp_path)
        assert again.status().paused == paused
        assert (again.claim(HUMAN_PLAN).status is ClaimStatus.WAIT) == paused
