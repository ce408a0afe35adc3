"""Which steps of an episode a policy sees together: the one definition for training, driving and reading data."""

import numpy as np
import numpy.typing as npt

from readygo.common.robot.kinematics import DT_S, RATE_HZ

FRAME_COUNT = 3
"""Images that a policy sees together, where it does not say."""


def window_rows(
    newest: npt.ArrayLike, first: npt.ArrayLike, spacing_steps: int, frame_count: int = FRAME_COUNT
) -> npt.NDArray[np.int64]:
    """The rows of a window, oldest first; an episode's first row stands in for what was before it.

    Args:
        newest: Row of the newest image of each window, shape (...).
        first: First row of each window's episode, shape (...).
        spacing_steps: Steps between the images.
        frame_count: Images of a window.

    Returns:
        Shape (..., frame_count).
    """
    back = spacing_steps * np.arange(frame_count - 1, -1, -1)
    rows: npt.NDArray[np.int64] = np.maximum(np.asarray(newest)[..., None] - back, np.asarray(first)[..., None])
    return rows


def spacing_steps_of(spacing_s: float, *, name: str = "frame_spacing_s") -> int:
    """Steps between images that are `spacing_s` [s] apart.

    Raises:
        ValueError: If that is not a positive multiple of the step.
    """
    steps = spacing_s * RATE_HZ
    if steps < 1 or abs(steps - round(steps)) > 1e-6:
        raise ValueError(f"{name} must be a multiple of {DT_S} s, got {spacing_s}.")
    return round(steps)
