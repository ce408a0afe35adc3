# mypy: disable-error-code="no-untyped-def, no-untyped-call"
# Triton's compiler reads the annotations of a kernel: only `tl.constexpr` may stand there.
"""The Triton kernel that projects the Gaussians of visible chunks; humans are posed on the way.

Legend: as in `cull`; N pairs of a camera and an instance of a chunk; slot = 256 * pair + lane of a Gaussian. A program
works on a chunk, one Gaussian per lane. The formulas are those of `cpu.project`, and so are the names: (px, py, pz)
means, (x, y, z) in the camera's frame, u, v tangents, uc, vc clamped, S = (xx, xy, xz, yy, yz, zz) covariance, R0 .. R8
rotation from its frame to the camera's, row by row, a and b rows of J R, p = S a and q = S b,
(sxx, sxy, syy) image covariance, `reach` squared distance in sigmas at which alpha falls to 1/255.

Source: Zwicker et al., EWA volume splatting, 2001; Kerbl et al., 3D Gaussian Splatting, 2023, section 4.
"""

import triton
import triton.language as tl

from readygo.common.rasterizer import constants
from readygo.common.rasterizer.gpu.triton.cull import CLOUD_SIZES, alive_in_box
from readygo.common.rasterizer.packed import scene

RECORD = 12
"""Numbers per record, at the places below, the last two unused: mean [px]; A, B, C of log2(alpha) =
A dx^2 + B dx dy + C dy^2 + log2(opacity), which are -log2(e) / 2 times the entries xx, 2 xy, yy of the inverse image
covariance [1/px2]; log2 opacity; colour; depth [m]."""
RECORD_X, RECORD_Y, RECORD_A, RECORD_B, RECORD_C, RECORD_OPACITY = 0, 1, 2, 3, 4, 5
RECORD_RED, RECORD_GREEN, RECORD_BLUE, RECORD_DEPTH = 6, 7, 8, 9
RECORD_NORMAL = 4
"""Numbers per record of a normal: x, y, z, one that is unused."""
LANE_BITS = 8
"""Bits of a slot below the number of its pair: a pair has 256 lanes."""
UNSEEN = -1
"""Box of a Gaussian that is not drawn."""

_RECORD = tl.constexpr(RECORD)
_UNSEEN = tl.constexpr(UNSEEN)
_NEAR_M = tl.constexpr(constants.NEAR_M)
_FOV_MARGIN = tl.constexpr(constants.FOV_MARGIN)
_DILATION_PX2 = tl.constexpr(constants.DILATION_PX2)
_LIGHT_MIN, _LIGHT_MAX = tl.constexpr(constants.LIGHT_MIN), tl.constexpr(constants.LIGHT_MAX)
_LOG2_E = tl.constexpr(constants.LOG2_E)
_CHUNK = tl.constexpr(1 << LANE_BITS)
_GEOMETRY_ROWS = tl.constexpr(scene.GEOMETRY_ROWS)
_MEAN_X, _MEAN_Y, _MEAN_Z = tl.constexpr(scene.MEAN_X), tl.constexpr(scene.MEAN_Y), tl.constexpr(scene.MEAN_Z)
_COV_XX, _COV_XY, _COV_XZ = tl.constexpr(scene.COV_XX), tl.constexpr(scene.COV_XY), tl.constexpr(scene.COV_XZ)
_COV_YY, _COV_YZ, _COV_ZZ = tl.constexpr(scene.COV_YY), tl.constexpr(scene.COV_YZ), tl.constexpr(scene.COV_ZZ)
_LOG2_OPACITY, _REACH2 = tl.constexpr(scene.LOG2_OPACITY), tl.constexpr(scene.REACH2)
_RECORD_NORMAL = tl.constexpr(RECORD_NORMAL)
_VIEW = tl.constexpr(12)
"""Numbers per camera: R_CW row by row, then p_WC."""
_JOINT = tl.constexpr(12)
"""Numbers per transform of a joint: three rows of four."""
_HUMAN = tl.constexpr(24 * 12)
"""Numbers per human: the transforms of 24 joints."""
_JOINTS_EACH = tl.constexpr(4)
"""Joints that move a Gaussian at most."""
_TERMS = tl.constexpr(10)
"""Terms of the light per channel: 1, x, y, z, xx, yy, zz, xy, xz, yz."""


