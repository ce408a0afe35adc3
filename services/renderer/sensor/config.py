"""Settings of the camera's sensor and lens: fixed values, ranges to draw from per episode, and recipes."""

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

Range = tuple[float, ...]
"""(lowest, highest), or () for the fixed value."""

SensorName = Literal["off", "sensor_phone_like"]
"""Names of the recipes in `SENSOR_RECIPES`."""

_LIMITS: Mapping[str, tuple[float, float]] = {
    "exposure_ev": (-8.0, 8.0),
    "red_gain": (0.1, 10.0),
    "blue_gain": (0.1, 10.0),
    "vignetting": (0.0, 1.0),
    "shot_noise": (0.0, 1.0),
    "read_noise": (0.0, 1.0),
    "exposure_s": (0.0, 0.05),
    "readout_s": (0.0, 0.05),
}
"""Smallest and largest value; the coefficients of a lens are judged together with the camera (`make_lens`)."""


@dataclass(frozen=True, kw_only=True)
class SensorRanges:
    """Values that are drawn anew for every episode, uniformly from (lowest, highest); () keeps the fixed value."""

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
                raise ValueError(f"ranges.{name} must be [lowest, highest], got {list(ends)}.")

    def items(self) -> list[tuple[str, Range]]:
        """Names and ranges, in the order in which they are drawn."""
        return [(entry.name, getattr(self, entry.name)) for entry in dataclasses.fields(self)]


@dataclass(frozen=True, kw_only=True)
class SensorConfig:
    """What lens and sensor do to an image; by default nothing.

    Light is linear: a value of 1 is white.
    """

    distortion: Literal["none", "brown_conrady", "fisheye"] = "none"
    """Lens: pinhole, Brown-Conrady (k1, k2, k3 radial, p1, p2 tangential) or equidistant fisheye (k1 to k4), with
    OpenCV's meaning of the coefficients. The focal length follows from the robot's horizontal field of view, which
    the image spans with every lens."""
    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    exposure_ev: float = 0.0
    """Brighter by this many stops: light is multiplied by 2^exposure_ev."""
    red_gain: float = 1.0
    """White balance: factor on red; green's is 1."""
    blue_gain: float = 1.0
    vignetting: float = 0.0
    """Share of the light that is lost in the corners; it grows with the square of the distance from the centre."""
    shot_noise: float = 0.0
    """Standard deviation of the photon noise at white; it falls with the square root of the light. A pixel that holds
    10,000 electrons has 0.01."""
    read_noise: float = 0.0
    """Standard deviation of the noise that does not depend on the light, in parts of white."""
    exposure_s: float = 0.0
    """Time for which each row collects light [s]: motion blur."""
    readout_s: float = 0.0
    """Time from the first row's end of exposure to the last row's [s]: rolling shutter."""
    sub_frames: int = 8
    """Images drawn per frame where the shutter takes time: the cost of a frame grows with it. Enough are those between
    which the image moves by about a pixel."""
    ranges: SensorRanges = field(default_factory=SensorRanges)

    def __post_init__(self) -> None:
        if not 2 <= self.sub_frames <= 64:
            raise ValueError(f"sub_frames must be 2..64, got {self.sub_frames}.")
        ranges = dict(self.ranges.items())
        for name in ranges:
            for value in (getattr(self, name), *ranges[name]):
                low, high = _LIMITS.get(name, (-math.inf, math.inf))
                if not (math.isfinite(value) and low <= value <= high):
                    raise ValueError(f"{name} must be {_interval(name)}, got {value}.")
        unused = [name for name in ("k1", "k2", "k3", "k4", "p1", "p2") if name not in self.coefficient_names]
        for name in unused:
            if getattr(self, name) or ranges[name]:
                raise ValueError(f'{name} has no meaning with distortion "{self.distortion}"; choose another model.')

    @property
    def coefficient_names(self) -> tuple[str, ...]:
        """Coefficients of the distortion model, in OpenCV's order."""
        return {
            "none": (),
            "brown_conrady": ("k1", "k2", "p1", "p2", "k3"),
            "fisheye": ("k1", "k2", "k3", "k4"),
        }[self.distortion]

    @property
    def off(self) -> bool:
        """True if images are exactly what the rasterizer draws."""
        plain = SensorConfig(sub_frames=self.sub_frames)
        return self == plain

    def drawn(self, rng: np.random.Generator) -> "SensorConfig":
        """One episode's sensor: every range replaced by a value from it.

        One number is drawn per name, whether it has a range or not, so that a range more changes no other value.
        """
        values: dict[str, Any] = {"ranges": SensorRanges()}
        for name, ends in self.ranges.items():
            share = rng.random()
            if ends:
                values[name] = ends[0] + (ends[1] - ends[0]) * share
        return dataclasses.replace(self, **values)

    def extremes(self) -> list["SensorConfig"]:
        """Every combination of the ends of the lens coefficients' ranges: all lenses lie between these."""
        ranges = dict(self.ranges.items())
        found = [dataclasses.replace(self, ranges=SensorRanges())]
        for name in self.coefficient_names:
            found = [_with(one, name, end) for one in found for end in ranges[name]] or found
        return found


def _with(sensor: SensorConfig, name: str, value: float) -> SensorConfig:
    values: dict[str, Any] = {name: value}
    return dataclasses.replace(sensor, **values)


def _interval(name: str) -> str:
    if name not in _LIMITS:
        return "a finite number"
    low, high = _LIMITS[name]
    return f"{low:g}..{high:g}{' s' if name.endswith('_s') else ''}"


def sensor_off() -> SensorConfig:
    """The ideal pinhole camera."""
    return SensorConfig()


def sensor_phone_like() -> SensorConfig:
    """A small camera module as in a phone: slight distortion, noise, motion blur and rolling shutter, all varied."""
    return SensorConfig(
        distortion="brown_conrady",
        sub_frames=4,
        ranges=SensorRanges(
            k1=(-0.04, 0.01),
            k2=(-0.002, 0.006),
            p1=(-0.001, 0.001),
            p2=(-0.001, 0.001),
            exposure_ev=(-0.3, 0.3),
            red_gain=(0.92, 1.08),
            blue_gain=(0.92, 1.08),
            vignetting=(0.05, 0.3),
            shot_noise=(0.005, 0.02),
            read_noise=(0.0005, 0.002),
            exposure_s=(1 / 200, 1 / 60),
            readout_s=(0.010, 0.020),
        ),
    )


SENSOR_RECIPES: Mapping[SensorName, Callable[[], SensorConfig]] = {
    "off": sensor_off,
    "sensor_phone_like": sensor_phone_like,
}
"""Sensors by the name that the command line takes."""
