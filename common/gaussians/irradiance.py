"""Light that falls on a surface, as a function of its normal: spherical harmonics of order 2.

Light is the square of a display value: within a few percent of sRGB's curve where it matters here, and exact to compute
on every CPU. All sums are scalar and in a fixed order.

Source: Ramamoorthi & Hanrahan, An efficient representation for irradiance environment maps, 2001.
"""

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array
from readygo.common.kernels import kernel_with_cache

HARMONICS = 9
"""Real spherical harmonics up to order 2, in the order (l, m) = (0, 0), (1, -1), .. (2, 2)."""
_Y0, _Y1, _Y2, _Y20, _Y22 = 0.282095, 0.488603, 1.092548, 0.315392, 0.546274
_COSINE_LOBE = (1.0, 2.0 / 3.0, 0.25)
"""Share of radiance of order l that is left in irradiance / pi: A_l / pi of the paper's equation 8."""


@kernel_with_cache
def add_radiance(radiance: Float64Array, direction: Float64Array, solid_angle: Float64Array, sh: Float64Array) -> None:
    """Project radiance to spherical harmonics and add it to `sh`, shape (9, 3).

    Args:
        radiance: Shape (N, 3).
        direction: Where it comes from, unit vectors, shape (N, 3).
        solid_angle: Steradians that each stands for, shape (N,).
        sh: Coefficients, shape (9, 3).
    """
    basis = np.empty(9)
    for n in range(len(radiance)):
        x, y, z = direction[n, 0], direction[n, 1], direction[n, 2]
        basis[0] = _Y0
        basis[1], basis[2], basis[3] = _Y1 * y, _Y1 * z, _Y1 * x
        basis[4], basis[5], basis[7] = _Y2 * x * y, _Y2 * y * z, _Y2 * x * z
        basis[6], basis[8] = _Y20 * (3.0 * z * z - 1.0), _Y22 * (x * x - y * y)
        for k in range(9):
            for channel in range(3):
                sh[k, channel] += basis[k] * solid_angle[n] * radiance[n, channel]


def irradiance_matrix(sh: Float64Array) -> Float64Array:
    """Irradiance / pi as a quadratic form per channel: E(n) / pi = [n, 1] M [n, 1]^T; the paper's equation 12.

    A place in a furnace of radiance 1 has the value 1 for every normal.

    Args:
        sh: Radiance, shape (9, 3).

    Returns:
        Symmetric matrices, shape (3, 4, 4).
    """
    M = np.empty((3, 4, 4))
    _fill_matrix(sh, M)
    return M


@kernel_with_cache
def _fill_matrix(sh: Float64Array, M: Float64Array) -> None:
    a0, a1, a2 = _COSINE_LOBE
    for c in range(3):
        M[c, 0, 0], M[c, 1, 1] = a2 * _Y22 * sh[8, c], -a2 * _Y22 * sh[8, c]
        M[c, 2, 2] = 3.0 * a2 * _Y20 * sh[6, c]
        M[c, 3, 3] = a0 * _Y0 * sh[0, c] - a2 * _Y20 * sh[6, c]
        for i, j, k in ((0, 1, 4), (1, 2, 5), (0, 2, 7)):
            M[c, i, j] = M[c, j, i] = 0.5 * a2 * _Y2 * sh[k, c]
        for i, k in ((1, 1), (2, 2), (0, 3)):
            M[c, i, 3] = M[c, 3, i] = 0.5 * a1 * _Y1 * sh[k, c]


def irradiance(M: Float64Array, normals: Float64Array) -> Float64Array:
    """Irradiance / pi of unit normals, (3, 4, 4) and (N, 3) -> (N, 3); see `irradiance_matrix`."""
    n = np.concatenate([normals, np.ones((len(normals), 1))], axis=1)
    values: Float64Array = np.einsum("ni,cij,nj->nc", n, M, n)
    return values


@kernel_with_cache
def rotate_forms(M: Float64Array, R: Float64Array, out: Float32Array) -> None:
    """Write the ten terms 1, x, y, z, xx, yy, zz, xy, xz, yz of quadratic forms in a frame turned by `R`.

    Args:
        M: Quadratic forms of the light, one per colour, from `irradiance_matrix`, shape (3, 4, 4).
        R: Maps normals to the other frame, shape (3, 3).
        out: Filled with the terms, shape (3, 10).
    """
    Q, T = np.empty((3, 3)), np.empty((3, 3))
    for c in range(3):
        for i in range(3):
            for j in range(3):
                T[i, j] = R[i, 0] * M[c, 0, j] + R[i, 1] * M[c, 1, j] + R[i, 2] * M[c, 2, j]
        for i in range(3):
            for j in range(3):
                Q[i, j] = T[i, 0] * R[j, 0] + T[i, 1] * R[j, 1] + T[i, 2] * R[j, 2]
            out[c, 1 + i] = 2.0 * (R[i, 0] * M[c, 0, 3] + R[i, 1] * M[c, 1, 3] + R[i, 2] * M[c, 2, 3])
            out[c, 4 + i] = Q[i, i]
        out[c, 0] = M[c, 3, 3]
        out[c, 7], out[c, 8], out[c, 9] = 2.0 * Q[0, 1], 2.0 * Q[0, 2], 2.0 * Q[1, 2]
