"""How policies are evaluated."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class EvaluatorConfig:
    """Settings of the closed loop that do not change its result."""

    lockstep: int = 8
    """Episodes that run side by side: the views of one render request."""

    def __post_init__(self) -> None:
        if self.lockstep < 1:
            raise ValueError(f"lockstep must be at least 1, got {self.lockstep}.")
