"""The light that frames are shown in: tables from bytes to what the network is given."""

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from readygo.common.arrays import Float32Array, Int64Array, UInt8Array
from readygo.common.images.names import RGB, kind_of


def draw_light(count: int, strength: float, rng: np.random.Generator) -> Float32Array:
    """Contrast, brightness and colour of episodes, as tables from bytes to numbers around [-1, 1].

    Args:
        count: Number of episodes.
        strength: Largest relative change.
        rng: Random generator.

    Returns:
        Shape (count, 256, 3).
    """
    contrast = 1 + rng.uniform(-strength, strength, (count, 1, 1))
    colour = 1 + rng.uniform(-strength, strength, (count, 1, 3)) / 2
    brightness = rng.uniform(-strength, strength, (count, 1, 1))
    plain = (np.arange(256) / 127.5 - 1)[:, None]
    tables: Float32Array = (contrast * colour * plain + brightness + colour - 1).astype(np.float32)
    return tables


def lit(frames: UInt8Array, groups: Int64Array, light: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
    """What the network is given for frames.

    Args:
        frames: Frames, shape (F, H, W, C).
        groups: Row of each frame's episode in `light`, shape (F,).
        light: Tables from bytes, of float32 or of 16 bits that stand for bfloat16, shape (G, 256, C).

    Returns:
        Of the type of `light`, shape (F, H, W, C).
    """
    shown = np.empty(frames.shape, light.dtype)
    for row, group in enumerate(groups.tolist()):
        cv2.LUT(frames[row], light[group][None], dst=shown[row])
    return shown


def light_on(light: Float32Array, images: Sequence[str]) -> Float32Array:
    """Tables of the channels of some images: of colours the light's, of depths what changes nothing, (G, 256, C)."""
    if len(images) == 1:
        return light
    plain = np.broadcast_to(draw_light(1, 0.0, np.random.default_rng(0))[..., :1], (len(light), 256, 1))
    return np.concatenate([light if kind_of(name) == RGB else plain for name in images], axis=2)
