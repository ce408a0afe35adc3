"""From derivatives by projected Gaussians to derivatives by their parameters and the camera pose.

Legend: d = mean - camera centre, R = R_CW, (x, y, z) = R d, tangents (u, v) = (x / z, y / z) clamped to (uc, vc),
E = rows of J R without the factors fx / z and fy / z, Q = rotation of the Gaussian, A = E Q, s = scales. The image axes
are a_k = A_0k s_k fx / z, b_k = A_1k s_k fy / z, the covariance is that of `image_covariance`, K is its inverse.
With v = dL / d ln(alpha) of a pixel at offset (dx, dy) from the projected mean, the moments of a record are the sums of
v, v dx, v dy, v dx^2, v dx dy, v dy^2 over its pixels:

    dL / d ln(opacity) = m0,  dL / d mean_px = K (m1, m2),  dL / d covariance = K M K / 2,  M = [[m3, m4], [m4, m5]].

These follow from ln(alpha) = ln(opacity) - (dx, dy) K (dx, dy)^T / 2 and dK = -K d(covariance) K. In the code, p = K M
and W = K M K is (wxx, wxy, wyy); g stands for derivatives: ga and gb by a and b, g_u and g_v by the tangents of the
mean, g_uc and g_vc by the clamped ones, e by the rows of E, row by row.
"""

from typing import Any

import numpy as np

from readygo.common.arrays import Float32Array
from readygo.common.kernels import inline_kernel
from readygo.common.rasterizer.cpu.optics import Optics, clamp_tangents, optics_of, rotation_rows
from readygo.common.rasterizer.cpu.view import PinholeView
from readygo.common.simd.memory import compress, load_f16, load_i16, prefetch, store_f16, transpose
from readygo.common.simd.types import (
    LANES,
    bit_pattern,
    count_bits,
    f16,
    float_bits,
    float_of_bits,
    fma,
    fnma,
    has_bit,
    lane_number,
    lowest_bit,
    mask_bits,
    sqrt,
    where,
)
from readygo.services.reconstructor.differentiable.colour import write_coefficient_gradients
from readygo.services.reconstructor.differentiable.ewa import (
    image_axes,
    image_covariance,
    image_rows,
    quaternion_matrix,
    to_camera,
)
from readygo.services.reconstructor.differentiable.memory import (
    BLUE_CHANNEL,
    CHANNELS,
    COLOURED,
    DEPTH_CHANNEL,
    DERIVATIVES,
    FEATURES,
    GREEN_CHANNEL,
    GROUP,
    MOMENTS,
    NUMBER,
    OFFSET,
    OPACITY,
    QUATERNION,
    RED_CHANNEL,
    SCALES,
    WEIGHT,
    Chunks,
    Cloud,
    ForwardMemory,
    Gradients,
)
from readygo.services.reconstructor.differentiable.released import kernel_without_gil
from readygo.services.reconstructor.differentiable.simd_rows import rows_of_four, rows_of_three, store_first

POSE_NUMBERS = 12
"""Rows of the derivatives by the pose: R_CW row by row, then the camera centre."""


@inline_kernel
def _row(kept: ForwardMemory, group: int, row: int) -> Any:
    """A row of a group, see `GROUP_ROWS`."""
    return load_f16(kept.groups, group * GROUP + LANES * row)


@inline_kernel
def _moment(out: Gradients, number: int) -> Any:
    """A moment of a group's gradient records."""
    return load_f16(out.sums, MOMENTS[number] * LANES)


@inline_kernel
def _quaternion_gradient(q: Any, G: Any) -> Any:
    """Derivatives by quaternions of any length of a loss whose derivatives by their rotations are G, row by row.

    The rotation of the unit quaternion (w, v) is I + 2 (w [v]x + v v^T - |v|^2 I). Half its derivatives, with n the
    vector of G - G^T and p_ij = G_ij + G_ji:

        by w: v . n,   by v_i: sum over j != i of p_ij v_j - 2 v_i (trace G - G_ii) + w n_i.

    Those by the given quaternion are projected to the tangent of the sphere, over its length.
    """
    inverse = 1.0 / sqrt(fma(q[0], q[0], fma(q[1], q[1], fma(q[2], q[2], q[3] * q[3]))))
    w, x, y, z = q[0] * inverse, q[1] * inverse, q[2] * inverse, q[3] * inverse
    # n = vector of G - G^T; p_ij = G_ij + G_ji.
    n0, n1, n2 = G[7] - G[5], G[2] - G[6], G[3] - G[1]
    p01, p02, p12 = G[1] + G[3], G[2] + G[6], G[5] + G[7]
    gw = fma(x, n0, fma(y, n1, z * n2))
    gx = fma(y, p01, fma(z, p02, fnma(x * 2.0, G[4] + G[8], w * n0)))
    gy = fma(x, p01, fma(z, p12, fnma(y * 2.0, G[0] + G[8], w * n1)))
    gz = fma(x, p02, fma(y, p12, fnma(z * 2.0, G[0] + G[4], w * n2)))
    along = fma(w, gw, fma(x, gx, fma(y, gy, z * gz)))
    twice = inverse * 2.0
    return (gw - along * w) * twice, (gx - along * x) * twice, (gy - along * y) * twice, (gz - along * z) * twice


