"""How scenarios are drawn. The run's config carries it.

"Paper" marks what the ReaDy-Go paper states; everything else is our choice, because the paper leaves it open.
"""

import math
from dataclasses import asdict, dataclass


@dataclass(frozen=True, kw_only=True)
class FamilyMix:
    """How often each family of encounters is drawn, relative to the others; 0 never draws it.

    A family that finds no room in a scenario is replaced by another one of the mix.
    """

    crossing: float = 0.0
    """Crosses the robot's way, timed to meet it, from either side."""
    parallel: float = 0.0
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
    """Two to four humans who stand together near the way."""
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


PAPER_MIX = FamilyMix(crossing=0.5, parallel=0.5)
"""The paper's families; it leaves their shares open."""


@dataclass(frozen=True, kw_only=True)
class HumanPlannerConfig:
    """Start, goal and the humans' trajectories (stage 1)."""

    mix: FamilyMix = PAPER_MIX
    """Families of encounters (paper: crossing or parallel)."""
    absent: float = 0.0
    """Share of the episodes without walking humans, 0..1; start and goal are the same as with humans."""
    absent_first: int = 0
    """Episodes of a smaller index have no humans either: a policy in training meets the place first, then people."""
    reactive: bool = False
    """True lets humans yield to the robot that they see: planned against the expert, see the README."""
    reactive_cone_deg: float = 200.0
    """Width of the view of humans who react [deg]."""
    reactive_range_m: float = 5.0
    """Humans react to a robot within this distance [m]."""
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
    """No human comes near a robot that stays at its start before this time [s]; it starts at rest and cannot back
    off."""
    start_peace_m: float = 0.75
    """Distance that `start_peace_s` calls near [m]."""
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
    """A human who comes round a blind corner is hidden from the robot's expected path until this long before they meet
    [s]."""
    pause_min_s: float = 1.5
    """Pauses of humans who stop and go [s]."""
    pause_max_s: float = 4.0

    def __post_init__(self) -> None:
        if not 0 < self.clearance_m <= self.route_clearance_m <= self.preferred_clearance_m:
            raise ValueError("clearances must be 0 < clearance_m <= route_clearance_m <= preferred_clearance_m.")
        if not 0 <= self.absent <= 1:
            raise ValueError(f"absent must be 0..1, got {self.absent}.")
        if self.absent_first < 0:
            raise ValueError(f"absent_first must be at least 0, got {self.absent_first}.")
        if not (0 <= self.goal_snap_m <= 5 and self.slope_max >= 0):
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
