"""Skinning of Gaussians forward and backward: what shapes the body, then what poses it.

    y = sum_k w_k B_k [x; 1]      x canonical on the first body, y on the shaped one
    z = sum_k w_k A_k [y; 1]      z in the world

Each Gaussian turns with the normalised sum of its joints' quaternions, which is within a fraction of a degree of the
nearest rotation of the blended matrix (`pose_avatar`); how this rotation depends on the pose is left out of the
gradients, as it hardly changes an image.

Source of the blend of quaternions: Markley et al., Averaging Quaternions, 2007.
"""

from typing import NamedTuple

import numpy as np

from readygo.common.arrays import Float32Array, Int64Array, UInt8Array
from readygo.common.kernels import kernel_with_cache


class Skinned(NamedTuple):
    """Gaussians in one pose."""

    means_m: Float32Array
    """Shape (N, 3)."""
    quats_wxyz: Float32Array
    """Shape (N, 4)."""
    shaped_m: Float32Array
    """The means y on the shaped body, shape (N, 3)."""
    turns_wxyz: Float32Array
    """Unit quaternion that turned each Gaussian, shape (N, 4)."""


class SkinnedSlopes(NamedTuple):
    """Derivatives of a loss."""

    means_m: Float32Array
    """By the canonical means of the rows, shape (n, 3)."""
    quats_wxyz: Float32Array
    """Shape (n, 4)."""
    A: Float32Array
    """Shape (24, 3, 4)."""
    B: Float32Array
    """Shape (24, 3, 4)."""


def skin_gaussians(
    means_m: Float32Array,
    quats_wxyz: Float32Array,
    joint: UInt8Array,
    weight: Float32Array,
    A: Float32Array,
    B: Float32Array,
    joint_quats: Float32Array,
) -> Skinned:
    """Pose Gaussians.

    Args:
        means_m: Canonical means x [m], shape (N, 3).
        quats_wxyz: Canonical rotations, shape (N, 4).
        joint: Joints, shape (N, 4).
        weight: Their weights, shape (N, 4).
        A: Transforms to the world, shape (24, 3, 4).
        B: Transforms to the shaped body, shape (24, 3, 4).
        joint_quats: Rotations of A, shape (24, 4).
    """
    out = Skinned(*(np.empty((len(means_m), width), np.float32) for width in (3, 4, 3, 4)))
    _skin(means_m, quats_wxyz, joint, weight, A, B, joint_quats, out.means_m, out.quats_wxyz, out.shaped_m, out[3])
    return out


def skin_slopes(
    rows: Int64Array,
    by_means: Float32Array,
    by_quats: Float32Array,
    means_m: Float32Array,
    joint: UInt8Array,
    weight: Float32Array,
    A: Float32Array,
    B: Float32Array,
    skinned: Skinned,
) -> SkinnedSlopes:
    """Derivatives by canonical means, rotations and transforms, from those by the posed ones of some rows.

    Args:
        rows: Gaussians with a derivative, shape (n,).
        by_means: Shape (n, 3).
        by_quats: Shape (n, 4).
        means_m: Canonical means [m], shape (N, 3).
        joint: Shape (N, 4).
        weight: Shape (N, 4).
        A: Shape (24, 3, 4).
        B: Shape (24, 3, 4).
        skinned: What `skin_gaussians` gave.
    """
    count = len(rows)
    out = SkinnedSlopes(
        np.empty((count, 3), np.float32),
        np.empty((count, 4), np.float32),
        np.zeros((24, 3, 4), np.float32),
        np.zeros((24, 3, 4), np.float32),
    )
    sums = np.zeros((2, 24, 3, 4))
    _slopes(
        rows, by_means, by_quats, means_m, joint, weight, A, B, skinned.shaped_m, skinned.turns_wxyz,
        out.means_m, out.quats_wxyz, sums,
    )  # fmt: skip
    return out._replace(A=sums[0].astype(np.float32), B=sums[1].astype(np.float32))


