"""How camera poses are found."""

from dataclasses import dataclass
from typing import Annotated, Literal

from readygo.common.config import Range, check_ranges

INCREMENTAL_MAX = 200
"""Up to this many images maps are built incrementally, larger ones globally."""


@dataclass(frozen=True, kw_only=True)
class PosesConfig:
    """How poses are found."""

    mapper: Literal["auto", "incremental", "global"] = "auto"
    """`auto` is incremental up to `INCREMENTAL_MAX` images."""
    threads: Annotated[int, Range(low=0)] = 0
    """0 takes all cores; 1 gives the same map each time."""
    seed: int = 0
    """Seed of matching and mapping."""

    def __post_init__(self) -> None:
        check_ranges(self)

    def mapper_of(self, count: int) -> Literal["incremental", "global"]:
        """The mapper for so many images."""
        if self.mapper == "auto":
            return "incremental" if count <= INCREMENTAL_MAX else "global"
        return self.mapper
