"""Colours of spherical harmonics, and what their derivatives are.

The basis is that of `readygo.common.gaussians.sh_basis`, as polynomials that equal it on the unit sphere; derivatives
are projected to the sphere's tangent plane, where the polynomials' values off the sphere do not matter.

Legend: (x, y, z) unit direction from the camera, c_m + i s_m = (x + i y)^m, colour = max(sum of c_k Y_k + 0.5, 0). Row
3 k + channel of `coefficients` is coefficient k of a channel, one lane per Gaussian; `rows` is its transpose.

Source: Kerbl et al., 3D Gaussian Splatting for Real-Time Radiance Field Rendering, 2023.
"""

from typing import Any

from readygo.common.gaussians.spherical_harmonics import SH_C0, SH_C1, SH_C2, SH_C3, SH_C20, SH_C30, SH_C31, SH_C32
from readygo.common.kernels import inline_kernel
from readygo.common.rasterizer.cpu.workspace import RECORD_RED, Workspace
from readygo.common.simd.memory import load_f16, store_f16, store_i16, transpose
from readygo.common.simd.types import LANES, f16, float_bits, fma, fms, i16, integer_where, lowest_bit, maximum, sqrt
from readygo.services.reconstructor.differentiable.memory import (
    COEFFICIENTS_MAX,
    COLOURED,
    DERIVATIVES,
    GROUP,
    NUMBER,
    Cloud,
    ForwardMemory,
    Gradients,
)
from readygo.services.reconstructor.differentiable.simd_rows import load_first, store_first, stream_f16


@inline_kernel
def _coefficient(kept: ForwardMemory, k: int, channel: int) -> Any:
    return load_f16(kept.coefficients, (3 * k + channel) * LANES)


@inline_kernel
def _load_coefficients(cloud: Cloud, group: int, drawn: int, kept: ForwardMemory) -> None:
    """Coefficients of the Gaussians of a group that are drawn, one row of 16 lanes each."""
    count = 3 * cloud.sh_count
    while drawn:
        lane = lowest_bit(drawn)
        drawn &= drawn - 1
        start = float_bits(kept.groups[group * GROUP + LANES * NUMBER + lane]) * cloud.sh_stride
        for j in range(0, count, LANES):
            whole = count - j >= LANES
            value = load_f16(cloud.sh, start + j) if whole else load_first(cloud.sh, start + j, count - j)
            store_f16(kept.rows, COEFFICIENTS_MAX * lane + j, value)
    for j in range(0, count, LANES):
        transpose(kept.rows, j, COEFFICIENTS_MAX, kept.coefficients, LANES * j, LANES)


@inline_kernel
def colour_group(cloud: Cloud, group: int, drawn: int, keep: bool, kept: ForwardMemory, ws: Workspace) -> None:
    """Write the colours of a group to the scratch memory, and their derivatives to the group if asked."""
    if cloud.sh_count == 0:
        for channel in range(3):
            store_f16(ws.scratch, LANES * (RECORD_RED + channel), f16(0.0))
        return
    _load_coefficients(cloud, group, drawn, kept)
    place = group * GROUP
    # The group begins with the offset from the camera.
    dx, dy = load_f16(kept.groups, place), load_f16(kept.groups, place + LANES)
    dz = load_f16(kept.groups, place + 2 * LANES)
    inverse = 1.0 / sqrt(fma(dx, dx, fma(dy, dy, dz * dz)))
    x, y, z = dx * inverse, dy * inverse, dz * inverse
    coloured = i16(0)
    for channel in range(3):
        value = _value(kept, channel, cloud.sh_count, x, y, z)
        store_f16(ws.scratch, LANES * (RECORD_RED + channel), value)
        coloured = coloured | integer_where(value > 0.0, 1 << channel, 0)
    if keep:
        store_i16(kept.groups, place + LANES * COLOURED, coloured)
        if cloud.sh_count > 1:
            for channel in range(3):
                target = place + LANES * (DERIVATIVES + 3 * channel)
                _write_derivative(kept, channel, cloud.sh_count, x, y, z, inverse, target)