@kernel_with_cache(error_model="numpy", nogil=True)
def _skin(
    means: Float32Array,
    quats: Float32Array,
    joint: UInt8Array,
    weight: Float32Array,
    A: Float32Array,
    B: Float32Array,
    joint_quats: Float32Array,
    out: Float32Array,
    out_quats: Float32Array,
    shaped: Float32Array,
    turns: Float32Array,
) -> None:
    zero = np.float32(0)
    for n in range(len(means)):
        x, y, z = means[n, 0], means[n, 1], means[n, 2]
        a, b, c = zero, zero, zero
        for k in range(4):
            w = weight[n, k]
            if w != zero:
                M = B[joint[n, k]]
                a += w * (M[0, 0] * x + M[0, 1] * y + M[0, 2] * z + M[0, 3])
                b += w * (M[1, 0] * x + M[1, 1] * y + M[1, 2] * z + M[1, 3])
                c += w * (M[2, 0] * x + M[2, 1] * y + M[2, 2] * z + M[2, 3])
        shaped[n, 0], shaped[n, 1], shaped[n, 2] = a, b, c
        x, y, z = zero, zero, zero
        qw, qx, qy, qz = zero, zero, zero, zero
        first = joint_quats[joint[n, 0]]
        for k in range(4):
            w = weight[n, k]
            if w != zero:
                M = A[joint[n, k]]
                x += w * (M[0, 0] * a + M[0, 1] * b + M[0, 2] * c + M[0, 3])
                y += w * (M[1, 0] * a + M[1, 1] * b + M[1, 2] * c + M[1, 3])
                z += w * (M[2, 0] * a + M[2, 1] * b + M[2, 2] * c + M[2, 3])
                q = joint_quats[joint[n, k]]
                # q and -q are the same rotation: all on the side of the first.
                if q[0] * first[0] + q[1] * first[1] + q[2] * first[2] + q[3] * first[3] < zero:
                    w = -w
                qw += w * q[0]
                qx += w * q[1]
                qy += w * q[2]
                qz += w * q[3]
        out[n, 0], out[n, 1], out[n, 2] = x, y, z
        inverse = np.float32(1) / np.sqrt(qw * qw + qx * qx + qy * qy + qz * qz + np.float32(1e-20))
        qw, qx, qy, qz = qw * inverse, qx * inverse, qy * inverse, qz * inverse
        turns[n, 0], turns[n, 1], turns[n, 2], turns[n, 3] = qw, qx, qy, qz
        pw, px, py, pz = quats[n, 0], quats[n, 1], quats[n, 2], quats[n, 3]
        out_quats[n, 0] = qw * pw - qx * px - qy * py - qz * pz
        out_quats[n, 1] = qw * px + qx * pw + qy * pz - qz * py
        out_quats[n, 2] = qw * py - qx * pz + qy * pw + qz * px
        out_quats[n, 3] = qw * pz + qx * py - qy * px + qz * pw


@kernel_with_cache(error_model="numpy", nogil=True)
def _slopes(
    rows: Int64Array,
    by_means: Float32Array,
    by_quats: Float32Array,
    means: Float32Array,
    joint: UInt8Array,
    weight: Float32Array,
    A: Float32Array,
    B: Float32Array,
    shaped: Float32Array,
    turns: Float32Array,
    out: Float32Array,
    out_quats: Float32Array,
    sums: "np.ndarray[tuple[int, ...], np.dtype[np.float64]]",
) -> None:
    zero = np.float32(0)
    for row in range(len(rows)):
        n = rows[row]
        gx, gy, gz = by_means[row, 0], by_means[row, 1], by_means[row, 2]
        a, b, c = shaped[n, 0], shaped[n, 1], shaped[n, 2]
        ga, gb, gc = zero, zero, zero
        for k in range(4):
            w = weight[n, k]
            if w != zero:
                j = joint[n, k]
                M = A[j]
                ga += w * (M[0, 0] * gx + M[1, 0] * gy + M[2, 0] * gz)
                gb += w * (M[0, 1] * gx + M[1, 1] * gy + M[2, 1] * gz)
                gc += w * (M[0, 2] * gx + M[1, 2] * gy + M[2, 2] * gz)
                for i in range(3):
                    g = w * by_means[row, i]
                    sums[0, j, i, 0] += g * a
                    sums[0, j, i, 1] += g * b
                    sums[0, j, i, 2] += g * c
                    sums[0, j, i, 3] += g
        x, y, z = means[n, 0], means[n, 1], means[n, 2]
        hx, hy, hz = zero, zero, zero
        for k in range(4):
            w = weight[n, k]
            if w != zero:
                j = joint[n, k]
                M = B[j]
                hx += w * (M[0, 0] * ga + M[1, 0] * gb + M[2, 0] * gc)
                hy += w * (M[0, 1] * ga + M[1, 1] * gb + M[2, 1] * gc)
                hz += w * (M[0, 2] * ga + M[1, 2] * gb + M[2, 2] * gc)
                for i in range(3):
                    g = w * (ga if i == 0 else gb if i == 1 else gc)
                    sums[1, j, i, 0] += g * x
                    sums[1, j, i, 1] += g * y
                    sums[1, j, i, 2] += g * z
                    sums[1, j, i, 3] += g
        out[row, 0], out[row, 1], out[row, 2] = hx, hy, hz
        # The conjugate of the turn, times the derivative.
        qw, qx, qy, qz = turns[n, 0], -turns[n, 1], -turns[n, 2], -turns[n, 3]
        pw, px, py, pz = by_quats[row, 0], by_quats[row, 1], by_quats[row, 2], by_quats[row, 3]
        out_quats[row, 0] = qw * pw - qx * px - qy * py - qz * pz
        out_quats[row, 1] = qw * px + qx * pw + qy * pz - qz * py
        out_quats[row, 2] = qw * py - qx * pz + qy * pw + qz * px
        out_quats[row, 3] = qw * pz + qx * py - qy * px + qz * pw
