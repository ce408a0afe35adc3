import dataclasses
from pathlib import Path

import pytest

from readygo.common.errors import PeerError
from readygo.common.messages import (
    ClaimStatus,
    DoneRequest,
    ExpectRequest,
    GrantRequest,
    LostRequest,
    PendingRequest,
    TroubleRequest,
    VerdictStatus,
    topics,
)
from readygo.common.messages.stages import HUMAN_PLAN, RENDER
from readygo.services.coordinator.upkeep import requeue_lost
from tests.services.coordinator.line import Line, line_to_two_recorders


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
    pending = line.bus.request(topics.PENDING, PendingRequest(recorder="rec0"))
    assert (pending.indices, pending.attempts) == ((0,), (claim.attempt,))
    line.bus.request(topics.LOST, LostRequest(recorder="rec0", index=0, reason="", attempt=claim.attempt - 1))
    assert line.claim(RENDER).status is ClaimStatus.WAIT
    line.bus.request(topics.LOST, LostRequest(recorder="rec0", index=0, reason="", attempt=claim.attempt))
    assert line.claim(RENDER).status is ClaimStatus.LEASE


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


def test_recorders_trouble_is_told_until_it_is_over(line: Line) -> None:
    for reason in ("No space left.", ""):
        request = TroubleRequest(recorder="rec0", reason=reason)
        assert line.bus.request(topics.TROUBLE, request).status is VerdictStatus.OK
        assert line.status().trouble == reason
    assert line.bus.request(topics.TROUBLE, TroubleRequest(recorder="x", reason="y")).status is VerdictStatus.STALE
    assert line.status().trouble == ""


def test_recorder_that_cannot_write_ends_the_run_with_its_words(line: Line) -> None:
    line.plan()
    claim = line.claim(RENDER)
    line.grant(claim)
    lost = LostRequest(recorder="rec0", index=0, reason="No space left.", attempt=claim.attempt)
    assert line.bus.request(topics.LOST, lost).status is VerdictStatus.OK
    assert line.status().failed == "No space left."
    assert line.claim(RENDER).status is ClaimStatus.DONE


def test_done_is_believed_of_the_granted_recorder_and_attempt_alone(tmp_path: Path) -> None:
    line = line_to_two_recorders(tmp_path)
    claim, other = line.claim(RENDER), line.claim(RENDER)
    assert (claim.recorder, other.recorder) == ("rec0", "east")

    def done(index: int = 0, recorder: str = "rec0", attempt: int = claim.attempt) -> tuple[VerdictStatus, str]:
        request = DoneRequest(recorder=recorder, index=index, attempt=attempt, shard="s", sample_count=10)
        verdict = line.bus.request(topics.DONE, request)
        return verdict.status, verdict.reason

    assert done() == (VerdictStatus.STALE, "attempt 4 of episode 0 is not granted to rec0"), "leased, not granted"
    line.grant(claim)
    assert done(recorder="east")[0] is VerdictStatus.STALE
    assert done(attempt=99)[0] is VerdictStatus.STALE
    assert done(attempt=claim.attempt - 1)[0] is VerdictStatus.STALE
    assert done(index=3)[0] is VerdictStatus.STALE, "waits"
    assert done(index=10**9)[0] is VerdictStatus.STALE, "is not open"
    assert done(recorder="nobody") == (VerdictStatus.STALE, "the run has no recorder 'nobody'")
    assert line.status().committed == 0
    assert done() == (VerdictStatus.OK, "")
    assert done() == (VerdictStatus.OK, "")
    assert done(recorder="east")[0] is VerdictStatus.STALE
    assert line.status().samples == 10


def test_recorder_that_was_given_up_is_believed_no_more(tmp_path: Path) -> None:
    line = line_to_two_recorders(tmp_path)
    claim = line.claim(RENDER)
    line.grant(claim)
    line.coordinator.ledger.retire("rec0")
    line.coordinator.recorders = ("east",)
    assert line.done(claim) is VerdictStatus.STALE
    assert line.grant(claim) is VerdictStatus.STALE
    assert line.bus.request(topics.PENDING, PendingRequest(recorder="rec0")).indices == ()
    assert line.status().committed == 0


@pytest.mark.parametrize("count", [0, -5])
def test_durable_episode_has_samples(count: int) -> None:
    with pytest.raises(ValueError, match="a durable episode has samples"):
        DoneRequest(recorder="rec0", index=0, attempt=1, shard="s", sample_count=count)


def test_grant_is_for_the_stage_that_records_only(line: Line) -> None:
    assert line.grant(line.claim(HUMAN_PLAN)) is VerdictStatus.STALE


def test_episodes_are_shared_by_the_runs_recorders(tmp_path: Path) -> None:
    line = Line(tmp_path, recorders=("rec0", "rec1"))
    names = []
    for _ in range(3):
        line.plan()
        names.append(line.claim(RENDER).recorder)
    assert names == ["rec0", "rec1", "rec0"]


def test_result_that_two_episodes_share_stays_until_both_are_durable(line: Line) -> None:
    line.plan()
    line.plan()
    for left in (3, 0):
        claim = line.claim(RENDER)
        assert [blob.data for blob in claim.inputs] == [b"human-plan", b"animate", b"robot-plan"]
        line.grant(claim)
        line.done(claim)
        assert len(list(line.coordinator.blobs._folder.iterdir())) == left


def test_what_a_full_disk_does_not_take_another_recorder_gets(tmp_path: Path) -> None:
    line = line_to_two_recorders(tmp_path)
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
