"""How scenarios are drawn and how the expert drives. The run's config carries both.

"Paper" marks what the ReaDy-Go paper states; everything else is our choice, because the paper leaves it open.
"""

import math
from dataclasses import asdict, dataclass, field
from typing import Literal


@dataclass(frozen=True, kw_only=True)
class FamilyMix:
    """How often each family of encounters is drawn, relative to the others; 0 never draws it.

    A family that finds no room in a scenario is replaced by another one of the mix. The default is the paper's.
    """

    crossing: float = 0.5
    """Crosses the robot's way, timed to meet it, from either side."""
    parallel: float = 0.5
    """Walks along the robot's way, with it or against it, up to 1 m beside."""
    frontal: float = 0.0
    """Comes towards the robot on its own way."""
    overtaking: float = 0.0
    """Is overtaken by the robot because they are slow, or overtakes it."""
    crossing_left: float = 0.0
    """Crosses from the robot's left to its right."""
    crossing_right: float = 0.0
    """Crosses from the robot's right to its left."""
    blind_corner: float = 0.0
    """Steps out from behind an obstacle shortly before the meeting."""
    doorway: float = 0.0
    """Meets the robot in a narrow passage."""
    standing_group: float = 0.0
    """Two to four people who stand together near the way."""
    stop_and_go: float = 0.0
    """Crosses the way or walks along it, and pauses for some seconds."""
    goalward: float = 0.0
    """Walks to the robot's goal from elsewhere, and past it."""

    def __post_init__(self) -> None:
        shares = asdict(self)
        for name, share in shares.items():
            if not (math.isfinite(share) and share >= 0):
                raise ValueError(f"{name} must be a number from 0 on, got {share}.")
        if sum(shares.values()) <= 0:
            raise ValueError("at least one family needs a share above 0.")

    @property
    def shares(self) -> dict[str, float]:
        """The families that are drawn, in a fixed order, and their shares."""
        return {name: share for name, share in asdict(self).items() if share > 0}


@dataclass(frozen=True, kw_only=True)
class HumanPlannerConfig:
    """Start, goal and the humans' trajectories (stage 1)."""

    mix: FamilyMix = field(default_factory=FamilyMix)
    """Families of encounters (paper: crossing or parallel)."""
    reactive: bool = False
    """True lets people yield to the robot that they see: planned against the expert, see the README."""
    reactive_cone_deg: float = 200.0
    """Width of the view of people who react [deg]."""
    reactive_range_m: float = 5.0
    """How far away they care [m]."""
    goal_snap_m: float = 0.5
    """A scripted goal inside an obstacle moves to the nearest free place this near [m]; 0 refuses it."""
    slope_max: float = 0.0
    """Steeper floor is not walked on, nor are steps (rise over run across 0.3 m); 0 does not look at the floor."""

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
    """Draws per human and family before another family is tried."""
    searches: int = 1000
    """Paths that are searched in these draws, which is what they cost, before another family is tried."""
    families_tried: int = 4
    """Families that are tried for a human before there is no room."""
    fewer_humans: bool = False
    """True: where the drawn number finds no room, the episode has fewer, but at least `human_count_min`; False rejects
    it."""
    hidden_until_s: float = 2.0
    """Whoever comes round a blind corner is hidden from the robot's expected way until this long before [s]."""
    pause_min_s: float = 1.5
    """Pauses of people who stop and go [s]."""
    pause_max_s: float = 4.0

    def __post_init__(self) -> None:
        if not 0 < self.clearance_m <= self.route_clearance_m <= self.preferred_clearance_m:
            raise ValueError("clearances must be 0 < clearance_m <= route_clearance_m <= preferred_clearance_m.")
        if not (0 <= self.goal_snap_m <= 5 and 0 <= self.slope_max):
            raise ValueError("goal_snap_m must be 0..5 m and slope_max at least 0.")
        if not (0 < self.reactive_cone_deg <= 360 and self.reactive_range_m > 0):
            raise ValueError("reactive_cone_deg must be above 0 and at most 360, reactive_range_m above 0.")
        if not 0 < self.hidden_until_s <= 10:
            raise ValueError(f"hidden_until_s must be above 0 and at most 10 s, got {self.hidden_until_s}.")
        if not 0 < self.pause_min_s <= self.pause_max_s:
            raise ValueError("pauses must be 0 < pause_min_s <= pause_max_s.")
        if not 0 <= self.crossing_fraction_min <= self.crossing_fraction_max <= 1:
            raise ValueError("crossing fractions must be 0 <= min <= max <= 1.")
        if self.detour_max < 1 or min(self.attempts, self.searches, self.families_tried) < 1:
            raise ValueError("detour_max, attempts, searches and families_tried must be at least 1.")


