"""antimatter15's .splat files: 32 bytes a Gaussian, without header and without view-dependent colour.

Source: antimatter15/splat, `convert.py` and `main.js` (MIT).
"""

from pathlib import Path

import numpy as np

from readygo.common.arrays import AnyArray, Float32Array
from readygo.common.gaussians.cloud import GaussianCloud
from readygo.common.gaussians.spherical_harmonics import sh_of_rgb

ROW = np.dtype([("position", "<f4", 3), ("scale", "<f4", 3), ("rgba", "u1", 4), ("wxyz", "u1", 4)])
"""One Gaussian: position, linear standard deviations, bytes of colour and opacity over 255, and bytes of the rotation,
(b - 128) / 128."""

_PLAUSIBLE_MIN = 0.9
_LENGTH_MAX = 1e9


def is_splat(start: bytes) -> bool:
    """Whether bytes look like .splat, which no magic number tells: rotations of length 1, lengths that are numbers."""
    rows = np.frombuffer(start, ROW, len(start) // ROW.itemsize)
    if len(rows) == 0:
        return False
    with np.errstate(invalid="ignore"):
        lengths = np.concatenate([np.abs(rows["position"]), rows["scale"]], axis=1)
        sound = ((lengths >= 0) & (lengths < _LENGTH_MAX)).all(axis=1)
    norm2 = (_quats(rows).astype(np.float64) ** 2).sum(axis=1)
    return bool((sound & (np.abs(norm2 - 1.0) < 0.1)).mean() >= _PLAUSIBLE_MIN)


def cloud_from_splat(path: Path) -> GaussianCloud:
    """Gaussians of a file whose size is a multiple of 32 bytes; SH degree 0, not validated.

    Raises:
        OSError: If the file cannot be read.
    """
    rows = np.fromfile(path, ROW)
    return GaussianCloud(
        means_m=np.ascontiguousarray(rows["position"]),
        quats_wxyz=_quats(rows),
        scales_m=np.ascontiguousarray(rows["scale"]),
        opacities=rows["rgba"][:, 3].astype(np.float32) / np.float32(255.0),
        sh=sh_of_rgb(rows["rgba"][:, :3] / 255.0).astype(np.float32)[:, None],
    )


def _quats(rows: AnyArray) -> Float32Array:
    return (rows["wxyz"].astype(np.float32) - np.float32(128.0)) / np.float32(128.0)