@inline_kernel
def _add_pose(k: int, drawn: Any, value: Any, out: Gradients) -> None:
    """Add the drawn lanes of a value to those of number `k` of the pose."""
    store_f16(out.pose, k * LANES, load_f16(out.pose, k * LANES) + where(drawn, value, 0.0))


@inline_kernel
def _add_poses(drawn: Any, d: Any, g: Any, G: Any, w: Any, out: Gradients) -> None:
    """Add derivatives by R_CW, of which `G` holds what the covariances give, and by the camera centre.

    (x, y, z) = R d gives g d^T to R, with g the derivatives by (x, y, z); d = mean - centre gives -w to the centre.
    """
    _add_pose(0, drawn, fma(g[0], d[0], G[0]), out)
    _add_pose(1, drawn, fma(g[0], d[1], G[1]), out)
    _add_pose(2, drawn, fma(g[0], d[2], G[2]), out)
    _add_pose(3, drawn, fma(g[1], d[0], G[3]), out)
    _add_pose(4, drawn, fma(g[1], d[1], G[4]), out)
    _add_pose(5, drawn, fma(g[1], d[2], G[5]), out)
    _add_pose(6, drawn, fma(g[2], d[0], G[6]), out)
    _add_pose(7, drawn, fma(g[2], d[1], G[7]), out)
    _add_pose(8, drawn, fma(g[2], d[2], G[8]), out)
    _add_pose(9, drawn, 0.0 - w[0], out)
    _add_pose(10, drawn, 0.0 - w[1], out)
    _add_pose(11, drawn, 0.0 - w[2], out)


@inline_kernel
def _copy_features(group: int, row: int, weighty: int, out: Gradients) -> None:
    """Copy derivatives by features from the gradient records of the lanes `weighty` to rows from `row` on."""
    size = out.feature_size
    while weighty:
        lane = lowest_bit(weighty)
        weighty &= weighty - 1
        source, target = (LANES * group + lane) * out.record_size, row * size
        row += 1
        for k in range(0, size, LANES):
            store_first(out.features, target + k, size - k, load_f16(out.records, source + FEATURES + k))


@inline_kernel
def _pack_lanes(lanes: Any, value: Any) -> Any:
    """The lanes of a mask, moved to the front."""
    return float_of_bits(compress(lanes, bit_pattern(value)))


@inline_kernel
def _write_rows_of_three(rows: Float32Array, row: int, lanes: Any, a: Any, b: Any, c: Any) -> None:
    """Write the columns (a, b, c) of the lanes of a mask as rows of three, from `row` on."""
    r0, r1, r2 = rows_of_three(_pack_lanes(lanes, a), _pack_lanes(lanes, b), _pack_lanes(lanes, c))
    store_f16(rows, 3 * row, r0)
    store_f16(rows, 3 * row + LANES, r1)
    store_f16(rows, 3 * row + 2 * LANES, r2)


@inline_kernel
def _ask_for(group: int, kept: ForwardMemory, out: Gradients) -> None:
    """Ask the cache for a group and its gradient records."""
    for k in range(0, GROUP, LANES):
        prefetch(kept.groups, group * GROUP + k)
    for lane in range(LANES):
        prefetch(out.records, (LANES * group + lane) * out.record_size)


@inline_kernel
def _gradient_rows(group: int, out: Gradients) -> None:
    """Bring the first 16 numbers of a group's gradient records to one row each."""
    transpose(out.records, LANES * group * out.record_size, out.record_size, out.sums, 0, LANES)


