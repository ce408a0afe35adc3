"""MobileNetV2's features.

Source: Sandler et al., MobileNetV2: Inverted residuals and linear bottlenecks, CVPR 2018, table 2.
"""

import torch
from torch import nn

CHANNELS = 1280
_BLOCKS = ((1, 16, 1, 1), (6, 24, 2, 2), (6, 32, 3, 2), (6, 64, 4, 2), (6, 96, 3, 1), (6, 160, 3, 2), (6, 320, 1, 1))
"""Expansion, channels, repeats and stride of the first one."""


def mobilenet_features(channels: int) -> nn.Sequential:
    """Images of some channels, (B, C, H, W), to features, (B, 1280, h, w)."""
    layers: list[nn.Module] = [_conv(channels, 32, 3, 2)]
    inside = 32
    for expansion, outside, repeats, stride in _BLOCKS:
        for number in range(repeats):
            layers.append(InvertedResidual(inside, outside, stride if number == 0 else 1, expansion))
            inside = outside
    return nn.Sequential(*layers, _conv(inside, CHANNELS, 1, 1))


class InvertedResidual(nn.Module):
    """Wider, depthwise, narrower again; added to what came in where the shapes allow."""

    def __init__(self, inside: int, outside: int, stride: int, expansion: int) -> None:
        super().__init__()
        hidden = inside * expansion
        wider = [_conv(inside, hidden, 1, 1)] if expansion != 1 else []
        self.conv = nn.Sequential(
            *wider,
            _conv(hidden, hidden, 3, stride, groups=hidden),
            nn.Conv2d(hidden, outside, 1, bias=False),
            nn.BatchNorm2d(outside),
        )
        self._adds = stride == 1 and inside == outside

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(B, C, H, W) -> (B, C', H', W')."""
        y: torch.Tensor = self.conv(x)
        return x + y if self._adds else y


def _conv(inside: int, outside: int, size: int, stride: int, groups: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inside, outside, size, stride, size // 2, groups=groups, bias=False),
        nn.BatchNorm2d(outside),
        nn.ReLU6(),
    )
