"""How the robot expert drives. The run's config carries it.

"Paper" marks what the ReaDy-Go paper states; everything else is our choice, because the paper leaves it open.
The keys of `[expert]` are flat; the classes say which belong together, and each key what numbers it takes.
"""

from dataclasses import dataclass
from typing import Annotated, Literal

from readygo.common.config import Range, check_ranges
from readygo.common.errors import ConfigError
from readygo.common.robot.kinematics import DT_S

PRIMITIVES_MAX = 63
"""Primitives of the longest plan in space and time: what the keys of the search have room for."""

NotNegative = Annotated[float, Range(low=0.0)]
Positive = Annotated[float, Range(above=0.0)]
Weight = Annotated[float, Range(low=1.0)]
Count = Annotated[int, Range(low=1)]
Headings = Annotated[int, Range(low=8)]


@dataclass(frozen=True, kw_only=True)
class Perception:
    """What the expert knows of humans."""

    near_field_m: NotNegative = 0.0
    """Humans this near are perceived in all directions, even behind obstacles [m]. A policy cannot see that."""
    oracle: bool = False
    """True perceives all humans, all round and through walls, and knows their true motion. A policy cannot."""
    line_of_sight: bool | None = None
    """True hides humans behind obstacles. None: off in mode "paper", which asks for the field of view only, else on."""
    range_m: Positive = 10.0
    """Farther humans are not perceived [m]."""
    memory_s: NotNegative = 4.0
    """How long a human that left the view stays in the map, moving on [s]."""
    standing_memory_s: NotNegative = 60.0
    """How long a human that stood stays in the map [s]; ends earlier when the place is seen to be empty."""
    velocity_window_s: Annotated[float, Range(low=DT_S)] = 0.2
    """Velocities are estimated over this much continuous observation [s]."""


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """Where the expert expects humans."""

    prediction_s: Positive = 2.0
    """Constant-velocity prediction of mode "paper" (paper: 2 s)."""
    timed_prediction_s: Positive = 4.0
    """How far ahead humans are predicted in mode "spacetime" [s]."""
    oracle_prediction_s: Positive = 8.0
    """How far ahead an oracle knows them [s]."""
    route_weight: NotNegative = 2.0
    """How likely it is that a human walks to the robot's start or goal, if its last steps look like that, in
    proportion to walking on as before; 0 leaves these routes out."""
    chance_gain: NotNegative = 2.0
    """Chances count this much, at most fully: what is half likely is avoided like what is certain."""
    doubt_mps: NotNegative = 0.1
    """Growth of the predicted humans' radius while tracking [m/s]."""
    doubt_growth_mps: NotNegative = 0.2
    """Growth of `timed_margin_m` with the time ahead [m/s]."""
    doubt_max_m: NotNegative = 0.6
    """Largest growth of `timed_margin_m` with the time ahead [m]."""


@dataclass(frozen=True, kw_only=True)
class MapCosts:
    """What its ways cost on the map, and what they keep free."""

    cell_margin_m: NotNegative = 0.01
    """Added to the planning radius at cell centres; elsewhere in a cell a wall may be 0.035 m nearer [m]."""
    tight_margin_m: NotNegative = 0.03
    """Added to the robot's radius where no way keeps the planning radius [m]."""
    wall_cost: Annotated[float, Range(low=0.0, high=10.0)] = 0.5
    """Extra cost per metre right at the planning distance from a wall."""
    wall_distance_m: NotNegative = 0.2
    """Width of the strip that this cost falls off over [m]."""
    dear_factor: Annotated[int, Range(low=4, high=60)] = 40
    """Cost factor (in quarters) of predicted ground when no path avoids it."""
    standing_margin_m: NotNegative = 0.5
    """Ground this near to contact with a human who stands is dearer [m]."""


@dataclass(frozen=True, kw_only=True)
class PoseSearch:
    """Mode "paper": the search over poses."""

    heading_count: Headings = 72
    heuristic_weight: Weight = 1.5
    """1.0 searches for the cheapest path, more is faster."""
    steering_cost: NotNegative = 0.2
    """Cost of full turning, per metre at full speed (the penalty is the paper's, its weight ours)."""
    slow_cost: NotNegative = 0.2
    """Cost of standing still, per metre at full speed; 0 is the paper's cost, which dawdles."""
    turn_cost_m: NotNegative = 0.8
    """Cost of turning in place by one radian, which only a standing robot may do [m]."""
    expansions_max: Count = 10_000


