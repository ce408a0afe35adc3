"""How far a training of Gaussians is."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, kw_only=True)
class TrainingProgress:
    """How far a training, or the search for transients before it, is."""

    step: int
    steps: int
    gaussians: int
    loss: float
    psnr_db: float | None
    """Mean PSNR of the held-out images when they were last drawn [dB]; None before that or without any."""
    seconds: float
    """Spent so far, those before an interruption included; in the search, on the part that is being trained."""
    picture: Path | None
    """The latest held-out render beside its photo."""
    searches: bool = False
    """True while transients are searched; `step` and `steps` are those of the search then."""


Tell = Callable[[TrainingProgress], None]
