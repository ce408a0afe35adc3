from pathlib import Path

import pytest

from readygo.common.errors import PeerError
from readygo.common.fleet.blobs import fetch_blob
from readygo.common.messages import (
    ClaimStatus,
    Command,
    ControlRequest,
    FileRef,
    PolicyRef,
    VerdictStatus,
    topics,
)
from readygo.common.messages.stages import ANIMATE, DRIVE, DRIVE_LINE, HUMAN_PLAN, RENDER
from readygo.services.coordinator.upkeep import requeue_lost
from tests.services.coordinator.line import Line

LIVE = PolicyRef(path="", files=(), mix=0.5)


@pytest.fixture
def live(tmp_path: Path) -> Line:
    """A run that takes policies."""
    return Line(tmp_path, stages=DRIVE_LINE, policy=LIVE)


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


def test_paused_run_gives_no_work_until_resumed(line: Line) -> None:
    line.bus.request(topics.CONTROL, ControlRequest(command=Command.PAUSE))
    assert line.claim(HUMAN_PLAN).status is ClaimStatus.WAIT
    line.bus.request(topics.CONTROL, ControlRequest(command=Command.RESUME))
    assert line.claim(HUMAN_PLAN).status is ClaimStatus.LEASE
    assert line.status().failed == ""
    line.bus.request(topics.CONTROL, ControlRequest(command=Command.CANCEL))
    assert line.claim(HUMAN_PLAN).status is ClaimStatus.DONE
    assert line.status().failed.startswith("The run was cancelled")


def test_large_result_is_fetched_in_chunks(line: Line, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("readygo.services.coordinator.handlers.workers.INLINE_BYTES", 10)
    monkeypatch.setattr("readygo.services.coordinator.handlers.run.BLOB_CHUNK_BYTES", 7)
    line.complete(HUMAN_PLAN, line.claim(HUMAN_PLAN), result=bytes(range(100)))
    (blob,) = line.claim(ANIMATE).inputs
    assert blob.data == b""
    assert fetch_blob(line.bus, blob.sha256) == bytes(range(100))


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
    first = live.offer(graph=b"1", spec=b"2")
    driven.append(_driven(live))
    second = live.offer(graph=b"3", spec=b"2")
    driven.append(_driven(live))
    assert driven == ["", first.sha256, second.sha256]
    assert (first.version, second.version, live.status().policies) == (1, 2, 2)
    assert live.coordinator.ledger.census.driven_by() == dict(enumerate(driven))
    assert [policy.samples for policy in live.coordinator.ledger.policies.all()] == [10, 20]


def _held(line: Line) -> set[bytes]:
    """What offered files the coordinator has."""
    return {path.read_bytes() for path in line.coordinator.blobs._folder.iterdir() if len(path.read_bytes()) == 1}


def test_policies_that_drove_nothing_go_when_a_newer_one_comes(live: Line) -> None:
    live.offer(graph=b"1", spec=b"s")
    live.offer(graph=b"2", spec=b"s")
    assert _held(live) == {b"2", b"s"}, "the first one drove nothing"
    _driven(live)
    live.offer(graph=b"3", spec=b"s")
    live.pass_on(HUMAN_PLAN, ANIMATE)
    leased = live.claim(DRIVE)
    live.offer(graph=b"4", spec=b"t")
    assert _held(live) == {b"2", b"s", b"3", b"4", b"t"}, "the second drove, the third is leased"
    assert live.grant(leased) is VerdictStatus.OK
    live.offer(graph=b"5", spec=b"t")
    assert _held(live) == {b"2", b"s", b"3", b"5", b"t"}
    assert live.done(leased, "") is VerdictStatus.OK
    assert live.offer(graph=b"6", spec=b"t").version == 6
    assert _held(live) == {b"2", b"s", b"6", b"t"}, "the expert drove in the third one's stead"


def test_policy_travels_by_its_blobs_and_outlives_a_restart(live: Line, tmp_path: Path) -> None:
    offered = live.offer(graph=b"1", spec=b"2")
    live.coordinator.ledger.close()
    again = Line(tmp_path, stages=DRIVE_LINE, policy=LIVE)
    assert again.claim(HUMAN_PLAN).policy is None
    again.now_s = 100.0
    requeue_lost(again.coordinator)
    again.pass_on(HUMAN_PLAN, ANIMATE)
    policy = again.claim(DRIVE).policy
    assert policy is not None
    assert (policy.sha256, policy.path, policy.mix) == (offered.sha256, "", 0.5)
    assert {file.path: fetch_blob(again.bus, file.sha256) for file in policy.files} == {"graph": b"1", "spec": b"2"}


def test_equal_files_are_the_same_policy(live: Line) -> None:
    first, other = live.offer(graph=b"1", spec=b"2"), live.offer(graph=b"3", spec=b"2")
    assert live.offer(spec=b"2", graph=b"1") == first
    assert other.version == 2
    assert live.status().policies == 2


def test_episode_keeps_the_policy_of_its_lease_and_a_later_attempt_gets_the_newest(live: Line) -> None:
    old, _ = live.offer(graph=b"1"), live.pass_on(HUMAN_PLAN, ANIMATE)
    late = live.claim(DRIVE)
    new = live.offer(graph=b"2")
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
        live.offer(graph=b"1")
    assert live.status().policies == 0
    assert list(live.coordinator.blobs._folder.iterdir()) == []


def test_run_of_the_expert_or_of_one_policy_takes_no_others(line: Line, tmp_path: Path) -> None:
    with pytest.raises(PeerError, match="Run run-test takes no policies: the expert drives in it"):
        line.offer(graph=b"1")
    (tmp_path / "other").mkdir()
    own = PolicyRef(path="p", files=(FileRef(path="graph", sha256="a" * 64, size=1),), mix=0.5)
    with pytest.raises(PeerError, match="takes no policies: the policy that it began with drives"):
        Line(tmp_path / "other", stages=DRIVE_LINE, policy=own).offer(graph=b"1")
