"""A camera of `robot.toml`: all that is constant of it.

Legend: s = what the lens' radial polynomial is taken of: tan of the angle to the optical axis (Brown-Conrady, pinhole)
or the angle itself (fisheye).
"""

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from readygo.common.arrays import Float64Array

Distortion = Literal["none", "brown_conrady", "fisheye"]

DEFAULT_FOV_DEG = 100.0
LENS_COEFFICIENTS: Mapping[str, tuple[str, ...]] = {
    "none": (),
    "brown_conrady": ("k1", "k2", "p1", "p2", "k3"),
    "fisheye": ("k1", "k2", "k3", "k4"),
}
"""Coefficients of each lens model, in OpenCV's order."""
_FOXGLOVE_MODELS: Mapping[str, str] = {"none": "", "brown_conrady": "plumb_bob", "fisheye": "kannala_brandt"}
SENSOR_LIMITS: Mapping[str, tuple[float, float]] = {
    "exposure_ev": (-8.0, 8.0),
    "red_gain": (0.1, 10.0),
    "blue_gain": (0.1, 10.0),
    "vignetting": (0.0, 1.0),
    "shot_noise": (0.0, 1.0),
    "read_noise": (0.0, 1.0),
    "exposure_s": (0.0, 0.05),
    "readout_s": (0.0, 0.05),
}
"""Smallest and largest value of light and shutter."""
_LIMITS: Mapping[str, tuple[float, float]] = {
    **SENSOR_LIMITS,
    "mount_x_m": (-5.0, 5.0),
    "mount_y_m": (-5.0, 5.0),
    "mount_height_m": (0.0, 10.0),
    "mount_yaw_deg": (-180.0, 180.0),
    "mount_pitch_deg": (-89.0, 89.0),
    "latency_s": (0.0, 1.0),
    "depth_min_m": (0.0, 10.0),
    "depth_max_m": (0.1, 65.0),
    "depth_noise": (0.0, 0.1),
    "depth_lost": (0.0, 0.9),
}
_FOCAL_NAMES = ("fx_px", "fy_px", "cx_px", "cy_px")
COEFFICIENT_NAMES = ("k1", "k2", "k3", "k4", "p1", "p2")


def check_camera_value(name: str, value: float) -> None:
    """Raise ValueError unless a number may be the camera's; coefficients are judged as a lens (`make_lens`)."""
    low, high = _LIMITS.get(name, (-math.inf, math.inf))
    if not (math.isfinite(value) and low <= value <= high):
        interval = f"{low:g}..{high:g}{' s' if name.endswith('_s') else ''}" if name in _LIMITS else "a finite number"
        raise ValueError(f"{name} must be {interval}, got {value}.")


