"""Opacity per voxel: every voxel that a Gaussian's 1-sigma ellipsoid touches receives the Gaussian's opacity.

Row by row along x: the part of an ellipsoid inside one (y, z) slab of voxels has a closed-form x extent, so that no
voxel is tested on its own and the result is exact.
"""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from readygo.common.arrays import BoolArray, Float32Array
from readygo.common.gaussians import GaussianCloud
from readygo.common.gaussians.covariance import covariance_of
from readygo.common.kernels import kernel_with_cache
from readygo.common.maps.grid import GridFrame

SCALE_MIN_M = 1e-4
"""Thinner Gaussians count as this thick; keeps their covariance invertible."""
OPACITY_MIN = 0.2
"""Fainter Gaussians are haze and occupy nothing."""
VOXELS_PER_BAND = 16_000_000
"""Largest number of voxels held at a time."""

_EMPTY = -1e300
_STEEP = 1e300
"""Reciprocal of a variance that rounds to nothing."""


Cut = tuple[float, float, float, float, float, float, float, float]
"""What cuts of an ellipsoid by planes a = constant have in common; see `_cut`."""


@kernel_with_cache(inline="always")
def _cut(s_ab: float, s_ac: float, s_aa: float, s_bb: float, s_bc: float, s_cc: float) -> Cut:
    """Cuts by planes a = constant: ellipses in (b, c) whose shape does not depend on where they are.

    `s_ab` and so on are covariance entries of the axes a (fixed), b (maximised) and c (clamped).
    """
    to_b, to_c = s_ab / s_aa, s_ac / s_aa
    v_bb = math.sqrt(max(s_bb - s_ab * to_b, 0.0))
    v_bc = s_bc - s_ab * to_c
    v_cc = s_cc - s_ac * to_c
    per_cc = 1.0 / v_cc if v_cc > 0.0 else _STEEP
    slope = v_bc * per_cc if v_cc > 0.0 else 0.0
    rest = math.sqrt(max(v_bb * v_bb - v_bc * slope, 0.0))
    return 1.0 / s_aa, to_b, to_c, v_bb, v_bc / v_bb if v_bb > 0.0 else 0.0, per_cc, slope, rest


@kernel_with_cache(inline="always")
def _face_reach(at: float, cut: Cut, low: float, high: float) -> float:
    """Largest b on the cut of the ellipsoid by the plane a = at, with c in [low, high]; _EMPTY if there is none."""
    per_aa, to_b, to_c, half_b, lean, per_cc, slope, rest = cut
    left = 1.0 - at * at * per_aa
    if left < 0.0:
        return _EMPTY
    root = math.sqrt(left)
    c = to_c * at + root * lean
    if low <= c <= high:
        return to_b * at + root * half_b
    off = (low if c < low else high) - to_c * at
    left -= off * off * per_cc
    if left < 0.0:
        return _EMPTY
    return to_b * at + slope * off + math.sqrt(left) * rest


@kernel_with_cache(inline="always")
def _slab_reach(
    tip: tuple[float, float, float], by_y: Cut, by_z: Cut, y0: float, y1: float, z0: float, z1: float
) -> float:
    """Largest x of the ellipsoid within y0..y1 and z0..z1; _EMPTY if they do not meet. `tip` is its largest x."""
    x, y, z = tip
    if y0 <= y <= y1 and z0 <= z <= z1:
        return x
    best = _EMPTY
    if y < y0 or y > y1:
        best = _face_reach(y0 if y < y0 else y1, by_y, z0, z1)
    if z < z0 or z > z1:
        best = max(best, _face_reach(z0 if z < z0 else z1, by_z, y0, y1))
    return best


