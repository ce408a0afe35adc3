"""How a map becomes metric."""

from dataclasses import dataclass
from typing import Annotated, Literal

from readygo.common.config import Range, check_ranges
from readygo.services.reconstructor.metric.markers import DEFAULT_DICTIONARY


@dataclass(frozen=True, kw_only=True)
class MetricConfig:
    """What makes a map metric: a marker, lengths or a scale, in this order."""

    marker_size_m: Annotated[float, Range(low=0.0)] = 0.0
    """Printed side of the markers' black squares [m]; 0: there are none."""
    marker_dictionary: str = DEFAULT_DICTIONARY
    """Dictionary of the markers, such as 4X4_50."""
    marker_ids: tuple[int, ...] = ()
    """Markers of that size; empty: all that are found."""
    marker_on: Literal["auto", "floor", "wall"] = "auto"
    """What markers lie on; `auto` goes by how the cameras were held."""
    lengths: tuple[str, ...] = ()
    """Lengths between picked points; see `metric/lengths.py`. With a marker they check it."""
    scale: Annotated[float, Range(low=0.0)] = 0.0
    """Metres per unit of the map; 0: not given."""

    def __post_init__(self) -> None:
        check_ranges(self)
