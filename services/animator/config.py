"""Configuration of the animator."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, kw_only=True)
class AnimatorConfig:
    """How trajectories become motions; recorded with every dataset."""

    source: Literal["gait"] = "gait"
    """Motion generator: "gait" is parametric and needs no files."""
    style_variation: float = 1.0
    """How much people differ in cadence, arm swing, lean and step width: 0 (all alike) to 1."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.style_variation <= 1.0:
            raise ValueError(f"style_variation must be within 0..1, got {self.style_variation}.")
