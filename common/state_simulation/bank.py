"""A bank of episodes as arrays: starts, goals, where people walk, remaining distances; kept in one file."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from readygo.common.array_files import load_npz
from readygo.common.arrays import Float32Array, Float64Array, Int64Array, UInt16Array
from readygo.common.errors import RunError
from readygo.common.files import write_then_rename
from readygo.common.messages import EpisodeMotions, Scenario
from readygo.common.state_simulation.goal_distances import GoalDistances

BANK_BYTES_MAX = 8 << 30


@dataclass(frozen=True, kw_only=True, eq=False)
class EpisodeBank:
    """E episodes."""

    index: Int64Array
    """Index of each episode in its split, shape (E,)."""
    start_xyyaw: Float64Array
    """Robot's start: x, y [m], yaw [rad], shape (E, 3)."""
    goal_xy_m: Float64Array
    """Goal [m], shape (E, 2)."""
    human_count: Int64Array
    """People, shape (E,)."""
    walks_m: Float32Array
    """Roots of the people's motions at every step [m], shape (E, T, M, 2); after T they stay."""
    fields_cm: UInt16Array
    """Remaining distances to each goal, see `GoalDistances`, shape (E, H, W)."""

    def __len__(self) -> int:
        return len(self.index)

    @property
    def human_max(self) -> int:
        """Most people of an episode that the arrays have room for."""
        return int(self.walks_m.shape[2])

    def first(self, count: int) -> "EpisodeBank":
        """The first episodes."""
        return EpisodeBank(**{field.name: getattr(self, field.name)[:count] for field in fields(self)})

    def save(self, path: Path) -> None:
        """Write a file.

        Raises:
            RunError: If it cannot be written.
        """
        with write_then_rename(path, raises=RunError) as made, made.open("wb") as file:
            np.savez(file, **{field.name: getattr(self, field.name) for field in fields(self)})


def load_bank(path: Path) -> EpisodeBank:
    """Read a file that `EpisodeBank.save` wrote.

    Raises:
        RunError: If it is damaged.
    """
    names = [field.name for field in fields(EpisodeBank)]
    arrays = load_npz(path, names, bytes_max=BANK_BYTES_MAX, raises=RunError, remedy="Delete it, it is made again.")
    return EpisodeBank(**arrays)


def make_bank(
    episodes: Sequence[tuple[Scenario, EpisodeMotions]], distances: GoalDistances, human_max: int
) -> EpisodeBank:
    """The bank of some episodes.

    Args:
        episodes: Scenarios and motions; none make a bank without episodes.
        distances: Of the robot's map.
        human_max: Most people of an episode.
    """
    walks = [[human.motion.root_m[:, :2] for human in motions.humans] for _, motions in episodes]
    rows = max((len(walk) for people in walks for walk in people), default=1)
    walks_m = np.zeros((len(episodes), rows, human_max, 2), np.float32)
    for of_episode, people in zip(walks_m, walks, strict=True):
        for m, walk in enumerate(people):
            of_episode[:, m] = walk[np.minimum(np.arange(rows), len(walk) - 1)]
    scenarios = [scenario for scenario, _ in episodes]
    goals = [(float(scenario.goal_xy_m[0]), float(scenario.goal_xy_m[1])) for scenario in scenarios]
    fields_cm = [distances.to_goal_cm(goal) for goal in goals]
    return EpisodeBank(
        index=np.array([scenario.episode.index for scenario in scenarios], np.int64),
        start_xyyaw=np.array([scenario.start_xyyaw for scenario in scenarios], np.float64).reshape(-1, 3),
        goal_xy_m=np.array(goals, np.float64).reshape(-1, 2),
        human_count=np.array([len(people) for people in walks], np.int64),
        walks_m=walks_m,
        fields_cm=np.array(fields_cm, np.uint16).reshape(-1, *distances.shape),
    )


def join_banks(banks: Sequence[EpisodeBank]) -> EpisodeBank:
    """Some banks of one scene as one."""
    rows = max(bank.walks_m.shape[1] for bank in banks)
    walks = [bank.walks_m[:, np.minimum(np.arange(rows), bank.walks_m.shape[1] - 1)] for bank in banks]
    joined = {
        field.name: np.concatenate([getattr(bank, field.name) for bank in banks])
        for field in fields(EpisodeBank)
        if field.name != "walks_m"
    }
    return EpisodeBank(**joined, walks_m=np.concatenate(walks))
