from pathlib import Path

import pytest

from readygo.common.errors import DiskError
from readygo.common.messages import (
    ClaimStatus,
    VerdictStatus,
)
from readygo.common.messages.stages import ANIMATE, HUMAN_PLAN, RENDER, ROBOT_PLAN
from readygo.services.coordinator.protocol import Holder
from readygo.services.coordinator.upkeep import requeue_lost
from tests.services.coordinator.line import Line


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


def _life(worker: str, session: str = "first") -> Holder:
    return Holder(worker=worker, role="human-planner", session=session)


def test_dead_workers_leases_are_free_at_once(line: Line) -> None:
    line.claim(HUMAN_PLAN, "dead", role="human-planner", session="first")
    alive = line.claim(HUMAN_PLAN, "alive", role="human-planner", session="first")
    requeue_lost(line.coordinator, holder=_life("dead"))
    again = line.claim(HUMAN_PLAN, "alive")
    assert again.episode is not None
    assert (again.episode.index, again.attempt) == (0, 2)
    assert line.complete(HUMAN_PLAN, alive, worker="alive", result=b"x") is VerdictStatus.OK


def test_episode_that_kills_its_workers_is_set_aside(line: Line) -> None:
    for _ in range(8):
        line.claim(HUMAN_PLAN, "doomed", role="human-planner", session="first")
        requeue_lost(line.coordinator, holder=_life("doomed"))
    assert line.status().rejected == {"set aside: 8 workers ended while they held it": 1}


def test_lease_ends_with_the_very_life_of_the_worker_that_took_it(line: Line) -> None:
    held = line.claim(HUMAN_PLAN, "desk-1", role="human-planner", session="second")
    unannounced = line.claim(HUMAN_PLAN, "desk-2")
    others = (
        Holder(worker="desk-1", role="animator", session="second"),
        Holder(worker="desk-1", role="human-planner", session="first"),
        Holder(worker="desk-2", role="human-planner", session="second"),
        Holder(worker="desk-2"),
    )
    assert not any(requeue_lost(line.coordinator, holder=other) for other in others)
    for claim, worker in ((held, "desk-1"), (unannounced, "desk-2")):
        assert line.complete(HUMAN_PLAN, claim, worker=worker, result=b"x") is VerdictStatus.OK


def test_deaths_at_earlier_stages_are_forgotten(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("readygo.services.coordinator.upkeep.DEATHS_MAX", 2)
    line = Line(tmp_path, wanted=1)
    for stage in (HUMAN_PLAN, ANIMATE, ROBOT_PLAN, RENDER):
        line.claim(stage, "preempted", role="all", session=stage.name)
        requeue_lost(line.coordinator, holder=Holder(worker="preempted", role="all", session=stage.name))
        assert line.status().rejected == {}
        line.pass_on(*((stage,) if stage is not RENDER else ()))
    line.record(line.claim(RENDER))
    assert line.status().finished


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