@kernel_with_cache
def _accumulate(
    means: Float32Array,
    quats: Float32Array,
    scales: Float32Array,
    opacities: Float32Array,
    origin: tuple[float, float, float],
    h: float,
    sums: Float32Array,
) -> None:
    nz, ny, nx = sums.shape
    for n in range(means.shape[0]):
        X, Y, Z = means[n, 0] - origin[0], means[n, 1] - origin[1], means[n, 2] - origin[2]
        far = max(scales[n, 0], scales[n, 1], scales[n, 2], SCALE_MIN_M)
        if X + far < 0 or Y + far < 0 or Z + far < 0 or X - far > nx * h or Y - far > ny * h or Z - far > nz * h:
            continue
        S = covariance_of(
            quats[n, 0],
            quats[n, 1],
            quats[n, 2],
            quats[n, 3],
            max(scales[n, 0], SCALE_MIN_M),
            max(scales[n, 1], SCALE_MIN_M),
            max(scales[n, 2], SCALE_MIN_M),
        )
        s_xx, s_xy, s_xz, s_yy, s_yz, s_zz = S
        ex, ey, ez = math.sqrt(s_xx), math.sqrt(s_yy), math.sqrt(s_zz)
        i0 = math.floor((X - ex) / h)
        j0, j1 = max(0, math.floor((Y - ey) / h)), min(ny - 1, math.floor((Y + ey) / h))
        k0, k1 = max(0, math.floor((Z - ez) / h)), min(nz - 1, math.floor((Z + ez) / h))
        tip = (ex, s_xy / ex, s_xz / ex)
        by_y, by_z = _cut(s_xy, s_yz, s_yy, s_xx, s_xz, s_zz), _cut(s_xz, s_yz, s_zz, s_xx, s_xy, s_yy)
        for k in range(k0, k1 + 1):
            z0 = k * h - Z
            for j in range(j0, j1 + 1):
                y0 = j * h - Y
                high = _slab_reach(tip, by_y, by_z, y0, y0 + h, z0, z0 + h)
                if high == _EMPTY:
                    continue
                first, last = i0, math.floor((X + high) / h)
                if last > first:
                    # The ellipsoid is symmetric: its smallest x is the largest one in the mirrored slab.
                    low = -_slab_reach(tip, by_y, by_z, -y0 - h, -y0, -z0 - h, -z0)
                    first = math.floor((X + low) / h)
                for i in range(max(0, first), min(nx - 1, last) + 1):
                    sums[k, j, i] += opacities[n]


def opacity_sums(cloud: GaussianCloud, frame: GridFrame, bottom_m: float, shape: tuple[int, int, int]) -> Float32Array:
    """Sum of the opacities of all Gaussians whose 1-sigma ellipsoid touches each voxel.

    Args:
        cloud: Gaussians.
        frame: Places rows (y) and columns (x); its resolution is the edge of the cubic voxels.
        bottom_m: World z of the lowest layer's lower face [m].
        shape: Layers, rows, columns.

    Returns:
        Sums, shape `shape` = (z, y, x).
    """
    sums = np.zeros(shape, np.float32)
    origin = (float(frame.origin_x_m), float(frame.origin_y_m), float(bottom_m))
    _accumulate(
        cloud.means_m, cloud.quats_wxyz, cloud.scales_m, cloud.opacities, origin, float(frame.resolution_m), sums
    )
    return sums


def occupied_bands(
    cloud: GaussianCloud, frame: GridFrame, bottom_m: float, shape: tuple[int, int, int], threshold: float
) -> Iterator[tuple[slice, BoolArray]]:
    """The voxels that a cloud occupies, in bands of rows that fit into memory.

    Args:
        cloud: Gaussians.
        frame: Places rows (y) and columns (x); its resolution is the edge of the cubic voxels.
        bottom_m: World z of the lowest layer's lower face [m].
        shape: Layers, rows, columns.
        threshold: A voxel is occupied if the opacities of the Gaussians that touch it sum up to more than this.

    Yields:
        Rows of a band, and its occupied voxels, shape (layers, rows of the band, columns).
    """
    layers, count, columns = shape
    cell_m, reach = frame.resolution_m, cloud.scales_m.max(axis=1)
    z, y = cloud.means_m[:, 2], cloud.means_m[:, 1]
    solid = (z + reach > bottom_m) & (z - reach < bottom_m + layers * cell_m) & (cloud.opacities >= OPACITY_MIN)
    rows_per_band = max(1, VOXELS_PER_BAND // (layers * columns))
    for row in range(0, count, rows_per_band):
        rows = min(rows_per_band, count - row)
        low_m = frame.origin_y_m + row * cell_m
        here = cloud.select(solid & (y + reach > low_m) & (y - reach < low_m + rows * cell_m))
        sums = opacity_sums(here, replace(frame, origin_y_m=low_m), bottom_m, (layers, rows, columns))
        yield slice(row, row + rows), sums > threshold
