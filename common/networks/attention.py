"""Self-attention over the encoded images of a window."""

import math

import torch
from torch import nn


class PositionalEncoding(nn.Module):
    """Sines of the place in a sequence, added. Source: Vaswani et al., Attention is all you need, 2017."""

    def __init__(self, width: int, length: int) -> None:
        super().__init__()
        place = torch.arange(length)[:, None]
        rate = torch.exp(torch.arange(0, width, 2) * (-math.log(10000.0) / width))
        self.register_buffer(
            "pos_enc", torch.stack([torch.sin(place * rate), torch.cos(place * rate)], dim=2).reshape(1, length, width)
        )
        self.pos_enc: torch.Tensor

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(B, T, width) -> (B, T, width)."""
        return x + self.pos_enc[:, : x.shape[1]]


def attention_layer(width: int, feed_forward: int) -> nn.TransformerEncoderLayer:
    """One layer of four heads, normalised first."""
    return nn.TransformerEncoderLayer(width, 4, feed_forward, activation="gelu", batch_first=True, norm_first=True)


def attention(layer: nn.TransformerEncoderLayer) -> nn.TransformerEncoder:
    """Four layers like one."""
    return nn.TransformerEncoder(layer, 4, enable_nested_tensor=False)
