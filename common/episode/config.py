"""What an episode is: task, limits and the humans in it."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class EpisodeConfig:
    """Task and judging; recorded with every dataset and shared by planner, evaluator and trainer."""

    time_limit_s: float = 50.0
    success_radius_m: float = 1.0
    goal_distance_min_m: float = 3.0
    goal_distance_max_m: float = 10.0
    human_count_min: int = 1
    human_count_max: int = 2
    human_speed_min_mps: float = 0.8
    human_speed_max_mps: float = 1.4
    human_radius_m: float = 0.25

    def __post_init__(self) -> None:
        if not 0 <= self.human_count_min <= self.human_count_max <= 8:
            raise ValueError(
                f"human counts must be 0 <= min <= max <= 8, got {self.human_count_min}..{self.human_count_max}."
            )
        if not 0 < self.human_speed_min_mps <= self.human_speed_max_mps <= 3.5:
            raise ValueError("human speeds must be 0 < min <= max <= 3.5 m/s.")
        if not self.success_radius_m < self.goal_distance_min_m <= self.goal_distance_max_m:
            raise ValueError("goal distances must be success_radius_m < min <= max.")
        if self.time_limit_s <= 0 or self.human_radius_m <= 0:
            raise ValueError("time_limit_s and human_radius_m must be positive.")
