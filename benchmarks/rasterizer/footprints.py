"""Where Gaussians lie in an image, in float64 and one after the other: what any renderer has to work through.

The rules are those of `readygo.common.rasterizer.constants`.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import BoolArray, Float32Array, Float64Array, Int64Array
from readygo.common.gaussians import GaussianCloud, rgb_along
from readygo.common.kernels import kernel_with_cache
from readygo.common.rasterizer.constants import (
    ALPHA_MAX,
    ALPHA_MIN,
    DILATION_PX2,
    FOV_MARGIN,
    NEAR_M,
    TRANSMITTANCE_MIN,
)

CENTRE_X, CENTRE_Y, CONIC_XX, CONIC_XY, CONIC_YY, OPACITY, DEPTH = range(7)


@dataclass(frozen=True, kw_only=True, eq=False)
class Footprints:
    """The Gaussians whose box holds a pixel's centre, nearest first; equal depths in the order of the cloud."""

    index: Int64Array
    """Their numbers in the cloud, shape (N,)."""
    shape: Float64Array
    """Columns `CENTRE_X` to `DEPTH` [px, px^-2, m], shape (N, 7)."""
    box: Int64Array
    """First and last column, first and last row of pixels, shape (N, 4)."""


@dataclass(frozen=True, kw_only=True)
class Work:
    """Work for one image, the same for every renderer."""

    visible: int
    """Gaussians whose box holds a pixel's centre."""
    drawn: int
    """Those of them that add to a pixel that is not finished."""
    drawn_people: int
    """Those of `drawn` that belong to people."""
    tile_entries: int
    """Pairs of a 16x16 px tile and a visible Gaussian whose box meets it."""
    block_entries: int
    """Pairs of a 4x4 px block and a Gaussian that adds to one of its pixels before that is finished."""
    pixel_pairs: int
    """Pairs of a pixel and a Gaussian that adds to it before it is finished."""


def footprints(
    cloud: GaussianCloud, T_world_camera: npt.ArrayLike, K_px: npt.ArrayLike, height_px: int, width_px: int
) -> Footprints:
    """Project a cloud; arguments as in `rasterize_reference`."""
    T, K = np.asarray(T_world_camera, dtype=np.float64), np.asarray(K_px, dtype=np.float64)
    R_CW = np.ascontiguousarray(T[:3, :3].T)
    lens = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2]])
    size = len(cloud)
    index, shape = np.empty(size, dtype=np.int64), np.empty((size, 7))
    box = np.empty((size, 4), dtype=np.int64)
    n = _project(
        cloud.means_m, cloud.quats_wxyz, cloud.scales_m, cloud.opacities, R_CW, np.ascontiguousarray(T[:3, 3]), lens,
        height_px, width_px, index, shape, box,
    )  # fmt: skip
    order = np.argsort(shape[:n, DEPTH], kind="stable")
    return Footprints(index=index[order], shape=shape[order], box=box[order])


