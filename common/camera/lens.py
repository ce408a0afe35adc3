"""Lenses: which ray a pixel of a distorted image sees.

Legend: s = what the radial polynomial is taken of: tan of the angle to the optical axis (Brown-Conrady) or the angle
itself (fisheye); g(s) = s (1 + a1 s^2 + a2 s^4 + a3 s^6 + a4 s^8) = distance from the image's centre over the focal
length; (x, y) = a ray's point on the plane z = 1; (u, v) = pixel, centres at +0.5.

Scalar arithmetic in a fixed order: the same bits on every CPU.

Source: OpenCV 4, modules calib3d and fisheye (Brown, Close-range camera calibration, 1971; Kannala and Brandt, A
generic camera model and calibration method, 2006).
"""

import math
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.camera.config import COEFFICIENT_NAMES, CameraConfig
from readygo.common.camera.sensor import SensorConfig
from readygo.common.errors import ConfigError
from readygo.common.kernels import kernel_with_cache

ANGLE_MAX_RAD = math.radians(88.0)
"""Rays further from the optical axis are refused: depth along the axis stays positive."""
FOLD_STEPS = 8192
NEWTON_STEPS = 50
_RESIDUAL_MAX = 1e-10


@dataclass(frozen=True, kw_only=True, eq=False)
class Lens:
    """A lens in front of an image."""

    fisheye: bool
    radial: tuple[float, float, float, float]
    """Radial coefficients a1 to a4."""
    tangential: tuple[float, float] = (0.0, 0.0)
    """p1, p2 of Brown-Conrady."""
    s_max: float
    """Up to here the radial polynomial grows."""
    K_px: Float64Array
    """Intrinsics of the distorted image [px], shape (3, 3)."""
    height_px: int
    width_px: int
    distortion: str
    """Name of the model in `CameraConfig`."""
    coefficients: tuple[float, ...]
    """In OpenCV's order: k1, k2, p1, p2, k3 (Brown-Conrady) or k1 to k4 (fisheye)."""

    def rays(self, uv_px: Float64Array) -> Float64Array:
        """Points on the plane z = 1 that pixels see, NaN where the lens sees nothing.

        Args:
            uv_px: Pixels, shape (N, 2).

        Returns:
            Shape (N, 2).
        """
        return _rays(np.ascontiguousarray(uv_px, dtype=np.float64), *self._numbers())

    def pixels(self, xy: Float64Array) -> Float64Array:
        """Pixels that see points on the plane z = 1, shape (N, 2) -> (N, 2)."""
        return _pixels(np.ascontiguousarray(xy, dtype=np.float64), *self._numbers())

    @property
    def radius_max(self) -> float:
        """Largest distance from the optical axis, on the plane z = 1, of a point that the lens can show."""
        return math.tan(self.s_max) if self.fisheye else self.s_max

    def _numbers(self) -> tuple[bool, Float64Array, float, tuple[float, float, float, float]]:
        c, K = np.array([*self.radial, *self.tangential]), self.K_px
        return self.fisheye, c, self.s_max, (float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]))


def make_lens(camera: CameraConfig) -> Lens:
    """The lens of a camera.

    Raises:
        ConfigError: If the distortion folds the image, or shows more than a half space.
    """
    fisheye, s = camera.distortion == "fisheye", camera.edge_s
    s_max = _grows_until(np.array(camera.radial), ANGLE_MAX_RAD if fisheye else math.tan(ANGLE_MAX_RAD))
    if camera.distortion != "none" and s is not None and s >= s_max:
        raise ConfigError(_folds(camera, f"the field of view of {camera.horizontal_fov_deg:g} deg is beyond that"))
    lens = Lens(
        fisheye=fisheye,
        radial=camera.radial,
        tangential=(camera.p1, camera.p2),
        s_max=s_max,
        K_px=camera.K_px,
        height_px=camera.height_px,
        width_px=camera.width_px,
        distortion=camera.distortion,
        coefficients=camera.coefficients,
    )
    if lens.distortion != "none" and np.isnan(lens.rays(_border(camera.height_px, camera.width_px))).any():
        raise ConfigError(_folds(camera, "the image's corners are beyond that"))
    return lens


def check_sensor(sensor: SensorConfig, camera: CameraConfig) -> None:
    """Raise ConfigError if some lens between the ends of the sensor's ranges cannot be drawn with a camera."""
    for name, ends in sensor.items():
        if ends and name in COEFFICIENT_NAMES and name not in camera.coefficient_names:
            raise ConfigError(
                f'renderer.sensor.{name} has no meaning with distortion "{camera.distortion}" of the robot\'s camera; '
                "choose another model there, or leave the range out."
            )
    for extreme in sensor.extremes(camera):
        make_lens(extreme)


def _folds(camera: CameraConfig, why: str) -> str:
    values = ", ".join(f"{name} {getattr(camera, name):g}" for name in camera.coefficient_names)
    remedy = "a longer focal length" if camera.horizontal_fov_deg is None else "a smaller horizontal_fov_deg"
    return (
        f"The {camera.distortion} distortion ({values}) folds the image, or shows more than "
        f"{math.degrees(2 * ANGLE_MAX_RAD):g} deg: {why}. Use smaller coefficients or {remedy}."
    )


