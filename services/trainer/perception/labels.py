"""What a robot's camera could have told at each image: exact, from recorded poses and the scene's maps."""

import math
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import BoolArray, Float32Array, Float64Array, Int64Array
from readygo.common.camera.config import CameraConfig
from readygo.common.camera.view import in_view, view_of
from readygo.common.dataset import Dataset
from readygo.common.kernels import kernel_with_cache
from readygo.common.maps import OccupancyMap, SightMap
from readygo.common.perception.grid import FAR_M, polar_grid
from readygo.services.trainer.episodes import BODY_RADIUS_M

PEOPLE_MAX = 8
"""Most humans of one image that have labels, the nearest ones."""
VELOCITY_S = 0.1
"""Velocities are those between this long before and after the image [s]."""
RAY_MAX_M = 10.0
"""Free distances are told up to here [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PerceptionLabels:
    """Labels of N images."""

    people: Float32Array
    """Bearing [rad] and distance [m] from the camera, velocity over the ground along the line of sight (away) and to
    its left [m/s], shape (N, PEOPLE_MAX, 4); NaN where there are fewer."""
    visible: BoolArray
    """True for humans whose body the camera shows; others are in the view, and hidden; shape (N, PEOPLE_MAX)."""
    rays_m: Float32Array
    """Distance to what blocks the robot in the direction of each column, at most `RAY_MAX_M` [m], shape (N, C)."""


def labels_of(
    dataset: Dataset, samples: Int64Array, camera: CameraConfig, blocked: OccupancyMap, sight: SightMap
) -> PerceptionLabels:
    """Labels of some samples of a dataset that was recorded in one scene.

    Args:
        dataset: The recorded episodes.
        samples: Numbers of the samples, rising, shape (N,).
        camera: The robot's camera.
        blocked: What blocks the robot.
        sight: What hides humans.

    Raises:
        DatasetError: If a shard is damaged.
    """
    people = np.full((len(samples), PEOPLE_MAX, 4), np.nan, np.float32)
    visible = np.zeros((len(samples), PEOPLE_MAX), np.bool_)
    eyes = np.array([camera.eye(*pose) for pose in dataset.poses[samples][:, [0, 1, 3]].tolist()]).reshape(-1, 3)
    episodes = dataset.episode_of_sample[samples]
    for number in np.unique(episodes).tolist():
        entry = dataset.episodes[number]
        walked = dataset.humans_xyzyaw[entry.first_sample : entry.first_sample + entry.sample_count]
        for row in np.flatnonzero(episodes == number).tolist():
            step = int(samples[row]) - entry.first_sample
            told, shown = _people_of(walked, step, eyes[row], camera, sight, dataset.clock.rate_hz)
            people[row, : len(told)], visible[row, : len(told)] = told, shown
    rays_m = free_distances(blocked, eyes, polar_grid(camera).bearings_rad)
    return PerceptionLabels(people=people, visible=visible, rays_m=rays_m)


def free_distances(blocked: OccupancyMap, eyes: Float64Array, bearings_rad: Float64Array) -> Float32Array:
    """Distances to the first blocked cell, at most `RAY_MAX_M` [m].

    Args:
        blocked: What blocks the robot; outside of it all is blocked.
        eyes: Where rays begin: x, y [m], yaw [rad], shape (N, 3).
        bearings_rad: Directions of the rays from the yaw to the left [rad], shape (C,).

    Returns:
        Shape (N, C).
    """
    frame = blocked.frame
    out = np.empty((len(eyes), len(bearings_rad)), np.float32)
    place = (frame.origin_x_m, frame.origin_y_m, frame.resolution_m)
    _cast(blocked.occupied, place, np.ascontiguousarray(eyes), bearings_rad, RAY_MAX_M, out)
    return out


def _people_of(
    walked: tuple[Float64Array, ...],
    step: int,
    eye: Float64Array,
    camera: CameraConfig,
    sight: SightMap,
    rate_hz: float,
) -> tuple[Float64Array, BoolArray]:
    """The humans in view at a step of an episode, nearest first: `PerceptionLabels.people` and `visible`."""
    around = round(VELOCITY_S * rate_hz)
    first, last = max(step - around, 0), min(step + around, len(walked) - 1)
    x, y, yaw = eye.tolist()
    view, rows = view_of(camera), []
    for human, (hx, hy) in enumerate(walked[step][:, :2].tolist()):
        if not in_view((x, y, yaw), hx, hy, view, FAR_M, BODY_RADIUS_M):
            continue
        distance_m = max(math.hypot(hx - x, hy - y), 1e-3)
        towards = math.atan2(hy - y, hx - x)
        vx, vy = (walked[last][human, :2] - walked[first][human, :2]) * rate_hz / max(last - first, 1)
        c, s = math.cos(towards), math.sin(towards)
        bearing = math.remainder(towards - yaw, math.tau)
        shown = sight.sees(x, y, view.height_m, (hx, hy))
        rows.append((distance_m, (bearing, distance_m, c * vx + s * vy, c * vy - s * vx), shown))
    rows.sort(key=lambda row: row[0])
    rows = rows[:PEOPLE_MAX]
    told = np.array([row[1] for row in rows]).reshape(-1, 4)
    return told, np.array([row[2] for row in rows], np.bool_)


@kernel_with_cache
def _cast(
    blocked: BoolArray,
    place: tuple[float, float, float],
    eyes: Float64Array,
    bearings: Float64Array,
    most: float,
    out: Float32Array,
) -> None:
    """Walk along rays by a third of a cell; `place` is the map's corner x, y and the edge of a cell [m]."""
    stride = place[2] / 3.0
    for n in range(len(eyes)):
        for k in range(len(bearings)):
            c, s = np.cos(eyes[n, 2] + bearings[k]), np.sin(eyes[n, 2] + bearings[k])
            d = 0.0
            while d < most:
                i = int(np.floor((eyes[n, 1] + s * d - place[1]) / place[2]))
                j = int(np.floor((eyes[n, 0] + c * d - place[0]) / place[2]))
                if i < 0 or j < 0 or i >= blocked.shape[0] or j >= blocked.shape[1] or blocked[i, j]:
                    break
                d += stride
            out[n, k] = min(d, most)
