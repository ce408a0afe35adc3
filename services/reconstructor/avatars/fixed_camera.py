"""A video from a camera that stands still becomes footage in the plain layout.

Beside the video may lie, as in that layout, with what is known of its frames:

    masks/000123.png     by the number of the frame, from 0
    poses.npz            rows of all frames of the video, or of those that are taken
    keypoints.npz        the same, or with the images' names (000123.jpg)

The camera stands at (0, 0, height) and looks along x, tilted down; the floor is z = 0.
"""

import math
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from readygo.common.array_files import load_npz
from readygo.common.arrays import AnyArray, Float64Array, Int64Array
from readygo.common.camera.captured import CapturedViews, views_text
from readygo.common.config import section_to_mapping
from readygo.common.errors import AvatarError, ConfigError
from readygo.common.files import write_then_rename, write_whole
from readygo.services.reconstructor.avatars.config import FixedCameraConfig
from readygo.services.reconstructor.avatars.footage import (
    CAMERAS_FILE,
    FRAMES_MAX,
    FRAMES_MIN,
    IMAGES,
    POSES_FILE,
    mask_files,
    masks_folder,
)
from readygo.services.reconstructor.avatars.keypoints import KEYPOINTS_FILE
from readygo.services.reconstructor.frames.even import extract_even_frames
from readygo.services.reconstructor.frames.exif import focal_of_35mm
from readygo.services.reconstructor.poses.intrinsics import fit_to_images, read_intrinsics
from readygo.services.reconstructor.stages import Stages, code_digest, identity_of

VIDEO_STAGE = "video"
FOCAL_35MM = 26.0
"""Focal length of most phones' main cameras, given for film of 36 x 24 mm [mm]."""
STILL_MAX = 0.01
"""A background that moves farther, as a share of the image's width, is not that of a camera that stands still."""
RATE_MIN_HZ = 9.0
"""Fewer frames a second do not show how a person walks."""
_BYTES_MAX = 2**26
_ROWS = {POSES_FILE: ("root_m", "pose_axis_angle"), KEYPOINTS_FILE: ("keypoints", "images")}


def footage_of_video(video: Path, stages: Stages, camera: FixedCameraConfig) -> tuple[Path, tuple[str, ...]]:
    """Make the footage of a video, once.

    Args:
        video: The video; masks, poses and keypoints may lie beside it.
        stages: Where to keep the footage.
        camera: Where the camera stands.

    Returns:
        The folder of the footage, and hints for the user.

    Raises:
        ReadygoError: If the video cannot be used, the camera moves, or what lies beside it does not fit.
    """
    beside = [video.parent / name for name in _ROWS]
    masks = masks_folder(video.parent)

    def make(stage: Path) -> Mapping[str, Any]:
        found = extract_even_frames(video, stage / IMAGES, rate_hz=camera.rate_hz, count_max=FRAMES_MAX)
        _check_video(video, found, camera)
        names = tuple(f"{number:06d}.jpg" for number in found["numbers"])
        views = fixed_views(names, K_of_video(found, camera), found["size_px"], camera)
        write_whole(stage / CAMERAS_FILE, views_text(views), raises=AvatarError)
        for path in filter(Path.is_file, beside):
            _take_rows(path, stage / path.name, names, np.array(found["numbers"]), found["frames"])
        if masks is not None:
            (stage / masks.name).mkdir()
            for mask in mask_files(masks, names):
                shutil.copyfile(mask, stage / masks.name / mask.name)
        return {"notes": [*found["notes"], *_notes(found, camera)]}

    files = [video, *beside, *(sorted(masks.iterdir()) if masks is not None else ())]
    settings = {"camera": section_to_mapping(camera), "files": identity_of(files)}
    done = stages.run(VIDEO_STAGE, settings, make, code=code_digest("avatars", "frames"))
    return stages.folder / VIDEO_STAGE, tuple(done["notes"])


