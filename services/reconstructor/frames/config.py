"""Which images are used."""

from dataclasses import dataclass
from typing import Annotated, Literal

from readygo.common.config import Range, check_ranges


@dataclass(frozen=True, kw_only=True)
class FramesConfig:
    """Which images of a video or a folder are used."""

    count_max: Annotated[int, Range(low=3)] = 300
    """At most this many images are taken of a video."""
    side_max_px: Annotated[int, Range(low=320)] = 1600
    """Larger images are made smaller: longer side [px]."""
    projection: Literal["perspective", "equirectangular"] = "perspective"
    """`equirectangular`: images of 360 degrees, twice as wide as high; each is cut into eight perspective views, and
    `count_max` counts views."""
    masks: str = ""
    """Folder with a mask of each image, named after it as a.jpg.png, in which 0 is ignored; empty: there are none."""

    depth: bool = True
    """Use the depth images that come with a capture."""

    def __post_init__(self) -> None:
        check_ranges(self)
