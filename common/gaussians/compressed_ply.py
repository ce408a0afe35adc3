"""PlayCanvas .compressed.ply files: chunks of 256 Gaussians quantised between per-chunk minima and maxima.

Source: playcanvas/splat-transform, `decompress-ply.ts` and `write-compressed-ply.ts` (MIT).
"""

from pathlib import Path

import numpy as np

from readygo.common.arrays import AnyArray, Float32Array, Float64Array, UInt32Array
from readygo.common.errors import SceneError
from readygo.common.gaussians.activations import scales_from_logs
from readygo.common.gaussians.cloud import GaussianCloud
from readygo.common.gaussians.ply import sh_from_channels, sh_rest_names
from readygo.common.gaussians.ply_format import columns, require_fields
from readygo.common.gaussians.spherical_harmonics import sh_of_rgb

CHUNK_SIZE = 256

_PACKED = ["packed_position", "packed_rotation", "packed_scale", "packed_color"]
_WHAT = "a PlayCanvas compressed PLY"


def is_compressed_ply(tables: dict[str, AnyArray]) -> bool:
    """True for the elements of a PlayCanvas compressed PLY."""
    return "chunk" in tables and "packed_position" in (tables.get("vertex", np.empty(0)).dtype.names or ())


def cloud_from_compressed_ply(tables: dict[str, AnyArray], path: Path) -> GaussianCloud:
    """Gaussians of the elements chunk, vertex and optionally sh; not validated.

    Older files have no colour range in their chunks: colours are then plain 0..1.

    Raises:
        SceneError: If a property is missing or the row counts disagree.
    """
    chunks, vertices = tables["chunk"], tables["vertex"]
    require_fields(vertices, _PACKED, path, _WHAT)
    count = len(vertices)
    if len(chunks) * CHUNK_SIZE < count:
        raise SceneError(f"{path} has {len(chunks)} chunks of {CHUNK_SIZE} for {count} Gaussians; export it again.")
    colour = _unpack_8888(vertices["packed_color"])
    rgb = colour[:, :3]
    if "min_r" in (chunks.dtype.names or ()):
        rgb = _expand(rgb, chunks, "{}_{}", "rgb", path)
    log_scales = _expand(_unpack_111011(vertices["packed_scale"]), chunks, "{}_scale_{}", "xyz", path)
    means = _expand(_unpack_111011(vertices["packed_position"]), chunks, "{}_{}", "xyz", path)
    return GaussianCloud(
        means_m=means.astype(np.float32),
        quats_wxyz=_unpack_rotation(vertices["packed_rotation"]),
        scales_m=scales_from_logs(log_scales.astype(np.float32)),
        opacities=colour[:, 3].astype(np.float32),
        sh=sh_from_channels(sh_of_rgb(rgb).astype(np.float32), _sh_rest(tables.get("sh"), count, path)),
    )


def _expand(unit: Float64Array, chunks: AnyArray, pattern: str, axes: str, path: Path) -> Float64Array:
    """Numbers in 0..1 spread over their chunk's range; `pattern` makes property names of min or max and an axis."""
    low_names, high_names = [[pattern.format(end, axis) for axis in axes] for end in ("min", "max")]
    require_fields(chunks, low_names + high_names, path, _WHAT)
    chunk = np.arange(len(unit)) // CHUNK_SIZE
    low = columns(chunks, low_names).astype(np.float64)[chunk]
    high = columns(chunks, high_names).astype(np.float64)[chunk]
    spread: Float64Array = low * (1.0 - unit) + high * unit
    return spread


def _unpack_111011(words: UInt32Array) -> Float64Array:
    return np.stack([(words >> 21) / 2047.0, ((words >> 11) & 1023) / 1023.0, (words & 2047) / 2047.0], axis=1)


def _unpack_8888(words: UInt32Array) -> Float64Array:
    return np.stack([((words >> shift) & 255) / 255.0 for shift in (24, 16, 8, 0)], axis=1)


def _unpack_rotation(words: UInt32Array) -> Float32Array:
    """Quaternions (w, x, y, z): the top two bits name the largest component, which is left out."""
    small = (np.stack([((words >> shift) & 1023) / 1023.0 for shift in (20, 10, 0)], axis=1) - 0.5) * np.sqrt(2.0)
    x, y, z = small.T
    largest = np.sqrt(np.maximum(0.0, 1.0 - (x * x + y * y + z * z)))
    which = (words >> 30).astype(np.intp)
    quats = np.empty((len(words), 4), np.float32)
    for component in range(4):
        rows = which == component
        others = [i for i in range(4) if i != component]
        quats[rows, component] = largest[rows]
        quats[np.ix_(rows, others)] = small[rows]
    return quats


def _sh_rest(table: AnyArray | None, count: int, path: Path) -> Float32Array:
    if table is None:
        return np.empty((count, 0), np.float32)
    if len(table) != count:
        raise SceneError(f"{path} has {len(table)} rows of spherical harmonics for {count} Gaussians; export it again.")
    stored = columns(table, sh_rest_names(table, path))
    unit = np.where(stored == 0, 0.0, np.where(stored == 255, 1.0, (stored + 0.5) / 256.0))
    return ((unit - 0.5) * 8.0).astype(np.float32)
