"""Projection of chunks of Gaussians to records, for static scenes and for posed humans.

Legend (values of 16 lanes, a Gaussian each; `workspace` has the places in memory):

    (px, py, pz)     mean relative to its chunk's centre, or in canonical coordinates [m]
    (x, y, z)        mean in the camera's frame [m]
    (u, v)           tangents (x / z, y / z) of its direction; (uc, vc) the same, clamped
    S                covariance in its own frame, xx xy xz yy yz zz [m2]
    R                rotation from that frame to the camera's, R[3 * row + column]
    J                derivative of the projection at (uc, vc): rows fx / z (1, 0, -uc) and fy / z (0, 1, -vc)
    a, b             rows of J R [px/m]
    (sxx, sxy, syy)  covariance in the image, J R S R^T J^T + `DILATION_PX2` I [px2]
    reach            squared distance in sigmas at which alpha falls to 1/255
    g, o             where a block begins in packed geometry, and in packed coefficients or normals

Source: Zwicker et al., EWA volume splatting, 2001; Kerbl et al., 3D Gaussian Splatting, 2023, section 4.
"""

from typing import Any, NamedTuple

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array, Int16Array, Int64Array
from readygo.common.gaussians.spherical_harmonics import SH_C0, SH_C1, SH_C2, SH_C3, SH_C20, SH_C30, SH_C31, SH_C32
from readygo.common.kernels import inline_kernel, kernel
from readygo.common.rasterizer.constants import DILATION_PX2, LIGHT_MAX, LIGHT_MIN, LOG2_E, NEAR_M
from readygo.common.rasterizer.cpu.optics import Optics, clamp_tangents, optics_of, rotation_rows
from readygo.common.rasterizer.cpu.outputs import normal_block
from readygo.common.rasterizer.cpu.posing import nearest_rotation
from readygo.common.rasterizer.cpu.slabs import NEAR_BITS, Slab, is_due
from readygo.common.rasterizer.cpu.tiles import LARGE, box_codes, is_alive, tiles_met
from readygo.common.rasterizer.cpu.view import PinholeView, VisibleChunks
from readygo.common.rasterizer.cpu.workspace import (
    BITS_DEPTH,
    BITS_HIGH,
    BITS_LOW,
    BITS_TILE,
    BLOCK_BITS,
    BOX,
    DEPTH_SHIFT,
    KEYS,
    LARGE_ENTRIES,
    LATER,
    RECORD,
    RECORD_A,
    RECORD_B,
    RECORD_C,
    RECORD_DEPTH,
    RECORD_OPACITY,
    RECORD_RED,
    RECORD_X,
    RECORD_Y,
    RECORDS,
    Workspace,
)
from readygo.common.rasterizer.packed.scene import (
    BLOCKS,
    COV_XX,
    COV_XY,
    COV_XZ,
    COV_YY,
    COV_YZ,
    COV_ZZ,
    GEOMETRY_ROWS,
    LOG2_OPACITY,
    MEAN_X,
    MEAN_Y,
    MEAN_Z,
    NORMAL_STEP,
    REACH2,
)
from readygo.common.simd.memory import load_f16, load_short, peek, poke, store_f16, store_i16, transpose
from readygo.common.simd.types import (
    LANES,
    bit_pattern,
    fma,
    fms,
    fnma,
    integer_where,
    lowest_bit,
    mask_bits,
    maximum,
    minimum,
    sqrt,
    to_float,
    truncate,
)

GEOMETRY = GEOMETRY_ROWS * LANES
"""Float32 numbers per block of packed geometry."""
COLOURS = 3 * LANES
"""Numbers per block of packed colours, and of packed normals: three rows."""
LIGHT_TERMS = 10
"""Terms of the light per channel: 1, x, y, z, xx, yy, zz, xy, xz, yz."""
LEAD_MAX = 4
"""Place in `lead` of the largest lead [m]; before it: its growth along x, y and z, and its value at the camera [m]."""


class FlatScene(NamedTuple):
    """Arrays of a `PackedScene`, flat."""

    centre_m: Float64Array
    geometry: Float32Array
    colour: Float32Array
    sh: Int16Array
    sh_step: float
    sh_count: int
    """Coefficients per channel; 1: `colour` is used."""
    normal: Int16Array | None = None
    """Packed shortest axes of the Gaussians, flat; None where no normals are wanted, and not compiled in."""


