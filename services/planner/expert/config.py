"""How the robot expert drives. The run's config carries it.

"Paper" marks what the ReaDy-Go paper states; everything else is our choice, because the paper leaves it open.
"""

from dataclasses import dataclass
from typing import Literal

from readygo.common.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class ExpertConfig:
    """The robot expert (stage 3)."""

    mode: Literal["paper", "spacetime"] = "spacetime"
    """"paper": humans are static ground in the map; "spacetime": the search knows when they are where."""
    near_field_m: float = 0.0
    """Humans this near are felt all round, whatever hides them [m]. A policy cannot see that."""
    oracle: bool = False
    """True perceives all humans, all round and through walls, and knows their true motion. A policy cannot."""
    line_of_sight: bool | None = None
    """True hides humans behind obstacles. None: off in mode "paper", which asks for the field of view only, else on."""
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
    near_m: float = 3.0
    """A visible human enters the map if this near to the plan [m] (paper: "a safety margin")."""
    range_m: float = 10.0
    """Farther humans are not perceived [m]."""
    memory_s: float = 4.0
    """How long a human that left the view stays in the map, moving on [s]."""
    standing_memory_s: float = 60.0
    """The same for one that stood; it ends when the place is seen to be empty [s]."""
    prediction_s: float = 2.0
    """Constant-velocity prediction (paper: 2 s)."""
    velocity_window_s: float = 0.2
    """Velocities are estimated over this much continuous observation [s]."""
    buffer_m: float = 0.25
    """Added to the human's radius along the prediction, and around the avatar's Gaussians [m]."""
    replan_period_s: float = 0.5
    """Time after which a path is planned anew in mode "paper" [s]."""
    keep_ratio: float = 1.25
    """The old plan stays if it is free and costs at most this many times as much as the new one."""
    replan_distance_m: float = 1.5
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
    evasion_gap_m: float = 0.4
    """Free space that evading aims at [m]."""
    timed_heuristic_weight: float = 1.2
    """This and all that follows is of mode "spacetime" only. 1.0 searches for the cheapest plan, more is faster."""
    timed_heading_count: int = 36
    timed_expansions_max: int = 1000
    timed_steering_cost: float = 0.15
    """Cost of turning fully, per second and metre per second of full speed."""
    swerve_cost: float = 0.1
    """Cost of changing the turn rate by its maximum, in metres at full speed of 1 m/s."""
    timed_prediction_s: float = 4.0
    """How far ahead humans are predicted [s]."""
    oracle_prediction_s: float = 8.0
    """How far ahead an oracle knows them [s]."""
    hard_margin_m: float = 0.03
    """Smaller gaps between robot and expected human count as contact [m]."""
    timed_margin_m: float = 0.4
    """Free space beyond it that costs nothing [m]."""
    doubt_growth_mps: float = 0.2
    """Growth of this space with the time ahead [m/s]."""
    doubt_max_m: float = 0.6
    """Largest growth [m]."""
    nearness_cost: float = 30.0
    """Cost of a second without this space, in metres at full speed; falls off with its square."""
    route_weight: float = 2.0
    """How likely it is that a human walks to the robot's start or goal, if its last steps look like that, in
    proportion to walking on as before; 0 leaves these routes out."""
    standing_margin_m: float = 0.5
    """Ground this near to contact with a human who stands is dearer [m]."""
    chance_gain: float = 2.0
    """Chances count this much, at most fully: what is half likely is avoided like what is certain."""
    timed_replan_s: float = 0.25
    """Time after which a plan is made anew while humans are known [s]."""
    timed_idle_replan_s: float = 1.0
    """The same while none are [s]."""

    def __post_init__(self) -> None:
        if self.heuristic_weight < 1 or self.expansions_max < 1 or self.heading_count < 8:
            raise ValueError("heuristic_weight and expansions_max must be at least 1, heading_count at least 8.")
        if not 4 <= self.dear_factor <= 60:
            raise ValueError(f"dear_factor must be 4..60, got {self.dear_factor}.")
        if not self.lookahead_m or min(self.lookahead_m) <= 0:
            raise ValueError("lookahead_m needs at least one positive distance.")
        if min(self.primitive_s, self.replan_period_s, self.replan_interval_min_s, self.prediction_s) <= 0:
            raise ValueError("durations must be positive.")
        if not self.near_field_m >= 0:
            raise ValueError(f"near_field_m must be at least 0, got {self.near_field_m}.")

    @property
    def needs_line_of_sight(self) -> bool:
        """True if obstacles hide humans, the mode's default applied."""
        return self.mode != "paper" if self.line_of_sight is None else self.line_of_sight


def expert_recipe(name: str) -> ExpertConfig:
    """The settings of a named expert: "paper", "spacetime", "near_field" or "oracle".

    Raises:
        ConfigError: If there is no such recipe.
    """
    recipes = {
        "paper": ExpertConfig(mode="paper"),
        "spacetime": ExpertConfig(),
        "near_field": ExpertConfig(near_field_m=2.0),
        "oracle": ExpertConfig(oracle=True),
    }
    if name not in recipes:
        raise ConfigError(f"Unknown expert {name!r}; known: {', '.join(recipes)}.")
    return recipes[name]
