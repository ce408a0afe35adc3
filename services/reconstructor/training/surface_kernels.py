"""The losses of `planes` and `neighbours` with their derivatives, pixel by pixel: torch takes dozens of passes.

Planes are (4, H, W): blended normals N towards the camera in the world's axes, and distances D [m]. A depth of 0 says
that there is none. A camera is 18 numbers: fx, fy, cx, cy, the rows of R_WC, p_WC, 1/fx, 1/fy.

Legend: (u, v) column and row of a pixel; r its ray at depth 1 in the world's axes; the point of a pixel is depth * r
from the camera. A vector named n has the numbers nx, ny, nz. "Slope" is the derivative of a loss L, `by_x` is dL / dx.

Source: Chen et al., PGSR, 2024, sections 4.1 and 4.2; `planes` and `neighbours` are the same formulas in torch.
"""

import math
from typing import Any

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array, Int64Array
from readygo.common.kernels import inline_kernel, kernel_with_cache

CAMERA = 18
_FX, _FY, _CX, _CY, _R, _P, _PER_FX, _PER_FY = 0, 1, 2, 3, 4, 13, 16, 17
"""Places in a camera."""
_NX, _NY, _NZ, _DISTANCE = 0, 1, 2, 3
"""Places in planes and their slopes."""
_EPSILON = 1e-12
_MISSING_MAX = 0.01
"""A depth between pixels counts if those without depth have less weight than this."""
_NO_DEPTH_M = 1e-6
"""Points nearer to a camera's plane than this are moved to it, so that nothing is divided by 0."""
_VARIANCE_MIN = 1e-8
"""Added to the product of two variances of grey values, for patches of one grey."""


