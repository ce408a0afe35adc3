"""Frames of 360 degrees, put together from six pinhole images of the faces of a cube."""

import math
from collections.abc import Iterator
from itertools import islice

import cv2
import numpy as np

from readygo.common.arrays import Float32Array, Float64Array, UInt8Array
from readygo.common.camera import CameraConfig
from readygo.common.images.light import byte_of_light, light_of_byte
from readygo.services.reconstructor import panorama_rays

_TURNS = (
    ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    ((0, 0, -1), (0, 1, 0), (1, 0, 0)),
    ((-1, 0, 0), (0, 1, 0), (0, 0, -1)),
    ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
    ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
    ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
)
"""Axes x, y and z of the cameras of the faces in the panorama's: ahead, right, back, left, down, up."""
_EDGE_PX = 2
"""Pixels of a face beyond 90 deg on each side, for the interpolation at its edges."""


def face_poses(T_world_panorama: Float64Array) -> Float64Array:
    """Poses of the cameras of the six faces, shape (6, 4, 4)."""
    T = np.tile(np.eye(4), (len(_TURNS), 1, 1))
    T[:, :3, :3] = np.swapaxes(np.array(_TURNS, dtype=np.float64), 1, 2)
    return np.asarray(T_world_panorama @ T)


def face_camera(width_px: int, *, shot_noise: float = 0.0, read_noise: float = 0.0) -> CameraConfig:
    """The camera of a face that is as fine as the horizon of an equirectangular image of this width."""
    focal_px, side_px = _focal_px(width_px), _side_px(width_px)
    return CameraConfig(
        width_px=side_px,
        height_px=side_px,
        fx_px=focal_px,
        fy_px=focal_px,
        cx_px=side_px / 2,
        cy_px=side_px / 2,
        shot_noise=shot_noise,
        read_noise=read_noise,
    )


def _focal_px(width_px: int) -> float:
    return float(math.ceil(width_px / math.tau))


def _side_px(width_px: int) -> int:
    return 2 * (int(_focal_px(width_px)) + _EDGE_PX)


def join_faces(faces: Iterator[UInt8Array], width_px: int) -> Iterator[UInt8Array]:
    """Equirectangular images, shape (W / 2, W, 3), of the faces of each, shape (S, S, 3), in the order of the poses."""
    u, v = _places(width_px)
    while six := list(islice(faces, len(_TURNS))):
        light = light_of_byte().astype(np.uint16)[np.concatenate(six)]
        yield byte_of_light()[cv2.remap(light, u, v, cv2.INTER_LINEAR)]


def _places(width_px: int) -> tuple[Float32Array, Float32Array]:
    """Column and row, from the first pixel's centre, in the faces below each other that each pixel shows."""
    rays, axes = panorama_rays(width_px), np.array(_TURNS, dtype=np.float64)
    face = np.argmax(rays @ axes[:, 2].T, axis=-1)
    x, y, z = np.einsum("hwij,hwj->ihw", axes[face], rays)
    focal_px, side_px = _focal_px(width_px), _side_px(width_px)
    u = focal_px * x / z + side_px / 2 - 0.5
    v = focal_px * y / z + side_px / 2 - 0.5 + face * side_px
    return u.astype(np.float32), v.astype(np.float32)
