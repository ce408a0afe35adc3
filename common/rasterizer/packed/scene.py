"""Gaussian clouds packed for the CPU rasterizer: chunks of 256 neighbours, sixteen to a SIMD register.

A packed scene is a folder of .npy files that all workers of a host map read-only, so that it is in memory once.
"""

import contextlib
import dataclasses
import functools
import json
import math
import mmap
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from readygo.common.array_files import map_npy
from readygo.common.arrays import AnyArray, BoolArray, Float32Array, Float64Array, Int16Array, Int64Array, UInt64Array
from readygo.common.documents import read_json
from readygo.common.errors import ReadygoError, SceneError
from readygo.common.files import unfinished_folder, write_then_rename
from readygo.common.gaussians import GaussianCloud, rgb_of_sh
from readygo.common.rasterizer.constants import ALPHA_MIN
from readygo.common.rasterizer.packed.cache import one_at_a_time

FORMAT = "readygo-packed/1"
CHUNK = 256
"""Gaussians per chunk."""
PIECE = 1 << 17
"""Gaussians that are packed at a time: a multiple of `CHUNK` that bounds the memory for intermediate results."""
BLOCKS = CHUNK // 16
"""Blocks of 16 Gaussians per chunk."""
MEAN_X, MEAN_Y, MEAN_Z = 0, 1, 2
"""Rows of a block's geometry, 16 numbers each: mean [m]."""
COV_XX, COV_XY, COV_XZ, COV_YY, COV_YZ, COV_ZZ = 3, 4, 5, 6, 7, 8
"""Covariance [m2]."""
LOG2_OPACITY = 9
REACH2 = 10
"""Squared distance in sigmas at which alpha falls to 1/255: 2 ln(255 opacity); negative: padding."""
GEOMETRY_ROWS = 11
"""Rows of a block's geometry."""
POPULATED_BYTES_MAX = 1 << 28
_MADV_POPULATE_READ = 22
_NORMAL_FILE = "normal.npy"
NORMAL_STEP = 1.0 / 32767.0
"""Value of one step of a packed normal."""
_ARRAYS = ("centre_m", "half_m", "reach_m", "geometry", "colour", "sh", "sh_step")


@dataclass(frozen=True, kw_only=True, eq=False)
class PackedScene:
    """C chunks of up to 256 Gaussians that lie close together, in blocks of 16, structure of arrays.

    Colour has two forms: `colour` for clouds of degree 0 (`sh` is then empty), or `sh` as 16-bit fixed point, which
    every CPU reads alike (half floats need F16C).
    """

    centre_m: Float64Array
    """Centre of each chunk's means in the cloud's frame [m], shape (C, 3)."""
    half_m: Float32Array
    """Half sizes of the box around a chunk's means [m], shape (C, 3)."""
    reach_m: Float32Array
    """Largest distance from its mean at which a Gaussian of the chunk has alpha 1/255 [m], shape (C,)."""
    geometry: Float32Array
    """Per block the rows of `GEOMETRY_ROWS`, means relative to the chunk's centre, shape (C, 16, 11, 16)."""
    colour: Float32Array
    """Red, green, blue, not negative, shape (C, 16, 3, 16), or (0, 16, 3, 16)."""
    sh: Int16Array
    """SH coefficients in steps of `sh_step`, shape (C, 16, 3, K, 16), or (0, 16, 3, 1, 16)."""
    sh_step: Float32Array
    """Value of one step, shape (1,)."""
    normal: Int16Array | None = None
    """Shortest axis of every Gaussian in steps of `NORMAL_STEP`, in the frame of the covariances, shape
    (C, 16, 3, 16); None for those who need no images of normals."""

    @property
    def chunk_count(self) -> int:
        """Number of chunks, C."""
        return len(self.centre_m)


