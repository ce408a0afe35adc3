"""`[renderer.sensor]`: what varies of the camera from episode to episode."""

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from readygo.common.camera.config import CameraConfig, check_camera_value

Range = tuple[float, ...]
"""(lowest, highest), or () for the camera's own value."""


@dataclass(frozen=True, kw_only=True)
class SensorConfig:
    """Values of the camera that are drawn anew for every episode in place of its own: (lowest, highest), uniformly.

    () keeps the camera's own value. The names are those of `CameraConfig`.
    """

    k1: Range = ()
    k2: Range = ()
    k3: Range = ()
    k4: Range = ()
    p1: Range = ()
    p2: Range = ()
    exposure_ev: Range = ()
    red_gain: Range = ()
    blue_gain: Range = ()
    vignetting: Range = ()
    shot_noise: Range = ()
    read_noise: Range = ()
    exposure_s: Range = ()
    readout_s: Range = ()

    def __post_init__(self) -> None:
        for name, ends in self.items():
            if len(ends) not in (0, 2) or any(not math.isfinite(end) for end in ends) or list(ends) != sorted(ends):
                raise ValueError(f"{name} must be [lowest, highest], got {list(ends)}.")
            for end in ends:
                check_camera_value(name, end)

    def items(self) -> list[tuple[str, Range]]:
        """Names and ranges, in the order in which they are drawn."""
        return [(entry.name, getattr(self, entry.name)) for entry in dataclasses.fields(self)]

    @property
    def varies(self) -> bool:
        """True if there is a range."""
        return any(ends for _, ends in self.items())

    def middle(self, camera: CameraConfig) -> CameraConfig:
        """The camera with every value that has a range in the middle of it."""
        values: dict[str, Any] = {name: 0.5 * (ends[0] + ends[1]) for name, ends in self.items() if ends}
        return dataclasses.replace(camera, **values)

    def drawn(self, camera: CameraConfig, rng: np.random.Generator) -> CameraConfig:
        """One episode's camera: every value with a range replaced by one from it.

        One number is drawn per name, whether it has a range or not, so that a range more changes no other value.
        """
        values: dict[str, Any] = {}
        for name, ends in self.items():
            share = rng.random()
            if ends:
                values[name] = ends[0] + (ends[1] - ends[0]) * share
        return dataclasses.replace(camera, **values)

    def extremes(self, camera: CameraConfig) -> list[CameraConfig]:
        """The camera with every combination of the ends of its coefficients' ranges: all lenses lie between these."""
        ranges = dict(self.items())
        found: list[dict[str, Any]] = [{}]
        for name in camera.coefficient_names:
            found = [one | {name: end} for one in found for end in ranges[name]] or found
        return [dataclasses.replace(camera, **values) for values in found]
