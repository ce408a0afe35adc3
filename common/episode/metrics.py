"""How a task is scored: success rate with its interval, average reaching time, path efficiency."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from readygo.common.episode.conduct import Conduct
from readygo.common.messages.plan import Outcome, RobotTrajectory


@dataclass(frozen=True, kw_only=True)
class EpisodeResult:
    """What the score needs to know about one episode."""

    outcome: Outcome
    duration_s: float
    path_length_m: float
    shortest_m: float
    """Shortest way to the circle of success around the goal [m]; see `shortest_way_m`."""
    conduct: Conduct | None = None
    """Social measures of the run; None where they were not measured."""

    @classmethod
    def from_trajectory(cls, trajectory: RobotTrajectory, shortest_m: float) -> "EpisodeResult":
        """The result of a run whose shortest way is known."""
        return cls(
            outcome=trajectory.outcome,
            duration_s=trajectory.duration_s,
            path_length_m=math.fsum(abs(v) * trajectory.dt_s for v in trajectory.actions[:, 0].tolist()),
            shortest_m=shortest_m,
        )


@dataclass(frozen=True, kw_only=True)
class TaskSummary:
    """Score of one task (static or dynamic) over its episodes."""

    episode_count: int
    success_rate: float
    success_rate_low: float
    """Lower end of the Wilson 95 % interval."""
    success_rate_high: float
    """Upper end of the Wilson 95 % interval."""
    art_s: float
    """Average reaching time over all episodes [s]; a failed one counts as the time limit."""
    spl: float
    """Success weighted by path length (Anderson et al., arXiv:1807.06757)."""
    static_collision_rate: float
    human_collision_rate: float
    timeout_rate: float


def summarize(results: Sequence[EpisodeResult], *, time_limit_s: float) -> TaskSummary:
    """Score a task.

    Args:
        results: One or more episodes; their order does not matter.
        time_limit_s: What a failed episode counts in the average reaching time [s].

    Raises:
        ValueError: If there are no results.
    """
    if not results:
        raise ValueError("a summary needs at least one episode.")
    count = len(results)
    rate = {outcome: sum(result.outcome is outcome for result in results) / count for outcome in Outcome}
    low, high = wilson_interval(round(rate[Outcome.SUCCESS] * count), count)
    successes = [result for result in results if result.outcome is Outcome.SUCCESS]
    reaching_s = math.fsum(result.duration_s for result in successes) + (count - len(successes)) * time_limit_s
    return TaskSummary(
        episode_count=count,
        success_rate=rate[Outcome.SUCCESS],
        success_rate_low=low,
        success_rate_high=high,
        art_s=reaching_s / count,
        spl=math.fsum(spl_of(result) for result in successes) / count,
        static_collision_rate=rate[Outcome.STATIC_COLLISION],
        human_collision_rate=rate[Outcome.HUMAN_COLLISION],
        timeout_rate=rate[Outcome.TIMEOUT],
    )


def wilson_interval(success_count: int, count: int) -> tuple[float, float]:
    """Wilson score interval of a rate, 95 %.

    Raises:
        ValueError: If `count` is not positive or `success_count` is not in 0..count.

    Source: E. B. Wilson, JASA 22 (1927).
    """
    if count <= 0 or not 0 <= success_count <= count:
        raise ValueError(f"success_count must be 0..count with count > 0, got {success_count} of {count}.")
    z = 1.959963984540054
    p, zz = success_count / count, z * z
    centre = (p + zz / (2 * count)) / (1 + zz / count)
    half = z / (1 + zz / count) * math.sqrt(p * (1 - p) / count + zz / (4 * count * count))
    return max(0.0, centre - half), min(1.0, centre + half)


def spl_of(result: EpisodeResult) -> float:
    """Path efficiency of a run that succeeded, 0..1; 0 for any other."""
    if result.outcome is not Outcome.SUCCESS:
        return 0.0
    longer_m = max(result.path_length_m, result.shortest_m)
    return result.shortest_m / longer_m if 0 < longer_m < math.inf else 0.0