@triton.jit(do_not_specialize=["capacity", "slab", *CLOUD_SIZES])
def project(
    pairs, pair_total, capacity, humans, transforms, lights, first_chunks, joints, weights, shading,
    views, offsets, geometry, colours, sh, sh_rows, normals, edges, alive_sums,
    records, record_normals, rects, depths, owners,
    slab, scene_chunks, human_chunks, human_count, instance_count, fx, fy, cx, cy, width, height,
    SLABS: tl.constexpr, SH_COUNT: tl.constexpr, NORMALS: tl.constexpr,
    TILE_W: tl.constexpr, TILE_H: tl.constexpr, COLUMNS: tl.constexpr, ROWS: tl.constexpr,
):  # fmt: skip
    """Project the chunks of the listed pairs; any number of programs share them.

    Args:
        pairs: Numbers of the instances, camera * I + instance, shape (capacity,).
        pair_total: Number of pairs, shape (1,).
        capacity: Room for pairs.
        humans: Avatar of each human, -1: this place is empty, shape (B * P,).
        transforms: Transforms of the joints from canonical to camera coordinates, shape (B * P, 24, 12).
        lights: Terms of the light on humans in their camera's frame, shape (B * P, 3, 10).
        first_chunks: First chunk of each avatar, counted from the first one of all avatars, shape (A,).
        joints: Joints that move each Gaussian of the avatars, uint8, shape (C_avatars, 4, 256).
        weights: Skinning weights of these joints, shape (C_avatars, 4, 256).
        shading: Normals of the avatars that light falls on, shape (C_avatars, 3, 256).
        views: R_CW row by row and p_WC of each camera, float32, shape (B, 12).
        offsets: Centres of the scenes' chunks in the camera frame [m], shape (B, I, 3).
        geometry: Mean, covariance, log2 opacity and squared reach of the Gaussians, scenes first, shape (C, 11, 256).
        colours: Colours of degree 0, shape (C, 3, 256).
        sh: Higher coefficients of the chunks that have them, float16, shape (S, SH_COUNT - 1, 3, 256).
        sh_rows: Row in `sh` of each chunk, -1: none, shape (C,).
        normals: Shortest axis of each Gaussian, shape (C, 3, 256).
        edges: Depths at which the slabs begin and end [m], shape (B, SLABS + 1).
        alive_sums: Unfinished tiles above and left of each corner of a tile, shape (B, ROWS + 1, COLUMNS + 1).
        records: Written for Gaussians that are drawn: shape (capacity * 256, RECORD).
        record_normals: Written with NORMALS: axes towards the camera, in its frame, shape (capacity * 256, 4).
        rects: Written: tiles of each Gaussian, packed as boxes are, or UNSEEN, shape (capacity * 256,).
        depths: Written: depth of each Gaussian [m], shape (capacity * 256,).
        owners: Written: number of each pair's human, from 1; 0: the scene, shape (capacity,).
        slab: Number of the slab.
        scene_chunks: Instances before the first human's.
        human_chunks: Instances that each human has room for.
        human_count: Humans per camera, P.
        instance_count: Instances per camera, I.
        fx: Focal length along rows [px].
        fy: Focal length along columns [px].
        cx: Principal point, from the left border [px].
        cy: Principal point, from the upper border [px].
        width: Image width [px].
        height: Image height [px].
        SLABS: Number of slabs.
        SH_COUNT: Coefficients per channel, 1, 4, 9 or 16.
        NORMALS: Write normals.
        TILE_W: Tile width [px].
        TILE_H: Tile height [px].
        COLUMNS: Tiles along an image row.
        ROWS: Tiles along an image column.
    """
    lane = tl.arange(0, _CHUNK)
    total = tl.minimum(tl.load(pair_total), capacity)
    for pair in range(tl.program_id(0), total, tl.num_programs(0)):
        place = tl.load(pairs + pair)
        camera, instance = place // instance_count, place % instance_count
        view = views + camera * _VIEW
        sums = alive_sums + camera * (ROWS + 1) * (COLUMNS + 1)
        edge = edges + camera * (SLABS + 1) + slab
        first_m, limit_m = tl.load(edge), tl.load(edge + 1)
        slot = (lane + pair * _CHUNK).to(tl.int64)
        human = (instance - scene_chunks) // human_chunks
        chunk = instance
        red_gain = tl.full((_CHUNK,), 1.0, tl.float32)
        green_gain, blue_gain = red_gain, red_gain
        if instance < scene_chunks:
            x, y, z, R0, R1, R2, R3, R4, R5, R6, R7, R8 = _scene_means(
                geometry + chunk.to(tl.int64) * (_GEOMETRY_ROWS * _CHUNK) + lane, view, offsets + place.to(tl.int64) * 3
            )
        else:
            wearer = camera * human_count + human
            # The chunk's number among those of all avatars.
            own = tl.load(first_chunks + tl.load(humans + wearer)) + (instance - scene_chunks) % human_chunks
            chunk = scene_chunks + own
            skin = own.to(tl.int64) * (_JOINTS_EACH * _CHUNK) + lane
            x, y, z, R0, R1, R2, R3, R4, R5, R6, R7, R8 = _human_means(
                geometry + chunk.to(tl.int64) * (_GEOMETRY_ROWS * _CHUNK) + lane,
                transforms + wearer.to(tl.int64) * _HUMAN, joints + skin, weights + skin,
            )  # fmt: skip
            # The normal in the camera's frame, which the light falls on.
            n = shading + own.to(tl.int64) * (3 * _CHUNK) + lane
            nx, ny, nz = tl.load(n), tl.load(n + _CHUNK), tl.load(n + 2 * _CHUNK)
            lx, ly, lz = R0 * nx + R1 * ny + R2 * nz, R3 * nx + R4 * ny + R5 * nz, R6 * nx + R7 * ny + R8 * nz
            light = lights + wearer.to(tl.int64) * (3 * _TERMS)
            red_gain = _gain(light, lx, ly, lz)
            green_gain, blue_gain = _gain(light + _TERMS, lx, ly, lz), _gain(light + 2 * _TERMS, lx, ly, lz)
        tl.store(owners + pair, tl.where(instance < scene_chunks, 0, human + 1))
        _splat(
            chunk, lane, slot, geometry + chunk.to(tl.int64) * (_GEOMETRY_ROWS * _CHUNK) + lane,
            view, sums, first_m, limit_m, x, y, z, R0, R1, R2, R3, R4, R5, R6, R7, R8, red_gain, green_gain, blue_gain,
            colours, sh, sh_rows, normals, records, record_normals, rects, depths,
            fx, fy, cx, cy, width, height, SH_COUNT, NORMALS, TILE_W, TILE_H, COLUMNS,
        )  # fmt: skip