@inline_kernel
def _value(kept: ForwardMemory, channel: int, count: int, x: Any, y: Any, z: Any) -> Any:
    """Colour of one channel along unit directions, not negative."""
    value = fma(_coefficient(kept, 0, channel), SH_C0, 0.5)
    if count >= 4:
        value = fma(y * -SH_C1, _coefficient(kept, 1, channel), value)
        value = fma(z * SH_C1, _coefficient(kept, 2, channel), value)
        value = fma(x * -SH_C1, _coefficient(kept, 3, channel), value)
    if count >= 9:
        zz = z * z
        c1, s1 = fms(x, x, y * y), x * y * 2.0
        value = fma(s1 * (0.5 * SH_C2), _coefficient(kept, 4, channel), value)
        value = fma(y * z * -SH_C2, _coefficient(kept, 5, channel), value)
        value = fma(fma(zz, 3.0 * SH_C20, -SH_C20), _coefficient(kept, 6, channel), value)
        value = fma(x * z * -SH_C2, _coefficient(kept, 7, channel), value)
        value = fma(c1 * (0.5 * SH_C2), _coefficient(kept, 8, channel), value)
        if count >= 16:
            c2, s2 = fms(x, c1, y * s1), fma(x, s1, y * c1)
            t = fma(zz, -5.0 * SH_C31, SH_C31)
            value = fma(s2 * -SH_C3, _coefficient(kept, 9, channel), value)
            value = fma(z * s1 * SH_C32, _coefficient(kept, 10, channel), value)
            value = fma(t * y, _coefficient(kept, 11, channel), value)
            value = fma(z * fma(zz, 5.0 * SH_C30, -3.0 * SH_C30), _coefficient(kept, 12, channel), value)
            value = fma(t * x, _coefficient(kept, 13, channel), value)
            value = fma(z * c1 * SH_C32, _coefficient(kept, 14, channel), value)
            value = fma(c2 * -SH_C3, _coefficient(kept, 15, channel), value)
    return maximum(value, 0.0)


@inline_kernel
def _write_derivative(
    kept: ForwardMemory, channel: int, count: int, x: Any, y: Any, z: Any, inverse: Any, place: int
) -> None:
    """Derivatives of one channel by the offset from the camera, whose inverse length is `inverse`, to `place`.

    j is the gradient of the polynomial sum of c_k Y_k at the unit direction n = (x, y, z). As n = offset / |offset|,
    the derivatives by the offset are (j - (j . n) n) / |offset|.
    """
    jx = _coefficient(kept, 3, channel) * -SH_C1
    jy = _coefficient(kept, 1, channel) * -SH_C1
    jz = _coefficient(kept, 2, channel) * SH_C1
    if count >= 9:
        k4, k5, k6 = _coefficient(kept, 4, channel), _coefficient(kept, 5, channel), _coefficient(kept, 6, channel)
        k7, k8 = _coefficient(kept, 7, channel), _coefficient(kept, 8, channel)
        jx = fma(fma(k4, y, fms(k8, x, k7 * z)), SH_C2, jx)
        jy = fma(fms(k4, x, fma(k5, z, k8 * y)), SH_C2, jy)
        jz = fma(fma(k5, y, k7 * x), -SH_C2, fma(k6 * z, 6.0 * SH_C20, jz))
        if count >= 16:
            c1, s1, zz = fms(x, x, y * y), x * y * 2.0, z * z
            t = fma(zz, -5.0 * SH_C31, SH_C31)
            k9, k10, k11 = (
                _coefficient(kept, 9, channel), _coefficient(kept, 10, channel), _coefficient(kept, 11, channel)
            )  # fmt: skip
            k12, k13 = _coefficient(kept, 12, channel), _coefficient(kept, 13, channel)
            k14, k15 = _coefficient(kept, 14, channel), _coefficient(kept, 15, channel)
            # The inner derivatives of z s1 and z c1 by x and y carry a factor of 2.
            jx = fma(fma(k9, s1, k15 * c1), -3.0 * SH_C3, fma(fma(k10, y, k14 * x) * z, 2.0 * SH_C32, fma(k13, t, jx)))
            jy = fma(fms(k9, c1, k15 * s1), -3.0 * SH_C3, fma(fms(k10, x, k14 * y) * z, 2.0 * SH_C32, fma(k11, t, jy)))
            jz = fma(fma(k10, s1, k14 * c1), SH_C32, fma(fma(k11, y, k13 * x) * z, -10.0 * SH_C31, jz))
            jz = fma(k12, fma(zz, 15.0 * SH_C30, -3.0 * SH_C30), jz)
    along = fma(jx, x, fma(jy, y, jz * z))
    store_f16(kept.groups, place, (jx - along * x) * inverse)
    store_f16(kept.groups, place + LANES, (jy - along * y) * inverse)
    store_f16(kept.groups, place + 2 * LANES, (jz - along * z) * inverse)


