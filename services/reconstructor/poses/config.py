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
    intrinsics: str = ""
    """The lens, if it is known: a calibration of OpenCV or ROS (.yml, .yaml, .xml), its matrix (.txt), a .json of
    cameras, or "fx fy cx cy [k1 k2 p1 p2]" in pixels of the upright images."""
    intrinsics_are: Literal["fixed", "prior"] = "fixed"
    """`fixed`: they stay as they are given; `prior`: focal length and distortion are refined from there."""
    given: Literal["auto", "keep", "adjust"] = "auto"
    """Poses that come with the images: `adjust` adjusts them to the matches, and keeps their scale and frame; `auto`
    does so for those of a device (Polycam's raw ones, Record3D, Stray Scanner)."""
    refine_principal_point: bool = False
    """True refines the principal point too, unless the lens is fixed; else it is the image's middle."""

    def __post_init__(self) -> None:
        check_ranges(self)

    @property
    def fixes_lens(self) -> bool:
        """Whether the lens is known and stays as it is."""
        return bool(self.intrinsics) and self.intrinsics_are == "fixed"

    def mapper_of(self, count: int) -> Literal["incremental", "global"]:
        """The mapper for so many images."""
        if self.mapper == "auto":
            return "incremental" if count <= INCREMENTAL_MAX else "global"
        return self.mapper