@inline_kernel
def _into(camera: Float64Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A direction of the world in a camera: R_WC^T (x, y, z)."""
    return (
        camera[_R] * x + camera[_R + 3] * y + camera[_R + 6] * z,
        camera[_R + 1] * x + camera[_R + 4] * y + camera[_R + 7] * z,
        camera[_R + 2] * x + camera[_R + 5] * y + camera[_R + 8] * z,
    )


@inline_kernel
def _out_of(camera: Float64Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A direction of a camera in the world: R_WC (x, y, z)."""
    return (
        camera[_R] * x + camera[_R + 1] * y + camera[_R + 2] * z,
        camera[_R + 3] * x + camera[_R + 4] * y + camera[_R + 5] * z,
        camera[_R + 6] * x + camera[_R + 7] * y + camera[_R + 8] * z,
    )


@inline_kernel
def _ray(camera: Float64Array, u: float, v: float) -> tuple[float, float, float]:
    """Ray of a point of the image [px], at depth 1, in the world."""
    x, y = (u - camera[_CX]) * camera[_PER_FX], (v - camera[_CY]) * camera[_PER_FY]
    ray: tuple[float, float, float] = _out_of(camera, x, y, 1.0)
    return ray


@kernel_with_cache(error_model="numpy", nogil=True)
def plane_depths(planes: Float32Array, camera: Float64Array, facing_min: float, depth_m: Float32Array) -> None:
    """Depths of the planes along the optical axis [m]: D / -(N . r); see `planes.plane_depth`."""
    height, width = depth_m.shape
    for v in range(height):
        for u in range(width):
            rx, ry, rz = _ray(camera, u + 0.5, v + 0.5)
            facing = -(planes[_NX, v, u] * rx + planes[_NY, v, u] * ry + planes[_NZ, v, u] * rz)
            distance = planes[_DISTANCE, v, u]
            depth_m[v, u] = distance / facing if facing > facing_min and distance > 0.0 else 0.0


@kernel_with_cache(error_model="numpy", nogil=True)
def add_depth_slopes(
    planes: Float32Array, camera: Float64Array, depth_m: Float32Array, by_depth: Float32Array, out: Float32Array
) -> None:
    """Add what derivatives by depths are by the planes.

    With depth = D / f and f = -(N . r): d depth / dD = 1 / f, d depth / dN = D / f^2 r = depth / f r.
    """
    height, width = depth_m.shape
    for v in range(height):
        for u in range(width):
            slope, depth = by_depth[v, u], depth_m[v, u]
            if depth == 0.0 or slope == 0.0:
                continue
            rx, ry, rz = _ray(camera, u + 0.5, v + 0.5)
            facing = -(planes[_NX, v, u] * rx + planes[_NY, v, u] * ry + planes[_NZ, v, u] * rz)
            by_normal = slope * depth / facing
            out[_NX, v, u] += by_normal * rx
            out[_NY, v, u] += by_normal * ry
            out[_NZ, v, u] += by_normal * rz
            out[_DISTANCE, v, u] += slope / facing


@inline_kernel
def _is_known(depth: Any) -> float:
    """A depth [m], 1 where there is none."""
    return depth if depth > 0.0 else 1.0


@inline_kernel
def _add_along(by_depth: Float32Array, depth_m: Float32Array, v: int, u: int, slope: float) -> None:
    """Add a slope to that of a pixel's depth, if the pixel has one."""
    if depth_m[v, u] > 0.0:
        by_depth[v, u] += slope


@kernel_with_cache(error_model="numpy", nogil=True)
def normal_slopes(
    planes: Float32Array,
    alpha: Float32Array,
    weights: Float32Array,
    camera: Float64Array,
    depth_m: Float32Array,
    scale: float,
    by_depth: Float32Array,
    out: Float32Array,
) -> float:
    """`scale` times the sum that `planes.normal_loss` is the mean of.

    Per pixel, with P the points of its neighbours and T its alpha, a constant here:

        a = P(right) - P(left),   b = P(above) - P(below),   c = a x b,   n = c / |c|,
        L = weight * sum of |e| over the axes,   e = T n - N.

    Backwards, with s = dL / de = weight * sign(e):

        dL / dN = -s,   dL / dc = T / |c| (s - n (n . s)) = t,   dL / da = b x t = p,   dL / db = t x a = q,

    as t . (a x b) = a . (b x t) = b . (t x a). P = depth * r makes dL / d depth(right) = p . r(right), and so on.

    Args:
        planes: Shape (4, H, W).
        alpha: Shape (H, W).
        weights: See `planes.edge_weights`.
        camera: Of the view.
        depth_m: See `plane_depths`.
        scale: Of the loss.
        by_depth: Is added to.
        out: Derivatives by the planes, but for those through depths, are added to it.
    """
    height, width = depth_m.shape
    # h and g: how r changes from one column, and from one row, to the next.
    hx, hy, hz = camera[_R] * camera[_PER_FX], camera[_R + 3] * camera[_PER_FX], camera[_R + 6] * camera[_PER_FX]
    gx, gy, gz = camera[_R + 1] * camera[_PER_FY], camera[_R + 4] * camera[_PER_FY], camera[_R + 7] * camera[_PER_FY]
    total = 0.0
    for v in range(1, height - 1):
        for u in range(1, width - 1):
            weight = scale * weights[v, u]
            if depth_m[v, u] == 0.0 or weight == 0.0:
                continue
            rx, ry, rz = _ray(camera, u + 0.5, v + 0.5)
            right, left = _is_known(depth_m[v, u + 1]), _is_known(depth_m[v, u - 1])
            above, below = _is_known(depth_m[v - 1, u]), _is_known(depth_m[v + 1, u])
            # a, b, c, n.
            ax, ay, az = (
                (rx + hx) * right - (rx - hx) * left,
                (ry + hy) * right - (ry - hy) * left,
                (rz + hz) * right - (rz - hz) * left,
            )
            bx, by, bz = (
                (rx - gx) * above - (rx + gx) * below,
                (ry - gy) * above - (ry + gy) * below,
                (rz - gz) * above - (rz + gz) * below,
            )
            cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
            per_length = 1.0 / max(math.sqrt(cx * cx + cy * cy + cz * cz), _EPSILON)
            nx, ny, nz = cx * per_length, cy * per_length, cz * per_length
            here = alpha[v, u]
            # e, the loss, s.
            ex, ey, ez = nx * here - planes[_NX, v, u], ny * here - planes[_NY, v, u], nz * here - planes[_NZ, v, u]
            total += weight * (abs(ex) + abs(ey) + abs(ez))
            sx, sy, sz = weight * np.sign(ex), weight * np.sign(ey), weight * np.sign(ez)
            out[_NX, v, u] -= sx
            out[_NY, v, u] -= sy
            out[_NZ, v, u] -= sz
            # t, the part of s that turns n, and from it p and q, the cross product's derivatives by its factors.
            along = nx * sx + ny * sy + nz * sz
            factor = here * per_length
            tx, ty, tz = factor * (sx - nx * along), factor * (sy - ny * along), factor * (sz - nz * along)
            px, py, pz = by * tz - bz * ty, bz * tx - bx * tz, bx * ty - by * tx
            qx, qy, qz = ty * az - tz * ay, tz * ax - tx * az, tx * ay - ty * ax
            _add_along(by_depth, depth_m, v, u + 1, px * (rx + hx) + py * (ry + hy) + pz * (rz + hz))
            _add_along(by_depth, depth_m, v, u - 1, -(px * (rx - hx) + py * (ry - hy) + pz * (rz - hz)))
            _add_along(by_depth, depth_m, v - 1, u, qx * (rx - gx) + qy * (ry - gy) + qz * (rz - gz))
            _add_along(by_depth, depth_m, v + 1, u, -(qx * (rx + gx) + qy * (ry + gy) + qz * (rz + gz)))
    return total


@inline_kernel
def _between(place: float, size: int) -> tuple[int, int, float, float]:
    """The two numbers of pixels beside a place [px], the share of the second, and how it grows with the place."""
    x = place - 0.5
    if x <= 0.0:
        return 0, 0, 0.0, 0.0
    if x >= size - 1:
        return size - 1, size - 1, 0.0, 0.0
    first = int(x)
    return first, first + 1, x - first, 1.0


@kernel_with_cache(error_model="numpy", nogil=True)
def return_slopes(
    depth_m: Float32Array,
    other_depth_m: Float32Array,
    camera: Float64Array,
    other: Float64Array,
    near_m: float,
    noise_px: float,
    away_px: Float32Array,
    by_depth: Float32Array,
    by_other: Float32Array,
) -> tuple[int, float]:
    """How many pixels count in `neighbours.there_and_back`, and their weighted distances summed up.

    A pixel's point goes to the neighbour, whose depth there says which point it sees, and this one comes back:

        there = s + depth d in the neighbour's camera, s the view's centre, d the ray;  ru, rv = its tangents
        seen = the neighbour's depth there, between its pixels;   q = seen (ru, rv, 1), in the view's camera
        away = |off|, off = pixel of q - pixel,   L = weight * away, weight = exp(-away) counts as a constant.

    Backwards, with slope = weight / (away qz), a = slope fx off_u and b = slope fy off_v:

        dL / dq = (a, b, -(a qx + b qy) / qz), turned to the neighbour's axes: y
        dL / d seen = y . (ru, rv, 1),   dL / d ru = yx seen + dL / d seen * d seen / d ru,   so for rv
        d ru / d depth = (dx - ru dz) / z,   so for rv.

    Args:
        depth_m: Of the view, see `plane_depths`.
        other_depth_m: Of its neighbour.
        camera: Of the view.
        other: Of its neighbour.
        near_m: Nearer points do not count.
        noise_px: Pixels that come back farther away do not count.
        away_px: Gets the distances [px], inf where they do not count.
        by_depth: The sum's derivatives by the view's depths are added to it; weights count as constants.
        by_other: Those by its neighbour's.
    """
    height, width = depth_m.shape
    rows, columns = other_depth_m.shape
    # s: the view's centre in its neighbour's camera; t: the neighbour's centre in the view's.
    ox, oy, oz = camera[_P] - other[_P], camera[_P + 1] - other[_P + 1], camera[_P + 2] - other[_P + 2]
    sx, sy, sz = _into(other, ox, oy, oz)
    tx, ty, tz = _into(camera, -ox, -oy, -oz)
    count, total = 0, 0.0
    for v in range(height):
        for u in range(width):
            away_px[v, u] = np.inf
            depth = depth_m[v, u]
            if depth == 0.0:
                continue
            # The point in the neighbour's camera, its tangents and its place in the neighbour's image.
            rx, ry, rz = _ray(camera, u + 0.5, v + 0.5)
            dx, dy, dz = _into(other, rx, ry, rz)
            x, y, z = sx + dx * depth, sy + dy * depth, sz + dz * depth
            if z <= near_m:
                continue
            per_z = 1.0 / z
            ru, rv = x * per_z, y * per_z
            pu, pv = ru * other[_FX] + other[_CX], rv * other[_FY] + other[_CY]
            if pu < 0.0 or pv < 0.0 or pu > columns or pv > rows:
                continue
            # The neighbour's depth there, between four pixels: columns c0, c1 and rows l0, l1.
            c0, c1, cu, grows_u = _between(pu, columns)
            l0, l1, cv, grows_v = _between(pv, rows)
            e00, e01, e10, e11 = (
                other_depth_m[l0, c0],
                other_depth_m[l0, c1],
                other_depth_m[l1, c0],
                other_depth_m[l1, c1],
            )
            w00, w01, w10, w11 = (1.0 - cv) * (1.0 - cu), (1.0 - cv) * cu, cv * (1.0 - cu), cv * cu
            missing = (
                (w00 if e00 == 0.0 else 0.0)
                + (w01 if e01 == 0.0 else 0.0)
                + (w10 if e10 == 0.0 else 0.0)
                + (w11 if e11 == 0.0 else 0.0)
            )
            if missing >= _MISSING_MAX:
                continue
            f00, f01, f10, f11 = _is_known(e00), _is_known(e01), _is_known(e10), _is_known(e11)
            seen = w00 * f00 + w01 * f01 + w10 * f10 + w11 * f11
            # The point that the neighbour sees there, in the view's camera.
            wx, wy, wz = _out_of(other, ru * seen, rv * seen, seen)
            qx, qy, qz = _into(camera, wx, wy, wz)
            qx, qy, qz = qx + tx, qy + ty, qz + tz
            if qz <= near_m:
                continue
            per_qz = 1.0 / qz
            off_u = qx * per_qz * camera[_FX] + camera[_CX] - (u + 0.5)
            off_v = qy * per_qz * camera[_FY] + camera[_CY] - (v + 0.5)
            away = math.sqrt(off_u * off_u + off_v * off_v + _EPSILON)
            if away >= noise_px:
                continue
            away_px[v, u] = away
            count += 1
            weight = math.exp(-away)
            total += weight * away
            # Backwards.
            slope = weight / away * per_qz
            a, b = slope * off_u * camera[_FX], slope * off_v * camera[_FY]
            wx, wy, wz = _out_of(camera, a, b, -(a * qx + b * qy) * per_qz)
            yx, yy, yz = _into(other, wx, wy, wz)
            by_seen = yx * ru + yy * rv + yz
            if e00 > 0.0:
                by_other[l0, c0] += by_seen * w00
            if e01 > 0.0:
                by_other[l0, c1] += by_seen * w01
            if e10 > 0.0:
                by_other[l1, c0] += by_seen * w10
            if e11 > 0.0:
                by_other[l1, c1] += by_seen * w11
            # d seen / d ru and d seen / d rv.
            slope_u = grows_u * ((1.0 - cv) * (f01 - f00) + cv * (f11 - f10)) * other[_FX]
            slope_v = grows_v * ((1.0 - cu) * (f10 - f00) + cu * (f11 - f01)) * other[_FY]
            by_ru, by_rv = yx * seen + by_seen * slope_u, yy * seen + by_seen * slope_v
            by_depth[v, u] += (by_ru * (dx - ru * dz) + by_rv * (dy - rv * dz)) * per_z
    return count, total


@inline_kernel
def _sample(image: Float32Array, u: float, v: float) -> tuple[float, float, float]:
    """An image between its pixels, and its gradient [1/px]; beyond the border the border's value holds."""
    height, width = image.shape
    c0, c1, cu, grows_u = _between(u, width)
    l0, l1, cv, grows_v = _between(v, height)
    # Bilinear: f00 and f01 in the upper row l0, f10 and f11 in the lower row l1.
    f00, f01, f10, f11 = image[l0, c0], image[l0, c1], image[l1, c0], image[l1, c1]
    upper, lower = f00 + cu * (f01 - f00), f10 + cu * (f11 - f10)
    return (
        upper + cv * (lower - upper),
        grows_u * ((1.0 - cv) * (f01 - f00) + cv * (f11 - f10)),
        grows_v * (lower - upper),
    )


@kernel_with_cache(error_model="numpy", nogil=True)
def patch_slopes(
    planes: Float32Array,
    grey: Float32Array,
    other_grey: Float32Array,
    camera: Float64Array,
    other: Float64Array,
    chosen: Int64Array,
    away_px: Float32Array,
    side_px: int,
    differs_max: float,
    work: Float64Array,
    slopes: Float64Array,
) -> tuple[int, float]:
    """How many patches count in `neighbours.neighbour_losses`, and their weighted 1 - NCC^2 summed up.

    The plane of a pixel, N . (x - camera) = -D, is m . q = -1 in the view's camera with m = R_WC^T N / D. A tap of the
    patch with the ray r = (x, y, 1) there meets it at depth -1 / (m . r), so its point in the neighbour's camera is, up
    to a positive factor, p = R r - t (m . r), with R the rotation and t the view's centre there: a homography.

        b = the neighbour's grey at p,   db / d(m . r) = grow_u fx (ru tz - tx) / pz + grow_v fy (rv tz - ty) / pz
        NCC^2 = C^2 / (V_a V_b),   C = mean of a b, V_a = mean of a^2, V_b = mean of b^2, their means taken off
        d(1 - NCC^2) / db = (-2 C a + 2 C^2 / V_b b) / (V_a V_b n) for n taps
        dL / dm = sum of dL / db * db / d(m . r) * r,   dL / dN = R_WC dL / dm / D,   dL / dD = -(dL / dm . m) / D.

    Args:
        planes: Of the view, shape (4, H, W).
        grey: Its photo, shape (H, W).
        other_grey: That of its neighbour.
        camera: Of the view.
        other: Of its neighbour.
        chosen: Numbers of the pixels in the middle of the patches, row by row, shape (n,).
        away_px: See `return_slopes`; tells the weights.
        side_px: Of the patches, odd.
        differs_max: Patches that differ more do not count.
        work: Memory, shape (3, side_px^2).
        slopes: Gets the sum's derivatives by the planes of the chosen pixels, shape (n, 4).
    """
    height, width = grey.shape
    ox, oy, oz = camera[_P] - other[_P], camera[_P + 1] - other[_P + 1], camera[_P + 2] - other[_P + 2]
    tx, ty, tz = _into(other, ox, oy, oz)
    half, taps = side_px // 2, side_px * side_px
    count, total = 0, 0.0
    for n in range(len(chosen)):
        v, u = chosen[n] // width, chosen[n] % width
        for k in range(4):
            slopes[n, k] = 0.0
        distance = float(planes[_DISTANCE, v, u])
        nx, ny, nz = planes[_NX, v, u] / distance, planes[_NY, v, u] / distance, planes[_NZ, v, u] / distance
        mx, my, mz = _into(camera, nx, ny, nz)
        # Rows of `work`: a, b, and db / d(m . r) of each tap.
        mean_a, mean_b, i = 0.0, 0.0, 0
        for dv in range(-half, half + 1):
            for du in range(-half, half + 1):
                a = grey[min(max(v + dv, 0), height - 1), min(max(u + du, 0), width - 1)]
                x, y = (u + du + 0.5 - camera[_CX]) * camera[_PER_FX], (v + dv + 0.5 - camera[_CY]) * camera[_PER_FY]
                toward = mx * x + my * y + mz
                wx, wy, wz = _out_of(camera, x, y, 1.0)
                px, py, pz = _into(other, wx, wy, wz)
                px, py, pz = px - tx * toward, py - ty * toward, pz - tz * toward
                pz = pz if abs(pz) > _NO_DEPTH_M else _NO_DEPTH_M
                per_pz = 1.0 / pz
                ru, rv = px * per_pz, py * per_pz
                b, grows_u, grows_v = _sample(other_grey, ru * other[_FX] + other[_CX], rv * other[_FY] + other[_CY])
                # How b changes with m . r.
                grows_u, grows_v = grows_u * other[_FX], grows_v * other[_FY]
                work[0, i], work[1, i] = a, b
                work[2, i] = (grows_u * (ru * tz - tx) + grows_v * (rv * tz - ty)) * per_pz
                mean_a += a
                mean_b += b
                i += 1
        mean_a, mean_b = mean_a / taps, mean_b / taps
        # C, V_a and V_b.
        product, square_a, square_b = 0.0, 0.0, 0.0
        for i in range(taps):
            a, b = work[0, i] - mean_a, work[1, i] - mean_b
            work[0, i], work[1, i] = a, b
            product += a * b
            square_a += a * a
            square_b += b * b
        product, square_a, square_b = product / taps, square_a / taps, square_b / taps
        below = square_a * square_b + _VARIANCE_MIN
        differs = 1.0 - product * product / below
        if not differs < differs_max:
            continue
        weight = math.exp(-away_px[v, u])
        count += 1
        total += weight * differs
        # Derivatives by C and by V_b; (bx, by, bz) sums up those by m.
        by_product, by_square = -2.0 * product / below, product * product / (below * below) * square_a
        bx, by, bz, i = 0.0, 0.0, 0.0, 0
        for dv in range(-half, half + 1):
            for du in range(-half, half + 1):
                slope = (by_product * work[0, i] + 2.0 * by_square * work[1, i]) / taps * work[2, i]
                bx += slope * ((u + du + 0.5 - camera[_CX]) * camera[_PER_FX])
                by += slope * ((v + dv + 0.5 - camera[_CY]) * camera[_PER_FY])
                bz += slope
                i += 1
        wx, wy, wz = _out_of(camera, weight * bx / distance, weight * by / distance, weight * bz / distance)
        slopes[n, _NX], slopes[n, _NY], slopes[n, _NZ] = wx, wy, wz
        slopes[n, _DISTANCE] = -weight * (bx * mx + by * my + bz * mz) / distance
    return count, total