@inline_kernel
def _put(kept: ForwardMemory, k: int, basis: Any, g: Any) -> None:
    """Derivatives by coefficient k of the three channels: Y_k times those by the colour."""
    store_f16(kept.coefficients, 3 * LANES * k, basis * g[0])
    store_f16(kept.coefficients, 3 * LANES * k + LANES, basis * g[1])
    store_f16(kept.coefficients, 3 * LANES * k + 2 * LANES, basis * g[2])


@inline_kernel
def write_coefficient_gradients(
    cloud: Cloud, group: int, d: Any, g: Any, row: int, weighty: int, dense: bool, kept: ForwardMemory, out: Gradients
) -> None:
    """Derivatives by the coefficients of some lanes of a group.

    Args:
        cloud: Parameters.
        group: Number of the group.
        d: Unit directions from the camera.
        g: Derivatives by red, green and blue.
        row: Row of the first lane.
        weighty: Lanes (bits).
        dense: Write to the rows of all Gaussians instead.
        kept: What the projection kept.
        out: Where to write.
    """
    x, y, z = d[0], d[1], d[2]
    _put(kept, 0, f16(SH_C0), g)
    if cloud.sh_count >= 4:
        _put(kept, 1, y * -SH_C1, g)
        _put(kept, 2, z * SH_C1, g)
        _put(kept, 3, x * -SH_C1, g)
    if cloud.sh_count >= 9:
        zz = z * z
        c1, s1 = fms(x, x, y * y), x * y * 2.0
        _put(kept, 4, s1 * (0.5 * SH_C2), g)
        _put(kept, 5, y * z * -SH_C2, g)
        _put(kept, 6, fma(zz, 3.0 * SH_C20, -SH_C20), g)
        _put(kept, 7, x * z * -SH_C2, g)
        _put(kept, 8, c1 * (0.5 * SH_C2), g)
        if cloud.sh_count >= 16:
            c2, s2 = fms(x, c1, y * s1), fma(x, s1, y * c1)
            t = fma(zz, -5.0 * SH_C31, SH_C31)
            _put(kept, 9, s2 * -SH_C3, g)
            _put(kept, 10, z * s1 * SH_C32, g)
            _put(kept, 11, t * y, g)
            _put(kept, 12, z * fma(zz, 5.0 * SH_C30, -3.0 * SH_C30), g)
            _put(kept, 13, t * x, g)
            _put(kept, 14, z * c1 * SH_C32, g)
            _put(kept, 15, c2 * -SH_C3, g)
    count = 3 * cloud.sh_count
    for j in range(0, count, LANES):
        transpose(kept.coefficients, LANES * j, LANES, kept.rows, j, COEFFICIENTS_MAX)
    while weighty:
        lane = lowest_bit(weighty)
        weighty &= weighty - 1
        number = float_bits(kept.groups[group * GROUP + LANES * NUMBER + lane])
        start = (number if dense else row) * cloud.sh_stride
        row += 1
        for j in range(0, count, LANES):
            value = load_f16(kept.rows, COEFFICIENTS_MAX * lane + j)
            # Rows of 48 begin on a cache line.
            if cloud.sh_stride == COEFFICIENTS_MAX and count - j >= LANES:
                stream_f16(out.sh, start + j, value)
            else:
                store_first(out.sh, start + j, count - j, value)