def pack_cloud(cloud: GaussianCloud, *, normals: bool = False) -> PackedScene:
    """Pack a cloud; Gaussians that never reach alpha 1/255 are left out.

    Uses only operations that round alike on every CPU, so that packs made on different machines are equal.

    Args:
        cloud: What to pack.
        normals: Pack what images of normals are made of, too.
    """
    return pack_sorted(cloud, packing_order(cloud), normals=normals)


def packing_order(cloud: GaussianCloud) -> Int64Array:
    """Numbers of the Gaussians that can be seen, along a Morton curve."""
    index = np.flatnonzero(cloud.opacities >= np.float32(ALPHA_MIN))
    return index[np.argsort(morton_codes(cloud.means_m[index]), kind="stable")]


def pack_sorted(
    cloud: GaussianCloud,
    order: Int64Array | None = None,
    *,
    centred: bool = True,
    normals: bool = False,
) -> PackedScene:
    """Pack a cloud in its order.

    Args:
        cloud: Gaussians.
        order: Which of them, opacities at least 1/255, in which order; all as they come by default.
        centred: Store means relative to their chunk's centre; otherwise all centres are 0.
        normals: Pack normals as well.
    """
    order = np.arange(len(cloud)) if order is None else order
    starts = range(0, len(order), PIECE)
    step = _sh_step(cloud, [order[start : start + PIECE] for start in starts])
    scene = _empty_pack(-(-len(order) // CHUNK), cloud.sh.shape[1], step)
    for start in starts:
        piece = cloud.select(order[start : start + PIECE])
        _pack_piece(piece, step, centred, scene, start // CHUNK)
    return dataclasses.replace(scene, normal=_normals(cloud, order)) if normals else scene


def _empty_pack(chunks: int, coefficients: int, step: float) -> PackedScene:
    flat, curved = (chunks, 0) if coefficients == 1 else (0, chunks)
    return PackedScene(
        centre_m=np.empty((chunks, 3)),
        half_m=np.empty((chunks, 3), dtype=np.float32),
        reach_m=np.empty(chunks, dtype=np.float32),
        geometry=np.empty((chunks, BLOCKS, GEOMETRY_ROWS, 16), dtype=np.float32),
        colour=np.empty((flat, BLOCKS, 3, 16), dtype=np.float32),
        sh=np.empty((curved, BLOCKS, 3, coefficients, 16), dtype=np.int16),
        sh_step=np.array([step], dtype=np.float32),
    )


def _pack_piece(cloud: GaussianCloud, step: float, centred: bool, scene: PackedScene, first: int) -> None:
    """Write a part of a cloud to the chunks of `scene` from `first` on."""
    rows = chunk_rows(cloud, centred)
    here = slice(first, first + len(rows.geometry))
    scene.centre_m[here], scene.half_m[here], scene.reach_m[here] = rows.centre_m, rows.half_m, rows.reach_m
    scene.geometry[here] = _blocks(rows.geometry)
    if len(scene.sh):
        scene.sh[here] = _sh_steps(cloud, step)
    else:
        rgb = np.maximum(rgb_of_sh(cloud.sh[:, 0].astype(np.float64)), 0.0)
        scene.colour[here] = _blocks(pad_chunks(rgb))


class ChunkRows(NamedTuple):
    """C chunks of a cloud in its order; a row of numbers per Gaussian."""

    centre_m: Float64Array
    """Centre of each chunk's means [m], shape (C, 3)."""
    half_m: Float32Array
    """Half sizes of the box around a chunk's means [m], shape (C, 3)."""
    reach_m: Float32Array
    """Largest distance from its mean at which a Gaussian of the chunk has alpha 1/255 [m], shape (C,)."""
    geometry: Float64Array
    """The columns of `GEOMETRY_ROWS`, shape (C, 256, 11)."""


def chunk_rows(cloud: GaussianCloud, centred: bool) -> ChunkRows:
    """Chunks of a cloud in its order; with `centred` means are relative to their chunk's centre."""
    means = pad_chunks(cloud.means_m.astype(np.float64))
    valid = np.arange(means.shape[0] * CHUNK).reshape(-1, CHUNK) < len(cloud)
    log2_opacity, reach2 = opacity_terms(cloud.opacities)
    largest_scale = cloud.scales_m.max(axis=1, initial=0.0).astype(np.float64)
    reach = pad_chunks((np.sqrt(reach2) * largest_scale)[:, None])[..., 0].max(axis=1)
    centre, half = chunk_boxes(means, valid)
    relative = means - centre[:, None] if centred else means
    terms = [covariances(cloud), log2_opacity[:, None], reach2[:, None]]
    geometry = np.concatenate([relative, *(pad_chunks(term) for term in terms)], axis=2)
    geometry[~valid, REACH2] = -1.0
    return ChunkRows(centre, rounded_up(half), rounded_up(reach), geometry)


def chunk_boxes(means_m: Float64Array, valid: BoolArray) -> tuple[Float64Array, Float64Array]:
    """Centres and half sizes of boxes around the valid means of chunks, (C, n, 3) and (C, n) -> (C, 3), (C, 3)."""
    low = np.where(valid[..., None], means_m, np.inf).min(axis=1)
    high = np.where(valid[..., None], means_m, -np.inf).max(axis=1)
    # The centre is a float32 number, so that `mean - centre` loses nothing for means near it.
    centre = (0.5 * (low + high)).astype(np.float32).astype(np.float64)
    return centre, np.maximum(high - centre, centre - low)


def rounded_up(values: Float64Array) -> Float32Array:
    """Float32 numbers that are not below `values`."""
    return np.nextafter(values.astype(np.float32), np.float32(np.inf))


def morton_codes(means_m: Float32Array) -> UInt64Array:
    """Position of points along a Morton curve, 21 bits per axis between the 0.1 and 99.9 % quantiles."""
    if len(means_m) == 0:
        return np.zeros(0, dtype=np.uint64)
    means = means_m.astype(np.float64)
    ordered = np.sort(means, axis=0)
    low, high = ordered[len(means) // 1000], ordered[-1 - len(means) // 1000]
    size = max(float((high - low).max()), 1e-6)
    code = np.zeros(len(means), dtype=np.uint64)
    for axis in range(3):
        cell = (np.clip((means[:, axis] - low[axis]) / size, 0.0, 1.0) * (2**21 - 1)).astype(np.uint64)
        code |= _spread(cell) << np.uint64(axis)
    return code


def _spread(x: UInt64Array) -> UInt64Array:
    """Insert two zero bits after each of the lowest 21 bits."""
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        x = (x | (x << np.uint64(shift))) & np.uint64(mask)
    return x


def covariances(cloud: GaussianCloud) -> Float64Array:
    """Covariances xx, xy, xz, yy, yz, zz [m2], shape (N, 6)."""
    R, scale = _rotations(cloud), cloud.scales_m.astype(np.float64).T
    L = [[R[i][k] * scale[k] for k in range(3)] for i in range(3)]
    pairs = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    return np.stack([L[i][0] * L[j][0] + L[i][1] * L[j][1] + L[i][2] * L[j][2] for i, j in pairs], axis=1)


def shortest_axes(cloud: GaussianCloud) -> Float64Array:
    """Unit vectors along the axis with the smallest scale, the first one of equals, shape (N, 3)."""
    R = np.stack([np.stack(row, axis=1) for row in _rotations(cloud)], axis=1)
    shortest = np.argmin(cloud.scales_m, axis=1) if len(cloud) else np.zeros(0, dtype=np.int64)
    return np.take_along_axis(R, shortest[:, None, None], axis=2)[..., 0]


def flatness(covariance_m2: Float64Array, axes: Float64Array) -> Float64Array:
    """1 for flat Gaussians, 0 for balls, shape (N,).

    Args:
        covariance_m2: Covariances xx, xy, xz, yy, yz, zz [m2], shape (N, 6).
        axes: Shortest axes, shape (N, 3).
    """
    xx, xy, xz, yy, yz, zz = covariance_m2.T
    x, y, z = axes.T
    least = x * (xx * x + 2.0 * (xy * y + xz * z)) + y * (yy * y + 2.0 * yz * z) + z * zz * z
    share: Float64Array = np.clip(1.0 - 3.0 * least / np.maximum(xx + yy + zz, 1e-30), 0.0, 1.0)
    return share


def _rotations(cloud: GaussianCloud) -> list[list[Float64Array]]:
    """Rotation matrices from the principal axes, entry by entry, 3 rows of 3 arrays of shape (N,)."""
    q = cloud.quats_wxyz.astype(np.float64)
    w, x, y, z = q.T / np.sqrt(q[:, 0] * q[:, 0] + q[:, 1] * q[:, 1] + q[:, 2] * q[:, 2] + q[:, 3] * q[:, 3])
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]


def _normals(cloud: GaussianCloud, order: Int64Array) -> Int16Array:
    """Packed normals of some Gaussians."""
    normal = np.empty((-(-len(order) // CHUNK), BLOCKS, 3, 16), dtype=np.int16)
    for start in range(0, len(order), PIECE):
        axes = shortest_axes(cloud.select(order[start : start + PIECE]))
        chunks = -(-len(axes) // CHUNK)
        normal[start // CHUNK :][:chunks] = _blocks(pad_chunks(np.rint(axes / NORMAL_STEP)))
    return normal


def opacity_terms(opacities: Float32Array) -> tuple[Float64Array, Float64Array]:
    """Log2 of opacities, and the squared distance in sigmas at which they fall to 1/255, shapes (N,)."""
    # math.log: NumPy's vectorised logarithm differs between AVX2 and AVX-512 machines.
    log_opacity = np.array([math.log(value) for value in opacities.tolist()], dtype=np.float64)
    return log_opacity / math.log(2.0), np.maximum(2.0 * (log_opacity - math.log(ALPHA_MIN)), 0.0)


def pad_chunks(rows: AnyArray) -> Float64Array:
    """Rows (N, n) in chunks, shape (C, 256, n), the last chunk filled up with zeros."""
    chunks = -(-len(rows) // CHUNK)
    out = np.zeros((chunks * CHUNK, rows.shape[1]), dtype=np.float64)
    out[: len(rows)] = rows
    return out.reshape(chunks, CHUNK, rows.shape[1])


def _blocks(rows: AnyArray) -> AnyArray:
    """(C, 256, n) -> (C, 16 blocks, n, 16 lanes)."""
    chunks, _, n = rows.shape
    return np.ascontiguousarray(rows.reshape(chunks, BLOCKS, 16, n).transpose(0, 1, 3, 2))


def _sh_step(cloud: GaussianCloud, pieces: list[Int64Array]) -> float:
    """The step that spans the coefficients of some Gaussians with 16 bits; 1 for degree 0."""
    if cloud.sh.shape[1] == 1:
        return 1.0
    largest = max((float(np.abs(cloud.sh[piece]).max(initial=0.0)) for piece in pieces), default=0.0)
    return float(np.float32(max(largest, 1e-6) / 32767.0))


def _sh_steps(cloud: GaussianCloud, step: float) -> Float64Array:
    """Coefficients as whole numbers of steps, shape (C, 16, 3, K, 16)."""
    coefficients = cloud.sh.shape[1]
    steps = np.clip(np.rint(cloud.sh.astype(np.float64) / step), -32767, 32767)
    rows = steps.transpose(0, 2, 1).reshape(len(cloud), 3 * coefficients)
    return _blocks(pad_chunks(rows)).reshape(-1, BLOCKS, 3, coefficients, 16)


def save_packed(scene: PackedScene, folder: str | Path) -> None:
    """Write a packed scene to `folder`, which appears complete or not at all; a valid one that is there stays.

    Raises:
        OSError: If it cannot be written.
    """
    # Another worker may have been first: its pack is as good.
    with unfinished_folder(folder, good=lambda: load_packed(folder), raises=OSError) as part:
        for name in _ARRAYS:
            np.save(part / f"{name}.npy", getattr(scene, name))
        if scene.normal is not None:
            np.save(part / _NORMAL_FILE, scene.normal)
        (part / "packed.json").write_text(json.dumps({"format": FORMAT}))


def map_array(path: Path) -> AnyArray:
    """Map an array's file read-only, with all its pages unless it is larger than `POPULATED_BYTES_MAX`.

    A page that only one process has looked at so far counts as its own, and to look at them one by one costs a fault
    for each.

    Raises:
        SceneError: If the file cannot be read, or holds no array of numbers.
    """
    array = map_npy(path, raises=SceneError)
    if isinstance(array.base, mmap.mmap) and array.nbytes <= POPULATED_BYTES_MAX:
        # Kernels before 5.14 do not know it.
        with contextlib.suppress(OSError):
            array.base.madvise(_MADV_POPULATE_READ)
    return array


def load_packed(folder: str | Path) -> PackedScene | None:
    """Map a packed scene read-only; None if the folder holds no valid one."""
    folder = Path(folder)
    try:
        if read_json(folder / "packed.json") != {"format": FORMAT}:
            return None
        arrays = {name: map_array(folder / f"{name}.npy") for name in _ARRAYS}
    except (OSError, ValueError, SceneError):
        return None
    chunks = len(arrays["centre_m"])
    expected = {
        "half_m": (chunks, 3),
        "reach_m": (chunks,),
        "geometry": (chunks, BLOCKS, GEOMETRY_ROWS, 16),
        "sh_step": (1,),
    }
    if any(arrays[name].shape != shape for name, shape in expected.items()):
        return None
    if chunks not in (len(arrays["colour"]), len(arrays["sh"])):
        return None
    return PackedScene(**arrays, normal=_load_normals(folder, chunks))


def _load_normals(folder: Path, chunks: int) -> Int16Array | None:
    """Map the normals of a pack read-only; None if there are none."""
    try:
        normal = map_array(folder / _NORMAL_FILE)
    except SceneError:
        return None
    return normal if normal.shape == (chunks, BLOCKS, 3, 16) and normal.dtype == np.int16 else None


def load_or_pack(folder: str | Path, cloud: Callable[[], GaussianCloud], *, normals: bool = False) -> PackedScene:
    """The packed scene in `folder`; packed from `cloud()` and written there if it is missing or damaged.

    Processes that want it at the same time wait for the first one and then load what it packed.

    Args:
        folder: Cache folder of one cloud; its name carries the cloud's content hash.
        cloud: Loads the cloud; not called when the cache is good.
        normals: The pack shall have normals; they are added to the folder if they are missing there.

    Returns:
        A read-only memory map, or the pack itself where the folder cannot be written.
    """
    folder, cloud = Path(folder), functools.cache(cloud)
    packed = load_packed(folder)
    if packed is None or (normals and packed.normal is None):
        with one_at_a_time(folder):
            # Another process may have packed it meanwhile.
            packed = load_packed(folder) or _pack_into(folder, cloud())
            if normals and packed.normal is None:
                packed = _add_normals(packed, folder, cloud())
    return packed


def _pack_into(folder: Path, cloud: GaussianCloud) -> PackedScene:
    scene = pack_cloud(cloud)
    try:
        save_packed(scene, folder)
    except OSError:
        return scene
    return load_packed(folder) or scene


def _add_normals(scene: PackedScene, folder: Path, cloud: GaussianCloud) -> PackedScene:
    """The pack of `cloud` in `folder` with normals, which are written there if that is possible."""
    normal = _normals(cloud, packing_order(cloud))
    with contextlib.suppress(ReadygoError), write_then_rename(folder / _NORMAL_FILE) as part:
        np.save(part, normal)
    mapped = _load_normals(folder, scene.chunk_count)
    return dataclasses.replace(scene, normal=normal if mapped is None else mapped)
