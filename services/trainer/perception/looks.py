"""Images with what perception shall tell of them, in memory."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import BoolArray, Float32Array, Int64Array, UInt8Array
from readygo.common.camera.config import CameraConfig
from readygo.common.dataset import Dataset
from readygo.common.maps import OccupancyMap, SightMap
from readygo.common.perception.artifact import FRAMES
from readygo.common.policy.motion import own_motion
from readygo.common.policy.windows import window_at
from readygo.services.trainer.perception.labels import PerceptionLabels, labels_of
from readygo.services.trainer.perception.network import POOLED_HEIGHT_PX
from readygo.services.trainer.pooling import pool, pooling_of


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedScene:
    """Recorded episodes, with the maps of the scene that they were recorded in."""

    dataset: Dataset
    blocked: OccupancyMap
    """What blocks the robot."""
    sight: SightMap
    """What hides humans."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Looks:
    """N images, with the two before each."""

    frames: UInt8Array
    """All images, pooled, shape (N, H, W, 3)."""
    window: Int64Array
    """Rows of `frames` that are seen together, the oldest first, shape (N, 3)."""
    motion: Float32Array
    """Own motion, see `readygo.common.policy.motion.own_motion`, shape (N, 8)."""
    labels: PerceptionLabels
    episode: Int64Array
    """Number of each image's episode, shape (N,)."""

    def __len__(self) -> int:
        return len(self.window)


def image_bytes(camera: CameraConfig) -> int:
    """Memory that an image takes."""
    return math.prod(_pooled_size(camera))


def looks_of(recorded: Sequence[RecordedScene], camera: CameraConfig, spacing_s: float, *, share: float = 1.0) -> Looks:
    """The images of recorded episodes, those of all scenes in one array.

    Args:
        recorded: The recorded episodes, one or more of them with images.
        camera: The robot's camera.
        spacing_s: Time between the images that are seen together [s].
        share: Share of the episodes, spread evenly, whose images are taken.

    Raises:
        DatasetError: If a shard is damaged.
    """
    taken = [_taken(each.dataset, share) for each in recorded]
    first_rows = np.cumsum([0, *(len(samples) for samples in taken)])
    first_episodes = np.cumsum([0, *(len(each.dataset.episodes) for each in recorded)])
    frames = np.empty((first_rows[-1], *_pooled_size(camera)), np.uint8)
    windows, motions, labels, episodes = [], [], [], []
    for each, samples, first_row, first_episode in zip(recorded, taken, first_rows, first_episodes, strict=False):
        _decode(each.dataset, samples, frames[first_row:], pooling_of(camera, POOLED_HEIGHT_PX))
        window = _windows(each.dataset, samples, spacing_s)
        windows.append(first_row + window)
        motions.append(_motion(each.dataset, samples, window))
        labels.append(labels_of(each.dataset, samples, camera, each.blocked, each.sight))
        episodes.append(first_episode + each.dataset.episode_of_sample[samples].astype(np.int64))
    return Looks(
        frames=frames,
        window=np.concatenate(windows),
        motion=np.concatenate(motions),
        labels=PerceptionLabels(
            people=np.concatenate([part.people for part in labels]),
            visible=np.concatenate([part.visible for part in labels]),
            rays_m=np.concatenate([part.rays_m for part in labels]),
        ),
        episode=np.concatenate(episodes),
    )


def grey_of(frames: UInt8Array) -> UInt8Array:
    """Rounded mean of the colours, which are the last axis."""
    red, green, blue = (frames[..., channel].astype(np.uint16) for channel in range(3))
    grey: UInt8Array = ((red + green + blue + 1) // 3).astype(np.uint8)
    return grey


def held_out(looks: Looks, share: float, seed: int) -> BoolArray:
    """True for the images of a share of the episodes, drawn, shape (N,)."""
    episodes = np.unique(looks.episode)
    count = min(max(1, round(share * len(episodes))), len(episodes) - 1) if share > 0 else 0
    drawn = np.random.default_rng([seed, 0xE9]).permutation(episodes)[:count]
    chosen: BoolArray = np.isin(looks.episode, drawn)
    return chosen


def _pooled_size(camera: CameraConfig) -> tuple[int, int, int]:
    pooling = pooling_of(camera, POOLED_HEIGHT_PX)
    return camera.height_px // pooling, camera.width_px // pooling, 3


def _taken(dataset: Dataset, share: float) -> Int64Array:
    """Samples with an image of a share of the episodes."""
    numbers = np.arange(len(dataset.episodes))
    taken = np.floor((numbers + 1) * share) > np.floor(numbers * share)
    return np.flatnonzero(dataset.pictured & taken[dataset.episode_of_sample])


def _decode(dataset: Dataset, samples: Int64Array, frames: UInt8Array, pooling: int) -> None:
    for row, index in enumerate(samples.tolist()):
        frames[row] = pool(dataset.decode(index), pooling)


def _windows(dataset: Dataset, samples: Int64Array, spacing_s: float) -> Int64Array:
    """Rows of `samples` that are seen together, shape (N, 3)."""
    episode = dataset.episode_of_sample[samples]
    window = np.empty((len(samples), FRAMES), np.int64)
    for number in np.unique(episode).tolist():
        rows = np.flatnonzero(episode == number)
        times_ns = dataset.time_ns[samples[rows]].tolist()
        for k in range(len(rows)):
            window[rows[k]] = rows[0] + np.array(window_at(times_ns[: k + 1], round(spacing_s * 1e9), FRAMES))
    return window


def _motion(dataset: Dataset, samples: Int64Array, window: Int64Array) -> Float32Array:
    poses = dataset.poses[samples][:, [0, 1, 3]]
    begins = samples == np.array([entry.first_sample for entry in dataset.episodes])[dataset.episode_of_sample[samples]]
    executed = np.where(begins[:, None], 0.0, dataset.actions[np.maximum(samples - 1, 0)]).astype(np.float32)
    return own_motion(poses[window[:, :-1]], poses, executed)
