"""Clusters: sets of neighbouring Gaussians that one Gaussian stands for.

A *region* is a run of Gaussians, in the order of their chunks, that holds up to 256 clusters. Moments are always summed
over the original Gaussians, so that merging again and again loses nothing.

Images are sampled with a dilation of `DILATION_PX2`: Gaussians smaller than a pixel are drawn larger, and so with more
weight than they have. A merged Gaussian is to look like the dilated ones. All areas here are therefore those of
Gaussians that are dilated for the size of a pixel at which they will be drawn.

Legend: a cluster's weight W is the sum over its Gaussians of w = opacity * area; mean, colour and joint weights are
sums of w times those of the Gaussians, over W, and the covariance is sum of w (S + x x^T) / W - mean mean^T with the
Gaussians' covariances S and means x. Covariances have the entries xx, xy, xz, yy, yz, zz at 0 .. 5.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array, Int32Array, Int64Array
from readygo.common.kernels import inline_kernel, kernel
from readygo.common.rasterizer.constants import ALPHA_MAX, DILATION_PX2
from readygo.common.rasterizer.packed.scene import CHUNK

NEIGHBOURS = 8
"""Partners that are considered for a cluster: those with the nearest means."""
COVER_STEP = 0.25
"""Step of the integral of `_cover` in u = r^2 / 2."""
XX, XY, XZ, YY, YZ, ZZ = 0, 1, 2, 3, 4, 5
"""Places of a covariance."""
LANE_BITS = 4
LANES = 1 << LANE_BITS
"""Gaussians per block of packed colours and normals: a row of each has a number of every one."""


class Originals(NamedTuple):
    """N Gaussians in the order of their chunks."""

    mean_m: Float64Array
    """Means [m], shape (N, 3)."""
    covariance_m2: Float64Array
    """Covariances xx, xy, xz, yy, yz, zz [m2], shape (N, 6)."""
    opacity: Float64Array
    """Opacities, 0..1, shape (N,)."""
    colour: Float64Array
    """Colours without their dependence on direction, shape (N, 3)."""
    skin: Float32Array
    """Weights of an avatar's joints, shape (N, 24); (N, 0) for a scene."""


class Clusters(NamedTuple):
    """Scratch memory: the clusters of one region."""

    weight: Float64Array
    """Sum of opacity times area [m2], shape (256,)."""
    opacity: Float64Array
    """Mean opacity of the Gaussians, shape (256,)."""
    cover: Float64Array
    """Integral of the cluster's alpha over the merged Gaussian's area, see `_cover`, shape (256,)."""
    area: Float64Array
    """Area of the merged, dilated Gaussian [m2], shape (256,)."""
    mean_m: Float64Array
    """Mean relative to the region's first Gaussian [m], shape (256, 3)."""
    covariance_m2: Float64Array
    """Covariance xx, xy, xz, yy, yz, zz, not dilated [m2], shape (256, 6)."""
    colour: Float64Array
    """Colour without its dependence on direction, shape (256, 3)."""
    skin: Float64Array
    """Weights of an avatar's joints, shape (256, 24), or (256, 0) for a scene."""
    unrest: Float64Array
    """What a change of the order of blending costs, see `cost`, shape (256,)."""
    place_m: Float64Array
    """The means again, by axis, shape (3, 256)."""
    row: Float64Array
    """Squared distances to one cluster [m2], shape (256,)."""
    near: Int64Array
    """Neighbours, nearest first; -1: none, shape (256, 8)."""
    distance2: Float64Array
    """Squared distances to these neighbours, shape (256, 8)."""
    order: Float64Array
    """What blending in the wrong order with these neighbours costs, see `cost`, shape (256, 8)."""
    cost: Float64Array
    """Cost of the cheapest merger, shape (256,)."""
    partner: Int64Array
    """Partner of the cheapest merger, -1: none, shape (256,)."""
    number: Int64Array
    """Number after merging, shape (256,)."""


def make_clusters(joints: int) -> Clusters:
    """Scratch memory for regions of Gaussians with weights of that many joints."""

    def numbers(*shape: int) -> Float64Array:
        return np.zeros((CHUNK, *shape))

    def places(*shape: int) -> Int64Array:
        return np.zeros((CHUNK, *shape), dtype=np.int64)

    return Clusters(
        weight=numbers(),
        opacity=numbers(),
        cover=numbers(),
        area=numbers(),
        mean_m=numbers(3),
        covariance_m2=numbers(6),
        colour=numbers(3),
        skin=numbers(joints),
        unrest=numbers(),
        place_m=np.zeros((3, CHUNK)),
        row=numbers(),
        near=places(NEIGHBOURS),
        distance2=numbers(NEIGHBOURS),
        order=numbers(NEIGHBOURS),
        cost=numbers(),
        partner=places(),
        number=places(),
    )


