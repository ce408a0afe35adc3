"""Random changes to training samples."""

import math

import cv2
import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from readygo.common.camera import CameraConfig
from readygo.common.camera.lens import make_lens
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


class TurnedCamera:
    """What a robot's camera would have seen, had the robot been turned on the spot.

    A rotation moves pixels the same way at every depth, so that the images are exact but for what was out of view: the
    edge is repeated there. A camera that is not above the robot's centre also moves a little, which is left out. What
    varies of a lens between episodes is left out as well: all frames have the lens of `robot.toml`.
    """

    def __init__(self, camera: CameraConfig) -> None:
        self._lens = make_lens(camera)
        self._R_robot_camera = camera.T_world_camera(0.0, 0.0, 0.0, 0.0)[:3, :3]
        columns, rows = np.meshgrid(np.arange(camera.width_px) + 0.5, np.arange(camera.height_px) + 0.5)
        self._shape = columns.shape
        xy = self._lens.rays(np.stack([columns.ravel(), rows.ravel()], axis=1))
        self._rays = np.concatenate([xy, np.ones((len(xy), 1))], axis=1)

    def turn(self, frames: npt.NDArray[np.uint8], yaws_rad: npt.NDArray[np.float64]) -> npt.NDArray[np.uint8]:
        """The frames of robots that are turned to the left.

        Args:
            frames: Frames, shape (F, H, W, 3).
            yaws_rad: Turn of each frame to the left [rad], shape (F,).
        """
        warp = self._warped if self._lens.distortion == "none" else self._remapped
        turned = np.empty_like(frames)
        for yaw_rad in np.unique(yaws_rad).tolist():
            rows = np.flatnonzero(yaws_rad == yaw_rad)
            turned[rows] = warp(frames[rows], self._rotation(yaw_rad))
        return turned

    def _rotation(self, yaw_rad: float) -> npt.NDArray[np.float64]:
        """From the turned camera's axes to those before, shape (3, 3)."""
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        R_before_after = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        R: npt.NDArray[np.float64] = self._R_robot_camera.T @ R_before_after @ self._R_robot_camera
        return R

    def _warped(self, frames: npt.NDArray[np.uint8], R: npt.NDArray[np.float64]) -> npt.NDArray[np.uint8]:
        """Without a lens a rotation is a homography."""
        # OpenCV's warp counts pixel centres from 0.
        K = np.array([[1.0, 0.0, -0.5], [0.0, 1.0, -0.5], [0.0, 0.0, 1.0]]) @ self._lens.K_px
        H, size = K @ R @ np.linalg.inv(K), (self._shape[1], self._shape[0])
        flags, border = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, cv2.BORDER_REPLICATE
        return np.stack([cv2.warpPerspective(frame, H, size, flags=flags, borderMode=border) for frame in frames])

    def _remapped(self, frames: npt.NDArray[np.uint8], R: npt.NDArray[np.float64]) -> npt.NDArray[np.uint8]:
        """Through the lens: every pixel's ray, turned, and the pixel that saw it before."""
        x, y, ahead = (self._rays @ R.T).T
        xy = np.stack([x, y], axis=1) / np.maximum(ahead, 1e-6)[:, None]
        # Beyond what the lens can show its polynomial would turn back into the image.
        xy *= np.minimum(1.0, self._lens.radius_max / np.maximum(np.hypot(xy[:, 0], xy[:, 1]), 1e-12))[:, None]
        columns, rows = (self._lens.pixels(xy) - 0.5).astype(np.float32).T.reshape(2, *self._shape)
        border = cv2.BORDER_REPLICATE
        return np.stack([cv2.remap(frame, columns, rows, cv2.INTER_LINEAR, borderMode=border) for frame in frames])


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