def _border(height_px: int, width_px: int) -> Float64Array:
    """The outer border of an image at every half pixel, shape (N, 2)."""
    u, v = 0.5 * np.arange(2 * width_px + 1), 0.5 * np.arange(2 * height_px + 1)
    top = np.stack([u, np.zeros_like(u)], axis=1)
    left = np.stack([np.zeros_like(v), v], axis=1)
    bottom, right = np.stack([u, np.full_like(u, height_px)], axis=1), np.stack([np.full_like(v, width_px), v], axis=1)
    return np.concatenate([top, bottom, left, right])


@kernel_with_cache(error_model="numpy")
def _growth(c: Float64Array, s: float) -> float:
    """The growth of the lens function, g(s) / s."""
    t = s * s
    return float(1.0 + t * (c[0] + t * (c[1] + t * (c[2] + t * c[3]))))


@kernel_with_cache(error_model="numpy")
def _slope(c: Float64Array, s: float) -> float:
    """Derivative of the lens function g at s."""
    t = s * s
    return float(1.0 + t * (3.0 * c[0] + t * (5.0 * c[1] + t * (7.0 * c[2] + t * 9.0 * c[3]))))


@kernel_with_cache(error_model="numpy")
def _grows_until(c: Float64Array, s_limit: float) -> float:
    """The largest s up to `s_limit` before which g grows everywhere."""
    for step in range(1, FOLD_STEPS + 1):
        if _slope(c, s_limit * step / FOLD_STEPS) <= 0.0:
            return s_limit * (step - 1) / FOLD_STEPS
    return s_limit


@kernel_with_cache(error_model="numpy")
def _inverse(c: Float64Array, s_max: float, q: float) -> float:
    """The s with g(s) = q, by Newton's method between bounds; NaN beyond `s_max`."""
    low, high = 0.0, s_max
    if q > s_max * _growth(c, s_max):
        return math.nan
    s = min(q, 0.5 * s_max)
    for _ in range(NEWTON_STEPS):
        error = s * _growth(c, s) - q
        if error == 0.0:
            break
        if error > 0.0:
            high = s
        else:
            low = s
        following = s - error / _slope(c, s)
        if not low < following < high:
            following = 0.5 * (low + high)
        if following == s:
            break
        s = following
    return s


@kernel_with_cache(error_model="numpy")
def _distort(c: Float64Array, x: float, y: float) -> tuple[float, float, float, float, float]:
    """Brown-Conrady: image point over focal length of (x, y), and its derivatives xx, xy (= yx), yy."""
    r2, p1, p2 = x * x + y * y, c[4], c[5]
    r = math.sqrt(r2)
    growth = _growth(c, r)
    # d growth / d x = bend * x
    bend = (_slope(c, r) - growth) / r2 if r2 > 1e-30 else 2.0 * c[0]
    return (
        x * growth + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y * growth + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        growth + x * x * bend + 2.0 * p1 * y + 6.0 * p2 * x,
        x * y * bend + 2.0 * p1 * x + 2.0 * p2 * y,
        growth + y * y * bend + 6.0 * p1 * y + 2.0 * p2 * x,
    )


@kernel_with_cache(error_model="numpy")
def _ray(fisheye: bool, c: Float64Array, s_max: float, xd: float, yd: float) -> tuple[float, float]:
    """The ray (x, y) behind an image point over the focal length; NaN where there is none."""
    q = math.sqrt(xd * xd + yd * yd)
    s = _inverse(c, s_max, q)
    if fisheye:
        factor = math.tan(s) / q if q > 0.0 else 1.0
        return xd * factor, yd * factor
    factor = s / q if q > 0.0 else 1.0
    x, y = xd * factor, yd * factor
    if (c[4] == 0.0 and c[5] == 0.0) or math.isnan(x):
        return x, y
    residual = math.inf
    for _ in range(NEWTON_STEPS):
        ex, ey, xx, xy, yy = _distort(c, x, y)
        ex, ey, area = ex - xd, ey - yd, xx * yy - xy * xy
        residual = abs(ex) + abs(ey)
        if area <= 0.0 or x * x + y * y > s_max * s_max:
            return math.nan, math.nan
        if residual < 1e-13:
            break
        x, y = x - (yy * ex - xy * ey) / area, y - (xx * ey - xy * ex) / area
    if residual > _RESIDUAL_MAX:
        return math.nan, math.nan
    return x, y


@kernel_with_cache(error_model="numpy")
def _rays(
    uv: Float64Array, fisheye: bool, c: Float64Array, s_max: float, intrinsics: tuple[float, float, float, float]
) -> Float64Array:
    fx, fy, cx, cy = intrinsics
    out = np.empty_like(uv)
    for i in range(len(uv)):
        out[i] = _ray(fisheye, c, s_max, (uv[i, 0] - cx) / fx, (uv[i, 1] - cy) / fy)
    return out


@kernel_with_cache(error_model="numpy")
def _pixels(
    xy: Float64Array, fisheye: bool, c: Float64Array, s_max: float, intrinsics: tuple[float, float, float, float]
) -> Float64Array:
    fx, fy, cx, cy = intrinsics
    out = np.empty_like(xy)
    for i in range(len(xy)):
        x, y = xy[i, 0], xy[i, 1]
        if fisheye:
            r = math.sqrt(x * x + y * y)
            s = math.atan(r)
            factor = s * _growth(c, s) / r if r > 0.0 else 1.0
            x, y = x * factor, y * factor
        else:
            x, y, _, _, _ = _distort(c, x, y)
        out[i, 0], out[i, 1] = fx * x + cx, fy * y + cy
    return out