@triton.jit
def _scene_means(g, view, offset):
    """Means of a scene's chunk in the camera frame, and R_CW row by row; `offset` points to its centre there."""
    px, py, pz = tl.load(g + _MEAN_X * _CHUNK), tl.load(g + _MEAN_Y * _CHUNK), tl.load(g + _MEAN_Z * _CHUNK)
    none = tl.zeros_like(px)
    R0, R1, R2 = none + tl.load(view), none + tl.load(view + 1), none + tl.load(view + 2)
    R3, R4, R5 = none + tl.load(view + 3), none + tl.load(view + 4), none + tl.load(view + 5)
    R6, R7, R8 = none + tl.load(view + 6), none + tl.load(view + 7), none + tl.load(view + 8)
    # R_CW p + the centre in the camera's frame.
    x = R0 * px + R1 * py + R2 * pz + tl.load(offset)
    y = R3 * px + R4 * py + R5 * pz + tl.load(offset + 1)
    z = R6 * px + R7 * py + R8 * pz + tl.load(offset + 2)
    return x, y, z, R0, R1, R2, R3, R4, R5, R6, R7, R8


@triton.jit
def _human_means(g, A, joints, weights):
    """Means of an avatar's chunk in the camera frame, and the rotations that its Gaussians have taken.

    `A` points to the human's transforms, `joints` and `weights` to the chunk's Gaussians.
    """
    # Linear blend skinning: M = sum over joints of weight * transform.
    m0, m1, m2, m3 = _blend_row(A, joints, weights)
    m4, m5, m6, m7 = _blend_row(A + 4, joints, weights)
    m8, m9, m10, m11 = _blend_row(A + 8, joints, weights)
    px, py, pz = tl.load(g + _MEAN_X * _CHUNK), tl.load(g + _MEAN_Y * _CHUNK), tl.load(g + _MEAN_Z * _CHUNK)
    x = m0 * px + m1 * py + m2 * pz + m3
    y = m4 * px + m5 * py + m6 * pz + m7
    z = m8 * px + m9 * py + m10 * pz + m11
    R0, R1, R2, R3, R4, R5, R6, R7, R8 = nearest_rotation(m0, m1, m2, m4, m5, m6, m8, m9, m10)
    return x, y, z, R0, R1, R2, R3, R4, R5, R6, R7, R8