@dataclass(frozen=True, kw_only=True)
class ExpertConfig:
    """The robot expert (stage 3)."""

    mode: Literal["paper"] = "paper"
    primitive_s: float = 0.5
    """Duration of a primitive [s]; three speeds by left, straight, right are the paper's."""
    heading_count: int = 72
    goal_tolerance_m: float = 0.25
    """A plan ends this near to the goal [m]."""
    heuristic_weight: float = 1.5
    """1.0 searches for the cheapest path, more is faster."""
    steering_cost: float = 0.2
    """Cost of full turning, per metre at full speed (the penalty is the paper's, its weight ours)."""
    slow_cost: float = 0.2
    """Cost of standing still, per metre at full speed; 0 is the paper's cost, which dawdles."""
    turn_cost_m: float = 0.8
    """Cost of turning in place by one radian, which only a standing robot may do [m]."""
    wall_cost: float = 0.5
    """Extra cost per metre right at the planning distance from a wall."""
    wall_distance_m: float = 0.2
    """Width of the strip that this cost falls off over [m]."""
    cell_margin_m: float = 0.01
    """Added to the planning radius at cell centres; elsewhere in a cell a wall may be 0.035 m nearer [m]."""
    tight_margin_m: float = 0.03
    """Added to the robot's radius where no way keeps the planning radius [m]."""
    expansions_max: int = 10_000
    near_m: float = 1.0
    """A visible human enters the map if this near to the plan [m] (paper: "a safety margin")."""
    range_m: float = 10.0
    """Farther humans are not perceived [m]."""
    line_of_sight: bool = False
    """True hides humans behind obstacles; the paper asks for the field of view only."""
    memory_s: float = 2.0
    """How long a human that left the view stays in the map, moving on [s]."""
    prediction_s: float = 2.0
    """Constant-velocity prediction (paper: 2 s)."""
    velocity_window_s: float = 0.2
    """Velocities are estimated over this much continuous observation [s]."""
    buffer_m: float = 0.10
    """Added to the human's radius along the prediction, and around the avatar's Gaussians [m]."""
    replan_period_s: float = 1.0
    keep_ratio: float = 1.25
    """The old plan stays if it is free and costs at most this many times as much as the new one."""
    replan_distance_m: float = 0.8
    """A human this near to the path ahead triggers a replan [m]."""
    replan_lookahead_s: float = 2.0
    replan_interval_min_s: float = 0.1
    dear_factor: int = 40
    """Cost factor (in quarters) of predicted ground when no path avoids it."""
    lookahead_m: tuple[float, ...] = (1.0, 0.7, 0.45, 0.3, 0.2)
    """Pursuit distances, the first that keeps the disc free is taken [m]."""
    tracking_margin_m: float = 0.01
    """Free space around the disc that tracking keeps [m]."""
    yield_to_humans: bool = True
    """True lets tracking slow down for visible humans on its way."""
    yield_margin_m: float = 0.15
    """Free space between robot and human that yielding aims at [m]."""
    doubt_mps: float = 0.1
    """Growth of the predicted humans' radius while tracking [m/s]."""
    foresight_s: float = 0.0
    """Tracking knows where humans in view truly will be for this long [s], before constant velocity takes over.

    A policy cannot see this: an option that lets more dynamic episodes succeed.
    """
    evasion_gap_m: float = 0.4
    """Free space that evading aims at [m]."""

    def __post_init__(self) -> None:
        if self.heuristic_weight < 1 or self.expansions_max < 1 or self.heading_count < 8:
            raise ValueError("heuristic_weight and expansions_max must be at least 1, heading_count at least 8.")
        if not 4 <= self.dear_factor <= 60:
            raise ValueError(f"dear_factor must be 4..60, got {self.dear_factor}.")
        if not self.lookahead_m or min(self.lookahead_m) <= 0:
            raise ValueError("lookahead_m needs at least one positive distance.")
        if min(self.primitive_s, self.replan_period_s, self.replan_interval_min_s, self.prediction_s) <= 0:
            raise ValueError("durations must be positive.")
