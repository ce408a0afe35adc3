import dataclasses
from collections.abc import Callable
from pathlib import Path

import pytest

from readygo.common.errors import DiskError, PeerError
from readygo.common.messages import (
    ClaimStatus,
    PolicyRef,
    RenewRequest,
    Split,
    Stage,
    VerdictStatus,
    topics,
)
from readygo.common.messages.stages import ANIMATE, DRIVE, DRIVE_LINE, HUMAN_PLAN, RENDER, ROBOT_PLAN, OnRejection
from readygo.services.coordinator.upkeep import requeue_lost
from tests.services.coordinator.line import Line


def test_episode_passes_the_stages_in_order_with_the_earlier_results(line: Line) -> None:
    assert line.claim(ANIMATE).status is ClaimStatus.WAIT
    line.plan()
    claim = line.claim(RENDER)
    assert [blob.data for blob in claim.inputs] == [b"human-plan", b"animate", b"robot-plan"]
    assert claim.recorder == "rec0"
    assert claim.episode is not None
    assert (claim.episode.seed, claim.episode.split, claim.episode.index) == (5, Split.TRAIN, 0)


def test_renewed_lease_does_not_expire(line: Line) -> None:
    claim = line.claim(HUMAN_PLAN)
    line.now_s = 14.0
    renew = RenewRequest(worker="w", index=0, attempt=claim.attempt, lease=claim.lease)
    assert line.bus.request(topics.renew("human-plan"), renew).status is VerdictStatus.OK
    line.now_s = 20.0
    requeue_lost(line.coordinator)
    assert line.complete(HUMAN_PLAN, claim, result=b"x") is VerdictStatus.OK


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


def test_worker_that_does_not_say_its_numeric_class_or_is_not_of_the_runs_is_refused(tmp_path: Path) -> None:
    line = Line(tmp_path, metadata={"numeric_class": "the run's"})
    assert line.claim(HUMAN_PLAN, numeric_class="").status is ClaimStatus.REFUSED
    assert line.claim(HUMAN_PLAN, numeric_class="forged").status is ClaimStatus.REFUSED
    assert line.claim(HUMAN_PLAN, numeric_class="the run's").status is ClaimStatus.LEASE


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


def test_lease_brings_the_policy_that_its_episode_is_driven_by(tmp_path: Path) -> None:
    live = Line(tmp_path, stages=DRIVE_LINE, policy=PolicyRef(path="own", files=(), mix=0.25))
    live.pass_on(HUMAN_PLAN, ANIMATE)
    offers = [live.offer(graph=data, spec=b"2") for data in (b"1", b"3")]
    claim = live.claim(DRIVE)
    assert claim.policy is not None
    assert (claim.policy.sha256, claim.policy.path, claim.policy.mix) == (offers[1].sha256, "", 0.25)
    assert (claim.ttl_s, live.claim(DRIVE).status) == (live.coordinator.config.lease_s, ClaimStatus.WAIT)
