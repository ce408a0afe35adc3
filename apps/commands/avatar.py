"""`readygo avatar`: who can walk through scenes, and what they look like."""

import json as json_module
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.table import Table

from readygo.common.avatars import Avatar, avatar_hash, avatar_paths, joint_positions, load_avatar
from readygo.common.avatars.file import EMBEDDED_FOLDER
from readygo.common.errors import AvatarError
from readygo.common.frames import axis_angle_from_matrix, matrix_from_axis_angle
from readygo.common.messages import Motion

FloatArray = npt.NDArray[np.float32]
Image = npt.NDArray[np.uint8]

VIEW_COUNT = 8
TILE_HEIGHT_PX, TILE_WIDTH_PX = 420, 240
CAMERA_DISTANCE_M, CAMERA_HEIGHT_M, FOCAL_PX = 4.2, 1.2, 830.0


def avatar_list(*, avatars: Path | None = None, json: bool = False) -> None:
    """List avatars with their heights, sizes and licenses (--json tells the licenses in full).

    Args:
        avatars: Avatar file or folder of them; the embedded ones by default.
        json: Print a JSON array.
    """
    rows = [_described(path) for path in avatar_paths(avatars)]
    if json:
        sys.stdout.write(json_module.dumps(rows, indent=2) + "\n")
        return
    table = Table("name", "height [m]", "Gaussians", "size [MB]", "license")
    for row in rows:
        size_mb, license = row["size_bytes"] / 1e6, row["license"].split(". ")[0]
        table.add_row(row["name"], f"{row['height_m']:.2f}", f"{row['gaussians']:,}", f"{size_mb:.2f}", license)
    Console().print(table)


def avatar_preview(
    avatar: Path,
    /,
    *,
    out: Path | None = None,
    sheet: Path | None = None,
    video: Path | None = None,
    seed: int = 0,
) -> None:
    """Draw a person from all sides, standing and in mid-stride; in four phases of the gait; or film them on a walk.

    Args:
        avatar: Avatar file, or the name of an embedded avatar.
        out: PNG to write: eight sides, standing and in mid-stride.
        sheet: PNG to write: a contact sheet of four phases of the gait, each from three sides.
        video: MP4 to write: the person walks an S-curve over a floor with lines every 0.5 m.
        seed: Habits of the person on the walk.
    """
    if out is None and sheet is None and video is None:
        raise AvatarError("Say what to make: --out person.png, --sheet gait.png, --video person.mp4, or several.")
    for option, path, ending in (("--out", out, ".png"), ("--sheet", sheet, ".png"), ("--video", video, ".mp4")):
        if path is not None and path.suffix.lower() != ending:
            raise AvatarError(f"{option} {path} must end in {ending}.")
    from readygo.common.drawing.files import write_png

    person = load_avatar(_file_of(avatar))
    if out is not None:
        write_png(out, turntable(person, (standing_pose(), stride_pose())))
    if sheet is not None:
        from readygo.apps.avatar.sheet import contact_sheet

        write_png(sheet, contact_sheet(person, seed=seed))
    if video is not None:
        from readygo.apps.avatar.film import walk_frames
        from readygo.common.drawing.film import write_film

        write_film(video, walk_frames(person, seed=seed))


def turntable(avatar: Avatar, poses: Sequence[FloatArray]) -> Image:
    """A sheet with a row of views per pose, the person turning left from image to image.

    Args:
        avatar: Who.
        poses: Joint rotations [rad] as in `Motion` for a person that faces SMPL's +z, shape (24, 3) each.

    Returns:
        RGB, shape (len(poses) * 420, 8 * 240, 3).
    """
    from readygo.apps.avatar.stage import Lens, Stage, look_at

    stage = Stage(avatar, Lens(height_px=TILE_HEIGHT_PX, width_px=TILE_WIDTH_PX, focal_px=FOCAL_PX))
    # In front of the person, who faces -y, looking at the middle of the body.
    camera = look_at((0.0, -CAMERA_DISTANCE_M, CAMERA_HEIGHT_M), (0.0, 0.0, 0.52 * avatar.height_m))
    rows = []
    for pose in poses:
        tiles = []
        for view in range(VIEW_COUNT):
            turned = _turned(pose, 2 * np.pi * view / VIEW_COUNT)
            motion = Motion(root_m=_grounded_root(avatar, turned)[None], pose_axis_angle=turned[None])
            tiles.append(stage.picture(camera, motion, 0, joint_positions(avatar, motion)))
        rows.append(np.concatenate(tiles, axis=1))
    return np.concatenate(rows)


def standing_pose() -> FloatArray:
    """Upright, arms down."""
    pose = np.zeros((24, 3), dtype=np.float32)
    pose[16] = (0.0, -0.15, -1.22)
    pose[17] = (0.0, 0.15, 1.22)
    pose[18], pose[19] = (0.0, -0.25, 0.0), (0.0, 0.25, 0.0)
    return pose


def stride_pose() -> FloatArray:
    """The left foot ahead, the right arm with it."""
    pose = standing_pose()
    pose[1], pose[2] = (-0.42, 0.0, 0.0), (0.30, 0.0, 0.0)
    pose[4], pose[5] = (0.10, 0.0, 0.0), (0.45, 0.0, 0.0)
    pose[8] = (0.25, 0.0, 0.0)
    pose[16], pose[17] = _after(pose[16], 0.35), _after(pose[17], -0.40)
    return pose


def _after(axis_angle: FloatArray, swing_rad: float) -> FloatArray:
    """A rotation followed by one about the axis to the body's left."""
    R = matrix_from_axis_angle((swing_rad, 0.0, 0.0)) @ matrix_from_axis_angle(axis_angle)
    return axis_angle_from_matrix(R).astype(np.float32)


def _described(path: Path) -> dict[str, Any]:
    avatar = load_avatar(path)
    return {
        "name": avatar.name,
        "path": str(path),
        "height_m": avatar.height_m,
        "gaussians": len(avatar.cloud),
        "size_bytes": path.stat().st_size,
        "license": avatar.license,
        "hash": avatar_hash(avatar),
    }


def _file_of(avatar: Path) -> Path:
    embedded = EMBEDDED_FOLDER / f"{avatar}.npz"
    if avatar.exists() or avatar.name != str(avatar) or not embedded.exists():
        return avatar
    return embedded


def _turned(pose: FloatArray, angle_rad: float) -> FloatArray:
    turned = pose.copy()
    R = matrix_from_axis_angle((0.0, angle_rad, 0.0)) @ matrix_from_axis_angle(pose[0])
    turned[0] = axis_angle_from_matrix(R)
    return turned


def _grounded_root(avatar: Avatar, pose: FloatArray) -> FloatArray:
    """The pelvis' place that puts the lower ankle where it is when the person stands on z = 0."""
    motion = Motion(root_m=np.zeros((1, 3), dtype=np.float32), pose_axis_angle=pose[None])
    ankles_m = joint_positions(avatar, motion)[0, [7, 8], 2]
    return np.array([0.0, 0.0, avatar.joints_tpose_m[7, 1] - ankles_m.min()], dtype=np.float32)
