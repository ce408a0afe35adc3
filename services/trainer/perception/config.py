"""How perception is trained."""

from dataclasses import dataclass
from typing import Annotated, Literal

from readygo.common.config import Range, check_ranges
from readygo.services.trainer.config import MINUTES, PERCEPTION_SPACING_S, PERCEPTION_WIDTHS

Positive = Annotated[float, Range(above=0.0)]
Count = Annotated[int, Range(low=1)]


@dataclass(frozen=True, kw_only=True)
class PerceptionConfig:
    """Network, budget and optimisation of perception."""

    minutes: Annotated[float, MINUTES] = 20.0
    """Processor time of each training thread, on a GPU the time that goes by; runs that continue count that of the
    earlier ones [min]."""
    samples: int | None = None
    """Images to be learned from, repeats counted, instead of `minutes`; the result is then reproducible."""
    seed: Annotated[int, Range(low=0)] = 0
    threads: Annotated[int, Range(low=0)] = 0
    """CPU threads; 0 takes every core that the process may use."""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """"auto" takes a CUDA device if there is one."""
    precision: Literal["auto", "bf16", "fp32"] = "auto"
    """"auto" computes in bfloat16 on CUDA and on CPUs that multiply it, else in float32."""
    perception: str = ""
    """Folder of trained perception of this camera, whose weights training begins with; by default with new ones."""
    memory_mb: Count = 4096
    """Most memory for decoded images; of more data an even share of the episodes is learned from [MB]."""
    spacing_s: Positive = PERCEPTION_SPACING_S
    """Time between the three frames that it sees [s]."""
    widths: tuple[int, ...] = PERCEPTION_WIDTHS
    """Channels after each halving of the image, and of the columns."""
    batch_size: Count = 64
    """Images per step."""
    learning_rate: Positive = 2e-3
    """Largest one of AdamW; it rises over the first 2 % and falls as a cosine."""
    weight_decay: Annotated[float, Range(low=0.0)] = 0.02
    """Decoupled weight decay."""
    validation_fraction: Annotated[float, Range(low=0.0, high=0.9)] = 0.08
    """Share of the episodes that is held out."""

    def __post_init__(self) -> None:
        check_ranges(self)
        if len(self.widths) != 5 or min(self.widths) < 1:
            raise ValueError(f"widths must be five channel counts, got {self.widths}.")
        if self.samples is not None and self.samples < 1:
            raise ValueError(f"samples must be at least 1, got {self.samples}.")
