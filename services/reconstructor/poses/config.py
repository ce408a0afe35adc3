"""How camera poses are found."""

from dataclasses import dataclass
from typing import Annotated, Literal

from readygo.common.config import Range, check_ranges


@dataclass(frozen=True, kw_only=True)
class PosesConfig:
    """How poses are found."""

    features_max: Annotated[int, Range(low=256)] = 4096
    """Features of an image."""
    features_min: Annotated[int, Range(low=0)] = 600
    """Where the median image of a video has fewer, fainter ones are taken too, of all images."""
    overlap: Annotated[int, Range(low=2)] = 10
    """An image of a video is matched with this many that follow it, and with some that are far away."""
    exhaustive_max: Annotated[int, Range(low=2)] = 120
    """Up to this many photos each is matched with each; more are taken as a sequence in the order of their names."""
    mapper: Literal["auto", "incremental", "global"] = "auto"
    """`auto` is incremental up to `incremental_max` images."""
    incremental_max: Annotated[int, Range(low=2)] = 200
    registered_min: Annotated[float, Range(low=0.0, high=1.0)] = 0.6
    """A map that has fewer of the images, as share, is refused."""
    threads: Annotated[int, Range(low=0)] = 0
    """0 takes all cores; 1 gives the same map each time."""
    seed: int = 0

    def __post_init__(self) -> None:
        check_ranges(self)

    def mapper_of(self, count: int) -> Literal["incremental", "global"]:
        """The mapper for so many images."""
        if self.mapper == "auto":
            return "incremental" if count <= self.incremental_max else "global"
        return self.mapper