@inline_kernel
def _shape_gradients(
    optics: Optics, R: Any, group: int, first: int, row: int, lanes: Any, kept: ForwardMemory, out: Gradients
) -> Any:
    """Derivatives by quaternions, scales and opacities, written; those by the offsets in camera axes, returned.

    Also returned: what the covariances add to the derivatives by R_CW, row by row.
    """
    # The forward pass once more, as in `project`.
    d = (_row(kept, group, OFFSET), _row(kept, group, OFFSET + 1), _row(kept, group, OFFSET + 2))
    x, y, z = to_camera(R, d)
    inverse_z = 1.0 / z
    u, v = x * inverse_z, y * inverse_z
    uc, vc = clamp_tangents(optics, u, v)
    q = (
        _row(kept, group, QUATERNION),
        _row(kept, group, QUATERNION + 1),
        _row(kept, group, QUATERNION + 2),
        _row(kept, group, QUATERNION + 3),
    )
    Q = quaternion_matrix(q[0], q[1], q[2], q[3])
    E = image_rows(R, uc, vc)
    A = image_axes(E, Q)
    du, dv = inverse_z * optics.fx, inverse_z * optics.fy
    s0, s1, s2 = _row(kept, group, SCALES), _row(kept, group, SCALES + 1), _row(kept, group, SCALES + 2)
    su0, su1, su2, sv0, sv1, sv2 = s0 * du, s1 * du, s2 * du, s0 * dv, s1 * dv, s2 * dv
    a = (A[0] * su0, A[1] * su1, A[2] * su2)
    b = (A[3] * sv0, A[4] * sv1, A[5] * sv2)
    sxx, sxy, syy, det = image_covariance(a, b)
    # K, the inverse covariance.
    scale = 1.0 / det
    kxx, kxy, kyy = syy * scale, fnma(sxy, scale, f16(0.0)), sxx * scale
    m0, m1, m2 = _moment(out, 0), _moment(out, 1), _moment(out, 2)
    m3, m4, m5 = _moment(out, 3), _moment(out, 4), _moment(out, 5)
    # dL / d opacity = m0 / opacity, dL / d mean_px = K (m1, m2).
    store_f16(out.opacities, row, _pack_lanes(lanes, m0 / _row(kept, group, OPACITY)))
    gx, gy = fma(kxx, m1, kxy * m2), fma(kxy, m1, kyy * m2)
    store_f16(out.means_px, first, where(lanes, gx, 0.0))
    store_f16(out.means_px, out.stride + first, where(lanes, gy, 0.0))
    # W = K M K, twice the derivatives by the covariance.
    p00, p01 = fma(kxx, m3, kxy * m4), fma(kxy, m3, kyy * m4)
    p10, p11 = fma(kxx, m4, kxy * m5), fma(kxy, m4, kyy * m5)
    wxx, wxy, wyy = fma(p00, kxx, p10 * kxy), fma(p00, kxy, p10 * kyy), fma(p01, kxy, p11 * kyy)
    # covariance = sum of (a_k, b_k)^T (a_k, b_k): dL / d(a_k, b_k) = W (a_k, b_k).
    ga0, ga1, ga2 = fma(wxx, a[0], wxy * b[0]), fma(wxx, a[1], wxy * b[1]), fma(wxx, a[2], wxy * b[2])
    gb0, gb1, gb2 = fma(wxy, a[0], wyy * b[0]), fma(wxy, a[1], wyy * b[1]), fma(wxy, a[2], wyy * b[2])
    # a_k = A_0k s_k du, b_k = A_1k s_k dv: by s_k, and below by A, which is E Q: g = (g0 g1 g2; g3 g4 g5).
    _write_rows_of_three(
        out.scales_m,
        row,
        lanes,
        fma(ga0 * du, A[0], gb0 * dv * A[3]),
        fma(ga1 * du, A[1], gb1 * dv * A[4]),
        fma(ga2 * du, A[2], gb2 * dv * A[5]),
    )
    # By ln(fx / z) and ln(fy / z), both of which move with -ln(z).
    g_zoom = fma(ga0, a[0], fma(ga1, a[1], ga2 * a[2])) + fma(gb0, b[0], fma(gb1, b[1], gb2 * b[2]))
    g0, g1, g2, g3, g4, g5 = ga0 * su0, ga1 * su1, ga2 * su2, gb0 * sv0, gb1 * sv1, gb2 * sv2
    # By Q: E^T g; its columns are those of g.
    w0, w1, w2, w3 = _quaternion_gradient(
        q,
        (
            fma(E[0], g0, E[3] * g3), fma(E[0], g1, E[3] * g4), fma(E[0], g2, E[3] * g5),
            fma(E[1], g0, E[4] * g3), fma(E[1], g1, E[4] * g4), fma(E[1], g2, E[4] * g5),
            fma(E[2], g0, E[5] * g3), fma(E[2], g1, E[5] * g4), fma(E[2], g2, E[5] * g5),
        ),
    )  # fmt: skip
    h0, h1, h2, h3 = rows_of_four(
        _pack_lanes(lanes, w0), _pack_lanes(lanes, w1), _pack_lanes(lanes, w2), _pack_lanes(lanes, w3)
    )
    store_f16(out.quats_wxyz, 4 * row, h0)
    store_f16(out.quats_wxyz, 4 * row + LANES, h1)
    store_f16(out.quats_wxyz, 4 * row + 2 * LANES, h2)
    store_f16(out.quats_wxyz, 4 * row + 3 * LANES, h3)
    # By E: g Q^T.
    e0, e1, e2 = (
        fma(Q[0], g0, fma(Q[1], g1, Q[2] * g2)),
        fma(Q[3], g0, fma(Q[4], g1, Q[5] * g2)),
        fma(Q[6], g0, fma(Q[7], g1, Q[8] * g2)),
    )
    e3, e4, e5 = (
        fma(Q[0], g3, fma(Q[1], g4, Q[2] * g5)),
        fma(Q[3], g3, fma(Q[4], g4, Q[5] * g5)),
        fma(Q[6], g3, fma(Q[7], g4, Q[8] * g5)),
    )
    # E_0 = R_0 - uc R_2 and E_1 = R_1 - vc R_2: dL / duc = -(e0 e1 e2) . R_2, here without the sign, and so for vc.
    g_uc, g_vc = fma(e0, R[6], fma(e1, R[7], e2 * R[8])), fma(e3, R[6], fma(e4, R[7], e5 * R[8]))
    # A clamped tangent does not move with the mean.
    inside_u, inside_v = (u > optics.u_low) & (u < optics.u_high), (v > optics.v_low) & (v < optics.v_high)
    # mean_px = (fx u + cx, fy v + cy).
    g_u = fma(gx, optics.fx, where(inside_u, 0.0 - g_uc, 0.0))
    g_v = fma(gy, optics.fy, where(inside_v, 0.0 - g_vc, 0.0))
    # u = x / z: dL / dx = g_u / z, dL / dz = -(g_u u + g_v v + g_zoom) / z and what the depth's plane gives.
    g_depth = load_f16(out.sums, CHANNELS[DEPTH_CHANNEL] * LANES)
    g_z = fnma(fma(g_u, u, fma(g_v, v, g_zoom)), inverse_z, g_depth)
    # By R through E: e for the first two rows, -(uc e_0 + vc e_1) for the third.
    t0, t1, t2 = fma(uc, e0, vc * e3), fma(uc, e1, vc * e4), fma(uc, e2, vc * e5)
    zero = f16(0.0)
    return (g_u * inverse_z, g_v * inverse_z, g_z), (e0, e1, e2, e3, e4, e5, zero - t0, zero - t1, zero - t2)