@inline_kernel
def dilation_m2(pixel_m: float) -> float:
    """What the dilation adds to variances, for pixels of a size [m2]."""
    return DILATION_PX2 * pixel_m * pixel_m


@inline_kernel
def area_m2(c: Any, dilation: float) -> float:
    """Mean area of a dilated Gaussian over directions, up to a factor: root of the sum of its principal 2x2 minors."""
    xx, yy, zz = c[XX] + dilation, c[YY] + dilation, c[ZZ] + dilation
    minors = xx * yy - c[XY] * c[XY] + xx * zz - c[XZ] * c[XZ] + yy * zz - c[YZ] * c[YZ]
    return math.sqrt(max(minors, 0.0))


@inline_kernel
def gather(
    originals: Originals, label: Int32Array, first: int, end: int, count: int, pixel_m: float, out: Clusters
) -> None:
    """Moments of the clusters of a region, Gaussians `first` to `end`."""
    dilation = dilation_m2(pixel_m)
    for k in range(count):
        out.weight[k], out.opacity[k] = 0.0, 0.0
        out.mean_m[k], out.covariance_m2[k], out.colour[k], out.skin[k] = 0.0, 0.0, 0.0, 0.0
    for i in range(first, end):
        _add(originals, i, first, dilation, label[i], out)
    for k in range(count):
        _finish(k, dilation, out)


@inline_kernel
def _add(originals: Originals, i: int, first: int, dilation: float, k: int, out: Clusters) -> None:
    """Add Gaussian `i` to the sums of cluster `k`; means count from the region's first Gaussian."""
    c, mean, origin = originals.covariance_m2[i], originals.mean_m[i], originals.mean_m[first]
    area = area_m2(c, dilation)
    w = originals.opacity[i] * area
    x, y, z = mean[0] - origin[0], mean[1] - origin[1], mean[2] - origin[2]
    out.weight[k] += w
    out.opacity[k] += w * originals.opacity[i]
    m, s = out.mean_m[k], out.covariance_m2[k]
    m[0] += w * x
    m[1] += w * y
    m[2] += w * z
    s[XX] += w * (c[XX] + x * x)
    s[XY] += w * (c[XY] + x * y)
    s[XZ] += w * (c[XZ] + x * z)
    s[YY] += w * (c[YY] + y * y)
    s[YZ] += w * (c[YZ] + y * z)
    s[ZZ] += w * (c[ZZ] + z * z)
    for channel in range(3):
        out.colour[k, channel] += w * originals.colour[i, channel]
    for joint in range(originals.skin.shape[1]):
        out.skin[k, joint] += w * originals.skin[i, joint]


@inline_kernel
def _finish(k: int, dilation: float, out: Clusters) -> None:
    """Make means of the sums of cluster `k`."""
    inverse = 1.0 / out.weight[k]
    m, s = out.mean_m[k], out.covariance_m2[k]
    for axis in range(3):
        m[axis] *= inverse
        out.colour[k, axis] *= inverse
    # E[x x^T] - E[x] E[x]^T; rounding must not make variances negative.
    s[XX] = max(s[XX] * inverse - m[0] * m[0], 0.0)
    s[XY] = s[XY] * inverse - m[0] * m[1]
    s[XZ] = s[XZ] * inverse - m[0] * m[2]
    s[YY] = max(s[YY] * inverse - m[1] * m[1], 0.0)
    s[YZ] = s[YZ] * inverse - m[1] * m[2]
    s[ZZ] = max(s[ZZ] * inverse - m[2] * m[2], 0.0)
    for joint in range(out.skin.shape[1]):
        out.skin[k, joint] *= inverse
    out.area[k] = area_m2(s, dilation)
    out.opacity[k] *= inverse
    sum_of_alphas = out.weight[k] / out.area[k]
    # Of one Gaussian alone the rounding of its area may make a little less than one layer.
    layers = max(sum_of_alphas / out.opacity[k], 1.0)
    out.cover[k] = _cover(out.opacity[k], layers) if layers > 1.001 else sum_of_alphas


