"""Random changes to training samples."""

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from services.trainer.samples import Indices


def vary_light(images: Tensor, groups: Indices, strength: float, rng: np.random.Generator) -> None:
    """Change contrast, brightness and colour in place, alike for all frames of one group.

    Args:
        images: Frames in [-1, 1], shape (F, 3, H, W).
        groups: What belongs together, such as an episode, for each frame, shape (F,).
        strength: Largest relative change.
        rng: Random generator.
    """
    if strength == 0:
        return
    names, member = np.unique(groups, return_inverse=True)
    contrast = 1 + rng.uniform(-strength, strength, (len(names), 1))
    colour = 1 + rng.uniform(-strength, strength, (len(names), 3)) / 2
    brightness = rng.uniform(-strength, strength, (len(names), 1))
    gain = (contrast * colour)[member].astype(np.float32)
    offset = (brightness + colour - 1)[member].astype(np.float32)
    images.mul_(torch.from_numpy(gain)[:, :, None, None]).add_(torch.from_numpy(offset)[:, :, None, None])


def shift_frames(
    frames: npt.NDArray[np.uint8], groups: Indices, limit_px: int, rng: np.random.Generator
) -> npt.NDArray[np.uint8]:
    """Shift frames by a few pixels, alike for all frames of one group; the edge is repeated.

    Args:
        frames: Frames, shape (F, H, W, 3).
        groups: What belongs together, for each frame, shape (F,).
        limit_px: Largest shift along rows and columns [px].
        rng: Random generator.
    """
    if limit_px == 0:
        return frames
    names, member = np.unique(groups, return_inverse=True)
    shifts_px = rng.integers(-limit_px, limit_px + 1, (len(names), 2))[member]
    rows = np.clip(np.arange(frames.shape[1]) + shifts_px[:, :1], 0, frames.shape[1] - 1)
    columns = np.clip(np.arange(frames.shape[2]) + shifts_px[:, 1:], 0, frames.shape[2] - 1)
    shifted = np.empty_like(frames)
    for k, frame in enumerate(frames):
        shifted[k] = frame[rows[k]][:, columns[k]]
    return shifted


def corrupt_previous(previous: Tensor, noise: float, dropout: float, rng: np.random.Generator) -> Tensor:
    """Previous actions with noise, and withheld (zero) in some samples.

    An imitator that sees the previous action learns to repeat it: consecutive actions of an expert hardly differ, and
    the copy scores well on recorded data but never starts or stops by itself.

    Args:
        previous: Normalised previous actions, shape (B, 2).
        noise: Standard deviation of the noise.
        dropout: Probability that a sample's previous action is withheld.
        rng: Random generator.

    Source: Wen et al., Fighting copycat agents in behavioral cloning from observation histories, 2020.
    """
    disturbed = previous + torch.from_numpy(rng.normal(0.0, noise, previous.shape).astype(np.float32))
    kept = rng.random((len(previous), 1)) >= dropout
    return disturbed * torch.from_numpy(kept.astype(np.float32))
