"""What a depth camera measures of the depths that are there, and how policies are given it."""

import hashlib

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array, UInt8Array
from readygo.common.camera.config import CameraConfig

_NEAREST_BYTE = 255


def measured_depth(depth_m: Float32Array, camera: CameraConfig, rng: np.random.Generator) -> Float32Array:
    """Depths as the robot's camera measures them: noisy, some of them not at all.

    The error of stereo and of structured light grows with the square of the distance; see `CameraConfig.depth_noise`.

    Args:
        depth_m: True depths along the optical axis [m], inf where there is nothing, shape (H, W).
        camera: Whose errors they get.
        rng: Random generator; nothing is drawn for a camera without errors.

    Returns:
        Depths [m]; inf where nothing is measured, shape (H, W).

    Source: Khoshelham and Elberink, Accuracy and resolution of Kinect depth data, Sensors 12, 2012.
    """
    measured = depth_m
    if camera.depth_noise > 0:
        there = np.where(np.isfinite(depth_m), depth_m, np.float32(0.0))
        noise = rng.standard_normal(depth_m.shape, np.float32) * np.float32(camera.depth_noise)
        measured = np.asarray(depth_m + noise * there * there, np.float32)
    if camera.depth_lost > 0:
        measured = np.where(rng.random(depth_m.shape, np.float32) < camera.depth_lost, np.float32(np.inf), measured)
    return in_range(measured, camera)


def in_range(depth_m: Float32Array, camera: CameraConfig) -> Float32Array:
    """Depths [m]; inf where a camera measures nothing because that is too near or too far, or no number."""
    with np.errstate(invalid="ignore"):
        seen = (depth_m >= camera.depth_min_m) & (depth_m <= camera.depth_max_m)
    return np.where(seen, depth_m, np.float32(np.inf)).astype(np.float32)


def depth_bytes(depth_m: Float32Array, camera: CameraConfig) -> UInt8Array:
    """Depths as policies take them: 255 at the camera, 1 at the end of its range, 0 where nothing is measured.

    Args:
        depth_m: From `measured_depth` or `in_range` [m], shape (..., H, W).
        camera: Whose range it is.
    """
    near = np.clip(1.0 - depth_m / np.float32(camera.depth_max_m), 0.0, 1.0)
    levels = 1.0 + np.rint(near * np.float32(_NEAREST_BYTE - 1))
    return np.where(np.isfinite(depth_m), levels, 0.0).astype(np.uint8)


def scale_depth_bytes(levels: UInt8Array, factor: Float64Array, camera: CameraConfig) -> UInt8Array:
    """Bytes of depths that are each multiplied by a factor; 0 stays, and is what is then out of the camera's reach.

    Args:
        levels: From `depth_bytes`, shape (..., H, W).
        factor: By what, above 0, shape (H, W).
        camera: Whose range it is.
    """
    depth_m = (1.0 - (levels.astype(np.float64) - 1.0) / (_NEAREST_BYTE - 1)) * camera.depth_max_m * factor
    there = (levels > 0) & (depth_m <= camera.depth_max_m)
    return depth_bytes(np.where(there, depth_m, np.inf).astype(np.float32), camera)


def depth_rng(name: str, step: int) -> np.random.Generator:
    """The random generator of a frame's depths.

    Args:
        name: Name of the episode.
        step: Step of the frame in the episode.
    """
    digest = hashlib.sha256(f"depth {step} {name}".encode()).digest()
    return np.random.Generator(np.random.Philox(int.from_bytes(digest[:16], "little")))
