"""Configuration of the reconstructor."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

from readygo.common.config import Range, check_ranges
from readygo.services.reconstructor.metric.markers import DEFAULT_DICTIONARY
from readygo.services.reconstructor.training.config import GaussiansConfig


@dataclass(frozen=True, kw_only=True)
class FramesConfig:
    """Which images of a video or a folder are used."""

    count_max: Annotated[int, Range(low=3)] = 300
    """At most this many images are taken of a video."""
    step: Annotated[float, Range(low=0.005, high=0.5)] = 0.05
    """How far the picture moves from one image to the next, as share of its width."""
    side_max_px: Annotated[int, Range(low=320)] = 1600
    """Larger images are made smaller: longer side [px]."""

    def __post_init__(self) -> None:
        check_ranges(self)


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


@dataclass(frozen=True, kw_only=True)
class MetricConfig:
    """What makes a map metric: a marker, lengths or a scale, in this order."""

    marker_size_m: Annotated[float, Range(low=0.0)] = 0.0
    """Printed side of the markers' black squares [m]; 0: there are none."""
    marker_dictionary: str = DEFAULT_DICTIONARY
    marker_ids: tuple[int, ...] = ()
    """Markers of that size; empty: all that are found."""
    marker_on: Literal["auto", "floor", "wall"] = "auto"
    """What markers lie on; `auto` goes by how the cameras were held."""
    marker_sigma_m: Annotated[float, Range(low=0.0)] = 0.0002
    """Standard deviation of the printed side, as measured with a ruler [m]."""
    lengths: tuple[str, ...] = ()
    """Lengths between picked points; see `metric/lengths.py`. With a marker they check it."""
    scale: Annotated[float, Range(low=0.0)] = 0.0
    """Metres per unit of the map; 0: not given."""

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, kw_only=True)
class ReconstructorConfig:
    """How a video or photos become posed, metric images, and these Gaussians."""

    frames: FramesConfig = field(default_factory=FramesConfig)
    poses: PosesConfig = field(default_factory=PosesConfig)
    metric: MetricConfig = field(default_factory=MetricConfig)
    gaussians: GaussiansConfig = field(default_factory=GaussiansConfig)
