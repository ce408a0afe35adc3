"""The network that perceives: three frames, the older ones turned to the newest one's heading, to maps over columns.

The image is halved vertically more often than horizontally: a quarter of its columns stay, 32 of 128. Other numbers of
columns are resampled to 32. Each has a feature vector at the end, from which its distances, velocities and its free
distance are read. What else moved than the robot's heading is seen as the difference of the frames; how the robot
itself moved is told.
"""

import numpy as np
import torch
from torch import Tensor, nn

from readygo.common.arrays import Float64Array
from readygo.common.camera.config import CameraConfig
from readygo.common.perception.artifact import FRAMES
from readygo.common.perception.grid import SHAPE, polar_grid
from readygo.common.perception.people import CHANNELS
from readygo.services.trainer.pooling import pooling_of

POOLED_HEIGHT_PX = 72
_LOG_SD_MIN, _LOG_SD_MAX = -4.0, 1.5
_PRESENCE_BIAS = -4.0
"""Logit of a cell's probability at first: few cells hold a human."""


class Residual(nn.Module):
    """Two 3x3 convolutions around which the input goes."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(channels, channels, 3, padding=1, bias=False)
        self.norm1 = nn.BatchNorm2d(channels)
        self.conv2 = nn.Conv2d(channels, channels, 3, padding=1, bias=False)
        self.norm2 = nn.BatchNorm2d(channels)

    def forward(self, x: Tensor) -> Tensor:
        """Feature maps of one shape."""
        y = nn.functional.relu(self.norm1(self.conv1(x)))
        out: Tensor = nn.functional.relu(x + self.norm2(self.conv2(y)))
        return out


class Down(nn.Sequential):
    """A convolution that makes the image smaller."""

    def __init__(self, channels_in: int, channels_out: int, size: int, stride: tuple[int, int]) -> None:
        super().__init__(
            nn.Conv2d(channels_in, channels_out, size, stride=stride, padding=size // 2, bias=False),
            nn.BatchNorm2d(channels_out),
            nn.ReLU(),
        )


class ColumnBlock(nn.Module):
    """A convolution across the columns, around which the input goes."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.conv = nn.Conv1d(channels, channels, 5, padding=2)

    def forward(self, x: Tensor) -> Tensor:
        """Features of columns, shape (B, C, 32)."""
        out: Tensor = nn.functional.relu(x + self.conv(x))
        return out


