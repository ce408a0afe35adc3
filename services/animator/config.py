"""Configuration of the animator."""

from dataclasses import dataclass, field
from typing import Literal

from readygo.services.animator.priormdm.config import PriorMdmConfig


@dataclass(frozen=True, kw_only=True)
class AnimatorConfig:
    """How trajectories become motions; recorded with every dataset."""

    source: Literal["gait", "priormdm"] = "gait"
    """Motion generator: "gait" is parametric and needs no files; "priormdm" is a diffusion model of the user's."""
    style_variation: float = 1.0
    """How much people differ in cadence, arm swing, lean and step width: 0 (all alike) to 1."""
    priormdm: PriorMdmConfig = field(default_factory=PriorMdmConfig)
    """Files and sampling of the source "priormdm"."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.style_variation <= 1.0:
            raise ValueError(f"style_variation must be within 0..1, got {self.style_variation}.")
        if self.source == "priormdm":
            self.priormdm.check_named()