class FlatSkin(NamedTuple):
    """Arrays of a `PackedAvatar` that pose it."""

    joint_start: Int64Array
    joint: Int64Array
    weight: Float32Array


class Lit(NamedTuple):
    """The light on a human."""

    normal: Int16Array
    """Packed normals that light falls on, as `packed_shading` gives them, flat."""
    terms: Float32Array
    """Terms of the light in the camera's frame, as `rotate_forms` gives them, flat; empty: the avatar's own colours."""


@inline_kernel
def pixels_within(low: Any, high: Any, last: Any) -> Any:
    """First and last of the pixels 0, 1, .. `last` within [low, high] (I16 each), and where there is one (M16)."""
    low, high = minimum(maximum(low, 0.0), last + 1.0), minimum(high, last)
    # first = ceil(low), final = floor(high), from conversions that round towards zero.
    first = truncate(low)
    first = first + integer_where(to_float(first) < low, 1, 0)
    final = truncate(maximum(high, 0.0))
    return first, final, (high >= 0.0) & (first <= final)


@inline_kernel
def _image_block(optics: Optics, geometry: Float32Array, g: int, x: Any, y: Any, z: Any, R: Any, ws: Workspace) -> int:
    """Project a block of 16 Gaussians: their record rows go to the scratch memory, their mask of visible lanes back.

    Args:
        optics: Camera.
        geometry: Packed geometry.
        g: Index in `geometry` at which the block begins.
        x: Camera coordinates x of the means [m].
        y: Camera coordinates y of the means [m].
        z: Camera coordinates z of the means [m].
        R: Rotation from the frame of the covariances to the camera, row by row, nine values.
        ws: Workspace.
    """
    reach = load_f16(geometry, g + LANES * REACH2)
    # Mean: (fx x / z + cx, fy y / z + cy).
    inverse_z = 1.0 / z
    u, v = x * inverse_z, y * inverse_z
    mean_x, mean_y = fma(u, optics.fx, optics.cx), fma(v, optics.fy, optics.cy)
    uc, vc = clamp_tangents(optics, u, v)
    # a = fx / z (R_0 - uc R_2) and b = fy / z (R_1 - vc R_2), R_k being the rows of R.
    du, dv = inverse_z * optics.fx, inverse_z * optics.fy
    a0, a1, a2 = du * fnma(uc, R[6], R[0]), du * fnma(uc, R[7], R[1]), du * fnma(uc, R[8], R[2])
    b0, b1, b2 = dv * fnma(vc, R[6], R[3]), dv * fnma(vc, R[7], R[4]), dv * fnma(vc, R[8], R[5])
    xx, xy = load_f16(geometry, g + LANES * COV_XX), load_f16(geometry, g + LANES * COV_XY)
    xz, yy = load_f16(geometry, g + LANES * COV_XZ), load_f16(geometry, g + LANES * COV_YY)
    yz, zz = load_f16(geometry, g + LANES * COV_YZ), load_f16(geometry, g + LANES * COV_ZZ)
    # p = S a and q = S b.
    p0, p1, p2 = (
        fma(xx, a0, fma(xy, a1, xz * a2)),
        fma(xy, a0, fma(yy, a1, yz * a2)),
        fma(xz, a0, fma(yz, a1, zz * a2)),
    )
    q0, q1, q2 = (
        fma(xx, b0, fma(xy, b1, xz * b2)),
        fma(xy, b0, fma(yy, b1, yz * b2)),
        fma(xz, b0, fma(yz, b1, zz * b2)),
    )
    # The image covariance: a . S a, a . S b and b . S b, dilated.
    sxx = fma(p0, a0, fma(p1, a1, fma(p2, a2, DILATION_PX2)))
    sxy = fma(p0, b0, fma(p1, b1, p2 * b2))
    syy = fma(q0, b0, fma(q1, b1, fma(q2, b2, DILATION_PX2)))
    det = fms(sxx, syy, sxy * sxy)
    # The ellipse d^T (image covariance)^-1 d = reach has this bounding box; pixel centres are at +0.5.
    half_x, half_y = sqrt(reach * sxx), sqrt(reach * syy)
    left, top = mean_x - 0.5, mean_y - 0.5
    x0, x1, in_columns = pixels_within(left - half_x, left + half_x, optics.x_last)
    y0, y1, in_rows = pixels_within(top - half_y, top + half_y, optics.y_last)
    seen: int = mask_bits((z > NEAR_M) & (reach >= 0.0) & (det > 0.0) & in_columns & in_rows)
    if seen:
        # -log2(e) / 2 times the inverse covariance, 1 / det [[syy, -sxy], [-sxy, sxx]].
        scale = LOG2_E / det
        store_f16(ws.scratch, LANES * RECORD_X, mean_x)
        store_f16(ws.scratch, LANES * RECORD_Y, mean_y)
        store_f16(ws.scratch, LANES * RECORD_A, scale * syy * -0.5)
        store_f16(ws.scratch, LANES * RECORD_B, scale * sxy)
        store_f16(ws.scratch, LANES * RECORD_C, scale * sxx * -0.5)
        store_f16(ws.scratch, LANES * RECORD_OPACITY, load_f16(geometry, g + LANES * LOG2_OPACITY))
        store_f16(ws.scratch, LANES * RECORD_DEPTH, z)
        tile, low, high = box_codes(
            x0 >> BLOCK_BITS, x1 >> BLOCK_BITS, y0 >> BLOCK_BITS, y1 >> BLOCK_BITS, optics.columns
        )
        store_i16(ws.scratch_bits, BITS_TILE, tile)
        store_i16(ws.scratch_bits, BITS_LOW, low)
        store_i16(ws.scratch_bits, BITS_HIGH, high)
        # Bits of positive floats grow with them.
        store_i16(ws.scratch_bits, BITS_DEPTH, bit_pattern(z) - NEAR_BITS)
    return seen