class PerceptionNet(nn.Module):
    """Frames and own motion -> logits, offsets and deviations of the cells, and free distances."""

    motion_scale: Tensor
    rays: Tensor
    axes: Tensor
    to_grid: Tensor
    resampling: Tensor | None
    """Weights from the image's columns to those of the grid, shape (N, 32); None where the image has 32."""

    def __init__(self, camera: CameraConfig, widths: tuple[int, ...]) -> None:
        super().__init__()
        self.pooling = pooling_of(camera, POOLED_HEIGHT_PX)
        height, width = camera.height_px // self.pooling, camera.width_px // self.pooling
        a, b, c, d, neck = widths
        self.image = nn.Sequential(
            Down(3 + FRAMES - 1, a, 5, (2, 2)),
            Down(a, b, 3, (2, 2)),
            Residual(b),
            Down(b, c, 3, (2, 1)),
            Residual(c),
            Down(c, d, 3, (2, 1)),
            Residual(d),
        )
        rows = height
        for _ in range(4):
            rows = (rows + 1) // 2
        self.neck = nn.Conv1d(d * rows, neck, 1)
        self.motion = nn.Linear(3 * (FRAMES - 1) + 2, neck)
        self.columns = nn.Sequential(ColumnBlock(neck), ColumnBlock(neck))
        self.people = nn.Conv1d(neck, CHANNELS * SHAPE[0], 1)
        self.free = nn.Conv1d(neck, 2, 1)
        with torch.no_grad():
            self.people.bias.view(CHANNELS, SHAPE[0])[0] = _PRESENCE_BIAS  # type: ignore[union-attr]
        scale = [2.0, 5.0, 2.0] * (FRAMES - 1) + [1.0, 1.0]
        self.register_buffer("motion_scale", torch.tensor(scale), persistent=False)
        self.register_buffer("rays", _rays(camera, height, width), persistent=False)
        axes, to_grid = _matrices(camera)
        self.register_buffer("axes", torch.from_numpy(axes).float(), persistent=False)
        self.register_buffer("to_grid", torch.from_numpy(to_grid).float(), persistent=False)
        self.register_buffer("resampling", _resampling(width), persistent=False)

    def forward(self, shown: Tensor, motion: Tensor) -> tuple[Tensor, Tensor]:
        """What the network answers.

        Args:
            shown: See `stack`, shape (B, 5, H, W); channels_last is fastest.
            motion: See `readygo.common.policy.motion.own_motion`, shape (B, 8).

        Returns:
            Maps of people, shape (B, 9, D, C): logit of presence; offsets from the cell's bearing [rad] and from the
            logarithm of its distance; velocities [m/s]; logarithms of four deviations. And of each column the
            logarithm of the free distance [m] and that of its deviation, shape (B, 2, C).
        """
        return self.read(self.features(shown, motion))

    def features(self, shown: Tensor, motion: Tensor) -> Tensor:
        """Feature vectors of the columns, shape (B, F, C); arguments as in `forward`."""
        image = self.image(shown)
        columns = self.neck(image.flatten(1, 2))
        if self.resampling is not None:
            columns = columns @ self.resampling
        columns = columns + self.motion(motion * self.motion_scale)[:, :, None]
        features: Tensor = self.columns(nn.functional.relu(columns))
        return features

    def read(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """What `forward` answers, from the features of the columns."""
        people = self.people(features).float().view(-1, CHANNELS, *SHAPE)
        free = self.free(features).float()
        people = torch.cat([people[:, :5], people[:, 5:].clamp(_LOG_SD_MIN, _LOG_SD_MAX)], dim=1)
        return people, torch.cat([free[:, :1], free[:, 1:].clamp(_LOG_SD_MIN, _LOG_SD_MAX)], dim=1)

    def stack(self, newest: Tensor, grey: Tensor, motion: Tensor) -> Tensor:
        """The newest frame, and what was brighter or darker in the older ones, turned; shape (B, 5, H, W).

        Args:
            newest: Pooled colours in 0..1, shape (B, 3, H, W).
            grey: Mean of the colours of all frames, the oldest first, shape (B, 3, H, W).
            motion: As in `forward`.
        """
        older = [self.turned(grey[:, k : k + 1], motion[:, 3 * k + 2]) for k in range(FRAMES - 1)]
        return torch.cat([newest * 2.0 - 1.0, *(2.0 * (grey[:, -1:] - frame) for frame in older)], dim=1)

    def turned(self, grey: Tensor, yaw: Tensor) -> Tensor:
        """Frames as the camera would have taken them with its present heading.

        Args:
            grey: Frames, shape (B, 1, H, W).
            yaw: The robot's heading then, relative to now [rad], shape (B,).
        """
        c, s, zero, one = torch.cos(yaw), torch.sin(yaw), torch.zeros_like(yaw), torch.ones_like(yaw)
        # Rows: ahead, left and up of now in the robot's axes of then.
        about_up = torch.stack([c, -s, zero, s, c, zero, zero, zero, one], dim=1).view(-1, 3, 3)
        rays = torch.matmul(self.rays, torch.matmul(about_up, self.axes))
        uv = rays[..., :2] / rays[..., 2:].clamp(min=0.05) * self.to_grid[0] + self.to_grid[1]
        uv = uv.view(grey.shape[0], grey.shape[2], grey.shape[3], 2)
        turned: Tensor = nn.functional.grid_sample(
            grey, uv, mode="bilinear", padding_mode="border", align_corners=False
        )
        return turned


class PerceptionModule(nn.Module):
    """What is exported: bytes to SI units, see `readygo.common.perception.people`."""

    bearings: Tensor
    log_m: Tensor

    def __init__(self, net: PerceptionNet, camera: CameraConfig) -> None:
        super().__init__()
        self.net = net
        grid = polar_grid(camera)
        self.register_buffer("bearings", torch.from_numpy(grid.bearings_rad).float()[None, :], persistent=False)
        self.register_buffer("log_m", torch.from_numpy(np.log(grid.distances_m)).float()[:, None], persistent=False)

    def forward(self, frames: Tensor, motion: Tensor) -> tuple[Tensor, Tensor]:
        """One look.

        Args:
            frames: The camera's images as bytes, the oldest first, shape (3, H, W, 3).
            motion: As for the network, shape (1, 8).

        Returns:
            People, shape (9, D, C), and free distances [m] with the deviation of their logarithms, shape (2, C).
        """
        pooled = nn.functional.avg_pool2d(frames.permute(0, 3, 1, 2).float() / 255.0, self.net.pooling)
        shown = self.net.stack(pooled[-1:], pooled.mean(dim=1)[None], motion)
        people, free = self.decoded(*self.net(shown, motion))
        return people[0], free[0]

    def decoded(self, told: Tensor, free: Tensor) -> tuple[Tensor, Tensor]:
        """The network's answers in SI units, shapes (B, 9, D, C) and (B, 2, C)."""
        maps = [
            torch.sigmoid(told[:, :1]),
            told[:, 1:2] + self.bearings,
            torch.exp(told[:, 2:3] + self.log_m),
            told[:, 3:5],
            torch.exp(told[:, 5:]),
        ]
        return torch.cat(maps, dim=1), torch.exp(free)


def _resampling(width: int) -> Tensor | None:
    """Linear interpolation at the bearings of the grid, shape (N, C); None if the image has as many columns as it.

    Two convolutions of stride 2 leave N columns, column n around pixel 4 n + 0.5. Column c of the grid is at pixel
    (c + 0.5) width / C, see `polar_grid`; beyond the last column that one is taken.
    """
    count, columns = -(-width // 4), SHAPE[1]
    if count == columns:
        return None
    at = np.clip(((np.arange(columns) + 0.5) * width / columns - 0.5) / 4.0, 0.0, count - 1.0)
    weights = np.maximum(1.0 - np.abs(np.arange(count)[:, None] - at), 0.0)
    return torch.from_numpy(weights).float()


def _rays(camera: CameraConfig, height: int, width: int) -> Tensor:
    """Direction of each pixel in the robot's axes, as of a pinhole, row by row, shape (H W, 3)."""
    axes, (scale, offset) = _matrices(camera)
    v, u = np.meshgrid(np.arange(height) + 0.5, np.arange(width) + 0.5, indexing="ij")
    uv = np.stack([2.0 * u / width - 1.0, 2.0 * v / height - 1.0], axis=-1)
    rays = np.concatenate([(uv - offset) / scale, np.ones((height, width, 1))], axis=-1) @ axes.T
    return torch.from_numpy(rays.reshape(-1, 3)).float()


def _matrices(camera: CameraConfig) -> tuple[Float64Array, Float64Array]:
    """Camera axes in the robot's, shape (3, 3); factor and offset from the image plane to -1..1, shape (2, 2)."""
    K, size = camera.K_px, np.array([camera.width_px, camera.height_px])
    scale = 2.0 * np.array([K[0, 0], K[1, 1]]) / size
    offset = 2.0 * np.array([K[0, 2], K[1, 2]]) / size - 1.0
    return camera.T_world_camera(0.0, 0.0, 0.0, 0.0)[:3, :3], np.stack([scale, offset])
