"""A camera whose pixels are known, for files of every convention."""

from pathlib import Path

import cv2
import numpy as np

from readygo.services.reconstructor.given.capture import GivenCapture
from tests.services.reconstructor.synthetic import looking

POINT_M = np.array([0.3, -0.2, 0.9])
"""A point of the world, z up."""
CENTRES_M = np.array([[2.0, 0.1, 1.4], [1.7, 1.1, 1.5], [-1.2, 1.6, 1.3], [0.4, -2.1, 1.2]])
POSES = np.stack([looking(centre, np.array([0.0, 0.1, 0.8])) for centre in CENTRES_M])
"""OpenCV axes."""
FX, FY, CX, CY, WIDTH_PX, HEIGHT_PX = 60.0, 62.0, 41.0, 29.0, 80, 60


def pixel(row: int) -> np.ndarray:
    """Where a camera sees the point, without distortion: the textbook's formula, pixel centres at +0.5."""
    x, y, z = POSES[row, :3, :3].T @ (POINT_M - POSES[row, :3, 3])
    return np.array([FX * x / z + CX, FY * y / z + CY])


def opengl(row: int) -> np.ndarray:
    """The pose of the same camera with x right, y up and z to the one who looks."""
    right, down, forward = POSES[row, :3, :3].T
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.column_stack([right, -down, -forward]), POSES[row, :3, 3]
    return T


def arkit(row: int) -> np.ndarray:
    """The same in a world with y up: x, y, z become x, z, -y."""
    world = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0], [0, -1.0, 0, 0], [0, 0, 0, 1.0]])
    return world @ opengl(row)


ARKIT_POINT_M = np.array([0.3, 0.9, 0.2])
"""`POINT_M` in that world."""


def seen_by(capture: GivenCapture, row: int, point: np.ndarray) -> np.ndarray:
    """Where a camera that was read sees a point, by COLMAP's own projection."""
    import pycolmap

    T, lens = capture.T_world_camera[row], capture.lenses[row]
    assert lens.size_px is not None
    width, height = lens.size_px
    camera = pycolmap.Camera(model=lens.model, width=width, height=height, params=list(lens.params))
    local = T[:3, :3].T @ (point - T[:3, 3])
    return np.array(camera.img_from_cam(local[None]))[0]


def write_images(folder: Path, names: list[str], size_px: tuple[int, int] = (WIDTH_PX, HEIGHT_PX)) -> None:
    """Grey images."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        cv2.imwrite(str(folder / name), np.full((size_px[1], size_px[0], 3), 90, np.uint8))