@triton.jit
def _blend_row(A, joints, weights):
    """One row of the blended transforms; `A` points to that row of joint 0."""
    a0, a1, a2, a3 = 0.0, 0.0, 0.0, 0.0
    for k in tl.static_range(_JOINTS_EACH):
        w = tl.load(weights + k * _CHUNK)
        row = A + tl.load(joints + k * _CHUNK).to(tl.int32) * _JOINT
        a0 += w * tl.load(row)
        a1 += w * tl.load(row + 1)
        a2 += w * tl.load(row + 2)
        a3 += w * tl.load(row + 3)
    return a0, a1, a2, a3


@triton.jit
def nearest_rotation(m0, m1, m2, m3, m4, m5, m6, m7, m8):
    """Rotation nearest to a blend of rotations, row by row: Newton's iteration M <- (M + M^-T) / 2.

    Four steps bring singular values of 0.5, a blend of rotations that are 120 deg apart, to 1 within 1e-7.

    Source: Higham, Computing the polar decomposition - with applications, 1986.
    """
    for _ in tl.static_range(4):
        # Cofactors: M^-T = c / det.
        c0, c1, c2 = m4 * m8 - m5 * m7, m5 * m6 - m3 * m8, m3 * m7 - m4 * m6
        c3, c4, c5 = m2 * m7 - m1 * m8, m0 * m8 - m2 * m6, m1 * m6 - m0 * m7
        c6, c7, c8 = m1 * m5 - m2 * m4, m2 * m3 - m0 * m5, m0 * m4 - m1 * m3
        det = m0 * c0 + m1 * c1 + m2 * c2
        # Padding has no joints, and determinant 0.
        s = 0.5 / tl.where(det == 0.0, 1.0, det)
        m0, m1, m2 = 0.5 * m0 + c0 * s, 0.5 * m1 + c1 * s, 0.5 * m2 + c2 * s
        m3, m4, m5 = 0.5 * m3 + c3 * s, 0.5 * m4 + c4 * s, 0.5 * m5 + c5 * s
        m6, m7, m8 = 0.5 * m6 + c6 * s, 0.5 * m7 + c7 * s, 0.5 * m8 + c8 * s
    return m0, m1, m2, m3, m4, m5, m6, m7, m8


