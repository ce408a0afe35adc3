"""Keeps what the workers of an evaluation drive, and says what is missing.

To the coordinator it is the run's recorder: an episode is committed when all of it is on disk. A record is kept once,
however often it comes: two workers that drive the same episode come to the same record.
"""

from collections.abc import Mapping

from readygo.common.errors import RunError
from readygo.common.fleet.grants import Grants
from readygo.common.messages import (
    DoneRequest,
    Drive,
    DrivesReply,
    DrivesRequest,
    EpisodeKey,
    EvaluationPlan,
    KeepRequest,
    Verdict,
    VerdictStatus,
)
from readygo.common.robot import Clock
from readygo.services.evaluator.handlers import EvaluateRequest, Report
from readygo.services.evaluator.records import EpisodeRecord, RecordKey, record_of_mapping
from readygo.services.evaluator.results import RECORDS_FILE, Results


class Keeper:
    """One evaluation and its folder."""

    def __init__(
        self,
        *,
        plan: EvaluationPlan,
        request: EvaluateRequest,
        results: Results,
        grants: Grants,
        recorder: str,
        report: Report,
        clock: Clock,
    ) -> None:
        """Keep the records of some episodes.

        Args:
            plan: What workers are told.
            request: What is driven.
            results: Where records go.
            grants: The commit.
            recorder: The name that the keeper has to the coordinator.
            report: Told about every episode that ends.
            clock: The robot's.
        """
        self.plan, self.request, self.results = plan, request, results
        self.grants, self.recorder, self.report, self.clock = grants, recorder, report, clock

    def missing(self, index: int) -> list[RecordKey]:
        """What of an episode is not on disk."""
        return [key for key in self._keys(index) if key not in self.results.records]

    def commit(self, index: int, attempt: int) -> None:
        """Say that an episode is on disk as a whole; `Grants.flush` sends it."""
        if self.grants.ask(index, attempt) is VerdictStatus.OK:
            records = [self.results.records[key] for key in self._keys(index)]
            steps = max(1, sum(self.clock.steps(record.result.duration_s) for record in records))
            self.grants.report(
                DoneRequest(
                    recorder=self.recorder, index=index, attempt=attempt, shard=RECORDS_FILE, sample_count=steps
                )
            )

    def _keys(self, index: int) -> list[RecordKey]:
        request = self.request
        episode = EpisodeKey(seed=request.seed, split=request.split, index=index)
        return [(task, method, episode) for task in request.tasks for method in request.methods]


def handle_drives(keeper: Keeper, request: DrivesRequest) -> DrivesReply:
    """What is missing of an episode; one of which nothing is gets committed under the asker's attempt."""
    missing = keeper.missing(request.index)
    if not missing:
        keeper.commit(request.index, request.attempt)
    return DrivesReply(drives=tuple(Drive(task=task.value, method=method) for task, method, _ in missing))


def handle_keep(keeper: Keeper, request: KeepRequest) -> Verdict:
    """Keep a record, and commit its episode with the last one that was missing.

    Raises:
        RunError: If it is none, or cannot be kept.
    """
    record = _record(request.record)
    if record.key not in keeper.missing(request.index):
        kept = record.key in keeper.results.records
        return Verdict(
            status=VerdictStatus.DONE if kept else VerdictStatus.STALE,
            reason="" if kept else f"{record.method} in {record.episode.episode_id} is no part of this evaluation",
        )
    keeper.results.keep(record, request.trajectory)
    keeper.report(record)
    if not keeper.missing(request.index):
        keeper.commit(request.index, request.attempt)
    return Verdict(status=VerdictStatus.OK)


def _record(mapping: Mapping[str, object]) -> EpisodeRecord:
    try:
        return record_of_mapping(mapping)
    except ValueError as error:
        raise RunError(f"That is no record of an episode: {error}.") from error
