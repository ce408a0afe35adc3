"""What an episode is: task, limits and the humans in it."""

import math
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class EpisodeConfig:
    """Task and judging; recorded with every dataset and shared by planner, evaluator and trainer."""

    time_limit_s: float = 50.0
    """Longest duration of an episode; after it the outcome is a timeout [s]."""
    success_radius_m: float = 1.0
    """The goal is reached within this distance [m]."""
    goal_distance_min_m: float = 3.0
    """Shortest straight distance from start to goal [m]."""
    goal_distance_max_m: float = 10.0
    """Longest straight distance from start to goal [m]."""
    human_count_min: int = 1
    """Fewest pedestrians per episode."""
    human_count_max: int = 2
    """Most pedestrians per episode."""
    human_speed_min_mps: float = 0.8
    """Lowest walking speed of pedestrians [m/s]."""
    human_speed_max_mps: float = 1.4
    """Highest walking speed of pedestrians [m/s]."""
    human_radius_m: float = 0.25
    """Radius of the disc that stands for a pedestrian in collisions and planning [m]."""
    sharpness_min: float = 0.0
    """Episodes whose median view, without people, is duller are rejected: fog. See `readygo.common.images.clarity`,
    where 150 tells fog from what is clear; 0 rejects none."""
    coverage_min: float = 0.0
    """Episodes whose median view shows less surface are rejected, 0..1: haze, and places with nothing around them.
    0.45 tells them apart there; 0 rejects none."""

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
        if not (0 <= self.sharpness_min < math.inf and 0 <= self.coverage_min <= 1):
            raise ValueError(
                "sharpness_min must be a number from 0 on and coverage_min 0..1, "
                f"got {self.sharpness_min} and {self.coverage_min}."
            )
