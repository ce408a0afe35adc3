"""Random changes to training samples."""

import math

import cv2
import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from readygo.common.frames import goals_in_robot_frames
from readygo.services.trainer.samples import Indices, SampleTable

NEAR_M = 1.0
"""Goals are reached at this distance [m]."""


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


def draw_yaws(groups: Indices, sigma_rad: float, rng: np.random.Generator) -> npt.NDArray[np.float64]:
    """A yaw error [rad] for each row, alike within a group, cut off at 2.5 standard deviations.

    Args:
        groups: What belongs together, for each row, shape (F,).
        sigma_rad: Standard deviation [rad].
        rng: Random generator.
    """
    names, member = np.unique(groups, return_inverse=True)
    yaws: npt.NDArray[np.float64] = sigma_rad * np.clip(rng.normal(0.0, 1.0, len(names)), -2.5, 2.5)[member]
    return yaws


def turn_frames(
    frames: npt.NDArray[np.uint8], yaws_rad: npt.NDArray[np.float64], K_px: npt.NDArray[np.float64]
) -> npt.NDArray[np.uint8]:
    """What a level camera would have seen, had the robot been turned to the left; the edge is repeated.

    A rotation moves pixels the same way at every depth, so that the images are exact but for what was out of view.

    Args:
        frames: Frames, shape (F, H, W, 3).
        yaws_rad: Turn of each frame to the left [rad], shape (F,).
        K_px: Intrinsics [px], pixel centres at +0.5, shape (3, 3).
    """
    # OpenCV's warp counts pixel centres from 0.
    K = np.array([[1.0, 0.0, -0.5], [0.0, 1.0, -0.5], [0.0, 0.0, 1.0]]) @ K_px
    turned = np.empty_like(frames)
    for k, (frame, yaw_rad) in enumerate(zip(frames, yaws_rad.tolist(), strict=True)):
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        R_before_after = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
        turned[k] = cv2.warpPerspective(
            frame,
            K @ R_before_after @ np.linalg.inv(K),
            (frame.shape[1], frame.shape[0]),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
    return turned


def correct_for_turn(
    actions: Tensor, goals_xy_m: Tensor, yaws_rad: Tensor, gain_per_s: float, w_max_radps: float
) -> tuple[Tensor, Tensor]:
    """Action and goal of samples whose robot was turned to the left by `yaws_rad`.

    Args:
        actions: v [m/s], w [rad/s], shape (B, 2).
        goals_xy_m: Goals in the robot's frame [m], shape (B, 2).
        yaws_rad: Turn of each robot [rad], shape (B,).
        gain_per_s: Turn rate per yaw error that brings the robot back [1/s].
        w_max_radps: Limit of the corrected turn rate [rad/s].

    Source: Bojarski et al., End to end learning for self-driving cars, 2016 (rotated views with corrected steering).
    """
    c, s = torch.cos(yaws_rad), torch.sin(yaws_rad)
    x, y = goals_xy_m.unbind(1)
    w = (actions[:, 1] - gain_per_s * yaws_rad).clamp(-w_max_radps, w_max_radps)
    return torch.stack([actions[:, 0], w], dim=1), torch.stack([c * x + s * y, c * y - s * x], dim=1)


def hindsight_goals(
    table: SampleTable, samples: Indices, share: float, rng: np.random.Generator
) -> npt.NDArray[np.float32]:
    """Goals of samples, some of them replaced by a place that the robot reached later in the same episode.

    What the expert did was right for every place that it came to, so that one episode teaches many goals. Places within
    `NEAR_M` are no goals: an episode ends before the robot is that near.

    Args:
        table: Poses, goals and episodes.
        samples: Sample indices, shape (B,).
        share: Probability that a sample's goal is replaced.
        rng: Random generator.

    Returns:
        Goals in the robot's frame [m], shape (B, 2).

    Source: Andrychowicz et al., Hindsight experience replay, 2017; Ghosh et al., Learning to reach goals via iterated
    supervised learning, 2019.
    """
    later = samples + np.ceil(rng.random(len(samples)) * (table.last[samples] - samples)).astype(np.int64)
    reached = goals_in_robot_frames(table.xyyaw[samples], table.xyyaw[later, :2]).astype(np.float32)
    dx, dy = (table.xyyaw[later, :2] - table.xyyaw[samples, :2]).T
    replaced = (rng.random(len(samples)) < share) & (dx * dx + dy * dy > NEAR_M**2)
    goals: npt.NDArray[np.float32] = np.where(replaced[:, None], reached, table.goals_xy_m[samples])
    return goals


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
