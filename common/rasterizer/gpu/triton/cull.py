# mypy: disable-error-code="no-untyped-def, no-untyped-call"
# Triton's compiler reads the annotations of a kernel: only `tl.constexpr` may stand there.
"""Triton kernels that find the chunks which each camera of a batch sees.

Legend: B cameras, I instances of chunks per camera: the chunks of the scenes, then room for those of P humans; T tiles.
Boxes of means have a middle (x, y, z) and half sizes (rx, ry, rz) along the axes of the camera's frame [m]; half sizes
h in another frame become |R| h, entry by entry. u is a tangent x / z or y / z, its pixel is focal * u + centre.
"""

import triton
import triton.language as tl

from readygo.common.rasterizer import constants

CLOUD_SIZES = ("scene_chunks", "human_chunks", "human_count", "instance_count")
"""Arguments that change with the scene: kernels are not recompiled for numbers that happen to be round."""

_NEAR_M = tl.constexpr(constants.NEAR_M)
_FOV_MARGIN = tl.constexpr(constants.FOV_MARGIN)
_PAD_PX = tl.constexpr(2.0)
"""How far the image-space dilation reaches: sqrt(2 ln(255) * 0.3) = 1.83 px."""
_SLACK = tl.constexpr(1e-5)
"""Added to boxes for the rounding of float32 coordinates, in metres and relative to them."""
_ALL = tl.constexpr(1e30)
"""A bound that everything meets."""
_VIEW = tl.constexpr(12)
"""Numbers per camera: R_CW row by row, then p_WC."""
_CENTRE = tl.constexpr(9)
"""Where p_WC begins."""
_JOINT = tl.constexpr(12)
"""Numbers per transform of a joint: three rows of four."""
_HUMAN = tl.constexpr(24 * 12)
"""Numbers per human: the transforms of 24 joints."""


