"""Horizontal surfaces of a cloud: flat, lying Gaussians as weighted samples of the area that they cover."""

import math
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float32Array
from readygo.common.gaussians import GaussianCloud
from readygo.common.gaussians.covariance import rotation_of
from readygo.common.kernels import kernel_with_cache

OPACITY_MIN = 0.1
"""Fainter Gaussians are haze, not floor."""
TILT_COS_MIN = 0.8
"""Surfaces steeper than 37 deg are no floor."""
THIN_M = 0.03
"""A Gaussian of any shape that stands out by less than this (standard deviation) lies flat [m]."""
SAMPLES_PER_AXIS_MAX = 16


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceSamples:
    """Points on lying Gaussians, each standing for a piece of covered ground."""

    xyz_m: Float32Array
    """Positions [m], shape (N, 3)."""
    area_m2: Float32Array
    """Horizontal area inside 1 sigma times opacity that the sample stands for [m2], shape (N,)."""


@kernel_with_cache
def _sample(
    means: Float32Array,
    quats: Float32Array,
    scales: Float32Array,
    opacities: Float32Array,
    spacing: float,
    xyz: Float32Array,
    area: Float32Array,
) -> int:
    """Write the samples and return their number; with empty arrays, only count them."""
    count = 0
    for n in range(means.shape[0]):
        if opacities[n] < OPACITY_MIN:
            continue
        R = rotation_of(quats[n, 0], quats[n, 1], quats[n, 2], quats[n, 3])
        s = (float(scales[n, 0]), float(scales[n, 1]), float(scales[n, 2]))
        thin = 0 if s[0] <= s[1] and s[0] <= s[2] else (1 if s[1] <= s[2] else 2)
        a, b = (thin + 1) % 3, (thin + 2) % 3
        up = abs(R[6 + thin])
        standing = math.sqrt((s[0] * R[6]) ** 2 + (s[1] * R[7]) ** 2 + (s[2] * R[8]) ** 2)
        if standing > THIN_M and (up < TILT_COS_MIN or s[thin] > 0.5 * min(s[a], s[b])):
            continue
        na = min(max(1, math.ceil(2 * s[a] / spacing)), SAMPLES_PER_AXIS_MAX)
        nb = min(max(1, math.ceil(2 * s[b] / spacing)), SAMPLES_PER_AXIS_MAX)
        inside = 0
        for ia in range(na):
            for ib in range(nb):
                u, v = (2 * ia + 1) / na - 1, (2 * ib + 1) / nb - 1
                inside += u * u + v * v <= 1
        share = math.pi * s[a] * s[b] * max(up, 0.1) * opacities[n] / inside
        for ia in range(na):
            for ib in range(nb):
                u, v = (2 * ia + 1) / na - 1, (2 * ib + 1) / nb - 1
                if u * u + v * v > 1:
                    continue
                if area.size > 0:
                    for axis in range(3):
                        xyz[count, axis] = means[n, axis] + u * s[a] * R[3 * axis + a] + v * s[b] * R[3 * axis + b]
                    area[count] = share
                count += 1
    return count


def sample_surfaces(cloud: GaussianCloud, spacing_m: float) -> SurfaceSamples:
    """Sample the flat, lying Gaussians of a cloud.

    Args:
        cloud: Gaussians, z up.
        spacing_m: Distance of the samples on Gaussians that are larger than this [m].
    """
    arrays = cloud.means_m, cloud.quats_wxyz, cloud.scales_m, cloud.opacities
    count = _sample(*arrays, spacing_m, np.empty((0, 3), np.float32), np.empty(0, np.float32))
    xyz, area = np.empty((count, 3), np.float32), np.empty(count, np.float32)
    if count:
        _sample(*arrays, spacing_m, xyz, area)
    return SurfaceSamples(xyz_m=xyz, area_m2=area)
