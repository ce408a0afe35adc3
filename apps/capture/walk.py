"""The motion of a hand-held phone: along a path, with the bobbing of steps and changing view directions.

A walk is a function of time. It begins and ends with a view of the marker, and passes every place as often as time
allows. Each lap has a different view direction, so that one lap shows the parts that another one misses.
"""

import math
from dataclasses import dataclass

import numpy as np

from readygo.apps.capture.ground import WalkableGround, closed_way, marker_place
from readygo.apps.views.sightlines import sight_m
from readygo.common.arrays import Float64Array
from readygo.common.frames import wrap_angle
from readygo.common.scenes import Scene

HEIGHTS_M = (1.4, 1.6)
SPEED_MPS, SPEED_MAX_MPS = 0.5, 1.0
OVERLAP_M = 1.5
"""Length by which the last lap continues beyond the start of the first one [m]."""
STEPS_HZ = 1.8
LOOK_S = 4.0
"""Duration of the view of the marker at the start of the walk [s]."""
_TABLE_HZ = 20.0
_PITCH_RAD = math.radians(-14.0)
_LAP_YAWS_RAD = (math.radians(55.0), math.radians(-5.0), math.radians(100.0), math.radians(-35.0))
"""View direction of each lap, from its heading to the left, where the middle of the place is [rad]."""
_LOOK_AROUND_RAD = math.radians(30.0)
_SIGHT_MIN_M = 1.8
_BEARINGS_RAD = np.radians(np.arange(-180.0, 180.0, 10.0))


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraWalk:
    """Poses of a hand-held camera over time."""

    way_m: float
    """Length of the walk [m]."""
    loop_m: float
    """Length of the closed path [m]; a walk shorter than this does not close it."""
    marker_xy_m: tuple[float, float]
    knots: Float64Array
    """x, y, z [m], yaw, pitch (up), roll [rad] at `_TABLE_HZ`, shape (T, 6); angles are unwrapped."""

    def pose_at(self, time_s: float) -> Float64Array:
        """`T_world_camera` at a time, OpenCV axes, shape (4, 4); before and after the walk the camera rests."""
        at = min(max(time_s * _TABLE_HZ, 0.0), len(self.knots) - 1.0)
        values = _cubic(self.knots, at)
        return camera_pose(values[:3], *(float(angle) for angle in values[3:]))


def camera_pose(place_m: Float64Array, yaw_rad: float, pitch_rad: float, roll_rad: float) -> Float64Array:
    """Pose of a camera, OpenCV axes, shape (4, 4).

    Args:
        place_m: Centre of the camera [m], shape (3,).
        yaw_rad: View direction, from the world's x axis to the left [rad].
        pitch_rad: Positive looks up [rad].
        roll_rad: Positive turns the camera clockwise about its view direction [rad].
    """
    c, s, cp, sp = math.cos(yaw_rad), math.sin(yaw_rad), math.cos(pitch_rad), math.sin(pitch_rad)
    forward, level_right = np.array([c * cp, s * cp, sp]), np.array([s, -c, 0.0])
    level_down = np.cross(forward, level_right)
    cr, sr = math.cos(roll_rad), math.sin(roll_rad)
    T = np.eye(4)
    T[:3, 0], T[:3, 1] = cr * level_right + sr * level_down, cr * level_down - sr * level_right
    T[:3, 2], T[:3, 3] = forward, place_m
    return T


