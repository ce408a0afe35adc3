from pathlib import Path

import pytest

from readygo.common.errors import RunError
from readygo.common.messages import (
    ClaimStatus,
    Command,
    ControlRequest,
    PendingRequest,
    TroubleRequest,
    VerdictStatus,
    topics,
)
from readygo.common.messages.stages import HUMAN_PLAN, RENDER
from tests.services.coordinator.line import Line, line_to_two_recorders


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


def test_recorder_that_holds_grants_cannot_be_left_out(tmp_path: Path) -> None:
    first = Line(tmp_path)
    first.plan()
    first.grant(first.claim(RENDER))
    first.coordinator.ledger.close()
    with pytest.raises(RunError, match=r"Recorder 'rec0' was given episodes of this run; name it in \[coordinator\]"):
        Line(tmp_path, recorders=("other",))


def test_recorder_with_the_fewest_episodes_on_their_way_gets_the_next(tmp_path: Path) -> None:
    line = line_to_two_recorders(tmp_path)
    first = line.claim(RENDER)
    assert [first.recorder, line.claim(RENDER).recorder] == ["rec0", "east"]
    line.record(first)
    assert [line.claim(RENDER).recorder, line.claim(RENDER).recorder] == ["rec0", "east"]


def test_recorder_that_is_gone_or_has_trouble_gets_nothing_new_while_there_is_another(tmp_path: Path) -> None:
    line = line_to_two_recorders(tmp_path)
    line.coordinator.note_recorder("east", alive=False)
    assert [line.claim(RENDER).recorder for _ in range(2)] == ["rec0", "rec0"]
    line.bus.request(topics.TROUBLE, TroubleRequest(recorder="rec0", reason="full"))
    assert line.claim(RENDER).recorder in ("rec0", "east"), "all have trouble: whoever is over it first records"
    line.coordinator.note_recorder("east", alive=True)
    assert line.claim(RENDER).recorder == "east"


def test_recorder_that_was_given_up_is_no_recorder_any_more(tmp_path: Path) -> None:
    line = line_to_two_recorders(tmp_path)
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
