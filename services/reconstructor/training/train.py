"""Training of Gaussians from a posed COLMAP model."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from readygo.services.reconstructor.training.config import GaussiansConfig


@dataclass(frozen=True, kw_only=True)
class TrainingProgress:
    """How far a training is."""

    step: int
    steps: int
    gaussians: int
    loss: float
    psnr_db: float | None
    """Of the held-out images, when they were last drawn."""
    seconds: float
    """Spent so far, those before an interruption included."""
    picture: Path | None
    """The latest held-out render beside its photo."""


def train_gaussians(
    posed_folder: Path,
    out_folder: Path,
    settings: GaussiansConfig,
    progress: Callable[[TrainingProgress], None],
) -> dict[str, Any]:
    """Train Gaussians; go on where an earlier call with the same arguments was interrupted, to the same result.

    Args:
        posed_folder: `images/` and `sparse/0/`, as `readygo scene poses` leaves them in `posed`; or any COLMAP model.
        out_folder: Gets `gaussians.ply`, `training.json` (the report), `previews/` and, until it is done, `checkpoint.npz`.
        settings: How; see `preset`.
        progress: Is told about every few steps.

    Returns:
        The report: `psnr_db`, `ssim`, `gaussians`, `held_out` (by image), `seconds` (by stage), `settings`.

    Raises:
        ReadygoError: If the model or its images cannot be used, numbers stop being finite, or nothing can be written.
        KeyboardInterrupt: At Ctrl-C, after the state is saved.
    """
    raise NotImplementedError
