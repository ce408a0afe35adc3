"""How scenarios are drawn. The run's config carries it.

"Paper" marks what the ReaDy-Go paper states; everything else is our choice, because the paper leaves it open.
"""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class HumanPlannerConfig:
    """Start, goal and the humans' trajectories (stage 1)."""

    start_margin_m: float = 0.10
    """Free space around the planning disc at start and goal [m]."""
    detour_max: float = 3.0
    """Longest way to the goal, as a multiple of the straight distance."""
    clearance_m: float = 0.35
    """No point of a human's path is nearer to an obstacle [m]."""
    route_clearance_m: float = 0.375
    """Cells that a human's route may use [m]."""
    preferred_clearance_m: float = 0.6
    """Below this distance obstacles push the spline away [m]."""
    spline_spacing_m: float = 0.4
    """Distance of the B-spline's control points [m]."""
    obstacle_weight: float = 200.0
    jerk_weight: float = 2.0
    length_weight: float = 0.02
    iterations: int = 60
    crossing_share: float = 0.5
    """Share of humans that cross the robot's way; the others walk along it (paper: crossing or parallel)."""
    crossing_fraction_min: float = 0.3
    crossing_fraction_max: float = 0.7
    crossing_angle_min_deg: float = 45.0
    crossing_angle_max_deg: float = 135.0
    parallel_offset_m: float = 1.0
    """Largest lateral offset of a parallel human [m]."""
    robot_speed_fraction: float = 0.85
    """Mean speed that crossings are timed for, as a share of v_max."""
    meeting_jitter_s: float = 0.5
    """Standard deviation of the time between robot and human at the crossing [s]."""
    start_distance_min_m: float = 1.5
    """Between a human's first position and the robot [m]."""
    start_peace_s: float = 3.0
    """Nobody comes to a robot that stays at its start before this time [s]; it starts at rest and cannot back off."""
    start_peace_m: float = 0.75
    """Distance that this means [m]."""
    parked_distance_min_m: float = 1.6
    """Between a human's last position and the goal [m]."""
    attempts: int = 150
    """Draws per human and encounter before the episode is rejected."""

    def __post_init__(self) -> None:
        if not 0 < self.clearance_m <= self.route_clearance_m <= self.preferred_clearance_m:
            raise ValueError("clearances must be 0 < clearance_m <= route_clearance_m <= preferred_clearance_m.")
        if not 0 <= self.crossing_share <= 1:
            raise ValueError(f"crossing_share must be 0..1, got {self.crossing_share}.")
        if not 0 <= self.crossing_fraction_min <= self.crossing_fraction_max <= 1:
            raise ValueError("crossing fractions must be 0 <= min <= max <= 1.")
        if self.detour_max < 1 or self.attempts < 1:
            raise ValueError("detour_max and attempts must be at least 1.")