@inline_kernel
def _lead_block(lead: Float32Array, x: Any, y: Any, z: Any, ws: Workspace) -> None:
    """Have a block's Gaussians sorted as if those near the ground were nearer; their depths stay as they are."""
    # The lead falls linearly with the height above the ground, a linear function of camera coordinates.
    nearer = fma(x, lead[0], fma(y, lead[1], fma(z, lead[2], lead[3])))
    nearer = minimum(maximum(nearer, 0.0), lead[LEAD_MAX])
    store_i16(ws.scratch_bits, BITS_DEPTH, bit_pattern(maximum(z - nearer, NEAR_M)) - NEAR_BITS)


@inline_kernel
def _colour_block(cloud: FlatScene, block: int, x: Any, y: Any, z: Any, R_CW: Float64Array, ws: Workspace) -> None:
    """Write the colours of a block to the scratch memory; (x, y, z) are camera coordinates of the means."""
    if cloud.sh_count == 1:
        for channel in range(3):
            constant = load_f16(cloud.colour, block * COLOURS + LANES * channel)
            store_f16(ws.scratch, LANES * (RECORD_RED + channel), constant)
        return
    # The unit direction from the camera to the mean, in the world's axes.
    inverse = 1.0 / sqrt(fma(x, x, fma(y, y, z * z)))
    # From the camera to the world: the transpose of R_CW.
    dx = fma(x, R_CW[0, 0], fma(y, R_CW[1, 0], z * R_CW[2, 0])) * inverse
    dy = fma(x, R_CW[0, 1], fma(y, R_CW[1, 1], z * R_CW[2, 1])) * inverse
    dz = fma(x, R_CW[0, 2], fma(y, R_CW[1, 2], z * R_CW[2, 2])) * inverse
    step = np.float32(cloud.sh_step)
    for channel in range(3):
        value = _sh_channel(cloud, block, channel, dx, dy, dz, step)
        store_f16(ws.scratch, LANES * (RECORD_RED + channel), value)


