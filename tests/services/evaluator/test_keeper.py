"""What workers drive is kept once, and committed when it is whole."""

import dataclasses

import pytest

from readygo.common.bus import InProcessBus
from readygo.common.errors import RunError
from readygo.common.fleet.grants import Grants
from readygo.common.messages import (
    DoneRequest,
    Drive,
    DrivesRequest,
    EvaluationPlan,
    KeepRequest,
    Split,
    Verdict,
    VerdictStatus,
    topics,
)
from readygo.common.robot import Clock
from readygo.services.evaluator import POLICY, STRAIGHT_LINE, EvaluateRequest, Task, handle_evaluate, open_results
from readygo.services.evaluator.episodes import as_task
from readygo.services.evaluator.handlers import drive
from readygo.services.evaluator.keeper import Keeper, handle_drives, handle_keep
from readygo.services.evaluator.records import record_of_mapping

REQUEST = EvaluateRequest(tasks=(Task.STATIC, Task.DYNAMIC), methods=(POLICY, STRAIGHT_LINE), episodes=1)
PLAN = EvaluationPlan(
    tasks=("static", "dynamic"),
    methods=REQUEST.methods,
    control_hz=20.0,
    camera="policy",
    lockstep=8,
    checkpoints="",
    method_hashes={},
)


class Commits:
    """Stands in for the coordinator."""

    def __init__(self) -> None:
        self.done: list[DoneRequest] = []
        self.granted: list[tuple[int, int]] = []
        self.bus = InProcessBus()
        self.bus.serve(topics.GRANT, self._grant)
        self.bus.serve(topics.DONE, self._commit)

    def _grant(self, request):
        self.granted.append((request.index, request.attempt))
        late = any(done.index == request.index for done in self.done)
        return Verdict(status=VerdictStatus.DONE if late else VerdictStatus.OK)

    def _commit(self, request):
        self.done.append(request)
        return Verdict(status=VerdictStatus.OK)


@pytest.fixture
def commits():
    return Commits()


@pytest.fixture
def keeper(commits, tmp_path):
    with open_results(tmp_path / "kept", {}) as results:
        yield Keeper(
            plan=PLAN,
            request=REQUEST,
            results=results,
            grants=Grants(commits.bus, "keeper", 5.0),
            recorder="keeper",
            report=lambda _: None,
            clock=Clock(),
        )


@pytest.fixture
def driven(make_evaluator):
    """What a worker says of the first episode, drive by drive."""
    evaluator = make_evaluator()
    (dynamic,), _ = evaluator.source().draw(seed=0, split=Split.TEST, count=1, tasks=(Task.DYNAMIC,))
    return [
        KeepRequest(index=0, attempt=1, record=record.to_mapping(), trajectory=trajectory)
        for method in REQUEST.methods
        for task in REQUEST.tasks
        for record, trajectory in drive(evaluator, method, evaluator.driver(method), [as_task(dynamic, task)])
    ]


def test_episode_is_committed_when_all_of_it_is_kept(keeper, commits, driven) -> None:
    asked = DrivesRequest(index=0, attempt=1)
    assert handle_drives(keeper, asked).drives[1] == Drive(task="static", method=STRAIGHT_LINE)
    for number, request in enumerate(driven):
        assert len(handle_drives(keeper, asked).drives) == 4 - number
        keeper.grants.flush()
        assert commits.done == []
        assert handle_keep(keeper, request).status is VerdictStatus.OK
    keeper.grants.flush()
    (done,) = commits.done
    assert (done.index, done.attempt) == (0, 1)
    assert done.sample_count == sum(len(request.trajectory.actions) for request in driven)


def test_what_two_workers_drive_is_kept_once_and_as_one_process_keeps_it(keeper, driven, make_evaluator, tmp_path):
    late = [dataclasses.replace(request, attempt=2) for request in driven]
    statuses = [handle_keep(keeper, request).status for request in [*driven[:2], *late, *driven[2:]]]
    assert statuses.count(VerdictStatus.OK) == 4
    assert statuses.count(VerdictStatus.DONE) == 4
    with open_results(tmp_path / "here", {}) as results:
        handle_evaluate(make_evaluator(), REQUEST, results=results)
    for name in ("episodes.jsonl", "trajectories.jsonl"):
        kept, here = ((tmp_path / folder / name).read_text().splitlines() for folder in ("kept", "here"))
        assert sorted(kept) == sorted(here)


def test_whole_episode_of_a_lost_worker_is_committed_for_whoever_asks_next(keeper, commits, driven) -> None:
    for request in driven[:-1]:
        handle_keep(keeper, request)
    keeper.results.keep(record_of_mapping(driven[-1].record), driven[-1].trajectory)
    assert handle_drives(keeper, DrivesRequest(index=0, attempt=7)).drives == ()
    keeper.grants.flush()
    assert [(done.index, done.attempt) for done in commits.done] == [(0, 7)]


def test_records_of_something_else_are_not_kept(keeper, driven) -> None:
    foreign = {**driven[0].record, "seed": 9}
    verdict = handle_keep(keeper, dataclasses.replace(driven[0], record=foreign))
    assert verdict.status is VerdictStatus.STALE
    assert "no part of this evaluation" in verdict.reason
    assert handle_keep(keeper, dataclasses.replace(driven[0], index=3)).status is VerdictStatus.STALE
    with pytest.raises(RunError, match="no record of an episode"):
        handle_keep(keeper, dataclasses.replace(driven[0], record={"seed": 0}))
    assert keeper.results.records == {}