def count_work(prints: Footprints, scene_count: int, height_px: int, width_px: int) -> Work:
    """Count; Gaussians from number `scene_count` on belong to people."""
    counts = np.zeros(5, dtype=np.int64)
    _blend(prints.shape, prints.box, prints.index >= scene_count, np.ones((height_px, width_px)), counts)
    drawn, drawn_people, tiles, blocks, pairs = counts.tolist()
    return Work(
        visible=len(prints.index),
        drawn=drawn,
        drawn_people=drawn_people,
        tile_entries=tiles,
        block_entries=blocks,
        pixel_pairs=pairs,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class PixelStack:
    """The Gaussians that add to one pixel before it is finished, nearest first."""

    index: Int64Array
    """Numbers in the cloud, shape (M,)."""
    depth_m: Float64Array
    alpha: Float64Array
    transmittance: Float64Array
    """What is left in front of each."""
    rgb: Float64Array
    """Colours towards the camera, shape (M, 3)."""


def pixel_stack(
    prints: Footprints, cloud: GaussianCloud, T_world_camera: npt.ArrayLike, row: int, column: int
) -> PixelStack:
    """What a pixel shows."""
    box = prints.box
    near = np.flatnonzero((box[:, 0] <= column) & (column <= box[:, 1]) & (box[:, 2] <= row) & (row <= box[:, 3]))
    s = prints.shape[near]
    dx, dy = column + 0.5 - s[:, CENTRE_X], row + 0.5 - s[:, CENTRE_Y]
    power = -0.5 * (s[:, CONIC_XX] * dx * dx + s[:, CONIC_YY] * dy * dy) - s[:, CONIC_XY] * dx * dy
    alpha = np.minimum(ALPHA_MAX, s[:, OPACITY] * np.exp(power))
    near, alpha = near[alpha >= ALPHA_MIN], alpha[alpha >= ALPHA_MIN]
    before = np.cumprod(np.concatenate([[1.0], 1.0 - alpha]))[:-1]
    shown = before >= TRANSMITTANCE_MIN
    near = near[shown]
    index = prints.index[near]
    towards = cloud.means_m[index].astype(np.float64) - np.asarray(T_world_camera, dtype=np.float64)[:3, 3]
    return PixelStack(
        index=index,
        depth_m=prints.shape[near, DEPTH],
        alpha=alpha[shown],
        transmittance=before[shown],
        rgb=rgb_along(cloud.sh[index], towards),
    )


@kernel_with_cache(error_model="numpy")
def _project(
    means: Float32Array,
    quats: Float32Array,
    scales: Float32Array,
    opacities: Float32Array,
    R: Float64Array,
    p_WC: Float64Array,
    lens: Float64Array,
    height: int,
    width: int,
    index: Int64Array,
    shape: Float64Array,
    box: Int64Array,
) -> int:
    fx, fy, cx, cy = lens
    margin_x, margin_y = FOV_MARGIN * 0.5 * width / fx, FOV_MARGIN * 0.5 * height / fy
    rows, axes = np.empty((2, 3)), np.empty((3, 3))
    n = 0
    for i in range(len(means)):
        d0, d1, d2 = means[i, 0] - p_WC[0], means[i, 1] - p_WC[1], means[i, 2] - p_WC[2]
        z = R[2, 0] * d0 + R[2, 1] * d1 + R[2, 2] * d2
        opacity = float(opacities[i])
        if not (z > NEAR_M and opacity >= ALPHA_MIN):
            continue
        x = R[0, 0] * d0 + R[0, 1] * d1 + R[0, 2] * d2
        y = R[1, 0] * d0 + R[1, 1] * d1 + R[1, 2] * d2
        u = min(max(x / z, -cx / fx - margin_x), (width - cx) / fx + margin_x)
        v = min(max(y / z, -cy / fy - margin_y), (height - cy) / fy + margin_y)
        w, a, b, c = float(quats[i, 0]), float(quats[i, 1]), float(quats[i, 2]), float(quats[i, 3])
        norm = math.sqrt(w * w + a * a + b * b + c * c)
        w, a, b, c = w / norm, a / norm, b / norm, c / norm
        axes[0, 0], axes[0, 1], axes[0, 2] = 1 - 2 * (b * b + c * c), 2 * (a * b - w * c), 2 * (a * c + w * b)
        axes[1, 0], axes[1, 1], axes[1, 2] = 2 * (a * b + w * c), 1 - 2 * (a * a + c * c), 2 * (b * c - w * a)
        axes[2, 0], axes[2, 1], axes[2, 2] = 2 * (a * c - w * b), 2 * (b * c + w * a), 1 - 2 * (a * a + b * b)
        for k in range(3):
            rows[0, k] = fx / z * (R[0, k] - u * R[2, k])
            rows[1, k] = fy / z * (R[1, k] - v * R[2, k])
        xx, xy, yy = DILATION_PX2, 0.0, DILATION_PX2
        for k in range(3):
            s = float(scales[i, k])
            p = s * (rows[0, 0] * axes[0, k] + rows[0, 1] * axes[1, k] + rows[0, 2] * axes[2, k])
            q = s * (rows[1, 0] * axes[0, k] + rows[1, 1] * axes[1, k] + rows[1, 2] * axes[2, k])
            xx, xy, yy = xx + p * p, xy + p * q, yy + q * q
        det = xx * yy - xy * xy
        centre_x, centre_y = fx * x / z + cx, fy * y / z + cy
        reach = 2.0 * math.log(opacity / ALPHA_MIN)
        half_x, half_y = math.sqrt(reach * xx), math.sqrt(reach * yy)
        x0, x1 = max(math.ceil(centre_x - half_x - 0.5), 0.0), min(math.floor(centre_x + half_x - 0.5), width - 1.0)
        y0, y1 = max(math.ceil(centre_y - half_y - 0.5), 0.0), min(math.floor(centre_y + half_y - 0.5), height - 1.0)
        if not (x0 <= x1 and y0 <= y1 and det > 0.0):
            continue
        index[n] = i
        shape[n, 0], shape[n, 1], shape[n, 2], shape[n, 3] = centre_x, centre_y, yy / det, -xy / det
        shape[n, 4], shape[n, 5], shape[n, 6] = xx / det, opacity, z
        box[n, 0], box[n, 1], box[n, 2], box[n, 3] = int(x0), int(x1), int(y0), int(y1)
        n += 1
    return n


@kernel_with_cache(error_model="numpy")
def _blend(
    shape: Float64Array, box: Int64Array, is_human: BoolArray, transmittance: Float64Array, counts: Int64Array
) -> None:
    """Count drawn Gaussians, those of people, tile entries, block entries and pixel pairs, in this order."""
    for n in range(len(shape)):
        x0, x1, y0, y1 = box[n]
        counts[2] += ((x1 >> 4) - (x0 >> 4) + 1) * ((y1 >> 4) - (y0 >> 4) + 1)
        blocks, pairs = 0, 0
        for block_y in range(y0 >> 2, (y1 >> 2) + 1):
            for block_x in range(x0 >> 2, (x1 >> 2) + 1):
                touched = 0
                for row in range(max(y0, 4 * block_y), min(y1, 4 * block_y + 3) + 1):
                    for column in range(max(x0, 4 * block_x), min(x1, 4 * block_x + 3) + 1):
                        if transmittance[row, column] < TRANSMITTANCE_MIN:
                            continue
                        dx, dy = column + 0.5 - shape[n, 0], row + 0.5 - shape[n, 1]
                        q = 0.5 * (shape[n, 2] * dx * dx + shape[n, 4] * dy * dy) + shape[n, 3] * dx * dy
                        alpha = min(ALPHA_MAX, shape[n, 5] * math.exp(-q))
                        if alpha >= ALPHA_MIN:
                            transmittance[row, column] *= 1.0 - alpha
                            touched += 1
                pairs += touched
                blocks += 1 if touched else 0
        counts[0] += 1 if pairs else 0
        counts[1] += 1 if pairs and is_human[n] else 0
        counts[3] += blocks
        counts[4] += pairs
