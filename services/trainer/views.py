"""How episodes are shown in a batch: at random, alike for all samples of one episode."""

from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import BoolArray, Float32Array, Float64Array, Int64Array
from readygo.services.trainer.config import SamplingConfig
from readygo.services.trainer.light import draw_light

MIRRORED = 0.5
"""Share of the episodes of a batch that are mirrored left to right, with goals and turns."""
PHOTOMETRIC = 0.2
"""Largest relative change of brightness, contrast and colour."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BatchViews:
    """How each of G episodes is shown in a batch: turned, then shifted, then mirrored, in another light."""

    yaws_rad: Float64Array
    """Turn of the robot to the left [rad], shape (G,)."""
    shifts_px: Int64Array
    """Rows and columns by which the image moves down and right, shape (G, 2)."""
    mirrored: BoolArray
    """True where the image is mirrored, shape (G,)."""
    light: Float32Array
    """What the network is given for each byte of each colour, shape (G, 256, 3)."""


def draw_views(
    turnable: BoolArray, config: SamplingConfig, rng: np.random.Generator, *, mirrors: bool = True
) -> BatchViews:
    """A random view of each episode.

    Args:
        turnable: False where the robot must not be turned, shape (G,).
        config: How far.
        rng: Random generator.
        mirrors: False where the cameras are not their own mirror images.
    """
    count = len(turnable)
    yaws_rad = config.yaw_error_rad * np.clip(rng.normal(0.0, 1.0, count), -2.5, 2.5)
    return BatchViews(
        yaws_rad=np.where(turnable, yaws_rad, 0.0),
        shifts_px=rng.integers(-config.shift_px, config.shift_px + 1, (count, 2)),
        mirrored=rng.random(count) < (MIRRORED if mirrors else 0.0),
        light=draw_light(count, PHOTOMETRIC, rng),
    )


def plain_view() -> BatchViews:
    """What the camera saw, for a single episode or all of them."""
    zeros = np.zeros(1)
    return BatchViews(
        yaws_rad=zeros,
        shifts_px=np.zeros((1, 2), np.int64),
        mirrored=np.zeros(1, np.bool_),
        light=draw_light(1, 0.0, np.random.default_rng(0)),
    )
