"""Samples of the published networks: the images of the last second, one of a goal, and where the robot went."""

from dataclasses import dataclass

import numpy as np
import torch

from readygo.common.arrays import BoolArray, Float32Array, Float64Array, Int64Array
from readygo.common.dataset import Dataset
from readygo.common.errors import DatasetError
from readygo.common.messages import DriverKind
from readygo.common.networks import LOOK_HZ
from readygo.common.networks.images import normalise_images, small_image
from readygo.services.trainer.networks.config import GOAL_LOOKS_MAX

LOOKS_MIN = 4
"""Shorter trajectories teach nothing."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Looks:
    """L images of trajectories, a quarter of a second apart, in the order of the trajectories."""

    rows: Int64Array
    """Samples of the dataset, shape (L,)."""
    first: Int64Array
    """First look of each one's trajectory, shape (L,)."""
    last: Int64Array
    """Last look of each one's trajectory, shape (L,)."""
    xyyaw: Float64Array
    """Robot's pose: x, y [m], yaw [rad], shape (L, 3)."""
    unit_m: float
    """Way between two looks at full speed [m]."""

    def __len__(self) -> int:
        return len(self.rows)


@dataclass(frozen=True, kw_only=True, eq=False)
class NetworkBatch:
    """B samples of a network."""

    images: torch.Tensor
    """Latest images, oldest first, shape (B, frames, 3, H, W)."""
    goals: torch.Tensor
    """Images of goals, shape (B, 3, H, W)."""
    distances: torch.Tensor
    """Looks until the goal, shape (B,)."""
    places: torch.Tensor
    """Where the robot went: x forward, y left in units of `Looks.unit_m`, cosine and sine of its heading,
    shape (B, T, 4)."""
    other: torch.Tensor
    """True where the goal is out of another trajectory, shape (B,)."""


def looks_of(dataset: Dataset, names: set[str]) -> Looks:
    """The looks of the expert's episodes.

    Args:
        dataset: Recorded episodes.
        names: Ids of those that are taken.

    Raises:
        DatasetError: If there are not two trajectories, or the robot is unknown.
    """
    if dataset.robot is None:
        raise DatasetError("These data do not say what robot drove; record them again.")
    if dataset.robot.ranges.varies:
        raise DatasetError("These data are of several robots, which the published networks are not told apart.")
    clock = dataset.robot.clock
    steps = clock.nearest_images(1 / LOOK_HZ)
    trajectories = []
    for entry in dataset.episodes:
        if entry.episode.episode_id in names and entry.driver is DriverKind.EXPERT:
            rows = np.arange(entry.first_sample, entry.first_sample + entry.sample_count, steps)
            if len(rows) >= LOOKS_MIN and dataset.pictured[rows].all():
                trajectories.append(rows)
    if len(trajectories) < 2:
        raise DatasetError(
            f"Networks learn from two or more of the expert's episodes with an image every {1 / LOOK_HZ:g} s; there "
            f"are {len(trajectories)}."
        )
    counts = np.array([len(rows) for rows in trajectories])
    begins = np.cumsum(counts) - counts
    rows = np.concatenate(trajectories)
    return Looks(
        rows=rows,
        first=np.repeat(begins, counts),
        last=np.repeat(begins + counts - 1, counts),
        xyyaw=dataset.poses[rows][:, [0, 1, 3]],
        unit_m=dataset.robot.v_max_mps * steps / clock.rate_hz,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Choice:
    """Which looks make a batch, and with which goals."""

    looks: Int64Array
    """The present ones, shape (B,)."""
    goals: Int64Array
    """Looks at goals, shape (B,)."""
    distances: Int64Array
    """Looks until the goal, shape (B,)."""
    other: BoolArray
    """True where the goal is out of another trajectory, shape (B,)."""


def choose(looks: Looks, count: int, rng: np.random.Generator) -> Choice:
    """Draw samples as published: a goal up to 20 looks ahead, or out of another trajectory where that is 0."""
    present = rng.integers(len(looks), size=count)
    ahead = np.minimum(looks.last[present] - present, GOAL_LOOKS_MAX)
    distances = rng.integers(ahead + 1)
    other = distances == 0
    sizes = looks.last[present] - looks.first[present] + 1
    # Any look but those of the same trajectory: drawn among the others, and moved behind it.
    elsewhere = rng.integers(len(looks) - sizes)
    elsewhere += np.where(elsewhere >= looks.first[present], sizes, 0)
    goals = np.where(other, elsewhere, present + distances)
    return Choice(looks=present, goals=goals, distances=np.where(other, GOAL_LOOKS_MAX, distances), other=other)


def places_of(looks: Looks, present: Int64Array, count: int) -> Float32Array:
    """Where the robot was at the next looks, see `NetworkBatch.places`; at a trajectory's end it stays there."""
    following = np.minimum(present[:, None] + np.arange(1, count + 1), looks.last[present][:, None])
    now, then = looks.xyyaw[present][:, None], looks.xyyaw[following]
    delta, turned = then[..., :2] - now[..., :2], then[..., 2] - now[..., 2]
    cos, sin = np.cos(now[..., 2]), np.sin(now[..., 2])
    forward = (cos * delta[..., 0] + sin * delta[..., 1]) / looks.unit_m
    left = (cos * delta[..., 1] - sin * delta[..., 0]) / looks.unit_m
    return np.stack([forward, left, np.cos(turned), np.sin(turned)], axis=-1).astype(np.float32)


class Pictures:
    """Images of looks at a network's size; as many are kept as fit."""

    def __init__(self, dataset: Dataset, looks: Looks, width_px: int, height_px: int, cache_mb: int) -> None:
        self._dataset, self._looks = dataset, looks
        self._size = width_px, height_px
        self._kept: dict[int, torch.Tensor] = {}
        self._kept_max = cache_mb * 1_000_000 // (3 * width_px * height_px)

    def of(self, looks: Int64Array) -> torch.Tensor:
        """Images as a network takes them, shape (*looks.shape, 3, H, W)."""
        images = torch.stack([self._one(int(look)) for look in looks.reshape(-1)])
        return normalise_images(images.float() / 255).reshape(*looks.shape, *images.shape[1:])

    def _one(self, look: int) -> torch.Tensor:
        """One image in 8 bits."""
        if look in self._kept:
            return self._kept[look]
        image = small_image(self._dataset.decode(int(self._looks.rows[look])), *self._size)
        small = (image * 255).round().to(torch.uint8)
        if len(self._kept) < self._kept_max:
            self._kept[look] = small
        return small


def make_batch(looks: Looks, pictures: Pictures, choice: Choice, *, frames: int, places: int) -> NetworkBatch:
    """The batch of some samples; before a trajectory's start its first image is seen.

    Args:
        looks: Of the data.
        pictures: Their images.
        choice: Which ones.
        frames: Images that the network looks at.
        places: That it shall name.
    """
    window = np.maximum(choice.looks[:, None] - np.arange(frames - 1, -1, -1), looks.first[choice.looks][:, None])
    return NetworkBatch(
        images=pictures.of(window),
        goals=pictures.of(choice.goals),
        distances=torch.from_numpy(choice.distances.astype(np.float32)),
        places=torch.from_numpy(places_of(looks, choice.looks, places)),
        other=torch.from_numpy(choice.other),
    )
