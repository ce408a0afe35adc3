"""Previews of a walking avatar: a video, and contact sheets of its gait, and of a walk, a turn and a run.

The floor has lines that make foot sliding visible.
"""

from collections.abc import Iterator

import numpy as np

from readygo.apps.avatar.studio import Framing, Studio, look_at
from readygo.common.arrays import Float64Array, UInt8Array
from readygo.common.avatars import Avatar, joint_positions
from readygo.common.drawing.plan_view import WHITE, put_text
from readygo.common.errors import AvatarError
from readygo.common.maps import FloorMap, GridFrame
from readygo.common.messages import Motion
from readygo.services.animator import skeleton_of, walk

FPS = 20
"""Frames per second of the video [Hz], equal to the simulation's rate: it plays in real time."""
FRAMING = Framing(height_px=540, width_px=960, focal_px=1000.0)
SPEED_MPS, LENGTH_M, AMPLITUDE_M = 1.2, 7.0, 0.8
CAMERA_DISTANCE_M, CAMERA_HEIGHT_M = 3.6, 1.25
PHASES = ("left heel strike", "left stance", "right heel strike", "right stance")
"""Gait phases of the columns, a quarter of a stride apart."""
VIEWS = {"front": 0.0, "left side": 0.5 * np.pi, "back": np.pi}
"""Direction from the human to the camera by view: angle [rad] from the walking direction to the left."""
TILE = Framing(height_px=400, width_px=300, focal_px=800.0)
SHEET_LENGTH_M = 9.0
SHEET_DISTANCE_M, SHEET_HEIGHT_M = 4.4, 1.3
_CAPTION_PX = 22
RUN_MPS, TURN_MPS = 3.2, 0.7
"""Speeds of a run (the gait runs above 2.2 m/s) and of a walk around a tight circle [m/s]."""
TURN_RADIUS_M = 0.45
MOTIONS = ("walk", "turn", "run")
MOTION_COLUMNS, MOTION_STEP = 6, 3
"""Pictures of each motion, and frames from one to the next of a walk or a run."""
_MOTION_VIEW_RAD = 0.3 * np.pi


def walk_frames(avatar: Avatar, *, seed: int = 0) -> Iterator[UInt8Array]:
    """Frames of an S-curve walk at 1.2 m/s that ends in standing, seen from the side by a camera that moves along.

    Args:
        avatar: Avatar that walks.
        seed: Seed of the human's gait habits.

    Yields:
        RGB, shape (540, 960, 3), 20 frames per second.
    """
    motion = s_curve_walk(avatar, seed=seed)
    targets = _smooth_path(motion.root_m[:, :2].astype(np.float64))
    joints = joint_positions(avatar, motion)
    studio = Studio(avatar, FRAMING)
    for row, target in enumerate(targets):
        yield studio.picture(_camera(target, avatar.height_m), motion, row, joints)


def s_curve_walk(avatar: Avatar, *, seed: int = 0) -> Motion:
    """The walk of the video: along +x in S-curves on a level floor."""
    x = np.linspace(0.0, LENGTH_M, 2000)
    way = np.stack([x, AMPLITUDE_M * np.sin(2 * np.pi * x / LENGTH_M)], axis=1)
    return level_walk(avatar, way, SPEED_MPS, seed=seed)


def level_walk(avatar: Avatar, way_m: Float64Array, speed_mps: float, *, seed: int = 0) -> Motion:
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


def contact_sheet(avatar: Avatar, *, seed: int = 0) -> UInt8Array:
    """The sheet: a row per view, a column per phase of a straight walk at 1.2 m/s.

    Args:
        avatar: Avatar that walks.
        seed: Seed of the human's gait habits.

    Returns:
        RGB image of the sheet.
    """
    way = np.stack([np.linspace(0.0, SHEET_LENGTH_M, 200), np.zeros(200)], axis=1)
    motion = level_walk(avatar, way, SPEED_MPS, seed=seed)
    joints = joint_positions(avatar, motion)
    rows = phase_rows(joints)
    studio = Studio(avatar, TILE)
    strips = []
    for view, angle in VIEWS.items():
        tiles = []
        for phase, row in zip(PHASES, rows, strict=True):
            tile = studio.picture(_sheet_camera(avatar, motion, row, angle), motion, row, joints)
            put_text(tile, f"{phase}, {view}", (8, _CAPTION_PX - 6), size=0.4, halo=WHITE)
            tiles.append(tile)
        strips.append(np.concatenate(tiles, axis=1))
    return np.concatenate(strips)


