"""How policies are evaluated."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class EvaluatorConfig:
    """Settings of the closed loop that do not change its result."""

    lockstep: int = 8
    """Episodes that run side by side: the views of one render request."""
    renderer: str = "0"
    """Name of the renderer that is asked for images."""
    request_timeout_s: float = 120.0
    """Longest wait for one reply [s]."""
    rejected_max: int = 1000
    """Rejected scenarios in a row after which the scene is called unusable."""

    def __post_init__(self) -> None:
        if self.lockstep < 1 or self.rejected_max < 1:
            raise ValueError("lockstep and rejected_max must be at least 1.")
        if not self.request_timeout_s > 0:
            raise ValueError(f"request_timeout_s must be positive, got {self.request_timeout_s}.")