@triton.jit
def _splat(
    chunk, lane, slot, g, view, sums, first_m, limit_m, x, y, z, R0, R1, R2, R3, R4, R5, R6, R7, R8,
    red_gain, green_gain, blue_gain, colours, sh, sh_rows, normals, records, record_normals, rects, depths,
    fx, fy, cx, cy, width, height,
    SH_COUNT: tl.constexpr, NORMALS: tl.constexpr,
    TILE_W: tl.constexpr, TILE_H: tl.constexpr, COLUMNS: tl.constexpr,
):  # fmt: skip
    """Write the records of a chunk whose means are at (x, y, z) in the camera frame.

    R is the rotation from the frame of the covariances to the camera.
    """
    reach = tl.load(g + _REACH2 * _CHUNK)
    seen = (z > _NEAR_M) & (z >= first_m) & (z < limit_m) & (reach >= 0.0)
    inverse_z = 1.0 / tl.where(seen, z, 1.0)
    u, v = x * inverse_z, y * inverse_z
    # Tangents are clamped to `FOV_MARGIN` of the half image beyond its borders.
    margin_u, margin_v = _FOV_MARGIN * 0.5 * width / fx, _FOV_MARGIN * 0.5 * height / fy
    uc = tl.minimum(tl.maximum(u, -cx / fx - margin_u), (width - cx) / fx + margin_u)
    vc = tl.minimum(tl.maximum(v, -cy / fy - margin_v), (height - cy) / fy + margin_v)
    # a = fx / z (R_0 - uc R_2), b = fy / z (R_1 - vc R_2), p = S a, q = S b.
    du, dv = inverse_z * fx, inverse_z * fy
    a0, a1, a2 = du * (R0 - uc * R6), du * (R1 - uc * R7), du * (R2 - uc * R8)
    b0, b1, b2 = dv * (R3 - vc * R6), dv * (R4 - vc * R7), dv * (R5 - vc * R8)
    xx, xy, xz = tl.load(g + _COV_XX * _CHUNK), tl.load(g + _COV_XY * _CHUNK), tl.load(g + _COV_XZ * _CHUNK)
    yy, yz, zz = tl.load(g + _COV_YY * _CHUNK), tl.load(g + _COV_YZ * _CHUNK), tl.load(g + _COV_ZZ * _CHUNK)
    p0, p1, p2 = xx * a0 + xy * a1 + xz * a2, xy * a0 + yy * a1 + yz * a2, xz * a0 + yz * a1 + zz * a2
    q0, q1, q2 = xx * b0 + xy * b1 + xz * b2, xy * b0 + yy * b1 + yz * b2, xz * b0 + yz * b1 + zz * b2
    sxx = p0 * a0 + p1 * a1 + p2 * a2 + _DILATION_PX2
    sxy = p0 * b0 + p1 * b1 + p2 * b2
    syy = q0 * b0 + q1 * b1 + q2 * b2 + _DILATION_PX2
    det = sxx * syy - sxy * sxy
    mean_x, mean_y = u * fx + cx, v * fy + cy
    # Bounding box of the ellipse beyond which alpha is below 1/255; pixel centres are at +0.5.
    reach = tl.maximum(reach, 0.0)
    half_x, half_y = tl.sqrt(reach * sxx), tl.sqrt(reach * syy)
    x0, x1 = tl.maximum(tl.ceil(mean_x - 0.5 - half_x), 0.0), tl.minimum(tl.floor(mean_x - 0.5 + half_x), width - 1.0)
    y0, y1 = tl.maximum(tl.ceil(mean_y - 0.5 - half_y), 0.0), tl.minimum(tl.floor(mean_y - 0.5 + half_y), height - 1.0)
    seen = seen & (det > 0.0) & (x0 <= x1) & (y0 <= y1)
    tx0, tx1 = tl.where(seen, x0, 0.0).to(tl.int32) // TILE_W, tl.where(seen, x1, 0.0).to(tl.int32) // TILE_W
    ty0, ty1 = tl.where(seen, y0, 0.0).to(tl.int32) // TILE_H, tl.where(seen, y1, 0.0).to(tl.int32) // TILE_H
    # Tiles, 8 bits each.
    rect = tx0 | (ty0 << 8) | (tx1 << 16) | (ty1 << 24)
    seen = seen & (alive_in_box(sums, rect, seen, COLUMNS) > 0)
    tl.store(rects + slot, tl.where(seen, rect, _UNSEEN))
    if tl.max(seen.to(tl.int32), axis=0) != 0:
        red, green, blue = _colour(chunk, lane, x, y, z, view, seen, colours, sh, sh_rows, SH_COUNT)
        scale = _LOG2_E / tl.where(seen, det, 1.0)
        opacity = tl.load(g + _LOG2_OPACITY * _CHUNK)
        # Mean x, y, A, B; C, log2 opacity, red, green; blue, depth.
        row = records + slot * _RECORD
        _store_four(row, seen, mean_x, mean_y, scale * syy * -0.5, scale * sxy)
        _store_four(row + 4, seen, scale * sxx * -0.5, opacity, red * red_gain, green * green_gain)
        _store_four(row + 8, seen, blue * blue_gain, z, z, z)
        tl.store(depths + slot, z, mask=seen)
        if NORMALS:
            n = normals + chunk.to(tl.int64) * (3 * _CHUNK) + lane
            nx, ny, nz = tl.load(n), tl.load(n + _CHUNK), tl.load(n + 2 * _CHUNK)
            ax, ay, az = R0 * nx + R1 * ny + R2 * nz, R3 * nx + R4 * ny + R5 * nz, R6 * nx + R7 * ny + R8 * nz
            # Of both directions the one towards the camera.
            sign = tl.where(x * ax + y * ay + z * az > 0.0, -1.0, 1.0)
            _store_four(record_normals + slot * _RECORD_NORMAL, seen, sign * ax, sign * ay, sign * az, sign)


