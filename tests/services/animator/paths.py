"""Trajectories and floors to walk on, 20 Hz, metres."""

from collections.abc import Callable

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.maps.grid import FloorMap, GridFrame


def times(duration_s: float = 10.0) -> Float64Array:
    """Times of rows at 20 Hz [s]."""
    return np.arange(round(duration_s * 20)) * 0.05


def line(speed_mps: float, duration_s: float = 10.0) -> Float64Array:
    """Straight along x at constant speed, the middle at the origin."""
    t = times(duration_s)
    return np.stack([speed_mps * (t - 0.5 * duration_s), 0.0 * t], axis=1)


def circle(speed_mps: float, radius_m: float = 1.5) -> Float64Array:
    """Around the origin to the left."""
    angle = speed_mps * times() / radius_m
    return radius_m * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def s_curve(speed_mps: float) -> Float64Array:
    """Winding to both sides of x."""
    heading = 0.9 * np.sin(0.9 * speed_mps * times())
    return np.cumsum(np.stack([np.cos(heading), np.sin(heading)], axis=1) * speed_mps * 0.05, axis=0)


def stop_and_go(speed_mps: float) -> Float64Array:
    """Stand, walk along x, stop, turn left by 90 deg, walk along y up to the last row."""
    t = times()
    pace = np.interp(t, [0.5, 1.3, 4.0, 4.8, 6.5, 7.3], [0.0, 1.0, 1.0, 0.0, 0.0, 1.0])
    along = np.where((t < 6.0)[:, None], [1.0, 0.0], [0.0, 1.0])
    return np.cumsum(along * (speed_mps * 0.05 * pace)[:, None], axis=0)


def turn_in_place(speed_mps: float) -> Float64Array:
    """Walk along x, stop, turn by 135 deg and walk away, with eased starts and stops."""
    t = times()
    pace = np.interp(t, [0.3, 1.1, 3.5, 4.3, 6.0, 6.8], [0.0, 1.0, 1.0, 0.0, 0.0, 1.0])
    along = np.where((t < 5.0)[:, None], [1.0, 0.0], [-np.sqrt(0.5), np.sqrt(0.5)])
    return np.cumsum(along * (speed_mps * 0.05 * pace)[:, None], axis=0)


def dash(speed_mps: float) -> Float64Array:
    """From a stand along x up to a speed within 1.5 s, and to a stand again before the last row."""
    t = times()
    pace = np.interp(t, [0.5, 2.0, 7.5, 9.0], [0.0, 1.0, 1.0, 0.0])
    x = np.cumsum(pace * speed_mps * 0.05)
    return np.stack([x - 0.5 * x[-1], 0.0 * t], axis=1)


def hard_stops(speed_mps: float, pause_s: float) -> Float64Array:
    """Full speed from the first row, a pause after 3 s, full speed again for 3 s, and an abrupt end."""
    t = times(6.0 + pause_s)
    moving = (t < 3.0) | (t >= 3.0 + pause_s)
    return np.stack([np.cumsum(speed_mps * 0.05 * moving), 0.0 * t], axis=1)


def reversal(speed_mps: float) -> Float64Array:
    """Along x and, after 5 s, back without a pause."""
    t = times()
    return np.stack([np.cumsum(np.where(t < 5.0, 0.05, -0.05) * speed_mps), 0.0 * t], axis=1)


def floor(
    height: Callable[[Float64Array, Float64Array], Float64Array] | None = None,
    half_m: float = 14.0,
    cell_m: float = 0.1,
) -> FloorMap:
    """A floor map around the origin; `height` of x and y [m], None is flat at 0."""
    centres = (np.arange(round(2 * half_m / cell_m)) + 0.5) * cell_m - half_m
    x, y = np.meshgrid(centres, centres)
    z = np.zeros_like(x) if height is None else height(x, y)
    frame = GridFrame(origin_x_m=-half_m, origin_y_m=-half_m, resolution_m=cell_m)
    return FloorMap(frame=frame, height_m=z.astype(np.float32))
