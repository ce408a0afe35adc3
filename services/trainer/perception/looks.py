"""Images with what perception shall tell of them, in memory."""

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
class Looks:
    """N images, with the two before each."""

    frames: UInt8Array
    """All images, pooled, shape (N, H, W, 3)."""
    grey: UInt8Array
    """Mean of their colours, shape (N, H, W)."""
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
    """Memory that an image takes: its pooled colours and their mean."""
    pooling = pooling_of(camera, POOLED_HEIGHT_PX)
    return 4 * (camera.height_px // pooling) * (camera.width_px // pooling)


def looks_of(
    dataset: Dataset,
    camera: CameraConfig,
    blocked: OccupancyMap,
    sight: SightMap,
    spacing_s: float,
    *,
    share: float = 1.0,
) -> Looks:
    """The images of data that were recorded in one scene.

    Args:
        dataset: The recorded episodes.
        camera: The robot's camera.
        blocked: What blocks the robot in the scene.
        sight: What hides humans there.
        spacing_s: Time between the images that are seen together [s].
        share: Share of the episodes, spread evenly, whose images are taken.

    Raises:
        DatasetError: If a shard is damaged.
    """
    numbers = np.arange(len(dataset.episodes))
    taken = np.floor((numbers + 1) * share) > np.floor(numbers * share)
    samples = np.flatnonzero(dataset.pictured & taken[dataset.episode_of_sample])
    pooling = pooling_of(camera, POOLED_HEIGHT_PX)
    size = camera.height_px // pooling, camera.width_px // pooling, 3
    frames = np.empty((len(samples), *size), np.uint8)
    for row, index in enumerate(samples.tolist()):
        frames[row] = pool(dataset.decode(index), pooling)
    episode = dataset.episode_of_sample[samples].astype(np.int64)
    window = np.empty((len(samples), FRAMES), np.int64)
    spacing_ns = round(spacing_s * 1e9)
    for number in np.unique(episode).tolist():
        rows = np.flatnonzero(episode == number)
        times_ns = dataset.time_ns[samples[rows]].tolist()
        for k in range(len(rows)):
            window[rows[k]] = rows[0] + np.array(window_at(times_ns[: k + 1], spacing_ns, FRAMES))
    poses = dataset.poses[samples][:, [0, 1, 3]]
    begins = samples == np.array([entry.first_sample for entry in dataset.episodes])[episode]
    executed = np.where(begins[:, None], 0.0, dataset.actions[np.maximum(samples - 1, 0)]).astype(np.float32)
    return Looks(
        frames=frames,
        grey=grey_of(frames),
        window=window,
        motion=own_motion(poses[window[:, :-1]], poses, executed),
        labels=labels_of(dataset, samples, camera, blocked, sight),
        episode=episode,
    )


def joined(parts: Sequence[Looks]) -> Looks:
    """The images of several data folders as one."""
    if len(parts) == 1:
        return parts[0]
    first_frames = np.cumsum([0, *(len(part.frames) for part in parts)])
    first_episodes = np.cumsum([0, *(int(part.episode.max(initial=-1)) + 1 for part in parts)])
    return Looks(
        frames=np.concatenate([part.frames for part in parts]),
        grey=np.concatenate([part.grey for part in parts]),
        window=np.concatenate([part.window + first for part, first in zip(parts, first_frames, strict=False)]),
        motion=np.concatenate([part.motion for part in parts]),
        labels=PerceptionLabels(
            people=np.concatenate([part.labels.people for part in parts]),
            visible=np.concatenate([part.labels.visible for part in parts]),
            rays_m=np.concatenate([part.labels.rays_m for part in parts]),
        ),
        episode=np.concatenate([part.episode + first for part, first in zip(parts, first_episodes, strict=False)]),
    )


def grey_of(frames: UInt8Array) -> UInt8Array:
    """Mean of the colours, a frame at a time."""
    grey = np.empty(frames.shape[:3], np.uint8)
    for row, frame in enumerate(frames):
        red, green, blue = (frame[..., channel].astype(np.uint16) for channel in range(3))
        grey[row] = (red + green + blue + 1) // 3
    return grey


def held_out(looks: Looks, share: float, seed: int) -> BoolArray:
    """True for the images of a share of the episodes, drawn, shape (N,)."""
    episodes = np.unique(looks.episode)
    count = min(max(1, round(share * len(episodes))), len(episodes) - 1) if share > 0 else 0
    drawn = np.random.default_rng([seed, 0xE9]).permutation(episodes)[:count]
    chosen: BoolArray = np.isin(looks.episode, drawn)
    return chosen
