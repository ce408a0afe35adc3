"""The policy network: ten convolutions per frame, shared over three frames, then three fully connected layers.

The paper gives the number of convolutions, the sizes of the latents (20 per frame, 64 in all) and "2M" parameters;
widths, strides and normalisation are chosen here for training speed on a CPU: a stride-4 stem instead of a
stride-2 one with pooling costs 2.1 ms instead of 5.5 ms per frame (forward and backward, two threads).

Source: ReaDy-Go, section IV-B-2; residual blocks: He et al., Deep residual learning, 2016, with parameter-free
shortcuts (their option A).
"""

import itertools

import torch
from torch import Tensor, nn

from readygo.common.policy.artifact import FEATURE_COUNT, GOAL_SCALE_M, LATENT_COUNT
from readygo.common.policy.windows import FRAME_COUNT
from readygo.common.robot import RobotConfig

WIDTHS = (32, 64, 128, 192, 272)
NECK_CHANNELS = 32
HEAD_WIDTHS = (256, 128)


class ResidualBlock(nn.Module):
    """Two 3x3 convolutions that halve the image, and a shortcut by average pooling and zero channels."""

    def __init__(self, channels_in: int, channels_out: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(channels_in, channels_out, 3, stride=2, padding=1, bias=False)
        self.norm1 = nn.BatchNorm2d(channels_out)
        self.conv2 = nn.Conv2d(channels_out, channels_out, 3, stride=1, padding=1, bias=False)
        self.norm2 = nn.BatchNorm2d(channels_out)
        self.extra_channels = channels_out - channels_in

    def forward(self, x: Tensor) -> Tensor:
        """Feature maps (B, C, H, W) -> (B, C', ceil(H / 2), ceil(W / 2))."""
        y = nn.functional.relu(self.norm1(self.conv1(x)))
        y = self.norm2(self.conv2(y))
        shortcut = nn.functional.avg_pool2d(x, 2, ceil_mode=True, count_include_pad=False)
        return nn.functional.relu(y + nn.functional.pad(shortcut, (0, 0, 0, 0, 0, self.extra_channels)))


class Encoder(nn.Module):
    """One RGB frame -> 20 numbers: stem 8x8, four residual blocks, 1x1, fully connected."""

    def __init__(self, height_px: int, width_px: int) -> None:
        super().__init__()
        self.stem = nn.Conv2d(3, WIDTHS[0], 8, stride=4, padding=2, bias=False)
        self.stem_norm = nn.BatchNorm2d(WIDTHS[0])
        self.blocks = nn.Sequential(*(ResidualBlock(i, o) for i, o in itertools.pairwise(WIDTHS)))
        self.neck = nn.Conv2d(WIDTHS[-1], NECK_CHANNELS, 1)
        rows, columns = height_px // 4, width_px // 4
        for _ in self.blocks:
            rows, columns = (rows + 1) // 2, (columns + 1) // 2
        self.latent = nn.Linear(NECK_CHANNELS * rows * columns, LATENT_COUNT)

    def forward(self, image: Tensor) -> Tensor:
        """Images in [-1, 1], shape (B, 3, H, W), channels_last is fastest -> latents (B, 20)."""
        x = nn.functional.relu(self.stem_norm(self.stem(image)))
        x = nn.functional.relu(self.neck(self.blocks(x)))
        latents: Tensor = self.latent(x.flatten(1))
        return latents


class Head(nn.Module):
    """Three latents, previous action and goal -> action, all normalised."""

    def __init__(self) -> None:
        super().__init__()
        self.layer1 = nn.Linear(FEATURE_COUNT, HEAD_WIDTHS[0])
        self.layer2 = nn.Linear(HEAD_WIDTHS[0], HEAD_WIDTHS[1])
        self.layer3 = nn.Linear(HEAD_WIDTHS[1], 2)

    def forward(self, features: Tensor) -> Tensor:
        """Normalised features (B, 64) -> (v / v_max, w / w_max), shape (B, 2)."""
        actions: Tensor = self.layer3(nn.functional.relu(self.layer2(nn.functional.relu(self.layer1(features)))))
        return actions


class PolicyNet(nn.Module):
    """Encoder and head, with the robot's limits as units of the actions."""

    limits: Tensor

    def __init__(self, robot: RobotConfig) -> None:
        super().__init__()
        self.encoder = Encoder(robot.camera.height_px, robot.camera.width_px)
        self.head = Head()
        self.register_buffer("limits", torch.tensor([robot.v_max_mps, robot.w_max_radps]), persistent=False)

    def forward(self, images: Tensor, window: Tensor, previous: Tensor, goal_xy_m: Tensor) -> Tensor:
        """`encode_windows`, then `act`."""
        return self.act(self.encode_windows(images, window), previous, goal_xy_m)

    def encode_windows(self, images: Tensor, window: Tensor) -> Tensor:
        """Latents of windows that share frames.

        Args:
            images: Distinct frames in [-1, 1], shape (F, 3, H, W).
            window: Rows of `images` that each sample sees, oldest first, shape (B, 3).

        Returns:
            Shape (B, 60).
        """
        latents: Tensor = self.encoder(images)[window.reshape(-1)]
        return latents.reshape(len(window), FRAME_COUNT * LATENT_COUNT)

    def act(self, latents: Tensor, previous: Tensor, goal_xy_m: Tensor) -> Tensor:
        """Predicted actions.

        Args:
            latents: From `encode_windows`, shape (B, 60).
            previous: Previous actions from `normalise_previous`, shape (B, 2).
            goal_xy_m: Goals in the robot's frame [m], shape (B, 2).

        Returns:
            (v / v_max, w / w_max), not clipped, shape (B, 2).
        """
        goal = (goal_xy_m / GOAL_SCALE_M).clamp(-1.0, 1.0)
        actions: Tensor = self.head(torch.cat([latents, previous, goal], dim=1))
        return actions

    def normalise_previous(self, previous: Tensor) -> Tensor:
        """Previous actions [m/s, rad/s] -> numbers in [-1, 1]; 0 is half speed straight on, and "not known"."""
        scaled = previous / self.limits
        return torch.stack([2.0 * scaled[:, 0] - 1.0, scaled[:, 1]], dim=1)

    def clip(self, normalised_actions: Tensor) -> Tensor:
        """Normalised actions -> (v [m/s] in [0, v_max], w [rad/s] in +-w_max), as the exported head answers them."""
        v, w = normalised_actions.unbind(1)
        return torch.stack([v.clamp(0.0, 1.0), w.clamp(-1.0, 1.0)], dim=1) * self.limits


def images_from_bytes(frames: Tensor) -> Tensor:
    """Frames uint8 (F, H, W, 3) -> network input in [-1, 1], shape (F, 3, H, W), channels_last."""
    return frames.permute(0, 3, 1, 2).to(torch.float32).mul_(1 / 127.5).sub_(1.0)


def parameter_count(model: nn.Module) -> int:
    """Number of trained numbers."""
    return sum(parameter.numel() for parameter in model.parameters())
