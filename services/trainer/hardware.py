"""What a machine computes with."""

import os
import re
from pathlib import Path

import torch

from readygo.common.errors import PolicyError
from readygo.services.trainer.config import TrainConfig

CPU_INFO = Path("/proc/cpuinfo")
BF16_FEATURES = ("avx512_bf16", "amx_bf16", "bf16")
"""Features of CPUs that multiply bfloat16 numbers (the last one is Arm's)."""


def device_of(config: TrainConfig) -> torch.device:
    """The device to train on.

    Raises:
        PolicyError: If it is not there.
    """
    if config.device == "cpu":
        return torch.device("cpu")
    if torch.cuda.is_available():
        return torch.device("cuda")
    if config.device == "cuda":
        raise PolicyError("There is no CUDA device here; train with --device cpu.")
    return torch.device("cpu")


def dtype_of(config: TrainConfig, device: torch.device) -> torch.dtype:
    """The type of the network's numbers while it is trained."""
    half = config.precision == "bf16" or (config.precision == "auto" and (device.type == "cuda" or cpu_has_bf16()))
    return torch.bfloat16 if half else torch.float32


def cpu_has_bf16(cpu_info: Path = CPU_INFO) -> bool:
    """True if this CPU says that it multiplies bfloat16 numbers; False where it cannot be asked."""
    try:
        text = cpu_info.read_text()
    except OSError:
        return False
    lines = re.findall(r"^(?:flags|Features)\s*:(.*)$", text, re.MULTILINE)
    return bool(lines) and any(feature in lines[0].split() for feature in BF16_FEATURES)


def available_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
