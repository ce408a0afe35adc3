"""Sharpness of recorded images: finds episodes with fog in the data of any recorder."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from readygo.common.arrays import Float64Array, Int64Array
from readygo.common.dataset.reader import Dataset
from readygo.common.images.clarity import SHARP_FROM, sharpness

LOOKED_AT_MAX = 400
PER_EPISODE_MAX = 5


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedClarity:
    """Sharpness of some pictures, spread evenly over a dataset."""

    samples: Int64Array
    """The samples that were looked at, shape (K,), episode by episode."""
    sharpness: Float64Array
    """Sharpness of these samples' images, from `readygo.common.images.clarity`, shape (K,)."""
    of_episode: Float64Array
    """Median sharpness of each episode that was looked at, shape (E,)."""

    @property
    def blurred(self) -> int:
        """Episodes of those that show fog."""
        return int(np.count_nonzero(self.of_episode < SHARP_FROM))

    def to_mapping(self) -> dict[str, Any]:
        """Summary as plain values, for JSON."""
        return {
            "sharpness_median": round(float(np.median(self.sharpness)), 1),
            "sharpness_5_percent": round(float(np.quantile(self.sharpness, 0.05)), 1),
            "episodes_looked_at": len(self.of_episode),
            "episodes_blurred": self.blurred,
        }

    def __str__(self) -> str:
        return (
            f"sharpness {np.median(self.sharpness):.0f} (5 % below {np.quantile(self.sharpness, 0.05):.0f}); "
            f"{self.blurred} of {len(self.of_episode)} episodes blurred (below {SHARP_FROM:g})"
        )


def recorded_clarity(dataset: Dataset) -> RecordedClarity:
    """Look at up to 400 pictures, five of an episode at most: as long runs take no longer.

    Raises:
        DatasetError: If a picture is damaged.
    """
    count = len(dataset.episodes)
    chosen = np.unique(np.arange(LOOKED_AT_MAX) * count // LOOKED_AT_MAX)
    each = min(PER_EPISODE_MAX, max(1, LOOKED_AT_MAX // count))
    shares = (2 * np.arange(each) + 1) / (2 * each)
    entries = [dataset.episodes[number] for number in chosen.tolist()]
    samples = np.array([entry.first_sample + (entry.sample_count * shares).astype(np.int64) for entry in entries])
    samples = np.array([[_last_with_image(dataset, index) for index in row] for row in samples.tolist()])
    values = np.array([[sharpness(dataset.decode(index)) for index in row] for row in samples.tolist()])
    return RecordedClarity(samples=samples.ravel(), sharpness=values.ravel(), of_episode=np.median(values, axis=1))


def _last_with_image(dataset: Dataset, index: int) -> int:
    """The sample, or the one before it that has a picture: a camera may be slower than the robot."""
    while not dataset.image(index):
        index -= 1
    return index
