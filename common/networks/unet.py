"""The denoiser of NoMaD: a U-Net along time, conditioned on what the robot sees.

Source: Janner et al., Planning with diffusion, ICML 2022; Chi et al., Diffusion policy, RSS 2023.
"""

import itertools
import math

import torch
from torch import nn

WIDTHS = (64, 128, 256)
STEP_WIDTH = 256
GROUPS = 8


class ConditionalUnet(nn.Module):
    """Predicts the noise in waypoints."""

    def __init__(self, values: int, condition: int) -> None:
        super().__init__()
        condition += STEP_WIDTH
        self.mid_modules = nn.ModuleList(ConditionalBlock(WIDTHS[-1], WIDTHS[-1], condition) for _ in range(2))
        self.diffusion_step_encoder = nn.Sequential(
            StepEncoding(), nn.Linear(STEP_WIDTH, 4 * STEP_WIDTH), nn.Mish(), nn.Linear(4 * STEP_WIDTH, STEP_WIDTH)
        )
        self.up_modules = nn.ModuleList(
            nn.ModuleList([*_blocks(2 * outside, inside, condition), Resampled(nn.ConvTranspose1d, inside, 4)])
            for inside, outside in ((WIDTHS[1], WIDTHS[2]), (WIDTHS[0], WIDTHS[1]))
        )
        self.down_modules = nn.ModuleList(
            nn.ModuleList(
                [
                    *_blocks(inside, outside, condition),
                    nn.Identity() if outside == WIDTHS[-1] else Resampled(nn.Conv1d, outside, 3),
                ]
            )
            for inside, outside in zip((values, *WIDTHS), WIDTHS, strict=False)
        )
        self.final_conv = nn.Sequential(ConvBlock(WIDTHS[0], WIDTHS[0]), nn.Conv1d(WIDTHS[0], values, 1))

    def forward(self, sample: torch.Tensor, step: torch.Tensor, condition: torch.Tensor) -> torch.Tensor:
        """Noise in `sample` (B, T, values), at diffusion steps (B,), given (B, condition)."""
        x = sample.transpose(1, 2)
        condition = torch.cat([self.diffusion_step_encoder(step), condition], dim=1)
        kept = []
        for down in self.down_modules:
            first, second, smaller = _three(down)
            x = second(first(x, condition), condition)
            kept.append(x)
            x = smaller(x)
        for block in self.mid_modules:
            x = block(x, condition)
        for up in self.up_modules:
            first, second, larger = _three(up)
            x = torch.cat([x, kept.pop()], dim=1)
            x = larger(second(first(x, condition), condition))
        noise: torch.Tensor = self.final_conv(x)
        return noise.transpose(1, 2)


class StepEncoding(nn.Module):
    """Sines of the diffusion step."""

    def forward(self, step: torch.Tensor) -> torch.Tensor:
        """Encodings of diffusion steps, (B,) -> (B, 256)."""
        half = STEP_WIDTH // 2
        rate = torch.exp(torch.arange(half, device=step.device) * (-math.log(10000.0) / (half - 1)))
        angle = step[:, None] * rate
        return torch.cat([angle.sin(), angle.cos()], dim=1)


class ConvBlock(nn.Module):
    """Convolution, normalisation, Mish."""

    def __init__(self, inside: int, outside: int) -> None:
        super().__init__()
        self.block = nn.Sequential(nn.Conv1d(inside, outside, 3, padding=1), nn.GroupNorm(GROUPS, outside), nn.Mish())

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(B, C, T) -> (B, C', T)."""
        y: torch.Tensor = self.block(x)
        return y


class ConditionalBlock(nn.Module):
    """Two convolutions, between which the condition is added."""

    def __init__(self, inside: int, outside: int, condition: int) -> None:
        super().__init__()
        self.blocks = nn.ModuleList([ConvBlock(inside, outside), ConvBlock(outside, outside)])
        self.cond_encoder = nn.Sequential(nn.Mish(), nn.Linear(condition, outside))
        self.residual_conv = nn.Conv1d(inside, outside, 1) if inside != outside else nn.Identity()

    def forward(self, x: torch.Tensor, condition: torch.Tensor) -> torch.Tensor:
        """(B, C, T), (B, condition) -> (B, C', T)."""
        y = self.blocks[0](x) + self.cond_encoder(condition)[:, :, None]
        added: torch.Tensor = self.blocks[1](y) + self.residual_conv(x)
        return added


class Resampled(nn.Module):
    """Half or twice the length."""

    def __init__(self, kind: type[nn.Conv1d] | type[nn.ConvTranspose1d], channels: int, kernel: int) -> None:
        super().__init__()
        self.conv = kind(channels, channels, kernel, 2, 1)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(B, C, T) -> (B, C, T')."""
        y: torch.Tensor = self.conv(x)
        return y


class Ddpm:
    """Ten steps from noise to a sample, with squared cosines and clipped samples.

    Source: Ho et al., Denoising diffusion probabilistic models, 2020; Nichol & Dhariwal, 2021, for the schedule.
    """

    def __init__(self) -> None:
        steps = 10
        level = [math.cos((k / steps + 0.008) / 1.008 * math.pi / 2) ** 2 for k in range(steps + 1)]
        self.betas = torch.tensor([min(1 - after / before, 0.999) for before, after in itertools.pairwise(level)])
        self.kept = torch.cumprod(1 - self.betas, dim=0)

    def add_noise(self, clean: torch.Tensor, noise: torch.Tensor, step: torch.Tensor) -> torch.Tensor:
        """Clean samples (B, ...) with so much of `noise` in them as there is at steps (B,)."""
        kept = self.kept[step].reshape(-1, *[1] * (clean.dim() - 1))
        return kept.sqrt() * clean + (1 - kept).sqrt() * noise

    def back(self, sample: torch.Tensor, noise: torch.Tensor, step: int, generator: torch.Generator) -> torch.Tensor:
        """The sample one step before, given the noise that is predicted in it."""
        kept, before = self.kept[step], self.kept[step - 1] if step else torch.tensor(1.0)
        beta = self.betas[step]
        clean = ((sample - (1 - kept).sqrt() * noise) / kept.sqrt()).clamp(-1, 1)
        mean = (before.sqrt() * beta * clean + (1 - beta).sqrt() * (1 - before) * sample) / (1 - kept)
        if step == 0:
            return mean
        spread = ((1 - before) / (1 - kept) * beta).sqrt()
        return mean + spread * torch.randn(sample.shape, generator=generator)


def _three(modules: nn.Module) -> tuple[nn.Module, nn.Module, nn.Module]:
    """Two blocks, and what changes the length after them."""
    first, second, resampled = modules.children()
    return first, second, resampled


def _blocks(inside: int, outside: int, condition: int) -> tuple[ConditionalBlock, ConditionalBlock]:
    return ConditionalBlock(inside, outside, condition), ConditionalBlock(outside, outside, condition)