@dataclass(frozen=True, kw_only=True)
class CameraConfig:
    """A camera that is fixed to the robot; by default a level, ideal pinhole camera that looks along its x axis.

    Values that vary from episode to episode are drawn instead of these, see `SensorConfig`. Light is linear: a value of
    1 is white.
    """

    height_px: int = 144
    """Image height [px]."""
    width_px: int = 256
    """Image width [px]."""
    horizontal_fov_deg: float | None = None
    """What the image spans between the middles of its left and right edges, with every lens: the focal length follows
    from it. 100 if no intrinsics are given either."""
    fx_px: float | None = None
    """Focal length along rows [px]; together with the next three fields it replaces `horizontal_fov_deg`."""
    fy_px: float | None = None
    """Focal length along columns."""
    cx_px: float | None = None
    """Principal point from the left edge, pixel centres at +0.5."""
    cy_px: float | None = None
    """Principal point from the upper edge, pixel centres at +0.5."""
    distortion: Distortion = "none"
    """Lens: pinhole, Brown-Conrady (k1, k2, k3 radial, p1, p2 tangential) or equidistant fisheye (k1 to k4), with
    OpenCV's meaning of the coefficients."""
    k1: float = 0.0
    """Radial coefficient of s^2."""
    k2: float = 0.0
    """Radial coefficient of s^4."""
    k3: float = 0.0
    """Radial coefficient of s^6."""
    k4: float = 0.0
    """Radial coefficient of s^8."""
    p1: float = 0.0
    """Tangential coefficient."""
    p2: float = 0.0
    """Tangential coefficient."""
    mount_x_m: float = 0.0
    """Position ahead of the robot's centre [m]."""
    mount_y_m: float = 0.0
    """Position to the left of the robot's centre [m]."""
    mount_height_m: float = 0.5
    """Height above the local floor at the robot's centre [m]."""
    mount_yaw_deg: float = 0.0
    """Direction in which it looks [deg]: positive is to the left, 180 to the rear."""
    mount_pitch_deg: float = 0.0
    """Inclination [deg]: positive looks down."""
    exposure_ev: float = 0.0
    """Brighter by this many stops: light is multiplied by 2^exposure_ev."""
    red_gain: float = 1.0
    """White balance: factor on red; green's is 1."""
    blue_gain: float = 1.0
    """White balance: factor on blue."""
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
    latency_s: float = 0.0
    """Age of the image that a policy acts on [s], in whole steps of the robot's clock, the nearest. Training pairs an
    action with the image of so long before, and in closed loop a policy sees that one. Recorded images are not delayed,
    and the expert, which sees no images, has no latency."""

    depth_min_m: float = 0.0
    """Nearest depth that is measured, for policies that see depths [m]. What the next three say holds for them alone:
    recorded depths are the true ones."""
    depth_max_m: float = 10.0
    """Farthest depth that is measured [m]."""
    depth_noise: float = 0.0
    """Standard deviation of a depth of 1 m [m]; it grows with the square of the distance. Stereo and structured light
    have 0.001 to 0.005."""
    depth_lost: float = 0.0
    """Share of the pixels at which nothing is measured, besides those out of range."""

    def __post_init__(self) -> None:
        if not (8 <= self.height_px <= 4095 and 8 <= self.width_px <= 4095):
            raise ValueError(f"image size must be 8..4095 px, got {self.height_px}x{self.width_px}.")
        self._settle_intrinsics()
        if not self.depth_min_m < self.depth_max_m:
            raise ValueError(f"depth_min_m {self.depth_min_m:g} must be below depth_max_m {self.depth_max_m:g}.")
        for name in (*_LIMITS, *COEFFICIENT_NAMES):
            check_camera_value(name, getattr(self, name))
        if self.distortion not in LENS_COEFFICIENTS:
            raise ValueError(f"distortion must be one of {', '.join(LENS_COEFFICIENTS)}, got {self.distortion!r}.")
        for name in COEFFICIENT_NAMES:
            if getattr(self, name) and name not in self.coefficient_names:
                raise ValueError(f'{name} has no meaning with distortion "{self.distortion}"; choose another model.')

    def _settle_intrinsics(self) -> None:
        """Refuse intrinsics that are given by halves or in both ways; the default's are written down."""
        given = [name for name in _FOCAL_NAMES if getattr(self, name) is not None]
        if given and self.horizontal_fov_deg is not None:
            raise ValueError(f"give either horizontal_fov_deg or {', '.join(_FOCAL_NAMES)}, got both.")
        if given and len(given) < len(_FOCAL_NAMES):
            missing = [name for name in _FOCAL_NAMES if name not in given]
            raise ValueError(f"{', '.join(_FOCAL_NAMES)} belong together; {', '.join(missing)} is missing.")
        for name in given:
            value = getattr(self, name)
            if not (math.isfinite(value) and (value > 0 or name.startswith("c"))):
                raise ValueError(f"{name} must be a positive number of pixels, got {value}.")
        if not given and self.horizontal_fov_deg is None:
            object.__setattr__(self, "horizontal_fov_deg", DEFAULT_FOV_DEG)
        if self.horizontal_fov_deg is not None and not 10.0 <= self.horizontal_fov_deg <= 170.0:
            raise ValueError(f"horizontal_fov_deg must be 10..170, got {self.horizontal_fov_deg}.")

    @property
    def coefficient_names(self) -> tuple[str, ...]:
        """Coefficients of the lens model, in OpenCV's order."""
        return LENS_COEFFICIENTS[self.distortion]

    @property
    def coefficients(self) -> tuple[float, ...]:
        """Coefficients of the lens model, in OpenCV's order."""
        return tuple(getattr(self, name) for name in self.coefficient_names)

    @property
    def distortion_model(self) -> str:
        """The lens as shards and Foxglove name it: "plumb_bob", "kannala_brandt", or empty for a pinhole."""
        return _FOXGLOVE_MODELS[self.distortion]

    @property
    def radial(self) -> tuple[float, float, float, float]:
        """Coefficients of s^2 to s^8 in the radial polynomial's growth."""
        return self.k1, self.k2, self.k3, self.k4

    @property
    def ideal(self) -> bool:
        """True if images are exactly what the rasterizer draws: no lens, nothing done to the light, no shutter."""
        plain = {entry.name: entry.default for entry in dataclasses.fields(self)}
        return self.distortion == "none" and all(getattr(self, name) == plain[name] for name in SENSOR_LIMITS)

    @property
    def edge_s(self) -> float | None:
        """S at the middle of the right edge as `horizontal_fov_deg` says it; None if intrinsics are given."""
        if self.horizontal_fov_deg is None:
            return None
        half_rad = math.radians(self.horizontal_fov_deg) / 2
        return half_rad if self.distortion == "fisheye" else math.tan(half_rad)

    @property
    def K_px(self) -> Float64Array:
        """Intrinsics of the image, behind its lens [px], pixel centres at +0.5, shape (3, 3)."""
        if self.fx_px is not None:
            return np.array([[self.fx_px, 0.0, self.cx_px], [0.0, self.fy_px, self.cy_px], [0.0, 0.0, 1.0]])
        s = self.edge_s
        assert s is not None
        t = s * s
        growth = 1.0 + t * (self.k1 + t * (self.k2 + t * (self.k3 + t * self.k4)))
        focal_px = 0.5 * self.width_px / (s * growth)
        return np.array([[focal_px, 0.0, self.width_px / 2], [0.0, focal_px, self.height_px / 2], [0.0, 0.0, 1.0]])

    def place_m(self, x_m: float, y_m: float, yaw_rad: float) -> tuple[float, float]:
        """Position of a robot's camera seen from above [m].

        Args:
            x_m: World x of the robot's centre [m].
            y_m: World y of the robot's centre [m].
            yaw_rad: Its heading from the world's x axis to the left [rad].
        """
        return mounted_at(x_m, y_m, yaw_rad, self.mount_x_m, self.mount_y_m)

    def eye(self, x_m: float, y_m: float, yaw_rad: float) -> tuple[float, float, float]:
        """Where a robot's camera is, seen from above, and where it looks: x [m], y [m], yaw [rad].

        Args:
            x_m: World x of the robot's centre [m].
            y_m: World y of the robot's centre [m].
            yaw_rad: The robot's heading [rad].
        """
        return *self.place_m(x_m, y_m, yaw_rad), yaw_rad + math.radians(self.mount_yaw_deg)

    def T_world_camera(self, x_m: float, y_m: float, yaw_rad: float, floor_m: float) -> Float64Array:
        """Pose of the camera of a robot on the floor, OpenCV axes, shape (4, 4).

        Args:
            x_m: World x of the robot's centre [m].
            y_m: World y of the robot's centre [m].
            yaw_rad: Its heading from the world's x axis to the left [rad].
            floor_m: Height of the floor below it [m].
        """
        looks_rad = yaw_rad + math.radians(self.mount_yaw_deg)
        c, s = math.cos(looks_rad), math.sin(looks_rad)
        pitch_rad = math.radians(self.mount_pitch_deg)
        level, down = math.cos(pitch_rad), math.sin(pitch_rad)
        T = np.eye(4)
        T[:3, 0] = (s, -c, 0.0)
        # 0 - x is never -0: a level camera's pose has the bytes that it had before there was a pitch.
        T[:3, 1] = (0.0 - down * c, 0.0 - down * s, -level)
        T[:3, 2] = (level * c, level * s, 0.0 - down)
        T[:3, 3] = (*self.place_m(x_m, y_m, yaw_rad), floor_m + self.mount_height_m)
        return T


def mounted_at(x_m: float, y_m: float, yaw_rad: float, mount_x_m: float, mount_y_m: float) -> tuple[float, float]:
    """Position in the world of a point of a robot [m]; plain arithmetic, which numba compiles for compiled callers.

    Args:
        x_m: World x of the robot's centre [m].
        y_m: World y of the robot's centre [m].
        yaw_rad: Its heading from the world's x axis to the left [rad].
        mount_x_m: The point in the robot's frame, forward [m].
        mount_y_m: The point in the robot's frame, to the left [m].
    """
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return x_m + c * mount_x_m - s * mount_y_m, y_m + s * mount_x_m + c * mount_y_m
