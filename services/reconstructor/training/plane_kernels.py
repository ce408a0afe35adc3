"""`planes.plane_features` and its derivatives, Gaussian by Gaussian.

Legend: n shortest axis, column k of the rotation R(q) of the unit quaternion q = (w, x, y, z); o = camera - mean [m];
sign = -1 if n looks away from the camera, else 1. The features are sign n and sign (n . o). With a loss L:

    dL / d mean = -sign L_d n,   dL / dn = sign (L_n + L_d o),   L_n and L_d being those by the features.
"""

import math

from readygo.common.arrays import Float32Array, Float64Array, Int64Array
from readygo.common.kernels import inline_kernel, kernel_with_cache


@inline_kernel
def _shortest(scales_m: Float32Array, n: int) -> int:
    """Number of a Gaussian's shortest axis, the first one of equals."""
    first = 1 if scales_m[n, 1] < scales_m[n, 0] else 0
    return 2 if scales_m[n, 2] < scales_m[n, first] else first


@inline_kernel
def _axis(k: int, w: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Column of the rotation matrix of a unit quaternion."""
    if k == 0:
        return 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)
    if k == 1:
        return 2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)
    return 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)


@inline_kernel
def _axis_slopes(
    k: int, w: float, x: float, y: float, z: float, a: float, b: float, c: float
) -> tuple[float, float, float, float]:
    """Derivatives by the quaternion of a loss whose derivatives by the column of `_axis` are (a, b, c)."""
    if k == 0:
        return (
            2.0 * (z * b - y * c),
            2.0 * (y * b + z * c),
            2.0 * (x * b - 2.0 * y * a - w * c),
            2.0 * (w * b - 2.0 * z * a + x * c),
        )
    if k == 1:
        return (
            2.0 * (x * c - z * a),
            2.0 * (y * a - 2.0 * x * b + w * c),
            2.0 * (x * a + z * c),
            2.0 * (y * c - w * a - 2.0 * z * b),
        )
    return (
        2.0 * (y * a - x * b),
        2.0 * (z * a - w * b - 2.0 * x * c),
        2.0 * (w * a + z * b - 2.0 * y * c),
        2.0 * (x * a + y * b),
    )


@inline_kernel
def _unit(quats_wxyz: Float32Array, n: int) -> tuple[float, float, float, float, float]:
    """A quaternion of length one, and one over its length."""
    w, x, y, z = float(quats_wxyz[n, 0]), float(quats_wxyz[n, 1]), float(quats_wxyz[n, 2]), float(quats_wxyz[n, 3])
    per_length = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    return w * per_length, x * per_length, y * per_length, z * per_length, per_length


@kernel_with_cache(error_model="numpy", nogil=True)
def write_features(
    means_m: Float32Array, quats_wxyz: Float32Array, scales_m: Float32Array, camera_m: Float64Array, out: Float32Array
) -> None:
    """Normals towards the camera, and distances of the planes from it.

    Args:
        means_m: Shape (N, 3).
        quats_wxyz: Of any length, shape (N, 4).
        scales_m: Shape (N, 3).
        camera_m: Centre of the camera, shape (3,).
        out: Shape (N, 4).
    """
    for n in range(len(means_m)):
        w, x, y, z, _ = _unit(quats_wxyz, n)
        nx, ny, nz = _axis(_shortest(scales_m, n), w, x, y, z)
        distance = (
            nx * (camera_m[0] - means_m[n, 0]) + ny * (camera_m[1] - means_m[n, 1]) + nz * (camera_m[2] - means_m[n, 2])
        )
        sign = -1.0 if distance < 0.0 else 1.0
        out[n, 0], out[n, 1], out[n, 2], out[n, 3] = sign * nx, sign * ny, sign * nz, sign * distance


@kernel_with_cache(error_model="numpy", nogil=True)
def add_feature_slopes(
    means_m: Float32Array,
    quats_wxyz: Float32Array,
    scales_m: Float32Array,
    camera_m: Float64Array,
    rows: Int64Array,
    by_features: Float32Array,
    by_means: Float32Array,
    by_quats: Float32Array,
) -> None:
    """Add what derivatives by the features of some of the Gaussians are by their means and quaternions.

    Args:
        means_m: Shape (N, 3).
        quats_wxyz: Shape (N, 4).
        scales_m: Shape (N, 3).
        camera_m: Shape (3,).
        rows: Numbers of those Gaussians, shape (n,).
        by_features: Shape (n, 4).
        by_means: Is added to, shape (n, 3).
        by_quats: Is added to, shape (n, 4).
    """
    for i in range(len(rows)):
        n = rows[i]
        w, x, y, z, per_length = _unit(quats_wxyz, n)
        k = _shortest(scales_m, n)
        nx, ny, nz = _axis(k, w, x, y, z)
        ox, oy, oz = camera_m[0] - means_m[n, 0], camera_m[1] - means_m[n, 1], camera_m[2] - means_m[n, 2]
        sign = -1.0 if nx * ox + ny * oy + nz * oz < 0.0 else 1.0
        # sign L_d, and (a, b, c) = dL / dn.
        along = sign * by_features[i, 3]
        by_means[i, 0] -= along * nx
        by_means[i, 1] -= along * ny
        by_means[i, 2] -= along * nz
        a = sign * by_features[i, 0] + along * ox
        b = sign * by_features[i, 1] + along * oy
        c = sign * by_features[i, 2] + along * oz
        dw, dx, dy, dz = _axis_slopes(k, w, x, y, z, a, b, c)
        # The unit quaternion is q / |q|: what points along it changes nothing, the rest is divided by the length.
        inward = w * dw + x * dx + y * dy + z * dz
        by_quats[i, 0] += per_length * (dw - w * inward)
        by_quats[i, 1] += per_length * (dx - x * inward)
        by_quats[i, 2] += per_length * (dy - y * inward)
        by_quats[i, 3] += per_length * (dz - z * inward)