@inline_kernel
def _cover(opacity: float, layers: float) -> float:
    """Integral of a cluster's alpha, over its area and pi / 2.

    The cluster is taken for `layers` Gaussians of one opacity behind each other, each as large as the merged one:
    alpha = 1 - (1 - opacity exp(-u))^layers at the radius r with u = r^2 / 2. For one layer it is the opacity.
    """
    # Midpoint rule in u: the area element r dr is du.
    total, u = 0.0, 0.5 * COVER_STEP
    density = opacity * layers
    while True:
        alpha = opacity * math.exp(-u)
        total += 1.0 - math.exp(layers * math.log(1.0 - min(alpha, ALPHA_MAX)))
        u += COVER_STEP
        if density * math.exp(-u) < 0.02:
            # What is left falls like exp(-u).
            return total * COVER_STEP + density * math.exp(0.5 * COVER_STEP - u)


def opacity_of_cover(cover: float) -> float:
    """Opacity at which the integral of min(0.99, opacity * exp(-r^2 / 2)), over that of exp(-r^2 / 2), is `cover`.

    Above 0.99 the Gaussian has a flat top.
    """
    return cover if cover <= ALPHA_MAX else ALPHA_MAX * math.exp(cover / ALPHA_MAX - 1.0)


@kernel
def gather_region(
    originals: Originals, label: Int32Array, first: int, end: int, count: int, pixel_m: float, out: Clusters
) -> None:
    """Moments of the clusters of one region.

    Args:
        originals: Gaussians.
        label: Cluster of each Gaussian within its region, shape (N,).
        first: First Gaussian of the region.
        end: Behind its last one.
        count: Its clusters.
        pixel_m: Size of a pixel at the Gaussians [m].
        out: Where to write.
    """
    gather(originals, label, first, end, count, pixel_m, out)


@kernel
def gather_colours(
    originals: Originals,
    label: Int32Array,
    first: int,
    end: int,
    pixel_m: float,
    packed: Any,
    weight: Float64Array,
    out: Float64Array,
) -> None:
    """Mean packed colours of the clusters of one region, such as coefficients of spherical harmonics.

    Args:
        originals: Gaussians.
        label: Cluster of each Gaussian within its region, shape (N,).
        first: First Gaussian of the region.
        end: Behind its last one.
        pixel_m: Size of a pixel at the Gaussians [m].
        packed: Colours in blocks of 16 Gaussians, flat.
        weight: Weights of the clusters, from `gather_region`.
        out: Where to write, shape (clusters, rows of a block).
    """
    dilation, rows = dilation_m2(pixel_m), out.shape[1]
    out[:] = 0.0
    for i in range(first, end):
        w = originals.opacity[i] * area_m2(originals.covariance_m2[i], dilation) / weight[label[i]]
        # The block, then the row, then the lane of the Gaussian.
        place = (i >> LANE_BITS) * rows * LANES + (i & (LANES - 1))
        for row in range(rows):
            out[label[i], row] += w * packed[place + LANES * row]


@kernel
def gather_normals(
    originals: Originals, label: Int32Array, first: int, end: int, pixel_m: float, packed: Any, out: Float64Array
) -> None:
    """Mean packed normals of the clusters of one region, not of length 1; their signs mean nothing.

    Args:
        originals: Gaussians.
        label: Cluster of each Gaussian within its region, shape (N,).
        first: First Gaussian of the region.
        end: Behind its last one.
        pixel_m: Size of a pixel at the Gaussians [m].
        packed: Normals in blocks of 16 Gaussians, flat.
        out: Where to write, shape (clusters, 3).
    """
    dilation = dilation_m2(pixel_m)
    out[:] = 0.0
    for i in range(first, end):
        w = originals.opacity[i] * area_m2(originals.covariance_m2[i], dilation)
        place, k = (i >> LANE_BITS) * (3 * LANES) + (i & (LANES - 1)), label[i]
        x, y, z = packed[place], packed[place + LANES], packed[place + 2 * LANES]
        # Both directions of an axis are the same normal: the one nearer to the sum so far is added.
        if x * out[k, 0] + y * out[k, 1] + z * out[k, 2] < 0.0:
            w = -w
        out[k, 0] += w * x
        out[k, 1] += w * y
        out[k, 2] += w * z