@inline_kernel
def _colour_gradients(
    cloud: Cloud, group: int, row: int, weighty: int, dense: bool, kept: ForwardMemory, out: Gradients
) -> Any:
    """Derivatives by the coefficients, written; those by the offsets in world axes, returned."""
    zero = f16(0.0)
    if cloud.sh_count == 0:
        return zero, zero, zero
    # Black is cut off at 0, where nothing moves it: bits 0, 1 and 2 say which channels are not.
    coloured = load_i16(kept.groups, group * GROUP + LANES * COLOURED)
    g = (
        where(has_bit(coloured, 1), load_f16(out.sums, CHANNELS[RED_CHANNEL] * LANES), 0.0),
        where(has_bit(coloured, 2), load_f16(out.sums, CHANNELS[GREEN_CHANNEL] * LANES), 0.0),
        where(has_bit(coloured, 4), load_f16(out.sums, CHANNELS[BLUE_CHANNEL] * LANES), 0.0),
    )
    d = (_row(kept, group, OFFSET), _row(kept, group, OFFSET + 1), _row(kept, group, OFFSET + 2))
    inverse = 1.0 / sqrt(fma(d[0], d[0], fma(d[1], d[1], d[2] * d[2])))
    x, y, z = d[0] * inverse, d[1] * inverse, d[2] * inverse
    write_coefficient_gradients(cloud, group, (x, y, z), g, row, weighty, dense, kept, out)
    if cloud.sh_count == 1:
        return zero, zero, zero
    # Derivatives of red by the offset's x, y, z, then those of green, then those of blue.
    return (
        fma(
            g[0],
            _row(kept, group, DERIVATIVES),
            fma(g[1], _row(kept, group, DERIVATIVES + 3), g[2] * _row(kept, group, DERIVATIVES + 6)),
        ),
        fma(
            g[0],
            _row(kept, group, DERIVATIVES + 1),
            fma(g[1], _row(kept, group, DERIVATIVES + 4), g[2] * _row(kept, group, DERIVATIVES + 7)),
        ),
        fma(
            g[0],
            _row(kept, group, DERIVATIVES + 2),
            fma(g[1], _row(kept, group, DERIVATIVES + 5), g[2] * _row(kept, group, DERIVATIVES + 8)),
        ),
    )