@triton.jit
def _tile_range(low, high, z_low, z_high, reach, focal, centre, size, TILE_PX: tl.constexpr):
    """First and last tile that footprints may touch along one image axis; first > last: none.

    A Gaussian of radius `reach` at (u, depth z) reaches at most reach * sqrt(1 + u^2) / z from u, where u is clamped
    as in the projection.
    """
    # Tangents of the image's borders, and the clamp of the projection.
    margin = _FOV_MARGIN * 0.5 * size / focal
    u_first, u_last = -(centre + _PAD_PX) / focal, (size - centre + _PAD_PX) / focal
    u_limit = tl.maximum(tl.abs(u_first), tl.abs(u_last)) + margin
    widest = reach * tl.sqrt(1.0 + u_limit * u_limit)
    # Beyond a border at all depths: low - u_last z > widest where u_last z is largest, and so before the first column.
    beyond = (low - tl.where(u_last >= 0.0, u_last * z_high, u_last * z_low)) > widest
    before = (tl.where(u_first >= 0.0, u_first * z_low, u_first * z_high) - high) > widest
    # Bounds of the tangents of the means, widened by the footprint at the nearest depth.
    u_low = low / tl.where(low >= 0.0, z_high, z_low)
    u_high = high / tl.where(high >= 0.0, z_low, z_high)
    u_widest = tl.minimum(tl.maximum(tl.abs(u_low), tl.abs(u_high)), u_limit)
    spread = reach * tl.sqrt(1.0 + u_widest * u_widest) / z_low
    # Clamped as floats: a chunk at the near plane may reach farther than an int can say.
    first = tl.maximum((u_low - spread) * focal + centre - _PAD_PX, 0.0)
    last = tl.minimum((u_high + spread) * focal + centre + _PAD_PX, size - 1.0)
    none = beyond | before | (first > last)
    first, last = tl.minimum(first, size - 1.0), tl.maximum(last, 0.0)
    return tl.where(none, 1, first.to(tl.int32) // TILE_PX), tl.where(none, 0, last.to(tl.int32) // TILE_PX)


@triton.jit
def _store_bounds(
    out, inside, x_low, x_high, y_low, y_high, z_low, z_high, reach, nears, fars, boxes,
    fx, fy, cx, cy, width, height, TILE_W: tl.constexpr, TILE_H: tl.constexpr,
):  # fmt: skip
    """Write what is known of chunks whose means lie in boxes of the camera frame: depths and tiles."""
    front = tl.maximum(z_low, _NEAR_M)
    back = tl.maximum(z_high, front)
    x0, x1 = _tile_range(x_low, x_high, front, back, reach, fx, cx, width, TILE_W)
    y0, y1 = _tile_range(y_low, y_high, front, back, reach, fy, cy, height, TILE_H)
    seen = (z_high > _NEAR_M) & (x0 <= x1) & (y0 <= y1)
    tl.store(nears + out, tl.where(seen, z_low, _ALL), mask=inside)
    tl.store(fars + out, tl.where(seen, z_high, -_ALL), mask=inside)
    tl.store(boxes + out, x0 | (y0 << 8) | (x1 << 16) | (y1 << 24), mask=inside)


@triton.jit(do_not_specialize=["chunk_count", "instance_count"])
def cull_scene(
    views, centres, halves, reaches, offsets, nears, fars, boxes, chunk_count, instance_count,
    fx, fy, cx, cy, width, height, TILE_W: tl.constexpr, TILE_H: tl.constexpr, LANES: tl.constexpr,
):  # fmt: skip
    """Bounds of the scenes' chunks in each camera; programs (B, ceil(C / LANES)).

    Args:
        views: R_CW row by row and p_WC of each camera, float64, shape (B, 12).
        centres: Centres of the chunks [m], float64, shape (C, 3).
        halves: Half sizes of the boxes around their means [m], shape (C, 3).
        reaches: How far their Gaussians reach [m], shape (C,).
        offsets: Written: the centres in the camera frame [m], shape (B, I, 3).
        nears: Written: lower bounds of the means' depths [m], 1e30: not in the image, shape (B, I).
        fars: Written: upper bounds of the means' depths [m], -1e30: not in the image, shape (B, I).
        boxes: Written: first and last tiles x0 | y0 << 8 | x1 << 16 | y1 << 24, shape (B, I).
        chunk_count: Number of the scenes' chunks, C.
        instance_count: Instances per camera, I.
        fx: Focal length along rows [px].
        fy: Focal length along columns [px].
        cx: Principal point, from the left border [px].
        cy: Principal point, from the upper border [px].
        width: Image width [px].
        height: Image height [px].
        TILE_W: Tile width [px].
        TILE_H: Tile height [px].
        LANES: Chunks per program.
    """
    camera = tl.program_id(0)
    chunk = tl.program_id(1) * LANES + tl.arange(0, LANES)
    inside = chunk < chunk_count
    view = views + camera * _VIEW
    # In float64, so that the coordinates of far places lose nothing.
    dx = tl.load(centres + chunk * 3, mask=inside, other=0.0) - tl.load(view + _CENTRE)
    dy = tl.load(centres + chunk * 3 + 1, mask=inside, other=0.0) - tl.load(view + _CENTRE + 1)
    dz = tl.load(centres + chunk * 3 + 2, mask=inside, other=0.0) - tl.load(view + _CENTRE + 2)
    hx = tl.load(halves + chunk * 3, mask=inside, other=0.0)
    hy = tl.load(halves + chunk * 3 + 1, mask=inside, other=0.0)
    hz = tl.load(halves + chunk * 3 + 2, mask=inside, other=0.0)
    out = camera * instance_count + chunk
    x, rx = _scene_axis(view, dx, dy, dz, hx, hy, hz)
    y, ry = _scene_axis(view + 3, dx, dy, dz, hx, hy, hz)
    z, rz = _scene_axis(view + 6, dx, dy, dz, hx, hy, hz)
    place = offsets + out.to(tl.int64) * 3
    tl.store(place, x, mask=inside)
    tl.store(place + 1, y, mask=inside)
    tl.store(place + 2, z, mask=inside)
    reach = tl.load(reaches + chunk, mask=inside, other=0.0)
    _store_bounds(
        out, inside, x - rx, x + rx, y - ry, y + ry, z - rz, z + rz, reach, nears, fars, boxes,
        fx, fy, cx, cy, width, height, TILE_W, TILE_H,
    )  # fmt: skip


@triton.jit
def _scene_axis(row, dx, dy, dz, hx, hy, hz):
    """Middle and half size of boxes along one axis of the camera; `row` points to that row of R_CW."""
    r0, r1, r2 = tl.load(row), tl.load(row + 1), tl.load(row + 2)
    middle = (r0 * dx + r1 * dy + r2 * dz).to(tl.float32)
    half = tl.abs(r0.to(tl.float32)) * hx + tl.abs(r1.to(tl.float32)) * hy + tl.abs(r2.to(tl.float32)) * hz
    return middle, half + _SLACK * (1.0 + tl.abs(middle))


@triton.jit(do_not_specialize=CLOUD_SIZES)
def cull_humans(
    humans, transforms, first_chunks, chunk_counts, box_joints, box_centres, box_halves, reaches, nears, fars, boxes,
    scene_chunks, human_chunks, human_count, instance_count, fx, fy, cx, cy, width, height,
    BOXES: tl.constexpr, TILE_W: tl.constexpr, TILE_H: tl.constexpr, LANES: tl.constexpr,
):  # fmt: skip
    """Bounds of posed humans' chunks in each camera; programs (B * P, ceil(human_chunks / LANES)).

    A posed mean lies in the convex hull of where the chunk's joints would carry it, so within the bounds of the boxes
    that each joint carries along.

    Args:
        humans: Avatar of each human, -1: this place is empty, shape (B * P,).
        transforms: Transforms of the joints from canonical to camera coordinates, shape (B * P, 24, 12).
        first_chunks: First chunk of each avatar, counted from the first one of all avatars, shape (A,).
        chunk_counts: Number of its chunks, shape (A,).
        box_joints: Joint of each box of a chunk, -1: no box, shape (C, BOXES).
        box_centres: Centres of the boxes [m], shape (C, BOXES, 3).
        box_halves: Their half sizes [m], shape (C, BOXES, 3).
        reaches: How far the Gaussians of each chunk reach [m], shape (C,).
        nears: Written: lower bounds of the means' depths [m], 1e30: not in the image, shape (B, I).
        fars: Written: upper bounds of the means' depths [m], -1e30: not in the image, shape (B, I).
        boxes: Written: first and last tiles x0 | y0 << 8 | x1 << 16 | y1 << 24, shape (B, I).
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
        BOXES: Boxes per chunk.
        TILE_W: Tile width [px].
        TILE_H: Tile height [px].
        LANES: Chunks per program.
    """
    human = tl.program_id(0)
    local = tl.program_id(1) * LANES + tl.arange(0, LANES)
    avatar = tl.load(humans + human)
    known = tl.maximum(avatar, 0)
    used = local < tl.where(avatar >= 0, tl.load(chunk_counts + known), 0)
    chunk = tl.load(first_chunks + known) + local
    low = tl.full([LANES], _ALL, tl.float32)
    x_low, y_low, z_low, x_high, y_high, z_high = low, low, low, -low, -low, -low
    for k in range(BOXES):
        box = chunk * BOXES + k
        joint = tl.load(box_joints + box, mask=used, other=-1)
        valid = joint >= 0
        A = transforms + human.to(tl.int64) * _HUMAN + tl.maximum(joint, 0) * _JOINT
        px = tl.load(box_centres + box * 3, mask=valid, other=0.0)
        py = tl.load(box_centres + box * 3 + 1, mask=valid, other=0.0)
        pz = tl.load(box_centres + box * 3 + 2, mask=valid, other=0.0)
        hx = tl.load(box_halves + box * 3, mask=valid, other=0.0)
        hy = tl.load(box_halves + box * 3 + 1, mask=valid, other=0.0)
        hz = tl.load(box_halves + box * 3 + 2, mask=valid, other=0.0)
        x, rx = _human_axis(A, valid, px, py, pz, hx, hy, hz)
        y, ry = _human_axis(A + 4, valid, px, py, pz, hx, hy, hz)
        z, rz = _human_axis(A + 8, valid, px, py, pz, hx, hy, hz)
        x_low, x_high = _widen_bounds(x_low, x_high, x, rx, valid)
        y_low, y_high = _widen_bounds(y_low, y_high, y, ry, valid)
        z_low, z_high = _widen_bounds(z_low, z_high, z, rz, valid)
    reach = tl.load(reaches + chunk, mask=used, other=0.0)
    camera, slot = human // human_count, human % human_count
    out = camera * instance_count + scene_chunks + slot * human_chunks + local
    _store_bounds(
        out, local < human_chunks, x_low, x_high, y_low, y_high, z_low, z_high, reach, nears, fars, boxes,
        fx, fy, cx, cy, width, height, TILE_W, TILE_H,
    )  # fmt: skip


@triton.jit
def _widen_bounds(low, high, middle, half, valid):
    """Bounds that take in valid boxes as well."""
    return (
        tl.minimum(low, tl.where(valid, middle - half, _ALL)),
        tl.maximum(high, tl.where(valid, middle + half, -_ALL)),
    )


@triton.jit
def _human_axis(row, valid, px, py, pz, hx, hy, hz):
    """Middle and half size of boxes along one axis of the camera; `row` points to that row of their transforms."""
    a0, a1 = tl.load(row, mask=valid, other=0.0), tl.load(row + 1, mask=valid, other=0.0)
    a2, a3 = tl.load(row + 2, mask=valid, other=0.0), tl.load(row + 3, mask=valid, other=0.0)
    middle = a0 * px + a1 * py + a2 * pz + a3
    half = tl.abs(a0) * hx + tl.abs(a1) * hy + tl.abs(a2) * hz
    return middle, half + _SLACK * (1.0 + tl.abs(middle))


@triton.jit(do_not_specialize=["slab", "instance_count"])
def select_chunks(
    nears, fars, boxes, edges, alive_sums, flags, slab, instance_count,
    SLABS: tl.constexpr, COLUMNS: tl.constexpr, ROWS: tl.constexpr, LANES: tl.constexpr,
):  # fmt: skip
    """Flag the instances that may put Gaussians of a slab on unfinished tiles; programs (B, ceil(I / LANES)).

    Args:
        nears: Lower bounds of the means' depths [m], 1e30: not in the image, shape (B, I).
        fars: Upper bounds of the means' depths [m], -1e30: not in the image, shape (B, I).
        boxes: First and last tiles x0 | y0 << 8 | x1 << 16 | y1 << 24, shape (B, I).
        edges: Depths at which the slabs begin and end [m], shape (B, SLABS + 1).
        alive_sums: Unfinished tiles above and left of each corner of a tile, shape (B, ROWS + 1, COLUMNS + 1).
        flags: Written: 0 or 1, int32, shape (B, I).
        slab: Number of the slab.
        instance_count: Instances per camera, I.
        SLABS: Number of slabs.
        COLUMNS: Tiles along an image row.
        ROWS: Tiles along an image column.
        LANES: Instances per program.
    """
    camera = tl.program_id(0)
    instance = tl.program_id(1) * LANES + tl.arange(0, LANES)
    inside = instance < instance_count
    place = camera * instance_count + instance
    near = tl.load(nears + place, mask=inside, other=_ALL)
    far = tl.load(fars + place, mask=inside, other=-_ALL)
    edge = edges + camera * (SLABS + 1) + slab
    due = (near < tl.load(edge + 1)) & (far >= tl.load(edge)) & (near <= far)
    box = tl.load(boxes + place, mask=due, other=0)
    sums = alive_sums + camera * (ROWS + 1) * (COLUMNS + 1)
    alive = alive_in_box(sums, box, due, COLUMNS)
    tl.store(flags + place, (due & (alive > 0)).to(tl.int32), mask=inside)


@triton.jit
def alive_in_box(sums, box, mask, COLUMNS: tl.constexpr):
    """Number of unfinished tiles in packed boxes of tiles; `sums` points to the camera's corner sums."""
    x0, y0 = box & 0xFF, (box >> 8) & 0xFF
    x1, y1 = ((box >> 16) & 0xFF) + 1, ((box >> 24) & 0xFF) + 1
    # Sums over a rectangle from those above and left of its four corners (summed area table).
    stride: tl.constexpr = COLUMNS + 1
    inner = tl.load(sums + y1 * stride + x1, mask=mask, other=0) - tl.load(sums + y0 * stride + x1, mask=mask, other=0)
    return (
        inner
        - tl.load(sums + y1 * stride + x0, mask=mask, other=0)
        + tl.load(sums + y0 * stride + x0, mask=mask, other=0)
    )


@triton.jit(do_not_specialize=["total_count", "capacity"])
def list_pairs(flags, ends, pairs, total_count, capacity, LANES: tl.constexpr):
    """List the flagged instances of all cameras in order; programs (ceil(B I / LANES),).

    Args:
        flags: Flags of `select_chunks`, shape (B * I,).
        ends: Their running sum, shape (B * I,).
        pairs: Written: numbers of the flagged instances, shape (capacity,).
        total_count: Instances of all cameras, B * I.
        capacity: Length of `pairs`; what exceeds it is left out.
        LANES: Instances per program.
    """
    place = tl.program_id(0) * LANES + tl.arange(0, LANES)
    flag = tl.load(flags + place, mask=place < total_count, other=0) != 0
    target = tl.load(ends + place, mask=flag, other=0) - 1
    tl.store(pairs + target, place, mask=flag & (target < capacity))
