"""Selection of the episodes of an evaluation for videos."""

from collections.abc import Sequence

from readygo.common.errors import RunError
from readygo.common.messages import Outcome
from readygo.services.evaluator import POLICY, EpisodeRecord

FAILED, WORST = "failures", "worst"
WORST_COUNT = 4
FAILURES = {
    Outcome.HUMAN_COLLISION: "hit a human",
    Outcome.STATIC_COLLISION: "hit a thing",
    Outcome.TIMEOUT: "too late",
}
"""Failed outcomes in words, the worst first."""


def watched_method(methods: Sequence[str]) -> str:
    """Method whose episodes are filmed and shown: the policy if it drives, else the first method."""
    return POLICY if POLICY in methods else methods[0]


def check_wanted(wanted: Sequence[str]) -> None:
    """Raise RunError unless each value of `--video` is "worst", "failures" or an index."""
    for name in wanted:
        if name not in (FAILED, WORST) and not name.isdecimal():
            raise RunError(f'--video takes "{FAILED}", "{WORST}" or indices of episodes, got {name!r}.')


def filmed(records: Sequence[EpisodeRecord], wanted: Sequence[str]) -> list[EpisodeRecord]:
    """The requested episodes, the worst first.

    Args:
        records: Episodes of one method.
        wanted: "failures" for all failures, "worst" for the few worst episodes, and indices, of every task.

    Raises:
        RunError: If no episode has a requested index.
    """
    ranked = sorted(records, key=badness)
    failed = [record for record in ranked if record.result.outcome in FAILURES]
    indices = {int(name) for name in wanted if name.isdecimal()}
    missing = sorted(indices - {record.episode.index for record in records})
    if missing:
        raise RunError(f"No episode was driven with index {missing[0]}: indices without a scenario leave gaps.")
    chosen = failed if FAILED in wanted else ranked[:WORST_COUNT] if WORST in wanted else []
    return [record for record in ranked if record in chosen or record.episode.index in indices]


def badness(record: EpisodeRecord) -> tuple[int, float, int]:
    """Sort key, the worst first: kind of failure, then smallest distance to a human."""
    kinds = list(FAILURES)
    kind = kinds.index(record.result.outcome) if record.result.outcome in kinds else len(kinds)
    return kind, record.human_distance_min_m, record.episode.index