def plan_walk(scene: Scene, ground: WalkableGround, seconds: float, rng: np.random.Generator) -> CameraWalk:
    """A walk over a ground.

    Args:
        scene: Scene, for floor heights and occlusion.
        ground: Walkable ground.
        seconds: Duration [s].
        rng: Random generator of the hand's and body's movements.

    Raises:
        SceneError: If the ground is too narrow.
    """
    way = closed_way(ground)
    begin, marker_xy_m = marker_place(ground, way)
    loop_m = float(np.hypot(*(np.roll(way, -1, axis=0) - way).T).sum())
    laps = max(1, round((SPEED_MPS * seconds - OVERLAP_M) / loop_m))
    way_m = min(laps * loop_m + OVERLAP_M, SPEED_MAX_MPS * seconds)
    time_s = np.arange(math.ceil(seconds * _TABLE_HZ) + 1) / _TABLE_HZ
    gone_m = _walked_distances(time_s, way_m, rng)
    xy_m, heading_rad = _along(np.roll(way, -begin, axis=0), gone_m)
    sway = Sway(rng)
    yaw_rad, pitch_rad = _gaze(scene, xy_m, heading_rad, gone_m / loop_m, time_s, sway)
    z_m = scene.maps.floor.at_many(xy_m) + 0.5 * sum(HEIGHTS_M) + sway.slow(time_s, 0.07, 9.0)
    yaw_rad, pitch_rad = _towards_marker(scene, (xy_m, z_m), (yaw_rad, pitch_rad), time_s, gone_m / loop_m, marker_xy_m)
    knots = np.column_stack([xy_m, _smooth(z_m, 0.3), yaw_rad, pitch_rad, sway.slow(time_s, math.radians(1.5), 3.0)])
    return CameraWalk(
        way_m=way_m,
        loop_m=loop_m,
        marker_xy_m=marker_xy_m,
        knots=knots + _bobbing(time_s, heading_rad, sway),
    )


class Sway:
    """Smooth random movements: sums of waves with random phases."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng

    def slow(self, time_s: Float64Array, amplitude: float, period_s: float) -> Float64Array:
        """A movement within +-`amplitude`, about once in `period_s`."""
        out = np.zeros_like(time_s)
        for share, factor in ((0.5, 1.0), (0.3, 0.62), (0.2, 0.41)):
            phase = self._rng.uniform(0.0, math.tau)
            out += share * np.sin(math.tau * time_s / (period_s * factor) + phase)
        return amplitude * out


def _walked_distances(time_s: Float64Array, way_m: float, rng: np.random.Generator) -> Float64Array:
    """Distance walked at times [m]: slow at the start, where the marker is filmed, and never at a constant speed."""
    pace = 1.0 + Sway(rng).slow(time_s, 0.35, 6.0)
    pace *= 1.0 - 0.7 * _until(time_s, LOOK_S)
    gone = np.concatenate([[0.0], np.cumsum(0.5 * (pace[1:] + pace[:-1]))])
    return np.asarray(way_m * gone / gone[-1], dtype=np.float64)


def _until(time_s: Float64Array, end_s: float) -> Float64Array:
    """1 until a second before a time, 0 from it on."""
    left = np.clip(end_s - time_s, 0.0, 1.0)
    return np.asarray(left * left * (3.0 - 2.0 * left), dtype=np.float64)


def _along(way: Float64Array, gone_m: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Positions at distances along the closed path [m], shape (T, 2), and its headings there [rad], unwrapped."""
    step_m = float(np.hypot(*(np.roll(way, -1, axis=0) - way).T).mean())
    at = gone_m / step_m
    index = np.arange(len(way) + 1)
    closed = np.concatenate([way, way[:1]])
    xy_m = np.stack([np.interp(at % len(way), index, closed[:, k]) for k in (0, 1)], axis=1)
    chord = np.roll(way, -10, axis=0) - np.roll(way, 10, axis=0)
    heading = np.arctan2(chord[:, 1], chord[:, 0])[np.floor(at).astype(np.int64) % len(way)]
    return xy_m, np.unwrap(heading)


