"""MDM's transformer encoder: noisy motion, step and text -> clean motion.

Modules carry the names of the released state dict, so that it loads as it is.

Source: Tevet et al., Human Motion Diffusion Model, ICLR 2023, section 3 (trans_enc); Shafir et al., Human Motion
Diffusion as a Generative Prior, ICLR 2024.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from readygo.services.animator.priormdm.features import FEATURE_COUNT

POSITIONS = 5000
TEXT_COUNT = 512
"""Length of a CLIP ViT-B/32 text embedding."""


@dataclass(frozen=True, kw_only=True)
class NetworkShape:
    """Sizes of the network; the defaults are the release's."""

    layers: int = 8
    latent_dim: int = 512
    ff_size: int = 1024
    num_heads: int = 4
    text: bool = True
    """False for a model that was trained without texts."""

    def __post_init__(self) -> None:
        if min(self.layers, self.latent_dim, self.ff_size, self.num_heads) < 1 or self.latent_dim % self.num_heads:
            raise ValueError(
                f"layers, latent_dim, ff_size and num_heads must be positive and latent_dim a multiple of num_heads, "
                f"got {self.layers}, {self.latent_dim}, {self.ff_size} and {self.num_heads}."
            )


class PositionTable(nn.Module):
    """Sines and cosines of positions."""

    def __init__(self, width: int) -> None:
        super().__init__()
        position = torch.arange(POSITIONS, dtype=torch.float32)[:, None]
        rate = torch.exp(torch.arange(0, width, 2, dtype=torch.float32) * (-math.log(10000.0) / width))
        table = torch.zeros(POSITIONS, width)
        table[:, 0::2] = torch.sin(position * rate)
        table[:, 1::2] = torch.cos(position * rate[: width // 2])
        self.register_buffer("pe", table[:, None])
        self.pe: Tensor


class StepEmbedding(nn.Module):
    """The diffusion step, by its row of the position table."""

    def __init__(self, width: int, table: PositionTable) -> None:
        super().__init__()
        self.sequence_pos_encoder = table
        self.time_embed = nn.Sequential(nn.Linear(width, width), nn.SiLU(), nn.Linear(width, width))

    def forward(self, step: Tensor) -> Tensor:
        """Embed steps (B,) as (B, D)."""
        embedding: Tensor = self.time_embed(self.sequence_pos_encoder.pe[step, 0])
        return embedding


class SelfAttention(nn.Module):
    """Multi-head self-attention with the parameter names of `torch.nn.MultiheadAttention`."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.in_proj_weight = nn.Parameter(torch.empty(3 * width, width))
        self.in_proj_bias = nn.Parameter(torch.zeros(3 * width))
        self.out_proj = nn.Linear(width, width)
        nn.init.xavier_uniform_(self.in_proj_weight)

    def forward(self, x: Tensor, attends: Tensor | None) -> Tensor:
        """Attend over tokens (B, L, D); `attends` (B, L) is False for tokens that are masked out."""
        batch, length, width = x.shape
        qkv = nn.functional.linear(x, self.in_proj_weight, self.in_proj_bias)
        q, k, v = qkv.view(batch, length, 3, self.heads, width // self.heads).permute(2, 0, 3, 1, 4)
        mask = None if attends is None else attends[:, None, None]
        y = nn.functional.scaled_dot_product_attention(q, k, v, attn_mask=mask)
        projected: Tensor = self.out_proj(y.transpose(1, 2).reshape(batch, length, width))
        return projected


class EncoderLayer(nn.Module):
    """Attention and two linear layers with GELU, each followed by a normalisation of its sum with the input."""

    def __init__(self, shape: NetworkShape) -> None:
        super().__init__()
        self.self_attn = SelfAttention(shape.latent_dim, shape.num_heads)
        self.linear1 = nn.Linear(shape.latent_dim, shape.ff_size)
        self.linear2 = nn.Linear(shape.ff_size, shape.latent_dim)
        self.norm1 = nn.LayerNorm(shape.latent_dim)
        self.norm2 = nn.LayerNorm(shape.latent_dim)

    def forward(self, x: Tensor, attends: Tensor | None) -> Tensor:
        """Tokens (B, L, D) -> (B, L, D)."""
        x = self.norm1(x + self.self_attn(x, attends))
        y: Tensor = self.norm2(x + self.linear2(nn.functional.gelu(self.linear1(x))))
        return y


class TransformerEncoder(nn.Module):
    """A stack of layers."""

    def __init__(self, shape: NetworkShape) -> None:
        super().__init__()
        self.layers = nn.ModuleList(EncoderLayer(shape) for _ in range(shape.layers))

    def forward(self, x: Tensor, attends: Tensor | None) -> Tensor:
        """Tokens (B, L, D) -> (B, L, D)."""
        for layer in self.layers:
            x = layer(x, attends)
        return x


class InputProcess(nn.Module):
    """Features -> tokens."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.poseEmbedding = nn.Linear(FEATURE_COUNT, width)


class OutputProcess(nn.Module):
    """Tokens -> features."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.poseFinal = nn.Linear(width, FEATURE_COUNT)


class Mdm(nn.Module):
    """The denoiser."""

    def __init__(self, shape: NetworkShape) -> None:
        super().__init__()
        self.shape = shape
        self.input_process = InputProcess(shape.latent_dim)
        self.sequence_pos_encoder = PositionTable(shape.latent_dim)
        self.seqTransEncoder = TransformerEncoder(shape)
        self.embed_timestep = StepEmbedding(shape.latent_dim, self.sequence_pos_encoder)
        if shape.text:
            self.embed_text = nn.Linear(TEXT_COUNT, shape.latent_dim)
        self.output_process = OutputProcess(shape.latent_dim)

    def forward(self, x: Tensor, step: Tensor, text: Tensor | None = None, valid: Tensor | None = None) -> Tensor:
        """Estimate of the clean motion.

        Args:
            x: Noisy normalised features, shape (B, T, 263).
            step: Trained diffusion step of each motion, shape (B,).
            text: CLIP embeddings, shape (B, 512); None is no text: what the model saw with its texts masked.
            valid: False for padding, which no other frame then looks at, shape (B, T); None for no padding.

        Returns:
            Shape (B, T, 263).
        """
        condition = self.embed_timestep(step)
        if self.shape.text:
            condition = condition + self.embed_text(x.new_zeros(len(x), TEXT_COUNT) if text is None else text)
        tokens = torch.cat([condition[:, None], self.input_process.poseEmbedding(x)], dim=1)
        tokens = tokens + self.sequence_pos_encoder.pe[: tokens.shape[1], 0]
        attends = None if valid is None else torch.cat([valid.new_ones(len(valid), 1), valid], dim=1)
        y: Tensor = self.output_process.poseFinal(self.seqTransEncoder(tokens, attends)[:, 1:])
        return y
