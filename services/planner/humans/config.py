"""How scenarios are drawn. The run's config carries it.

"Paper" marks what the ReaDy-Go paper states; everything else is our choice, because the paper leaves it open.
"""

import math
from dataclasses import asdict, dataclass
from typing import Literal


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
class Spacing:
    """Distances that humans keep from walls, from the robot's start and from its goal."""

    clearance_m: float
    """No point of a human's path is nearer to an obstacle [m]."""
    route_clearance_m: float
    """Cells that a human's route may use [m]."""
    preferred_clearance_m: float
    """Below this distance obstacles push the spline away [m]."""
    start_distance_min_m: float
    """Between a human's first position and the robot [m]."""
    start_peace_s: float
    """No human comes near a robot that stays at its start before this time [s]; it starts at rest and cannot back
    off."""
    parked_distance_min_m: float
    """Between a human's last position and the goal [m]."""


SPACINGS = {
    "wide": Spacing(
        clearance_m=0.35,
        route_clearance_m=0.375,
        preferred_clearance_m=0.6,
        start_distance_min_m=1.5,
        start_peace_s=3.0,
        parked_distance_min_m=1.6,
    ),
    "narrow": Spacing(
        clearance_m=0.26,
        route_clearance_m=0.28,
        preferred_clearance_m=0.4,
        start_distance_min_m=1.0,
        start_peace_s=1.0,
        parked_distance_min_m=0.8,
    ),
}


@dataclass(frozen=True, kw_only=True)
class Effort:
    """Time spent on a human before another family is tried."""

    attempts: int
    """Draws per human and family."""
    searches: int
    """Paths that are searched in these draws, which is what they cost."""
    iterations: int
    """Of the smoothing of a path."""


EFFORTS = {
    "thorough": Effort(attempts=150, searches=1000, iterations=60),
    "quick": Effort(attempts=60, searches=3, iterations=30),
}
"""Quick: cheap draws often, costly ones seldom, 15 ms a scenario at most on average."""


STANDING_MAX = 4
"""Most humans who stand in the way of one episode."""


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
    yielding: float = 1.0
    """Share of the humans who yield where humans react to the robot, 0..1; the others keep to their trajectories."""
    standing_min: int = 0
    """Fewest humans who stand in the robot's way or beside it for the whole episode, besides those who walk."""
    standing_max: int = 0
    """Most humans who stand there; 0 for none. They never yield: to the robot they are obstacles."""
    slope_max: float = 0.0
    """Steeper floor is not walked on, nor are steps (rise over run across 0.3 m); 0 does not look at the floor."""
    fewer_humans: bool = False
    """True: where the drawn number finds no room, the episode has fewer, but at least `human_count_min`; False rejects
    it."""
    spacing: Literal["wide", "narrow"] = "wide"
    """"narrow" lets humans walk close to walls and near the robot's start and goal, for rooms of a few metres."""
    effort: Literal["thorough", "quick"] = "thorough"
    """"quick" gives up early on families that find no room, for mixes of many families."""

    def __post_init__(self) -> None:
        if not 0 <= self.absent <= 1:
            raise ValueError(f"absent must be 0..1, got {self.absent}.")
        if self.absent_first < 0:
            raise ValueError(f"absent_first must be at least 0, got {self.absent_first}.")
        if not 0 <= self.yielding <= 1:
            raise ValueError(f"yielding must be 0..1, got {self.yielding}.")
        if not 0 <= self.standing_min <= self.standing_max <= STANDING_MAX:
            raise ValueError(
                f"standing humans must be 0 <= min <= max <= {STANDING_MAX}, got {self.standing_min}.."
                f"{self.standing_max}."
            )
        if not self.slope_max >= 0:
            raise ValueError(f"slope_max must be at least 0, got {self.slope_max}.")
        for name, known in (("spacing", SPACINGS), ("effort", EFFORTS)):
            if getattr(self, name) not in known:
                raise ValueError(f"{name} must be one of {', '.join(known)}, got {getattr(self, name)!r}.")