@dataclass(frozen=True, kw_only=True)
class Replanning:
    """Mode "paper": when the expert replans, and how humans affect a plan."""

    near_m: Positive = 3.0
    """A visible human enters the map if this near to the plan [m] (paper: "a safety margin")."""
    buffer_m: NotNegative = 0.25
    """Added to the human's radius along the prediction, and around the avatar's Gaussians [m]."""
    replan_period_s: Positive = 0.5
    """Time after which a path is planned again in mode "paper" [s]."""
    keep_ratio: Weight = 1.25
    """The old plan stays if it is free and costs at most this many times as much as the new one."""
    replan_distance_m: Positive = 1.5
    """A human this near to the path ahead triggers a replan [m]."""
    replan_lookahead_s: Positive = 2.0
    replan_interval_min_s: Positive = 0.1


@dataclass(frozen=True, kw_only=True)
class TimedSearch:
    """Mode "spacetime": the search over poses and time."""

    timed_heuristic_weight: Weight = 1.2
    """1.0 searches for the cheapest plan, more is faster."""
    timed_heading_count: Headings = 36
    timed_expansions_max: Count = 1000
    timed_steering_cost: NotNegative = 0.15
    """Cost of turning fully, per second and metre per second of full speed."""
    swerve_cost: NotNegative = 0.1
    """Cost of changing the turn rate by its maximum, in metres at full speed of 1 m/s."""
    hard_margin_m: NotNegative = 0.03
    """Smaller gaps between robot and expected human count as contact [m]."""
    timed_margin_m: Positive = 0.4
    """Free space beyond contact that costs nothing [m]."""
    nearness_cost: Positive = 30.0
    """Cost of a second without this space, in metres at full speed; falls off with its square."""
    timed_replan_s: Positive = 0.25
    """Time after which a plan is renewed while humans are known [s]."""
    timed_idle_replan_s: Positive = 1.0
    """Time after which a plan is renewed while no humans are known [s]."""


@dataclass(frozen=True, kw_only=True)
class Following:
    """How commands are tried out before they are executed; mode "spacetime" does that where it has no plan."""

    lookahead_m: Annotated[tuple[float, ...], Range(above=0.0)] = (1.0, 0.7, 0.45, 0.3, 0.2)
    """Pursuit distances, the first that keeps the disc free is taken [m]."""
    tracking_margin_m: NotNegative = 0.01
    """Free space around the disc that tracking keeps [m]."""
    yield_to_humans: bool = True
    """True lets tracking slow down for visible humans on its way."""
    yield_margin_m: NotNegative = 0.15
    """Free space between robot and human that yielding aims at [m]."""
    evasion_gap_m: Positive = 0.4
    """Free space that evading aims at [m]."""


@dataclass(frozen=True, kw_only=True)
class ExpertConfig(Perception, Prediction, MapCosts, PoseSearch, Replanning, TimedSearch, Following):
    """The robot expert (stage 3)."""

    mode: Literal["paper", "spacetime"] = "spacetime"
    """"paper": humans are static ground in the map; "spacetime": the search knows when they are where."""
    primitive_s: Annotated[float, Range(low=0.1, high=5.0)] = 0.5
    """Duration of a primitive [s]; three speeds by left, straight, right are the paper's."""
    reverse_cost: NotNegative = 1.0
    """What a metre backwards costs more than one forwards, for a robot that reverses: it does not see where it goes."""
    gear_cost_m: NotNegative = 0.3
    """Cost of beginning to drive the other way, backwards or forwards [m]."""
    goal_tolerance_m: Positive = 0.25
    """A plan ends this near to the goal [m]."""

    def __post_init__(self) -> None:
        check_ranges(self)
        if not self.lookahead_m:
            raise ValueError("lookahead_m must be at least one distance.")
        longest_s = max(self.timed_prediction_s, self.oracle_prediction_s)
        if longest_s > PRIMITIVES_MAX * self.primitive_s:
            raise ValueError(
                f"primitive_s must be at least {longest_s / PRIMITIVES_MAX:.3g} s for {longest_s:g} s ahead."
            )

    @property
    def needs_avatars(self) -> bool:
        """True if the expert looks at the bodies of humans, not at their places alone."""
        return self.mode == "paper"

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
