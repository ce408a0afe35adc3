"""What a machine computes with."""

import re
from pathlib import Path
from typing import Literal

import torch

from readygo.common.errors import PolicyError
from readygo.services.trainer.config import TrainConfig

CPU_INFO = Path("/proc/cpuinfo")
BF16_FEATURES = ("avx512_bf16", "amx_bf16", "bf16")
"""Features of CPUs that multiply bfloat16 numbers (the last one is Arm's)."""

BF16_MIN_PX = 48
"""Maps of smaller images shrink to one pixel, for which torch's convolutions on the CPU read, in bfloat16,
uninitialised memory: the gradient is sometimes NaN (seen with torch 2.13 at 24x32, never from 48x64 on)."""


def device_of(wanted: Literal["auto", "cpu", "cuda"]) -> torch.device:
    """The device to train on, see `TrainConfig.device`.

    Raises:
        PolicyError: If it is not there.
    """
    if wanted == "cpu":
        return torch.device("cpu")
    if torch.cuda.is_available():
        return torch.device("cuda")
    if wanted == "cuda":
        raise PolicyError("There is no CUDA device here; train with --device cpu.")
    return torch.device("cpu")


def dtype_of(config: TrainConfig, device: torch.device, size_px: tuple[int, int]) -> torch.dtype:
    """The type of the network's numbers while it is trained.

    Args:
        config: Says which one is wanted.
        device: Where it is trained.
        size_px: Height and width of what the camera gives.
    """
    if config.precision != "auto":
        return torch.bfloat16 if config.precision == "bf16" else torch.float32
    half = device.type == "cuda" or (cpu_has_bf16() and min(size_px) >= BF16_MIN_PX)
    return torch.bfloat16 if half else torch.float32


def cpu_has_bf16(cpu_info: Path = CPU_INFO) -> bool:
    """True if this CPU says that it multiplies bfloat16 numbers; False where it cannot be asked."""
    try:
        text = cpu_info.read_text()
    except OSError:
        return False
    lines = re.findall(r"^(?:flags|Features)\s*:(.*)$", text, re.MULTILINE)
    return bool(lines) and any(feature in lines[0].split() for feature in BF16_FEATURES)