@triton.jit
def _gain(light, x, y, z):
    """What light makes of one channel along unit normals; `light` points to the ten terms T of the channel.

    sqrt(T_0 + x (T_1 + x T_4 + y T_7 + z T_8) + y (T_2 + y T_5 + z T_9) + z (T_3 + z T_6)).
    """
    along_x = tl.load(light + 1) + x * tl.load(light + 4) + y * tl.load(light + 7) + z * tl.load(light + 8)
    along_y = tl.load(light + 2) + y * tl.load(light + 5) + z * tl.load(light + 9)
    along_z = tl.load(light + 3) + z * tl.load(light + 6)
    value = tl.load(light) + x * along_x + y * along_y + z * along_z
    return tl.sqrt(tl.minimum(tl.maximum(value, _LIGHT_MIN), _LIGHT_MAX))


@triton.jit
def _store_four(row, mask, a, b, c, d):
    """Write four numbers of each lane side by side, which becomes one 16-byte store."""
    # join puts its arguments on the last axis: (((a, c), (b, d)) flattens to a, b, c, d.
    four = tl.reshape(tl.join(tl.join(a, c), tl.join(b, d)), [a.shape[0], 4])
    tl.store(row[:, None] + tl.arange(0, 4)[None, :], four, mask=mask[:, None])


@triton.jit
def _colour(chunk, lane, x, y, z, view, seen, colours, sh, sh_rows, SH_COUNT: tl.constexpr):
    """Colours along the rays from the camera, not negative.

    Source: Kerbl et al., 2023; the basis is that of `readygo.common.gaussians.sh_basis`.
    """
    base = colours + chunk.to(tl.int64) * (3 * _CHUNK) + lane
    red, green, blue = tl.load(base), tl.load(base + _CHUNK), tl.load(base + 2 * _CHUNK)
    if SH_COUNT > 1:
        row = tl.load(sh_rows + chunk)
        if row >= 0:
            inverse = 1.0 / tl.sqrt(tl.where(seen, x * x + y * y + z * z, 1.0))
            # From the camera to the world: the transpose of R_CW.
            dx = (x * tl.load(view) + y * tl.load(view + 3) + z * tl.load(view + 6)) * inverse
            dy = (x * tl.load(view + 1) + y * tl.load(view + 4) + z * tl.load(view + 7)) * inverse
            dz = (x * tl.load(view + 2) + y * tl.load(view + 5) + z * tl.load(view + 8)) * inverse
            c = sh + row.to(tl.int64) * ((SH_COUNT - 1) * 3 * _CHUNK) + lane
            red += _harmonics(c, dx, dy, dz, SH_COUNT)
            green += _harmonics(c + _CHUNK, dx, dy, dz, SH_COUNT)
            blue += _harmonics(c + 2 * _CHUNK, dx, dy, dz, SH_COUNT)
    return tl.maximum(red, 0.0), tl.maximum(green, 0.0), tl.maximum(blue, 0.0)


@triton.jit
def _coefficient(c, k: tl.constexpr):
    """Coefficient k of the channel that `c` points to; each has three rows, one per channel."""
    return tl.load(c + (k - 1) * 3 * _CHUNK).to(tl.float32)


@triton.jit
def _harmonics(c, x, y, z, SH_COUNT: tl.constexpr):
    """Harmonics of degree 1 and above along unit directions; `c` points to one channel's coefficient 1.

    With c_m + i s_m = (x + i y)^m, every basis function is a polynomial in z times c_m or s_m. The factors are those of
    `readygo.common.gaussians.spherical_harmonics`.
    """
    value = 0.48860251190292 * (z * _coefficient(c, 2) - y * _coefficient(c, 1) - x * _coefficient(c, 3))
    if SH_COUNT >= 9:
        xx, yy, zz = x * x, y * y, z * z
        c1, s1 = xx - yy, 2.0 * x * y
        value += 0.5462742152960395 * (s1 * _coefficient(c, 4) + c1 * _coefficient(c, 8))
        value -= 1.0925484305920792 * z * (y * _coefficient(c, 5) + x * _coefficient(c, 7))
        value += (0.9461746957575601 * zz - 0.3153915652525201) * _coefficient(c, 6)
        if SH_COUNT >= 16:
            c2, s2 = x * c1 - y * s1, x * s1 + y * c1
            t = 0.4570457994644658 - 2.285228997322329 * zz
            value -= 0.5900435899266435 * (s2 * _coefficient(c, 9) + c2 * _coefficient(c, 15))
            value += 1.445305721320277 * z * (s1 * _coefficient(c, 10) + c1 * _coefficient(c, 14))
            value += t * (y * _coefficient(c, 11) + x * _coefficient(c, 13))
            value += z * (1.865881662950577 * zz - 1.119528997770346) * _coefficient(c, 12)
    return value
