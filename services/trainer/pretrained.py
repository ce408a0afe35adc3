"""An encoder made of trained perception: three frames and ego-motion -> people and free space -> latents.

The network of perception is not changed: only what reads from it learns.
"""

from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from readygo.common.camera.config import CameraConfig
from readygo.common.errors import PolicyError
from readygo.common.perception.artifact import FRAMES, load_perception_spec
from readygo.common.perception.grid import SHAPE, polar_grid
from readygo.common.perception.people import ACROSS, ALONG, DISTANCE, PRESENCE
from readygo.common.robot import RobotConfig
from readygo.services.trainer.config import TrainConfig
from readygo.services.trainer.perception.network import PerceptionNet
from readygo.services.trainer.perception.weights import trained_weights

FEATURES = 16
"""Numbers that are read from the features of each column."""
TOLD = 5
"""Numbers that are told of each column: whether a human is there, how far away and how it moves; free distance."""


class PretrainedEncoder(nn.Module):
    """Frames and ego-motion -> latents, through a network of perception whose weights stay as they are."""

    log_m: Tensor

    def __init__(self, camera: CameraConfig, widths: tuple[int, ...], latent_count: int) -> None:
        super().__init__()
        self.perception = PerceptionNet(camera, widths).requires_grad_(False).eval()
        self.features = nn.Conv1d(widths[-1], FEATURES, 1)
        self.latent = nn.Linear((FEATURES + TOLD) * SHAPE[1], latent_count)
        log_m = torch.from_numpy(np.log(polar_grid(camera).distances_m)).float()
        self.register_buffer("log_m", log_m[:, None], persistent=False)

    def train(self, mode: bool = True) -> "PretrainedEncoder":
        """Turn training on or off; the statistics of perception's normalisations stay as they are."""
        super().train(mode)
        self.perception.eval()
        return self

    def forward(self, frames: Tensor, motion: Tensor) -> Tensor:
        """Latents, shape (B, L); arguments as for `look`."""
        return self.read(self.look(frames, motion))

    @torch.no_grad()
    def look(self, frames: Tensor, motion: Tensor) -> Tensor:
        """What perception has of each column: its features, and `TOLD` numbers, shape (B, F + TOLD, C).

        Args:
            frames: Three frames in [-1, 1], the oldest first, shape (B, 9, H, W).
            motion: See `readygo.common.policy.motion.own_motion`, shape (B, 8).
        """
        # Turning frames takes float32, also where convolutions are computed in bfloat16.
        pixels = 0.5 * (frames.float().view(len(frames), FRAMES, 3, *frames.shape[2:]) + 1.0)
        shown = self.perception.stack(pixels[:, -1], pixels.mean(dim=2), motion)
        columns = self.perception.features(shown, motion)
        told = self._told(*self.perception.read(columns))
        return torch.cat([columns.float(), told], dim=1)

    def read(self, looked: Tensor) -> Tensor:
        """Latents of what `look` answered, shape (B, L)."""
        columns, told = looked[:, :-TOLD], looked[:, -TOLD:]
        read = nn.functional.relu(self.features(columns))
        latents: Tensor = self.latent(torch.cat([read, told.to(read.dtype)], dim=1).flatten(1))
        return latents

    def _told(self, people: Tensor, free: Tensor) -> Tensor:
        """What perception tells of each column, in numbers around 1, shape (B, TOLD, C)."""
        presence = people[:, PRESENCE]
        there = presence.sigmoid().amax(dim=1)
        ring = presence.softmax(dim=1)
        distance = (ring * (people[:, DISTANCE] + self.log_m)).sum(dim=1)
        along, across = (there * (ring * people[:, axis]).sum(dim=1) for axis in (ALONG, ACROSS))
        return torch.stack([there, distance, along, across, free[:, 0]], dim=1)


def perception_weights(folder: Path, robot: RobotConfig, config: TrainConfig) -> tuple[dict[str, Tensor], str]:
    """Weights of trained perception for a policy's encoder, and their SHA-256.

    Args:
        folder: That `readygo train --recipe perception` wrote.
        robot: The policy's.
        config: Settings of the policy's training.

    Raises:
        PolicyError: If they are missing or broken, or of another camera, frame spacing or widths.
    """
    spacing_s = load_perception_spec(folder).spacing_s
    if spacing_s != config.sampling.frame_spacing_s:
        raise PolicyError(
            f"{folder} sees frames {spacing_s:g} s apart, the policy {config.sampling.frame_spacing_s:g} s: "
            f"give --sampling.frame-spacing-s {spacing_s:g}."
        )
    return trained_weights(folder, robot.camera, config.network.widths)
