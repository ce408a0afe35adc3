"""Which steps of an episode a policy sees together: the one definition for training, driving and reading data."""

from bisect import bisect_left
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import Int64Array

FRAME_COUNT = 3
"""Images that a policy sees together, where it does not say."""


def window_rows(
    newest: npt.ArrayLike,
    first: npt.ArrayLike,
    spacing_steps: int,
    frame_count: int = FRAME_COUNT,
    image_every: int = 1,
) -> Int64Array:
    """The rows of a window, oldest first; an episode's first row stands in for what was before it.

    Args:
        newest: Row of the newest image of each window, shape (...).
        first: First row of each window's episode, shape (...).
        spacing_steps: Steps between the images.
        frame_count: Images of a window.
        image_every: Steps from one image to the next: where `newest` has none, the one before it is the newest.

    Returns:
        Shape (..., frame_count).
    """
    back = spacing_steps * np.arange(frame_count - 1, -1, -1)
    since = np.maximum(np.asarray(newest) - np.asarray(first), 0) // image_every * image_every
    rows: Int64Array = np.maximum(since[..., None] - back, 0) + np.asarray(first)[..., None]
    return rows


def window_at(times_ns: Sequence[int], spacing_ns: int, frame_count: int = FRAME_COUNT) -> list[int]:
    """`window_rows` of images that come at any time, the newest of which is the last: the nearest to each spacing.

    Args:
        times_ns: When the images were taken [ns], rising, one or more.
        spacing_ns: Time between the images of a window [ns].
        frame_count: Images of a window.

    Returns:
        `frame_count` rows, oldest first; of two that are as near the older one.
    """
    rows = []
    for back in range(frame_count - 1, -1, -1):
        wanted_ns = times_ns[-1] - back * spacing_ns
        row = bisect_left(times_ns, wanted_ns)
        if row > 0 and wanted_ns - times_ns[row - 1] <= times_ns[row] - wanted_ns:
            row -= 1
        rows.append(row)
    return rows