@inline_kernel
def _write_numbers(group: int, row: int, weighty: int, kept: ForwardMemory, out: Gradients) -> None:
    """Write the indices of the Gaussians with weight of a group, from `row` on."""
    while weighty:
        lane = lowest_bit(weighty)
        weighty &= weighty - 1
        out.numbers[row] = float_bits(kept.groups[group * GROUP + LANES * NUMBER + lane])
        row += 1


@inline_kernel
def _group_gradients(
    optics: Optics,
    R: Any,
    cloud: Cloud,
    group: int,
    first: int,
    row: int,
    lanes: Any,
    dense: bool,
    kept: ForwardMemory,
    out: Gradients,
) -> None:
    """Derivatives by all parameters of the lanes `lanes` of a group, whose gradient records are in `sums`."""
    weighty = mask_bits(lanes)
    _write_numbers(group, row, weighty, kept, out)
    g, G = _shape_gradients(optics, R, group, first, row, lanes, kept, out)
    c = _colour_gradients(cloud, group, row, weighty, dense, kept, out)
    # By the means: R^T g and what the colours' dependence on direction gives.
    w = (
        fma(R[0], g[0], fma(R[3], g[1], fma(R[6], g[2], c[0]))),
        fma(R[1], g[0], fma(R[4], g[1], fma(R[7], g[2], c[1]))),
        fma(R[2], g[0], fma(R[5], g[1], fma(R[8], g[2], c[2]))),
    )
    _write_rows_of_three(out.means_m, row, lanes, w[0], w[1], w[2])
    d = (_row(kept, group, OFFSET), _row(kept, group, OFFSET + 1), _row(kept, group, OFFSET + 2))
    _add_poses(lanes, d, g, G, w, out)
    if out.feature_size:
        _copy_features(group, row, weighty, out)


@kernel_without_gil
def project_gradients(
    view: PinholeView, cloud: Cloud, chunks: Chunks, dense: bool, kept: ForwardMemory, out: Gradients
) -> int:
    """Derivatives by all parameters of the Gaussians with weight, in the order of memory; the number of these.

    Args:
        view: Camera.
        cloud: Parameters.
        chunks: Chunks after the projection.
        dense: Write those by SH coefficients to the rows of all Gaussians instead.
        kept: What the projection kept.
        out: Gradient records, and where to write.
    """
    optics, R = optics_of(view), rotation_rows(view.R_CW)
    for k in range(POSE_NUMBERS):
        store_f16(out.pose, k * LANES, f16(0.0))
    first, row = 0, 0
    for i in range(len(chunks.number)):
        for group in range(chunks.first_group[i], chunks.first_group[i] + chunks.group_count[i]):
            count: int = kept.lanes[group]
            if out.touched[group + 2]:
                _ask_for(group + 2, kept, out)
            if out.touched[group]:
                _gradient_rows(group, out)
                weight = load_f16(out.sums, WEIGHT * LANES)
                lanes = (weight > 0.0) & (lane_number() < count)
                store_f16(out.weights, first, weight)
                _group_gradients(optics, R, cloud, group, first, row, lanes, dense, kept, out)
                row += count_bits(mask_bits(lanes))
            else:
                store_f16(out.weights, first, f16(0.0))
                store_f16(out.means_px, first, f16(0.0))
                store_f16(out.means_px, out.stride + first, f16(0.0))
            first += count
    return row


@kernel_without_gil
def gather_sums(chunks: Chunks, kept: ForwardMemory, out: Gradients, begin: int, rows: Float32Array) -> None:
    """Copy numbers from `begin` on of the gradient records to `rows`, one row per Gaussian in the order of memory."""
    row = 0
    for i in range(len(chunks.number)):
        for group in range(chunks.first_group[i], chunks.first_group[i] + chunks.group_count[i]):
            for lane in range(kept.lanes[group]):
                place = (LANES * group + lane) * out.record_size + begin
                for k in range(rows.shape[1]):
                    rows[row, k] = out.records[place + k] if out.touched[group] else np.float32(0.0)
                row += 1
