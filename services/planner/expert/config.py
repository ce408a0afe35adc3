"""How the robot expert drives. The run's config carries it.

"Paper" marks what the ReaDy-Go paper states; everything else is our choice, because the paper leaves it open.
"""

from dataclasses import dataclass
from typing import Annotated, Literal

from readygo.common.config import Range, check_ranges
from readygo.common.errors import ConfigError

CELL_MARGIN_M = 0.01
"""Added to the planning radius at cell centres; elsewhere in a cell a wall may be 0.035 m nearer [m]."""
PRIMITIVE_S = 0.5
"""Duration of a primitive of both searches [s]; three speeds by left, straight, right are the paper's."""
REVERSE_COST = 1.0
"""Extra cost of a metre backwards, for a robot that reverses: it does not see where it drives."""
GEAR_COST_M = 0.3
"""Cost of a change between driving forwards and backwards [m]."""
BLIND_RANGE_M = 0.001
"""Range of an expert that perceives no human: robot and human touch long before [m]."""
GOAL_TOLERANCE_M = 0.25
"""A plan ends this near to the goal [m]."""


@dataclass(frozen=True, kw_only=True)
class ExpertConfig:
    """The robot expert (stage 3)."""

    mode: Literal["paper", "spacetime"] = "spacetime"
    """"paper": humans are static ground in the map; "spacetime": the search knows when they are where."""
    near_field_m: Annotated[float, Range(low=0.0)] = 0.0
    """Humans this near are perceived in all directions, even behind obstacles [m]. A policy cannot see that."""
    oracle: bool = False
    """True perceives all humans, all round and through walls, and knows their true motion. A policy cannot."""
    range_m: Annotated[float, Range(above=0.0)] = 10.0
    """Farther humans are not perceived [m]."""

    def __post_init__(self) -> None:
        check_ranges(self)

    @property
    def needs_avatars(self) -> bool:
        """True if the expert looks at the bodies of humans, not at their places alone."""
        return self.mode == "paper"

    @property
    def needs_line_of_sight(self) -> bool:
        """True if obstacles hide humans; mode "paper" asks for the field of view only."""
        return self.mode != "paper"


def expert_recipe(name: str) -> ExpertConfig:
    """The settings of a named expert: "paper", "spacetime", "near_field", "oracle" or "blind".

    Raises:
        ConfigError: If there is no such recipe.
    """
    recipes = {
        "paper": ExpertConfig(mode="paper"),
        "spacetime": ExpertConfig(),
        "near_field": ExpertConfig(near_field_m=2.0),
        "oracle": ExpertConfig(oracle=True),
        "blind": ExpertConfig(range_m=BLIND_RANGE_M),
    }
    if name not in recipes:
        raise ConfigError(f"Unknown expert {name!r}; known: {', '.join(recipes)}.")
    return recipes[name]