def motion_sheet(avatar: Avatar, *, seed: int = 0) -> UInt8Array:
    """A row each of a walk, a turn and a run, a column per moment; the turn goes half around a tight circle.

    Args:
        avatar: Avatar that moves.
        seed: Seed of the human's gait habits.

    Returns:
        RGB, shape (3 * 400, 6 * 300, 3).
    """
    studio, strips = Studio(avatar, TILE), []
    for name in MOTIONS:
        motion, rows = sheet_motion(avatar, name, seed=seed)
        joints, tiles = joint_positions(avatar, motion), []
        for row in rows:
            tile = studio.picture(_sheet_camera(avatar, motion, row, _MOTION_VIEW_RAD), motion, row, joints)
            put_text(tile, f"{name}, {(row - rows[0]) / FPS:.2f} s", (8, _CAPTION_PX - 6), size=0.4, halo=WHITE)
            tiles.append(tile)
        strips.append(np.concatenate(tiles, axis=1))
    return np.concatenate(strips)


def sheet_motion(avatar: Avatar, name: str, *, seed: int = 0) -> tuple[Motion, list[int]]:
    """One of `MOTIONS`, and the rows of it that are shown."""
    if name == "turn":
        angle = np.linspace(0.0, 2.0 * np.pi, 400)
        way = TURN_RADIUS_M * np.stack([np.sin(angle), 1.0 - np.cos(angle)], axis=1)
        motion = level_walk(avatar, way, TURN_MPS, seed=seed)
        half = np.pi * TURN_RADIUS_M / TURN_MPS * FPS
        return motion, np.linspace(0.5 * half, 1.5 * half, MOTION_COLUMNS).round().astype(int).tolist()
    way = np.stack([np.linspace(0.0, SHEET_LENGTH_M, 200), np.zeros(200)], axis=1)
    speed_mps = RUN_MPS if name == "run" else SPEED_MPS
    motion = level_walk(avatar, way, speed_mps, seed=seed)
    middle = round(0.5 * SHEET_LENGTH_M / speed_mps * FPS)
    return motion, [middle + MOTION_STEP * column for column in range(MOTION_COLUMNS)]


def _sheet_camera(avatar: Avatar, motion: Motion, row: int, angle: float) -> Float64Array:
    """Pose of a sheet's camera, from +x by an angle to the left of the person [rad]; OpenCV axes, shape (4, 4)."""
    x, y = motion.root_m[row, :2].tolist()
    away = SHEET_DISTANCE_M * np.array([np.cos(angle), np.sin(angle)])
    return look_at((x + away[0], y + away[1], SHEET_HEIGHT_M), (x, y, 0.5 * avatar.height_m))


def phase_rows(joints_m: Float64Array) -> tuple[int, int, int, int]:
    """Rows of `PHASES` in the middle stride of a walk along +x.

    A heel strikes where its ankle is furthest ahead of the pelvis.

    Args:
        joints_m: Joint positions [m], shape (T, 24, 3).

    Raises:
        AvatarError: If there is no whole stride.
    """
    ahead = joints_m[:, 7, 0] - joints_m[:, 0, 0]
    peaks = [t for t in range(1, len(ahead) - 1) if ahead[t - 1] < ahead[t] >= ahead[t + 1] and ahead[t] > 0.1]
    if len(peaks) < 2:
        raise AvatarError("The walk has no whole stride to show.")
    middle = (len(peaks) - 1) // 2
    first, stride = peaks[middle], peaks[middle + 1] - peaks[middle]
    return first, first + round(0.25 * stride), first + round(0.5 * stride), first + round(0.75 * stride)


def _smooth_path(xy: Float64Array) -> Float64Array:
    """The path of the camera's target: the pelvis, averaged over 1 s before and after."""
    padded = np.concatenate([np.repeat(xy[:1], FPS, axis=0), xy, np.repeat(xy[-1:], FPS, axis=0)])
    kernel = np.hanning(2 * FPS + 3)[1:-1]
    kernel /= kernel.sum()
    return np.stack([np.convolve(padded[:, axis], kernel, mode="valid") for axis in (0, 1)], axis=1)


def _camera(target_xy_m: Float64Array, height_m: float) -> Float64Array:
    """Pose of a camera beside the human, ahead of them by a quarter of its distance; OpenCV axes, shape (4, 4)."""
    x, y = target_xy_m[0] + 0.25 * CAMERA_DISTANCE_M, -AMPLITUDE_M - CAMERA_DISTANCE_M
    return look_at((x, y, CAMERA_HEIGHT_M), (target_xy_m[0], 0.0, 0.48 * height_m))