def _gaze(
    scene: Scene, xy_m: Float64Array, heading_rad: Float64Array, laps: Float64Array, time_s: Float64Array, sway: Sway
) -> tuple[Float64Array, Float64Array]:
    """Yaw and pitch of the camera [rad]: a side that changes from lap to lap, with sway, and away from close walls."""
    lap_yaw = np.array(_LAP_YAWS_RAD)[np.floor(laps).astype(np.int64) % len(_LAP_YAWS_RAD)]
    wanted = heading_rad + _smooth(lap_yaw, 1.0) + sway.slow(time_s, _LOOK_AROUND_RAD, 8.0)
    seen_m = sight_m(scene.maps.sight.opaque_between(1.1, HEIGHTS_M[1]), scene.maps.human.frame, xy_m, _BEARINGS_RAD)
    # An image shows directions up to 30 deg beside its centre.
    open_m = np.minimum.reduce([np.roll(seen_m, shift, axis=1) for shift in (-2, -1, 0, 1, 2)]) * 0.5 + seen_m * 0.5
    off = wrap_angle(_BEARINGS_RAD[None, :] - wanted[:, None])
    cost = (off / math.radians(50.0)) ** 2 + (np.maximum(0.0, _SIGHT_MIN_M - open_m) / 0.4) ** 2
    chosen = wanted + off[np.arange(len(off)), np.argmin(cost, axis=1)]
    pitch = _PITCH_RAD + sway.slow(time_s, math.radians(8.0), 7.0)
    return _smooth(np.unwrap(chosen), 0.7), pitch


def _towards_marker(
    scene: Scene,
    place: tuple[Float64Array, Float64Array],
    gaze: tuple[Float64Array, Float64Array],
    time_s: Float64Array,
    laps: Float64Array,
    marker_xy_m: tuple[float, float],
) -> tuple[Float64Array, Float64Array]:
    """Yaw and pitch [rad], turned to the marker at the start and each time a lap passes it."""
    (xy_m, z_m), (yaw, pitch) = place, gaze
    off_m = np.array(marker_xy_m) - xy_m
    away_m = np.hypot(*off_m.T)
    passing = np.exp(-(((away_m - 1.3) / 0.5) ** 2)) * (laps > 0.8) * (away_m > 0.7)
    weight = np.maximum(_until(time_s, LOOK_S), 0.9 * _smooth(passing, 0.5))
    bearing = np.arctan2(off_m[:, 1], off_m[:, 0])
    fall = np.arctan2(scene.maps.floor.at(*marker_xy_m) - z_m, np.maximum(away_m, 0.3))
    yaw = yaw + weight * wrap_angle(bearing - yaw)
    # A little above the marker, so that images show more than the marker.
    pitch = pitch + weight * (fall + math.radians(8.0) - pitch)
    return _smooth(np.unwrap(yaw), 0.3), _smooth(pitch, 0.3)


def _bobbing(time_s: Float64Array, heading_rad: Float64Array, sway: Sway) -> Float64Array:
    """Offsets by steps and hands in x, y, z [m], yaw, pitch and roll [rad], shape (T, 6)."""
    step = math.tau * STEPS_HZ * time_s
    side_m = 0.015 * np.sin(0.5 * step) + sway.slow(time_s, 0.02, 2.5)
    return np.column_stack(
        [
            -np.sin(heading_rad) * side_m,
            np.cos(heading_rad) * side_m,
            0.012 * np.sin(step) + sway.slow(time_s, 0.01, 1.7),
            sway.slow(time_s, math.radians(1.2), 1.1),
            sway.slow(time_s, math.radians(0.8), 0.9) + math.radians(0.3) * np.sin(step),
            math.radians(0.8) * np.sin(0.5 * step),
        ]
    )


def _smooth(values: Float64Array, sigma_s: float) -> Float64Array:
    from scipy.ndimage import gaussian_filter1d

    return np.asarray(gaussian_filter1d(values, sigma_s * _TABLE_HZ, mode="nearest"), dtype=np.float64)


def _cubic(knots: Float64Array, at: float) -> Float64Array:
    """Catmull-Rom interpolation between knots at a fractional index."""
    k = min(int(at), len(knots) - 2)
    t = at - k
    a, b, c, d = (knots[min(max(k + shift, 0), len(knots) - 1)] for shift in (-1, 0, 1, 2))
    value: Float64Array = b + 0.5 * t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a)))
    return value
