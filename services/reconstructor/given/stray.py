"""Recordings of Stray Scanner: `rgb.mp4`, `odometry.csv` and `camera_matrix.csv`, of one ARKit session.

`odometry.csv` has frame, x, y, z, qx, qy, qz, qw of each frame, named by its first line, in ARKit's world: metres, y
up; camera axes are OpenCV's. `camera_matrix.csv` is the matrix of the lens, row by row. `depth/000123.png` and
`confidence/000123.png` are ARKit's, by the number of the frame.

Source: docs.strayrobots.io, "Data Specification"; strayrobots/scanner, OdometryEncoder.swift.
"""

import csv
import io
from pathlib import Path

import cv2
import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.files import read_regular
from readygo.services.reconstructor.frames.video import open_video
from readygo.services.reconstructor.given.capture import GivenCapture, named_error, pose_matrices
from readygo.services.reconstructor.given.depth import LIDAR_FAR_M, find_depth
from readygo.services.reconstructor.poses.intrinsics import Intrinsics, lens

_KIND = "a recording of Stray Scanner"
_VIDEO, _POSES, _LENS = "rgb.mp4", "odometry.csv", "camera_matrix.csv"
_BYTES_MAX = 1 << 26


def find_stray(folder: Path) -> Path | None:
    """The folder if it is a recording; else None."""
    return folder if all((folder / name).is_file() for name in (_VIDEO, _POSES, _LENS)) else None


def read_stray(folder: Path) -> GivenCapture:
    """Read the frames of a recording.

    Raises:
        SceneError: If it cannot be read, or a pose is impossible.
    """
    try:
        numbers, T = _poses(folder / _POSES)
        return GivenCapture(
            kind="Stray Scanner",
            files=tuple(folder / name for name in (_POSES, _LENS, _VIDEO)),
            images=tuple(folder / f"{number:06d}.jpg" for number in numbers),
            lenses=(_lens(folder),) * len(numbers),
            T_world_camera=T,
            metric=True,
            rough=True,
            up=(0.0, 1.0, 0.0),
            depth=tuple(
                find_depth(
                    folder / "depth" / f"{number:06d}.png",
                    folder / "confidence" / f"{number:06d}.png",
                    far_m=LIDAR_FAR_M,
                )
                for number in numbers
            ),
            video=folder / _VIDEO,
        )
    except (OSError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise named_error(folder, _KIND, error) from error


def _poses(path: Path) -> tuple[list[int], Float64Array]:
    """Numbers of the frames, ascending, and their poses, shape (N, 4, 4)."""
    text = read_regular(path, bytes_max=_BYTES_MAX).decode("utf-8", errors="replace")
    rows = list(csv.DictReader(io.StringIO(text), skipinitialspace=True))
    numbers = [int(row["frame"]) for row in rows]
    if numbers != sorted(set(numbers)) or not numbers or numbers[0] < 0:
        raise ValueError(f"the frames of {path.name} are not numbered in order")
    values = np.array([[float(row[name]) for name in ("x", "y", "z", "qx", "qy", "qz", "qw")] for row in rows])
    return numbers, pose_matrices(values[:, 3:], values[:, :3])


def _lens(folder: Path) -> Intrinsics:
    words = read_regular(folder / _LENS, bytes_max=_BYTES_MAX).decode("utf-8", errors="replace").replace(",", " ")
    K = np.array(words.split(), dtype=np.float64).reshape(3, 3)
    video = open_video(folder / _VIDEO)
    size = (int(video.get(cv2.CAP_PROP_FRAME_WIDTH)), int(video.get(cv2.CAP_PROP_FRAME_HEIGHT)))
    video.release()
    return lens(K[0, 0], K[1, 1], K[0, 2], K[1, 2], size_px=size)