@inline_kernel
def _sh_channel(cloud: FlatScene, block: int, channel: int, x: Any, y: Any, z: Any, step: float) -> Any:
    """Colour of one channel along unit directions, not negative: max(sum of c_k Y_k(x, y, z) * step + 0.5, 0).

    Coefficient k of the block's Gaussians is row k. With c_m + i s_m = (x + i y)^m, every Y is a polynomial in z times
    c_m or s_m. Source: Kerbl et al., 2023; the basis is that of `readygo.common.gaussians.sh_basis`.
    """
    o = (block * 3 + channel) * cloud.sh_count * LANES
    sh = cloud.sh
    value = load_short(sh, o) * SH_C0
    value = fma(y * -SH_C1, load_short(sh, o + LANES), value)
    value = fma(z * SH_C1, load_short(sh, o + 2 * LANES), value)
    value = fma(x * -SH_C1, load_short(sh, o + 3 * LANES), value)
    if cloud.sh_count >= 9:
        xx, yy, zz = x * x, y * y, z * z
        c1, s1 = xx - yy, x * y * 2.0
        value = fma(s1 * (0.5 * SH_C2), load_short(sh, o + 4 * LANES), value)
        value = fma(y * z * -SH_C2, load_short(sh, o + 5 * LANES), value)
        value = fma(fma(zz, 3.0 * SH_C20, -SH_C20), load_short(sh, o + 6 * LANES), value)
        value = fma(x * z * -SH_C2, load_short(sh, o + 7 * LANES), value)
        value = fma(c1 * (0.5 * SH_C2), load_short(sh, o + 8 * LANES), value)
        if cloud.sh_count >= 16:
            c2, s2 = fms(x, c1, y * s1), fma(x, s1, y * c1)
            t = fma(zz, -5.0 * SH_C31, SH_C31)
            value = fma(s2 * -SH_C3, load_short(sh, o + 9 * LANES), value)
            value = fma(z * s1 * SH_C32, load_short(sh, o + 10 * LANES), value)
            value = fma(t * y, load_short(sh, o + 11 * LANES), value)
            value = fma(z * fma(zz, 5.0 * SH_C30, -3.0 * SH_C30), load_short(sh, o + 12 * LANES), value)
            value = fma(t * x, load_short(sh, o + 13 * LANES), value)
            value = fma(z * c1 * SH_C32, load_short(sh, o + 14 * LANES), value)
            value = fma(c2 * -SH_C3, load_short(sh, o + 15 * LANES), value)
    return maximum(fma(value, step, 0.5), 0.0)


@inline_kernel
def _light_block(lit: Lit, block: int, R: Any, ws: Workspace) -> None:
    """Light the colours of a block in the scratch memory.

    Args:
        lit: The light.
        block: Number of the block.
        R: Rotation from the frame of the normals to the camera, row by row, nine values.
        ws: Workspace.
    """
    o = block * COLOURS
    px, py, pz = load_short(lit.normal, o), load_short(lit.normal, o + LANES), load_short(lit.normal, o + 2 * LANES)
    px, py, pz = px * NORMAL_STEP, py * NORMAL_STEP, pz * NORMAL_STEP
    # (x, y, z): the normal in the camera's frame.
    x = fma(R[0], px, fma(R[1], py, R[2] * pz))
    y = fma(R[3], px, fma(R[4], py, R[5] * pz))
    z = fma(R[6], px, fma(R[7], py, R[8] * pz))
    for channel in range(3):
        # light = T_0 + x (T_1 + x T_4 + y T_7 + z T_8) + y (T_2 + y T_5 + z T_9) + z (T_3 + z T_6).
        t, row = channel * LIGHT_TERMS, LANES * (RECORD_RED + channel)
        along_x = fma(x, lit.terms[t + 4], fma(y, lit.terms[t + 7], fma(z, lit.terms[t + 8], lit.terms[t + 1])))
        along_y = fma(y, lit.terms[t + 5], fma(z, lit.terms[t + 9], lit.terms[t + 2]))
        along_z = fma(z, lit.terms[t + 6], lit.terms[t + 3])
        light = fma(x, along_x, fma(y, along_y, fma(z, along_z, lit.terms[t])))
        light = minimum(maximum(light, LIGHT_MIN), LIGHT_MAX)
        store_f16(ws.scratch, row, load_f16(ws.scratch, row) * sqrt(light))


