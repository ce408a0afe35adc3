"""The camera of the CPU rasterizer and the chunks that it sees.

Legend: boxes of means have bounds low, high along the axes of the camera's frame [m]; u is a tangent x / z (or y / z),
its pixel is focal * u + centre. A half size h of a box becomes |R| h under a rotation R, entry by entry.
"""

import math
from typing import NamedTuple

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array, Int64Array
from readygo.common.kernels import inline_kernel, kernel
from readygo.common.rasterizer.constants import FOV_MARGIN, NEAR_M
from readygo.common.rasterizer.cpu.tiles import pack_box

PAD_PX = 2.0
"""How far the image-space dilation reaches: sqrt(2 ln(255) * 0.3) = 1.83 px."""


SLACK_M = 1e-5
"""Added to boxes for the rounding of float32 coordinates."""


class PinholeView(NamedTuple):
    """A pinhole camera as the kernels take it."""

    R_CW: Float64Array
    """Rotation from world to camera, shape (3, 3)."""
    p_WC: Float64Array
    """Camera centre [m], shape (3,)."""
    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int


class VisibleChunks(NamedTuple):
    """Chunks that may touch the image."""

    number: Int64Array
    """Chunk numbers, shape (C,)."""
    depth_m: Float64Array
    """Lower bound of the depths of their means [m], shape (C,)."""
    box: Int64Array
    """Bounds of their footprints in blocks of 4x4 px, packed as in `pack_box`, shape (C,)."""
    corners: Float64Array
    """Scratch memory, shape (2, 3)."""


def make_view(T_world_camera: Float64Array, K_px: Float64Array, height_px: int, width_px: int) -> PinholeView:
    """A view of a camera pose (OpenCV axes) and intrinsics without skew."""
    return PinholeView(
        np.ascontiguousarray(T_world_camera[:3, :3].T),
        np.ascontiguousarray(T_world_camera[:3, 3]),
        float(K_px[0, 0]),
        float(K_px[1, 1]),
        float(K_px[0, 2]),
        float(K_px[1, 2]),
        width_px,
        height_px,
    )


@inline_kernel
def _axis_range(low: float, high: float, z_low: float, z_high: float) -> tuple[float, float]:
    """Range of the quotients of [low, high] and [z_low, z_high], z_low > 0."""
    return low / (z_high if low >= 0.0 else z_low), high / (z_low if high >= 0.0 else z_high)


@inline_kernel
def _blocks_of_range(
    low: float, high: float, z_low: float, z_high: float, reach: float, focal: float, centre: float, size: int
) -> tuple[int, int]:
    """First and last 4-px block that footprints may touch along one image axis; first > last: none.

    A Gaussian of radius `reach` at (u, depth z) reaches at most reach * sqrt(1 + u^2) / z from u, where u is clamped
    as in the projection.
    """
    # Tangents of the image's borders, and the clamp of the projection.
    margin = FOV_MARGIN * 0.5 * size / focal
    u_first, u_last = -(centre + PAD_PX) / focal, (size - centre + PAD_PX) / focal
    u_limit = max(abs(u_first), abs(u_last)) + margin
    # Beyond a border at all depths: (low - u_last z) > reach sqrt(1 + u^2), where u_last z is largest.
    widest = reach * math.sqrt(1.0 + u_limit * u_limit)
    if low - (u_last * z_high if u_last >= 0.0 else u_last * z_low) > widest:
        return 1, 0
    if (u_first * z_low if u_first >= 0.0 else u_first * z_high) - high > widest:
        return 1, 0
    # Bounds of the tangents of the means, widened by the footprint at the nearest depth.
    u_low, u_high = _axis_range(low, high, z_low, z_high)
    u_widest = min(max(abs(u_low), abs(u_high)), u_limit)
    spread = reach * math.sqrt(1.0 + u_widest * u_widest) / z_low
    first = max((u_low - spread) * focal + centre - PAD_PX, 0.0)
    last = min((u_high + spread) * focal + centre + PAD_PX, size - 1.0)
    if first > last:
        return 1, 0
    return int(first) >> 2, int(last) >> 2


@inline_kernel
def add_if_visible(
    view: PinholeView, low: Float64Array, high: Float64Array, reach: float, i: int, n: int, out: VisibleChunks
) -> int:
    """Write chunk `i`, whose means lie in a box of the camera frame, to place `n`; the number of chunks after that."""
    if high[2] <= NEAR_M:
        return n
    z_low = max(low[2], NEAR_M)
    x0, x1 = _blocks_of_range(low[0], high[0], z_low, high[2], reach, view.fx, view.cx, view.width)
    y0, y1 = _blocks_of_range(low[1], high[1], z_low, high[2], reach, view.fy, view.cy, view.height)
    if x0 > x1 or y0 > y1:
        return n
    out.number[n] = i
    out.depth_m[n] = low[2]
    out.box[n] = pack_box(x0, x1, y0, y1)
    return n + 1


