from pathlib import Path

import pytest

from readygo.common.messages import (
    ClaimStatus,
    Stage,
)
from readygo.common.messages.stages import HUMAN_PLAN, RENDER
from tests.services.coordinator.line import Line


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


def test_rejected_index_is_replaced_by_the_next_one(line: Line) -> None:
    line.plan(rejected="timeout")
    opened = []
    while (claim := line.claim(HUMAN_PLAN)).status is ClaimStatus.LEASE:
        assert claim.episode is not None
        opened.append(claim.episode.index)
    assert opened == [1, 2, 3]
    assert line.status().rejected == {"timeout": 1}


def test_scene_in_which_every_index_is_rejected_ends_the_run(tmp_path: Path) -> None:
    line = Line(tmp_path, wanted=2)
    while (claim := line.claim(HUMAN_PLAN)).status is ClaimStatus.LEASE:
        line.complete(HUMAN_PLAN, claim, rejected="no path")
    assert line.status().failed == "200 indices were rejected and 0 accepted: no path (200)."


def test_many_rejections_do_not_end_a_run_that_accepts_one_in_twenty(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("readygo.services.coordinator.giving_up.REJECTIONS_MAX", 5)
    line = Line(tmp_path, wanted=40)
    line.plan()
    for _ in range(20):
        line.complete(HUMAN_PLAN, line.claim(HUMAN_PLAN), rejected="no path")
    assert line.status().failed == ""
    line.complete(HUMAN_PLAN, line.claim(HUMAN_PLAN), rejected="no path")
    assert line.status().failed == "21 indices were rejected and 1 accepted: no path (21)."
