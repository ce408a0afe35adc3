"""`[renderer.sensor]`: what varies of the camera from episode to episode."""

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np

from readygo.common.camera.config import CameraConfig, check_camera_value
from readygo.common.ranges import Range, Ranges


@dataclass(frozen=True, kw_only=True)
class SensorConfig(Ranges):
    """Ranges (lowest, highest) from which each episode draws values of the camera, uniformly.

    () keeps the camera's own value. The names are those of `CameraConfig`.
    """

    k1: Range = ()
    """Radial lens coefficient of s^2."""
    k2: Range = ()
    """Radial lens coefficient of s^4."""
    k3: Range = ()
    """Radial lens coefficient of s^6."""
    k4: Range = ()
    """Radial lens coefficient of s^8."""
    p1: Range = ()
    """Tangential lens coefficient."""
    p2: Range = ()
    """Tangential lens coefficient."""
    exposure_ev: Range = ()
    """Exposure [stops]: light is multiplied by 2^exposure_ev."""
    red_gain: Range = ()
    """White balance: factor on red."""
    blue_gain: Range = ()
    """White balance: factor on blue."""
    vignetting: Range = ()
    """Share of the light that is lost in the corners."""
    shot_noise: Range = ()
    """Standard deviation of the photon noise at white."""
    read_noise: Range = ()
    """Standard deviation of the noise that does not depend on the light, in parts of white."""
    exposure_s: Range = ()
    """Time for which each row collects light [s]: motion blur."""
    readout_s: Range = ()
    """Time from the first row's end of exposure to the last row's [s]: rolling shutter."""

    def __post_init__(self) -> None:
        self.check(check_camera_value)

    def middle(self, camera: CameraConfig) -> CameraConfig:
        """The camera with every value that has a range in the middle of it."""
        values: dict[str, Any] = {name: 0.5 * (ends[0] + ends[1]) for name, ends in self.items() if ends}
        return dataclasses.replace(camera, **values)

    def draw_camera(self, camera: CameraConfig, rng: np.random.Generator) -> CameraConfig:
        """One episode's camera: every value with a range replaced by one from it."""
        values: dict[str, Any] = dict(self.drawn_values(rng))
        return dataclasses.replace(camera, **values)

    def extremes(self, camera: CameraConfig) -> list[CameraConfig]:
        """The camera with every combination of the ends of its coefficients' ranges: all lenses lie between these."""
        ranges = dict(self.items())
        found: list[dict[str, Any]] = [{}]
        for name in camera.coefficient_names:
            found = [one | {name: end} for one in found for end in ranges[name]] or found
        return [dataclasses.replace(camera, **values) for values in found]
