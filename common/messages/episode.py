"""Which episode, and what shall happen in it."""

import enum
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.messages.checks import check_array


class Split(enum.Enum):
    """Disjoint random streams of episodes."""

    TRAIN = "train"
    """Episodes to learn from."""
    VAL = "val"
    """Episodes to choose among checkpoints."""
    TEST = "test"
    """Episodes to measure success rates."""


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeKey:
    """An episode's place in its run's random streams; with scene and config it fixes every sample."""

    seed: int
    """Seed of the run."""
    split: Split
    """Split of the episode, which selects its random streams."""
    index: int
    """Number of the episode; those that are rejected leave gaps."""

    def __post_init__(self) -> None:
        if self.seed < 0 or self.index < 0:
            raise ValueError(f"seed and index must not be negative, got {self.seed} and {self.index}.")

    @property
    def episode_id(self) -> str:
        """Name of the episode in shards, logs and file names."""
        return f"{self.split.value}-{self.seed}-{self.index:06d}"


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class HumanTrajectory:
    """Where one human is over time; after the last row the human stands there."""

    avatar: str
    """Name of the avatar."""
    encounter: str
    """How the trajectory meets the robot's way: a family such as "crossing", or what a scenario file calls it."""
    speed_mps: float
    xy_m: Float64Array
    """Ground position at 20 Hz [m], shape (T, 2)."""

    def __post_init__(self) -> None:
        check_array("xy_m", self.xy_m, np.float64, (None, 2))


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Scenario:
    """Start and goal of the robot, and the trajectories of the humans (none in the static task)."""

    episode: EpisodeKey
    start_xyyaw: Float64Array
    """Robot's start: x [m], y [m], yaw [rad], shape (3,)."""
    goal_xy_m: Float64Array
    """Goal [m], shape (2,)."""
    humans: tuple[HumanTrajectory, ...]

    def __post_init__(self) -> None:
        check_array("start_xyyaw", self.start_xyyaw, np.float64, (3,))
        check_array("goal_xy_m", self.goal_xy_m, np.float64, (2,))
