"""What perception has of the images of episodes, kept in memory: a pretrained encoder looks at each image once."""

from collections.abc import Callable

import numpy as np

from readygo.common.arrays import Float16Array, Int64Array
from readygo.services.trainer.frames import FrameCache
from readygo.services.trainer.samples import TrainingSamples

Look = Callable[[TrainingSamples, FrameCache, Int64Array], Float16Array]
"""What perception has of samples of an episode, shape (B, LOOKED, C)."""


class LookCache:
    """What perception has of a reservoir's episodes; those asked for first stay.

    An episode that does not fit is looked at again for each batch.
    """

    def __init__(self, frames: FrameCache, *, limit_bytes: int) -> None:
        """Without an episode so far.

        Args:
            frames: The images.
            limit_bytes: Most memory for what is kept.
        """
        self._frames, self._limit_bytes = frames, limit_bytes
        self._kept: dict[str, tuple[Int64Array, Float16Array]] = {}
        """By episode: steps, ascending, and what perception has of them."""
        self._bytes = 0

    def get(self, table: TrainingSamples, samples: Int64Array, look: Look) -> Float16Array:
        """What perception has of usable samples, shape (B, LOOKED, C).

        An episode is looked at as a whole: the numbers do not depend on which samples were asked for.

        Args:
            table: The reservoir's samples.
            samples: Numbers of the samples.
            look: Looks.

        Raises:
            DatasetError: If an image is damaged.
        """
        self._forget_dropped(table)
        parts, places = [], []
        for row in np.unique(table.episode[samples]).tolist():
            here = np.flatnonzero(table.episode[samples] == row)
            steps, looked = self._episode(table, row, look)
            places.append(here)
            parts.append(looked[np.searchsorted(steps, samples[here] - table.first[samples[here]])])
        found = np.empty((len(samples), *parts[0].shape[1:]), np.float16)
        found[np.concatenate(places)] = np.concatenate(parts)
        return found

    def _episode(self, table: TrainingSamples, row: int, look: Look) -> tuple[Int64Array, Float16Array]:
        name = table.names[row]
        if name in self._kept:
            return self._kept[name]
        samples = np.flatnonzero(table.usable & (table.episode == row))
        made = samples - table.first[samples], look(table, self._frames, samples)
        if self._bytes + made[1].nbytes <= self._limit_bytes:
            self._kept[name], self._bytes = made, self._bytes + made[1].nbytes
        return made

    def _forget_dropped(self, table: TrainingSamples) -> None:
        for name in self._kept.keys() - set(table.names):
            self._bytes -= self._kept.pop(name)[1].nbytes