@inline_kernel
def _emit(seen: int, counts: tuple[int, int, int], slab: Slab, columns: int, ws: Workspace) -> tuple[int, int, int]:
    """Append the visible lanes of the scratch memory to the records, and their keys to this slab's or the later ones.

    Args:
        seen: Visible lanes.
        counts: Numbers of records, of this slab's keys and of later keys.
        slab: Depths that are drawn now.
        columns: Tiles along an image row.
        ws: Workspace.

    Returns:
        The new counts.
    """
    # From one row per number to one row per Gaussian.
    transpose(ws.scratch, 0, LANES, ws.scratch_records, 0, RECORD)
    records, keys, later = counts
    bits = ws.scratch_bits
    while seen:
        # Take the lowest visible lane, and clear its bit.
        lane = lowest_bit(seen)
        seen &= seen - 1
        tile = np.int64(peek(bits, BITS_TILE + lane))
        low, high = np.int64(peek(bits, BITS_LOW + lane)), np.int64(peek(bits, BITS_HIGH + lane))
        blocks = (low & 0xFFFFFFFF) | (high << 32)
        depth_bits = np.int64(peek(bits, BITS_DEPTH + lane))
        store_f16(ws.records, records * RECORD, load_f16(ws.scratch_records, lane * RECORD))
        if tile == LARGE:
            ws.counts[LARGE_ENTRIES] += tiles_met(blocks)
        # Written in any case, counted if true: cheaper than branches that the CPU cannot foresee.
        alive = is_alive(ws, columns, tile, blocks) if slab.cull else 1
        due = alive if depth_bits < slab.limit_bits else 0
        key = (depth_bits << DEPTH_SHIFT) | records
        poke(ws.boxes, BOX * records, tile)
        poke(ws.boxes, BOX * records + 1, blocks)
        poke(ws.keys, keys, key)
        poke(ws.later, later, key)
        records += alive
        keys += due
        later += alive - due
    return records, keys, later


@kernel
def project_scene(view: PinholeView, cloud: FlatScene, chunks: VisibleChunks, slab: Slab, ws: Workspace) -> None:
    """Project the slab's chunks of a static cloud, and append the Gaussians that touch unfinished pixels."""
    optics = optics_of(view)
    counts = (ws.counts[RECORDS], ws.counts[KEYS], ws.counts[LATER])
    R = rotation_rows(view.R_CW)
    for i in range(len(chunks.number)):
        if not is_due(slab, chunks.depth_m[i], chunks.box[i], optics.columns, ws.tile_alive):
            continue
        chunk = chunks.number[i]
        dx = cloud.centre_m[chunk, 0] - view.p_WC[0]
        dy = cloud.centre_m[chunk, 1] - view.p_WC[1]
        dz = cloud.centre_m[chunk, 2] - view.p_WC[2]
        # In float64, so that the coordinates of far places lose nothing.
        tx = view.R_CW[0, 0] * dx + view.R_CW[0, 1] * dy + view.R_CW[0, 2] * dz
        ty = view.R_CW[1, 0] * dx + view.R_CW[1, 1] * dy + view.R_CW[1, 2] * dz
        tz = view.R_CW[2, 0] * dx + view.R_CW[2, 1] * dy + view.R_CW[2, 2] * dz
        # Depths decide the order: the chunk's is added in two parts, high + low = tz, so that float32 loses nothing.
        tz_high = np.float32(tz)
        tz_low = np.float32(tz - np.float64(tz_high))
        for block in range(chunk * BLOCKS, chunk * BLOCKS + BLOCKS):
            g = block * GEOMETRY
            px = load_f16(cloud.geometry, g + LANES * MEAN_X)
            py = load_f16(cloud.geometry, g + LANES * MEAN_Y)
            pz = load_f16(cloud.geometry, g + LANES * MEAN_Z)
            # (x, y, z) = R p + t; most blocks end here or have depths only to look at.
            z = fma(R[6], px, fma(R[7], py, fma(R[8], pz, tz_low))) + tz_high
            if mask_bits(z > NEAR_M) == 0:
                continue
            x = fma(R[0], px, fma(R[1], py, fma(R[2], pz, tx)))
            y = fma(R[3], px, fma(R[4], py, fma(R[5], pz, ty)))
            seen = _image_block(optics, cloud.geometry, g, x, y, z, R, ws)
            if seen:
                _colour_block(cloud, block, x, y, z, view.R_CW, ws)
                normal_block(cloud.normal, block, x, y, z, R, ws)
                counts = _emit(seen, counts, slab, optics.columns, ws)
    ws.counts[RECORDS], ws.counts[KEYS], ws.counts[LATER] = counts


