"""EfficientNet-B0 as the published weights have it: images of every size are padded as for 224 pixels.

Source: Tan & Le, EfficientNet: Rethinking model scaling for convolutional neural networks, ICML 2019, table 1.
"""

from collections.abc import Callable

import torch
from torch import nn
from torch.nn import functional

CHANNELS = 1280
CLASSES = 1000
"""Classes of a last layer that nothing uses, but that the published weights hold."""
_BLOCKS = (
    (1, 3, 1, 1, 32, 16),
    (2, 3, 2, 6, 16, 24),
    (2, 5, 2, 6, 24, 40),
    (3, 3, 2, 6, 40, 80),
    (3, 5, 1, 6, 80, 112),
    (4, 5, 2, 6, 112, 192),
    (1, 3, 1, 6, 192, 320),
)
"""Repeats, kernel, stride of the first one, expansion, channels in and out."""
DROPOUT = 0.2
"""Dropout of the pooled features in training."""
Norm = Callable[[int], nn.Module]


def batch_norm(channels: int) -> nn.Module:
    """The normalisation of ViNT's encoders."""
    return nn.BatchNorm2d(channels, eps=1e-3, momentum=0.01)


def group_norm(channels: int) -> nn.Module:
    """The normalisation of NoMaD's encoders: sixteen channels a group."""
    return nn.GroupNorm(channels // 16, channels)


class EfficientNet(nn.Module):
    """Images to pooled features."""

    def __init__(self, channels: int, norm: Norm) -> None:
        super().__init__()
        self._conv_stem = PaddedConv(channels, 32, 3, 2)
        self._bn0 = norm(32)
        self._blocks = nn.ModuleList(
            MobileBlock(outside if number else inside, outside, kernel, 1 if number else stride, expansion, norm)
            for repeats, kernel, stride, expansion, inside, outside in _BLOCKS
            for number in range(repeats)
        )
        self._conv_head = PaddedConv(320, CHANNELS, 1, 1)
        self._bn1 = norm(CHANNELS)
        self._fc = nn.Linear(CHANNELS, CLASSES)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(B, C, H, W) -> (B, 1280)."""
        x = functional.silu(self._bn0(self._conv_stem(x)))
        for block in self._blocks:
            x = block(x)
        pooled = functional.silu(self._bn1(self._conv_head(x))).mean(dim=(2, 3))
        return functional.dropout(pooled, DROPOUT, self.training)


class MobileBlock(nn.Module):
    """Wider, depthwise, squeezed and excited, narrower again."""

    def __init__(self, inside: int, outside: int, kernel: int, stride: int, expansion: int, norm: Norm) -> None:
        super().__init__()
        hidden = inside * expansion
        self._expands, self._adds = expansion != 1, stride == 1 and inside == outside
        if self._expands:
            self._expand_conv = PaddedConv(inside, hidden, 1, 1)
            self._bn0 = norm(hidden)
        self._depthwise_conv = PaddedConv(hidden, hidden, kernel, stride, groups=hidden)
        self._bn1 = norm(hidden)
        squeezed = max(1, inside // 4)
        self._se_reduce = PaddedConv(hidden, squeezed, 1, 1, bias=True)
        self._se_expand = PaddedConv(squeezed, hidden, 1, 1, bias=True)
        self._project_conv = PaddedConv(hidden, outside, 1, 1)
        self._bn2 = norm(outside)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(B, C, H, W) -> (B, C', H', W')."""
        y = functional.silu(self._bn0(self._expand_conv(x))) if self._expands else x
        y = functional.silu(self._bn1(self._depthwise_conv(y)))
        squeezed = functional.silu(self._se_reduce(y.mean(dim=(2, 3), keepdim=True)))
        y = torch.sigmoid(self._se_expand(squeezed)) * y
        projected: torch.Tensor = self._bn2(self._project_conv(y))
        return x + projected if self._adds else projected


class PaddedConv(nn.Conv2d):
    """A convolution padded as for even sizes: with a stride of 2 one more below and to the right."""

    def __init__(
        self, inside: int, outside: int, kernel: int, stride: int, *, groups: int = 1, bias: bool = False
    ) -> None:
        super().__init__(inside, outside, kernel, stride, groups=groups, bias=bias)
        total = kernel - stride if stride > 1 else kernel - 1
        before = total // 2
        self._pad = (before, total - before, before, total - before)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(B, C, H, W) -> (B, C', H', W')."""
        return super().forward(functional.pad(x, self._pad))