@inline_kernel
def camera_box(
    view: PinholeView, centre_m: Float64Array, half_m: Float32Array, low: Float64Array, high: Float64Array
) -> None:
    """Write the bounds of a box in the camera's frame."""
    R = view.R_CW
    dx, dy, dz = centre_m[0] - view.p_WC[0], centre_m[1] - view.p_WC[1], centre_m[2] - view.p_WC[2]
    for k in range(3):
        middle = R[k, 0] * dx + R[k, 1] * dy + R[k, 2] * dz
        half = abs(R[k, 0]) * half_m[0] + abs(R[k, 1]) * half_m[1] + abs(R[k, 2]) * half_m[2] + SLACK_M
        low[k], high[k] = middle - half, middle + half


@kernel
def cull_scene(
    view: PinholeView, centre_m: Float64Array, half_m: Float32Array, reach_m: Float32Array, out: VisibleChunks
) -> int:
    """Write the chunks whose Gaussians may touch the image, and return their number."""
    low, high = out.corners[0], out.corners[1]
    n = 0
    for i in range(len(centre_m)):
        camera_box(view, centre_m[i], half_m[i], low, high)
        n = add_if_visible(view, low, high, reach_m[i], i, n, out)
    return n


@inline_kernel
def posed_box(
    A_CS: Float32Array,
    first: int,
    end: int,
    box_joint: Int64Array,
    centre_m: Float32Array,
    half_m: Float32Array,
    low: Float64Array,
    high: Float64Array,
) -> None:
    """Write the bounds in the camera's frame of the boxes `first` to `end`, each carried along by its joint."""
    for k in range(3):
        low[k], high[k] = np.inf, -np.inf
    for b in range(first, end):
        A = A_CS[box_joint[b]]
        c, h = centre_m[b], half_m[b]
        for k in range(3):
            middle = A[k, 0] * c[0] + A[k, 1] * c[1] + A[k, 2] * c[2] + A[k, 3]
            half = abs(A[k, 0]) * h[0] + abs(A[k, 1]) * h[1] + abs(A[k, 2]) * h[2] + SLACK_M
            low[k], high[k] = min(low[k], float(middle - half)), max(high[k], float(middle + half))


@inline_kernel
def add_human_chunk(
    view: PinholeView,
    low: Float64Array,
    high: Float64Array,
    reach: float,
    lead: Float32Array,
    i: int,
    n: int,
    out: VisibleChunks,
) -> int:
    """Add a chunk of a human if it may be seen, sorted as nearer by up to what `lead_terms` say within its box."""
    end: int = add_if_visible(view, low, high, reach, i, n, out)
    if end > n and lead[4] > 0.0:
        # Largest value of the linear function lead . (x, y, z, 1) in the box, at most lead[4].
        most = float(lead[3])
        for k in range(3):
            most += max(lead[k] * low[k], lead[k] * high[k])
        out.depth_m[n] -= min(max(most + SLACK_M, 0.0), float(lead[4]))
    return end


@kernel
def cull_human(
    view: PinholeView,
    lead: Float32Array,
    A_CS: Float32Array,
    box_start: Int64Array,
    box_joint: Int64Array,
    centre_m: Float32Array,
    half_m: Float32Array,
    reach_m: Float32Array,
    out: VisibleChunks,
) -> int:
    """Write the chunks of a posed avatar that may touch the image, and return their number.

    A posed mean lies in the convex hull of where the chunk's joints would carry it, so within the bounds of the boxes
    that each joint carries along.

    Args:
        view: Camera.
        lead: By how much the Gaussians are sorted as nearer, from `lead_terms`, shape (5,).
        A_CS: Transforms of the joints from canonical to camera coordinates, shape (24, 3, 4).
        box_start: First box of each chunk, shape (C + 1,).
        box_joint: Joint of each box, shape (B,).
        centre_m: Centres of the boxes around the means, canonical coordinates, shape (B, 3).
        half_m: Half sizes of these boxes [m], shape (B, 3).
        reach_m: Largest distance from its mean at which a Gaussian of the chunk is drawn, shape (C,).
        out: Where to write.
    """
    low, high = out.corners[0], out.corners[1]
    n = 0
    for i in range(len(reach_m)):
        posed_box(A_CS, box_start[i], box_start[i + 1], box_joint, centre_m, half_m, low, high)
        n = add_human_chunk(view, low, high, reach_m[i], lead, i, n, out)
    return n