@kernel
def project_human(
    view: PinholeView,
    cloud: FlatScene,
    skin: FlatSkin,
    lit: Lit,
    lead: Float32Array,
    A_CS: Float32Array,
    chunks: VisibleChunks,
    slab: Slab,
    ws: Workspace,
) -> None:
    """Pose the slab's chunks of an avatar straight into the camera's frame, and append what touches unfinished pixels.

    Args:
        view: Camera.
        cloud: Gaussians in canonical coordinates.
        skin: Joints and weights of its blocks.
        lit: The light on it.
        lead: By how much the Gaussians are sorted as nearer, from `lead_terms`, shape (5,).
        A_CS: Transforms of the joints from canonical to camera coordinates, shape (24, 3, 4).
        chunks: Chunks that may be seen.
        slab: Depths that are drawn now.
        ws: Workspace.
    """
    optics = optics_of(view)
    counts = (ws.counts[RECORDS], ws.counts[KEYS], ws.counts[LATER])
    for i in range(len(chunks.number)):
        if not is_due(slab, chunks.depth_m[i], chunks.box[i], optics.columns, ws.tile_alive):
            continue
        for block in range(chunks.number[i] * BLOCKS, chunks.number[i] * BLOCKS + BLOCKS):
            first, end = skin.joint_start[block], skin.joint_start[block + 1]
            if first == end:
                continue
            # Linear blend skinning: M = sum over the block's joints of weight * A_joint, the (3, 4) rows m0 .. m11.
            w, A = load_f16(skin.weight, first * LANES), A_CS[skin.joint[first]]
            m0, m1, m2, m3 = w * A[0, 0], w * A[0, 1], w * A[0, 2], w * A[0, 3]
            m4, m5, m6, m7 = w * A[1, 0], w * A[1, 1], w * A[1, 2], w * A[1, 3]
            m8, m9, m10, m11 = w * A[2, 0], w * A[2, 1], w * A[2, 2], w * A[2, 3]
            for k in range(first + 1, end):
                w, A = load_f16(skin.weight, k * LANES), A_CS[skin.joint[k]]
                m0, m1, m2, m3 = fma(w, A[0, 0], m0), fma(w, A[0, 1], m1), fma(w, A[0, 2], m2), fma(w, A[0, 3], m3)
                m4, m5, m6, m7 = fma(w, A[1, 0], m4), fma(w, A[1, 1], m5), fma(w, A[1, 2], m6), fma(w, A[1, 3], m7)
                m8, m9, m10 = fma(w, A[2, 0], m8), fma(w, A[2, 1], m9), fma(w, A[2, 2], m10)
                m11 = fma(w, A[2, 3], m11)
            g = block * GEOMETRY
            px = load_f16(cloud.geometry, g + LANES * MEAN_X)
            py = load_f16(cloud.geometry, g + LANES * MEAN_Y)
            pz = load_f16(cloud.geometry, g + LANES * MEAN_Z)
            z = fma(m8, px, fma(m9, py, fma(m10, pz, m11)))
            if mask_bits(z > NEAR_M) == 0:
                continue
            x = fma(m0, px, fma(m1, py, fma(m2, pz, m3)))
            y = fma(m4, px, fma(m5, py, fma(m6, pz, m7)))
            M = (m0, m1, m2, m4, m5, m6, m8, m9, m10)
            # One joint carries the block rigidly: its matrix is a rotation already.
            R = M if end - first == 1 else nearest_rotation(M)
            seen = _image_block(optics, cloud.geometry, g, x, y, z, R, ws)
            if seen:
                _colour_block(cloud, block, x, y, z, view.R_CW, ws)
                if lead[LEAD_MAX] > 0.0:
                    _lead_block(lead, x, y, z, ws)
                if lit.terms.size > 0:
                    _light_block(lit, block, R, ws)
                normal_block(cloud.normal, block, x, y, z, R, ws)
                counts = _emit(seen, counts, slab, optics.columns, ws)
    ws.counts[RECORDS], ws.counts[KEYS], ws.counts[LATER] = counts
