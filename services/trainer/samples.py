"""Which samples a batch holds, and which frames they see."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from readygo.common.camera import SensorConfig
from readygo.common.errors import DatasetError
from readygo.common.messages import EpisodeKey
from readygo.common.policy.windows import window_rows
from readygo.common.robot import RobotConfig

Indices = npt.NDArray[np.int64]


class EpisodeRange(Protocol):
    """One episode's place among the samples of a dataset."""

    @property
    def episode(self) -> EpisodeKey:
        """Which episode it is."""
        ...

    @property
    def first_sample(self) -> int:
        """Index of its first sample."""
        ...

    @property
    def sample_count(self) -> int:
        """Number of its samples, 20 per second."""
        ...


class SampleSource(Protocol):
    """What training reads of `readygo.common.dataset.Dataset`."""

    @property
    def episodes(self) -> Sequence[EpisodeRange]:
        """Episodes, in the order of their samples."""
        ...

    @property
    def actions(self) -> npt.NDArray[np.float32]:
        """Commands over the next step: v [m/s], w [rad/s], shape (S, 2)."""
        ...

    @property
    def goals_xy_m(self) -> npt.NDArray[np.float32]:
        """Goals in the robot's frame [m], shape (S, 2)."""
        ...

    @property
    def poses(self) -> npt.NDArray[np.float64]:
        """Robot on the floor: x, y, z [m], yaw [rad], shape (S, 4)."""
        ...

    @property
    def robot(self) -> RobotConfig | None:
        """The robot that the samples were recorded with, None if they do not say."""
        ...

    @property
    def sensor(self) -> SensorConfig:
        """What varied of the robot's camera from episode to episode."""
        ...

    @property
    def content_hash(self) -> str:
        """Hash of the data."""
        ...

    def decode(self, index: int) -> npt.NDArray[np.uint8]:
        """Image of one sample, RGB, shape (H, W, 3)."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class SampleTable:
    """The numbers of a set of episodes of one source, in flat arrays over ALL samples of the source."""

    first: Indices
    """First sample of each sample's episode, shape (S,)."""
    last: Indices
    """Last sample of each sample's episode, shape (S,)."""
    actions: npt.NDArray[np.float32]
    previous: npt.NDArray[np.float32]
    """Action of the sample before; the robot starts at rest, shape (S, 2)."""
    goals_xy_m: npt.NDArray[np.float32]
    xyyaw: npt.NDArray[np.float64]
    """Robot's pose: x, y [m], yaw [rad], shape (S, 3)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Batch:
    """Samples and the distinct frames that their windows see."""

    samples: Indices
    """Sample indices, shape (B,)."""
    frames: Indices
    """Sample indices of the distinct frames, ascending, shape (F,)."""
    window: Indices
    """Rows of `frames` that each sample sees, oldest first, shape (B, 3)."""


def build_table(source: SampleSource) -> SampleTable:
    """Flat arrays of a source."""
    count = sum(episode.sample_count for episode in source.episodes)
    first, last = np.zeros(count, np.int64), np.zeros(count, np.int64)
    previous = np.zeros((count, 2), np.float32)
    for episode in source.episodes:
        begin, end = episode.first_sample, episode.first_sample + episode.sample_count
        first[begin:end], last[begin:end] = begin, end - 1
        previous[begin + 1 : end] = source.actions[begin : end - 1]
    return SampleTable(
        first=first,
        last=last,
        actions=source.actions,
        previous=previous,
        goals_xy_m=source.goals_xy_m,
        xyyaw=source.poses[:, [0, 1, 3]],
    )


def split_episodes(
    episodes: Sequence[EpisodeRange], validation_fraction: float
) -> tuple[list[EpisodeRange], list[EpisodeRange]]:
    """Episodes to train on and to hold out, chosen by the hash of their names: the order of shards does not matter.

    Raises:
        DatasetError: If there are fewer than two episodes.
    """
    if len(episodes) < 2:
        raise DatasetError(f"Training needs 2 or more episodes, got {len(episodes)}; generate more, or give --val.")
    ranked = sorted(episodes, key=lambda item: hashlib.sha256(item.episode.episode_id.encode()).digest())
    held_out = min(max(1, round(validation_fraction * len(ranked))), len(ranked) - 1)

    def in_order(items: Sequence[EpisodeRange]) -> list[EpisodeRange]:
        return sorted(items, key=lambda item: item.first_sample)

    return in_order(ranked[held_out:]), in_order(ranked[:held_out])


def make_batch(samples: Indices, first: Indices, spacing_steps: int, latency_steps: int = 0) -> Batch:
    """The batch of some samples; before an episode's start its first frame is seen.

    Args:
        samples: Sample indices, shape (B,).
        first: First sample of each sample's episode for the whole source, shape (S,).
        spacing_steps: Steps between the frames of a window.
        latency_steps: Steps between the latest frame of a window and its sample.
    """
    seen = window_rows(samples - latency_steps, first[samples], spacing_steps)
    frames, window = np.unique(seen, return_inverse=True)
    return Batch(samples=samples, frames=frames, window=window.reshape(seen.shape))


def epoch_samples(
    episodes: Sequence[EpisodeRange],
    *,
    spacing_steps: int,
    chain_length: int,
    batch_size: int,
    rng: np.random.Generator,
) -> list[Indices]:
    """Sample indices of each batch of one pass over the episodes.

    Samples that are one frame spacing apart form chains of at most `chain_length`: a chain of n samples sees only
    n + 2 distinct frames. Chains are shuffled and cut into batches.
    """
    chains = []
    for episode in episodes:
        for offset in range(min(spacing_steps, episode.sample_count)):
            steps = np.arange(offset, episode.sample_count, spacing_steps) + episode.first_sample
            lead = int(rng.integers(chain_length))
            cuts = range(lead, len(steps), chain_length) if len(steps) > chain_length else ()
            chains += [chain for chain in np.split(steps, list(cuts)) if len(chain)]
    order = rng.permutation(len(chains))
    samples = np.concatenate([chains[i] for i in order])
    return np.array_split(samples, max(1, round(len(samples) / batch_size)))


def spread_samples(episodes: Sequence[EpisodeRange], limit: int) -> Indices:
    """At most `limit` samples of the episodes, evenly spread, in order."""
    samples = np.concatenate([np.arange(item.first_sample, item.first_sample + item.sample_count) for item in episodes])
    stride = -(-len(samples) // limit)
    return samples[::stride]
