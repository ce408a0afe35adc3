"""A film of an avatar on a walk, over a floor on which sliding feet would show."""

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from common.avatars import Avatar, joint_positions
from common.maps import FloorMap, GridFrame
from common.messages import Motion
from services.animator import AnimatorConfig, skeleton_of, walk

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]

FPS = 20
"""The simulation's rate: the film runs as fast as people do."""
HEIGHT_PX, WIDTH_PX, FOCAL_PX = 540, 960, 1000.0
SPEED_MPS, LENGTH_M, AMPLITUDE_M = 1.2, 7.0, 0.8
LINE_SPACING_M, LINE_WIDTH_M = 0.5, 0.012
CAMERA_DISTANCE_M, CAMERA_HEIGHT_M = 3.6, 1.25
_FLOOR, _LINE, _WALL = (0.70, 0.71, 0.72), (0.40, 0.43, 0.47), (0.84, 0.86, 0.88)
_SHADOW_RADIUS_M, _SHADOW_DEPTH, _SHADOW_FADE_M = 0.13, 0.45, 0.10


def walk_frames(avatar: Avatar, *, seed: int = 0) -> Iterator[Image]:
    """Pictures of an S-curve walk at 1.2 m/s into a stand, seen from the side by a camera that goes along.

    Args:
        avatar: Who.
        seed: Habits of the person.

    Yields:
        RGB, shape (540, 960, 3), 20 a second.
    """
    from common.rasterizer.cpu import CpuRasterizer, PosedPerson

    motion = s_curve_walk(avatar, seed=seed)
    K_px = np.array([[FOCAL_PX, 0, WIDTH_PX / 2], [0, FOCAL_PX, HEIGHT_PX / 2], [0, 0, 1]])
    rasterizer = CpuRasterizer([], [avatar], K_px, HEIGHT_PX, WIDTH_PX)
    targets = _smoothed(motion.root_m[:, :2].astype(np.float64))
    joints = joint_positions(avatar, motion)
    feet = 0.5 * (joints[:, [7, 8]] + joints[:, [10, 11]])
    resting = feet[:, :, 2].min()
    for row, target in enumerate(targets):
        T_world_camera = _camera(target, avatar.height_m)
        person = PosedPerson(avatar=0, root_m=motion.root_m[row], pose_axis_angle=motion.pose_axis_angle[row])
        images = rasterizer.render_images(T_world_camera, [person], ("alpha",))
        assert images.alpha is not None
        ground = _ground(T_world_camera, K_px, feet[row] - [0.0, 0.0, resting])
        mixed = images.rgb + (1.0 - images.alpha[:, :, None]) * ground
        yield np.clip(np.rint(mixed), 0, 255).astype(np.uint8)


def s_curve_walk(avatar: Avatar, *, seed: int = 0) -> Motion:
    """The walk of the film: along +x, swaying to both sides, on a level floor."""
    x = np.linspace(0.0, LENGTH_M, 2000)
    way = np.stack([x, AMPLITUDE_M * np.sin(2 * np.pi * x / LENGTH_M)], axis=1)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
    places = np.arange(0.0, along[-1], SPEED_MPS / FPS)
    trajectory = np.stack([np.interp(places, along, way[:, axis]) for axis in (0, 1)], axis=1)
    frame = GridFrame(origin_x_m=-5.0, origin_y_m=-5.0, resolution_m=1.0)
    floor = FloorMap(frame=frame, height_m=np.zeros((10, int(LENGTH_M) + 12), dtype=np.float32))
    rng = np.random.Generator(np.random.Philox(seed))
    return walk(skeleton_of(avatar), trajectory, floor, rng, AnimatorConfig())


def _smoothed(xy: Array) -> Array:
    """The way of the camera's target: that of the pelvis, averaged over a second to both sides."""
    padded = np.concatenate([np.repeat(xy[:1], FPS, axis=0), xy, np.repeat(xy[-1:], FPS, axis=0)])
    kernel = np.hanning(2 * FPS + 3)[1:-1]
    kernel /= kernel.sum()
    return np.stack([np.convolve(padded[:, axis], kernel, mode="valid") for axis in (0, 1)], axis=1)


def _camera(target_xy_m: Array, height_m: float) -> Array:
    """Beside the person, ahead of them by a quarter of the distance; OpenCV axes."""
    eye = np.array([target_xy_m[0] + 0.25 * CAMERA_DISTANCE_M, -AMPLITUDE_M - CAMERA_DISTANCE_M, CAMERA_HEIGHT_M])
    forward = np.array([target_xy_m[0], 0.0, 0.48 * height_m]) - eye
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    T = np.eye(4)
    T[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    T[:3, 3] = eye
    return T


def _ground(T_world_camera: Array, K_px: Array, feet_m: Array) -> Array:
    """The backdrop: a floor at z = 0 with lines and the shadows of the feet, and a wall, values 0..255."""
    u, v = np.meshgrid(np.arange(WIDTH_PX) + 0.5, np.arange(HEIGHT_PX) + 0.5)
    rays = np.stack([(u - K_px[0, 2]) / K_px[0, 0], (v - K_px[1, 2]) / K_px[1, 1], np.ones_like(u)], axis=-1)
    rays = rays @ T_world_camera[:3, :3].T
    eye = T_world_camera[:3, 3]
    distance = eye[2] / np.maximum(-rays[..., 2], 1e-3)
    points = eye[:2] + distance[..., None] * rays[..., :2]
    # A pixel covers this much floor, along the ray more than across it; lines are blurred to it.
    footprint = (distance / K_px[0, 0])[..., None] * np.stack(
        [np.ones_like(u), np.maximum(distance / eye[2], 1.0)], axis=-1
    )
    offset = np.abs((points + 0.5 * LINE_SPACING_M) % LINE_SPACING_M - 0.5 * LINE_SPACING_M)
    cover = np.clip((0.5 * LINE_WIDTH_M + 0.5 * footprint - offset) / footprint, 0.0, 1.0)
    cover *= np.minimum(1.0, LINE_WIDTH_M / footprint)
    line = cover.max(axis=-1, keepdims=True)
    floor = (1 - line) * np.array(_FLOOR) + line * np.array(_LINE)
    for foot in feet_m:
        away = ((points - foot[:2]) ** 2).sum(axis=-1, keepdims=True) / _SHADOW_RADIUS_M**2
        floor *= 1.0 - _SHADOW_DEPTH * np.exp(-away - max(float(foot[2]), 0.0) / _SHADOW_FADE_M)
    haze = np.clip((distance[..., None] - 6.0) / 8.0, 0.0, 1.0)
    wall = np.array(_WALL)
    picture: Array = 255.0 * np.where(rays[..., 2:] < -1e-3, (1 - haze) * floor + haze * wall, wall)
    return picture
