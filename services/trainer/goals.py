"""Goals of training samples: the episodes' own, and places that were reached later."""

from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float32Array, Int64Array
from readygo.common.frames import goals_in_robot_frames
from readygo.services.trainer.samples import TrainingSamples

NEAR_M = 1.0
"""Goals are reached at this distance [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Goals:
    """Goals of a batch."""

    xy_m: Float32Array
    """Goals in the robot's frame [m], shape (B, 2)."""
    seen_from: Int64Array
    """The sample whose frame shows what is seen there; -1 - e for the image of the goal of episode e, shape (B,)."""


def own_goals(table: TrainingSamples, samples: Int64Array) -> Goals:
    """The goals of the episodes."""
    return Goals(xy_m=table.goals_xy_m[samples], seen_from=-1 - table.episode[samples])


def hindsight_goals(
    table: TrainingSamples, samples: Int64Array, share: float, rng: np.random.Generator, *, seen: bool = False
) -> Goals:
    """Goals of samples, some of them replaced by a place that the robot reached later in the same episode.

    What the expert did was right for every place that it came to undisturbed, so that one episode teaches many goals.
    Places within `NEAR_M` are no goals: an episode ends before the robot is that near.

    Args:
        table: Poses, goals and episodes.
        samples: Sample indices, shape (B,).
        share: Probability that a sample's goal is replaced.
        rng: Random generator.
        seen: Take only places at which an image was taken.

    Source: Andrychowicz et al., Hindsight experience replay, 2017; Ghosh et al., Learning to reach goals via iterated
    supervised learning, 2019.
    """
    later = samples + np.ceil(rng.random(len(samples)) * (table.driven_last[samples] - samples)).astype(np.int64)
    later = table.pictured_at[later] if seen else later
    reached = goals_in_robot_frames(table.xyyaw[samples], table.xyyaw[later, :2]).astype(np.float32)
    dx, dy = (table.xyyaw[later, :2] - table.xyyaw[samples, :2]).T
    replaced = (rng.random(len(samples)) < share) & (dx * dx + dy * dy > NEAR_M**2)
    own = own_goals(table, samples)
    xy_m: Float32Array = np.where(replaced[:, None], reached, own.xy_m)
    return Goals(xy_m=xy_m, seen_from=np.where(replaced, later, own.seen_from))