def K_of_video(found: Mapping[str, Any], camera: FixedCameraConfig) -> Float64Array:
    """Intrinsics of a video's frames [px], shape (3, 3).

    Args:
        found: What `extract_even_frames` found.
        camera: Its lens.

    Raises:
        ConfigError: If it cannot be read, is for other images, or has distortion.
    """
    width, height = found["size_px"]
    if not camera.intrinsics:
        focal_px = focal_of_35mm(FOCAL_35MM, width, height)
        return np.array([[focal_px, 0.0, 0.5 * width], [0.0, focal_px, 0.5 * height], [0.0, 0.0, 1.0]])
    size = (width, height)
    lens = fit_to_images(read_intrinsics(camera.intrinsics), size, size, turned_deg=found["turned_deg"])
    fx, fy, cx, cy, *distortion = lens.params
    if any(distortion):
        raise ConfigError("--intrinsics have distortion: undistort the video first, and give those of the result.")
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def fixed_views(
    names: tuple[str, ...], K_px: Float64Array, size_px: tuple[int, int], camera: FixedCameraConfig
) -> CapturedViews:
    """The cameras of F frames from one place.

    Args:
        names: Names of the frames' images.
        K_px: Intrinsics, shape (3, 3).
        size_px: Width and height.
        camera: Where it stands.
    """
    tilt = math.radians(camera.tilt_deg)
    forward, right = np.array([math.cos(tilt), 0.0, -math.sin(tilt)]), np.array([0.0, -1.0, 0.0])
    T = np.eye(4)
    T[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    T[2, 3] = camera.height_m
    count = len(names)
    return CapturedViews(
        images=names,
        sizes_px=np.tile(np.array(size_px, dtype=np.int64), (count, 1)),
        K_px=np.tile(K_px, (count, 1, 1)),
        T_world_camera=np.tile(T, (count, 1, 1)),
    )


def _check_video(video: Path, found: Mapping[str, Any], camera: FixedCameraConfig) -> None:
    if len(found["numbers"]) < FRAMES_MIN:
        raise AvatarError(f"{video.name} has {found['frames']} frames; film the person for ten seconds or more.")
    if found["rate_hz"] < min(RATE_MIN_HZ, camera.rate_hz):
        raise AvatarError(
            f"{video.name} gives {found['rate_hz']:.1f} frames a second, {RATE_MIN_HZ:.0f} are needed of at most "
            f"{FRAMES_MAX} frames: cut it to a minute, or film at a higher rate."
        )
    if camera.check_still and found["moved"] > STILL_MAX:
        raise AvatarError(
            f"The camera of {video.name} moves: the background is {100 * found['moved']:.1f} % of the width off in the "
            f"median. Make its cameras with `readygo reconstruct {video}`, then give a folder in the plain layout. If "
            "the camera stood still: --camera.check-still false."
        )


def _notes(found: Mapping[str, Any], camera: FixedCameraConfig) -> list[str]:
    lens = f"no --intrinsics: a lens of {FOCAL_35MM:.0f} mm (35 mm film) is assumed, as most phones have."
    place = (
        f"the camera is taken to be {camera.height_m:g} m above the floor and to look down by {camera.tilt_deg:g} "
        "degrees (--camera.height-m, --camera.tilt-deg)."
    )
    return [place] if camera.intrinsics else [lens, place]


def _take_rows(path: Path, to: Path, names: tuple[str, ...], numbers: Int64Array, count: int) -> None:
    """Write the rows of the frames that are taken, of a file with rows of all frames of the video or of these."""
    arrays = dict(load_npz(path, _ROWS[path.name], bytes_max=_BYTES_MAX, raises=AvatarError))
    if "images" not in arrays:
        arrays = {key: _rows(path, array, numbers, count) for key, array in arrays.items()}
        if path.name == KEYPOINTS_FILE:
            arrays["images"] = np.array(names)
    with write_then_rename(to, raises=AvatarError) as part:
        np.savez(part, allow_pickle=False, **arrays)


def _rows(path: Path, array: AnyArray, numbers: Int64Array, count: int) -> AnyArray:
    rows = len(array) if array.ndim else 0
    if rows == count:
        return array[numbers]
    if rows != len(numbers):
        raise AvatarError(
            f"{path} has {rows} rows; the video has {count} frames, and {len(numbers)} of them are taken: give rows of "
            "all frames."
        )
    return array
