"""Normals of avatars that light falls on: outward, smooth, and robust against Gaussians that are no flat discs.

A normal is where a Gaussian lies seen from the bones that move it, bent towards the Gaussian's shortest axis as far as
the Gaussian is flat and the two agree; which way the axis points does not matter.
"""

import math

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array
from readygo.common.avatars.avatar import SMPL_PARENTS
from readygo.common.kernels import kernel_with_cache

AXIS_SHARE = 4.0
"""Weight of the axis of a flat Gaussian next to the direction from the bones."""
_NEXT = (3, 4, 5, 6, 7, 8, 9, 10, 11, 12, -1, -1, 15, 16, 17, -1, 18, 19, 20, 21, 22, 23, -1, -1)
"""The joint at the other end of each joint's bone; -1: the bone continues the one before it."""
_PARENTS = tuple(int(parent) for parent in SMPL_PARENTS)


def outward_normals(
    means_m: Float64Array, axes: Float64Array, flatness: Float64Array, weights: Float32Array, joints_m: Float32Array
) -> Float64Array:
    """Normals of an avatar's Gaussians in its canonical pose.

    Args:
        means_m: Means [m], shape (N, 3).
        axes: Shortest axes, unit vectors of either sign, shape (N, 3).
        flatness: 1 for a disc, 0 for a ball, shape (N,).
        weights: Weights of all joints, shape (N, 24).
        joints_m: Joints in the canonical pose [m], shape (24, 3).

    Returns:
        Unit vectors, shape (N, 3).
    """
    ends = np.array([_bone_end(joint, joints_m.astype(np.float64)) for joint in range(len(joints_m))])
    normals = np.empty((len(means_m), 3))
    _fill_normals(means_m, axes, flatness, weights, joints_m.astype(np.float64), ends, normals)
    return normals


def _bone_end(joint: int, joints_m: Float64Array) -> Float64Array:
    further = _NEXT[joint]
    end: Float64Array = joints_m[further] if further >= 0 else 2.0 * joints_m[joint] - joints_m[_PARENTS[joint]]
    return end


@kernel_with_cache
def _fill_normals(
    means: Float64Array,
    axes: Float64Array,
    flatness: Float64Array,
    weights: Float32Array,
    begins: Float64Array,
    ends: Float64Array,
    out: Float64Array,
) -> None:
    for n in range(len(means)):
        ox, oy, oz = 0.0, 0.0, 0.0
        for j in range(24):
            w = float(weights[n, j])
            if w == 0.0:
                continue
            px, py, pz = means[n, 0] - begins[j, 0], means[n, 1] - begins[j, 1], means[n, 2] - begins[j, 2]
            bx, by, bz = ends[j, 0] - begins[j, 0], ends[j, 1] - begins[j, 1], ends[j, 2] - begins[j, 2]
            length2 = bx * bx + by * by + bz * bz
            along = (px * bx + py * by + pz * bz) / length2 if length2 > 0.0 else 0.0
            along = min(max(along, 0.0), 1.0)
            ox, oy, oz = ox + w * (px - along * bx), oy + w * (py - along * by), oz + w * (pz - along * bz)
        length = math.sqrt(ox * ox + oy * oy + oz * oz)
        if length > 1e-9:
            ox, oy, oz = ox / length, oy / length, oz / length
        else:
            ox, oy, oz = 0.0, 1.0, 0.0
        ax, ay, az = axes[n, 0], axes[n, 1], axes[n, 2]
        bend = AXIS_SHARE * flatness[n] * (ox * ax + oy * ay + oz * az)
        x, y, z = ox + bend * ax, oy + bend * ay, oz + bend * az
        length = math.sqrt(x * x + y * y + z * z)
        out[n, 0], out[n, 1], out[n, 2] = x / length, y / length, z / length
