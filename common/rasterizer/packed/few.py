"""A few Gaussians, packed again for every image: `pack_sorted` for clouds of degree 0 in one compiled pass.

Legend: q = (w, x, y, z) quaternion, R(q) its rotation, s scales [m]; the columns of L = R diag(s) are the principal
axes, the covariance is L L^T; reach2 = 2 ln(255 opacity), the squared distance in sigmas at which alpha falls to 1/255.
"""

import math

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array
from readygo.common.gaussians import GaussianCloud
from readygo.common.gaussians.spherical_harmonics import SH_C0
from readygo.common.kernels import kernel_with_cache
from readygo.common.rasterizer.constants import ALPHA_MIN
from readygo.common.rasterizer.packed.scene import (
    BLOCKS,
    CHUNK,
    COV_XX,
    GEOMETRY_ROWS,
    LOG2_OPACITY,
    MEAN_X,
    REACH2,
    PackedScene,
)

_NO_SH, _STEP = np.empty((0, BLOCKS, 3, 1, 16), dtype=np.int16), np.ones(1, dtype=np.float32)
_LANES = 16
_UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
"""Entries of a covariance in the order of its rows, from `COV_XX` on."""


def pack_few(cloud: GaussianCloud) -> PackedScene:
    """Pack a cloud in its order, as `pack_sorted` does; opacities are at least 1/255.

    Args:
        cloud: Gaussians of degree 0.
    """
    chunks = -(-len(cloud) // CHUNK)
    centre, half, reach = np.empty((chunks, 3)), np.empty((chunks, 3), np.float32), np.empty(chunks, np.float32)
    geometry = np.empty((chunks, BLOCKS, GEOMETRY_ROWS, 16), np.float32)
    colour = np.empty((chunks, BLOCKS, 3, 16), np.float32)
    arrays = (cloud.means_m, cloud.quats_wxyz, cloud.scales_m, cloud.opacities, cloud.sh)
    _pack(*arrays, centre, half, reach, geometry, colour)
    return PackedScene(
        centre_m=centre,
        half_m=half,
        reach_m=reach,
        geometry=geometry,
        colour=colour,
        sh=_NO_SH,
        sh_step=_STEP,
    )


@kernel_with_cache
def _pack(
    means: Float32Array,
    quats: Float32Array,
    scales: Float32Array,
    opacities: Float32Array,
    sh: Float32Array,
    centre: Float64Array,
    half: Float32Array,
    reach: Float32Array,
    geometry: Float32Array,
    colour: Float32Array,
) -> None:
    geometry[:] = 0.0
    geometry[:, :, REACH2] = -1.0
    colour[:] = 0.0
    L, above = np.empty((3, 3)), np.float32(np.inf)
    for chunk in range(len(centre)):
        first, end = chunk * CHUNK, min((chunk + 1) * CHUNK, len(means))
        for axis in range(3):
            low, high = np.float64(means[first:end, axis].min()), np.float64(means[first:end, axis].max())
            # A float32 number, so that `mean - centre` loses nothing for means near it; sizes are rounded up.
            middle = np.float64(np.float32(0.5 * (low + high)))
            centre[chunk, axis] = middle
            half[chunk, axis] = np.nextafter(np.float32(max(high - middle, middle - low)), above)
        farthest = 0.0
        for n in range(first, end):
            out, lane = geometry[chunk, (n - first) // _LANES], n % _LANES
            _fill_axes(quats[n], scales[n], L)
            log_opacity = math.log(np.float64(opacities[n]))
            reach2 = max(2.0 * (log_opacity - math.log(ALPHA_MIN)), 0.0)
            for axis in range(3):
                out[MEAN_X + axis, lane] = np.float64(means[n, axis]) - centre[chunk, axis]
                colour[chunk, (n - first) // _LANES, axis, lane] = max(0.5 + SH_C0 * np.float64(sh[n, 0, axis]), 0.0)
            for k, (i, j) in enumerate(_UPPER):
                out[COV_XX + k, lane] = L[i, 0] * L[j, 0] + L[i, 1] * L[j, 1] + L[i, 2] * L[j, 2]
            out[LOG2_OPACITY, lane], out[REACH2, lane] = log_opacity / math.log(2.0), reach2
            farthest = max(farthest, math.sqrt(reach2) * np.float64(scales[n].max()))
        reach[chunk] = np.nextafter(np.float32(farthest), above)


@kernel_with_cache
def _fill_axes(q: Float32Array, scale: Float32Array, L: Float64Array) -> None:
    """Write the principal axes, as columns as long as the standard deviations."""
    w, x, y, z = np.float64(q[0]), np.float64(q[1]), np.float64(q[2]), np.float64(q[3])
    length = math.sqrt(w * w + x * x + y * y + z * z)
    w, x, y, z = w / length, x / length, y / length, z / length
    L[0, 0], L[0, 1], L[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    L[1, 0], L[1, 1], L[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    L[2, 0], L[2, 1], L[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    for i in range(3):
        for k in range(3):
            L[i, k] *= np.float64(scale[k])
