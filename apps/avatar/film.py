"""A video of a walking avatar, over a floor with lines that make foot sliding visible."""

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from readygo.apps.avatar.studio import Framing, Studio, look_at
from readygo.common.avatars import Avatar, joint_positions
from readygo.common.maps import FloorMap, GridFrame
from readygo.common.messages import Motion
from readygo.services.animator import skeleton_of, walk

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]

FPS = 20
"""Frames per second of the video [Hz], equal to the simulation's rate: it plays in real time."""
FRAMING = Framing(height_px=540, width_px=960, focal_px=1000.0)
SPEED_MPS, LENGTH_M, AMPLITUDE_M = 1.2, 7.0, 0.8
CAMERA_DISTANCE_M, CAMERA_HEIGHT_M = 3.6, 1.25


def walk_frames(avatar: Avatar, *, seed: int = 0) -> Iterator[Image]:
    """Frames of an S-curve walk at 1.2 m/s that ends in standing, seen from the side by a camera that moves along.

    Args:
        avatar: Avatar that walks.
        seed: Seed of the human's gait habits.

    Yields:
        RGB, shape (540, 960, 3), 20 frames per second.
    """
    motion = s_curve_walk(avatar, seed=seed)
    targets = _smoothed(motion.root_m[:, :2].astype(np.float64))
    joints = joint_positions(avatar, motion)
    studio = Studio(avatar, FRAMING)
    for row, target in enumerate(targets):
        yield studio.picture(_camera(target, avatar.height_m), motion, row, joints)


def s_curve_walk(avatar: Avatar, *, seed: int = 0) -> Motion:
    """The walk of the video: along +x in S-curves on a level floor."""
    x = np.linspace(0.0, LENGTH_M, 2000)
    way = np.stack([x, AMPLITUDE_M * np.sin(2 * np.pi * x / LENGTH_M)], axis=1)
    return level_walk(avatar, way, SPEED_MPS, seed=seed)


def level_walk(avatar: Avatar, way_m: Array, speed_mps: float, *, seed: int = 0) -> Motion:
    """A walk over the floor z = 0.

    Args:
        avatar: Avatar that walks.
        way_m: Path [m], shape (N, 2), within 4 m of the x axis from 0 to 11 m.
        speed_mps: Speed along the path [m/s].
        seed: Seed of the human's gait habits.
    """
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way_m, axis=0), axis=1))])
    places = np.arange(0.0, along[-1], speed_mps / FPS)
    trajectory = np.stack([np.interp(places, along, way_m[:, axis]) for axis in (0, 1)], axis=1)
    frame = GridFrame(origin_x_m=-5.0, origin_y_m=-5.0, resolution_m=1.0)
    floor = FloorMap(frame=frame, height_m=np.zeros((10, 20), dtype=np.float32))
    rng = np.random.Generator(np.random.Philox(seed))
    return walk(skeleton_of(avatar), trajectory, floor, rng)


def _smoothed(xy: Array) -> Array:
    """The path of the camera's target: the pelvis, averaged over 1 s before and after."""
    padded = np.concatenate([np.repeat(xy[:1], FPS, axis=0), xy, np.repeat(xy[-1:], FPS, axis=0)])
    kernel = np.hanning(2 * FPS + 3)[1:-1]
    kernel /= kernel.sum()
    return np.stack([np.convolve(padded[:, axis], kernel, mode="valid") for axis in (0, 1)], axis=1)


def _camera(target_xy_m: Array, height_m: float) -> Array:
    """Pose of a camera beside the human, ahead of them by a quarter of its distance; OpenCV axes, shape (4, 4)."""
    x, y = target_xy_m[0] + 0.25 * CAMERA_DISTANCE_M, -AMPLITUDE_M - CAMERA_DISTANCE_M
    return look_at((x, y, CAMERA_HEIGHT_M), (target_xy_m[0], 0.0, 0.48 * height_m))
