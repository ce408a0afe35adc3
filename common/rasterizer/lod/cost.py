"""What an image loses when one Gaussian stands for two clusters.

Costs are squared errors, summed over the pixels and the colour channels (0..1) that a merger touches, as the mean of
three projections along the axes. Three errors add up:

- coverage: the merged Gaussian's alpha is not the sum of both alphas. It shows by the contrast between the Gaussian and
  what is behind it, which is not known here: `MergeRule.contrast` is assumed.
- colour: each has the colour of both, before a background of that colour.
- order: Gaussians are blended in the order of their means. Where two opaque ones of different colours overlap, the
  nearer one is seen and the merged one shows the mean. And a mean that moves may pass a third Gaussian (`unrest`).

Legend: clusters i and j, merged m, their weights' shares f_i + f_j = 1; o a cluster's opacity (`cover`); a, b and m
covariances (xx, xy, yy) of dilated Gaussians in one projection; (x, y) the offset of the means there; G_a the Gaussian
of peak 1 with the covariance a. Integrals over the plane are over pi:

    integral of G_a^2 = sqrt(det a),   integral of G_a G_b = 2 sqrt(det a det b / det(a + b)) exp(-q / 2),
    q = (x, y) (a + b)^-1 (x, y)^T.
"""

import math
from typing import Any, NamedTuple

from readygo.common.kernels import inline_kernel
from readygo.common.rasterizer.lod.clusters import (
    NEIGHBOURS,
    XX,
    XY,
    XZ,
    YY,
    YZ,
    ZZ,
    Clusters,
    area_m2,
    dilation_m2,
)

FAR_Q = 40.0
"""Squared distance in sigmas at which Gaussians do not overlap any more."""


class MergeRule(NamedTuple):
    """What may be merged."""

    pixel_m: float
    """Size of a pixel at the Gaussians [m]."""
    tolerance: float
    """Largest cost of a merger."""
    contrast: float
    """Squared difference between the colour of a Gaussian and what is behind it, summed over channels."""
    skin_tolerance: float
    """Largest sum of the differences between two clusters' joint weights."""


@inline_kernel
def _planes(c: Any, d: float) -> tuple[Any, Any, Any]:
    """Covariances (xx, xy, yy) of a dilated Gaussian's projections along z, y and x."""
    return (c[XX] + d, c[XY], c[YY] + d), (c[XX] + d, c[XZ], c[ZZ] + d), (c[YY] + d, c[YZ], c[ZZ] + d)


@inline_kernel
def _root_det(a: Any) -> float:
    """Root of the determinant of a covariance (xx, xy, yy)."""
    root: float = math.sqrt(max(a[0] * a[2] - a[1] * a[1], 0.0))
    return root


@inline_kernel
def _overlap(a: Any, b: Any, x: float, y: float, power: float) -> float:
    """Integral over the plane, over pi, of (g_a g_b)^power of two Gaussians of peak 1 whose means lie (x, y) apart."""
    # 2 / power sqrt(det a det b / det(a + b)) exp(-power q / 2).
    xx, xy, yy = a[0] + b[0], a[1] + b[1], a[2] + b[2]
    det = xx * yy - xy * xy
    q = (yy * x * x - 2.0 * xy * x * y + xx * y * y) / det
    if q > FAR_Q:
        return 0.0
    overlap: float = 2.0 / power * _root_det(a) * _root_det(b) / math.sqrt(det) * math.exp(-0.5 * power * q)
    return overlap


@inline_kernel
def _contrast2(i: int, j: int, c: Clusters) -> float:
    """Squared difference of two clusters' colours, summed over channels."""
    total = 0.0
    for channel in range(3):
        difference = c.colour[i, channel] - c.colour[j, channel]
        total += difference * difference
    return total


@inline_kernel
def _offset(i: int, j: int, c: Clusters) -> tuple[float, float, float]:
    """The mean of cluster `i` as seen from that of cluster `j` [m]."""
    return c.mean_m[i, 0] - c.mean_m[j, 0], c.mean_m[i, 1] - c.mean_m[j, 1], c.mean_m[i, 2] - c.mean_m[j, 2]


@inline_kernel
def _order_cost(i: int, j: int, d: float, c: Clusters) -> float:
    """Squared error, over pi and up to the contrast, if two clusters blend in the wrong order; three projections."""
    # The merged one shows the mean of both colours: off by half of o_i o_j G_i G_j times the contrast.
    oi, oj = min(c.cover[i], 1.0), min(c.cover[j], 1.0)
    x, y, z = _offset(i, j, c)
    a, b = _planes(c.covariance_m2[i], d), _planes(c.covariance_m2[j], d)
    overlap = _overlap(a[0], b[0], x, y, 2.0) + _overlap(a[1], b[1], x, z, 2.0) + _overlap(a[2], b[2], y, z, 2.0)
    cost: float = 0.25 * oi * oi * oj * oj * overlap
    return cost


@inline_kernel
def find_unrest(count: int, rule: MergeRule, c: Clusters) -> None:
    """What each cluster costs per metre that it moves: it passes a neighbour after their distance at the latest."""
    d = dilation_m2(rule.pixel_m)
    for k in range(count):
        c.unrest[k] = 0.0
        for n in range(NEIGHBOURS):
            other = c.near[k, n]
            if other < 0:
                break
            distance_m = max(math.sqrt(c.distance2[k, n]), 0.01 * rule.pixel_m)
            c.order[k, n] = _contrast2(k, other, c) * _order_cost(k, other, d, c)
            c.unrest[k] += c.order[k, n] / distance_m


@inline_kernel
def merger_cost(i: int, n: int, most: float, rule: MergeRule, c: Clusters) -> float:
    """Cost of merging cluster `i` and its neighbour of place `n`; infinite if it is no less than `most`."""
    j = c.near[i, n]
    d = dilation_m2(rule.pixel_m)
    w = c.weight[i] + c.weight[j]
    fi, fj = c.weight[i] / w, c.weight[j] / w
    x, y, z = _offset(i, j, c)
    # Covariance of both: f_i S_i + f_j S_j + f_i f_j offset offset^T.
    p, q, f = c.covariance_m2[i], c.covariance_m2[j], fi * fj
    merged = (
        fi * p[XX] + fj * q[XX] + f * x * x,
        fi * p[XY] + fj * q[XY] + f * x * y,
        fi * p[XZ] + fj * q[XZ] + f * x * z,
        fi * p[YY] + fj * q[YY] + f * y * y,
        fi * p[YZ] + fj * q[YZ] + f * y * z,
        fi * p[ZZ] + fj * q[ZZ] + f * z * z,
    )
    # The merged opacity keeps the sum of opacity times area.
    oi, oj = c.cover[i], c.cover[j]
    opacities = (oi, oj, (oi * c.area[i] + oj * c.area[j]) / area_m2(merged, d))
    contrast2 = _contrast2(i, j, c)
    a, b, m = _planes(p, d), _planes(q, d), _planes(merged, d)
    # Means move by f_j and f_i of their distance.
    moved = math.sqrt(x * x + y * y + z * z) * (fj * c.unrest[i] + fi * c.unrest[j])
    u, v = (x, x, y), (y, z, z)
    total = c.order[i, n]
    for plane in range(3):
        # No part is negative: a sum of some is at most the whole one, also as rounded.
        if _per_pixel(total + moved, rule) >= most:
            return math.inf
        total += _blend_cost(a[plane], b[plane], m[plane], u[plane], v[plane], fi, opacities, contrast2, rule.contrast)
    cost = _per_pixel(total + moved, rule)
    return cost if cost < most else math.inf


@inline_kernel
def _per_pixel(total: float, rule: MergeRule) -> float:
    """Mean cost of three projections, in pixels."""
    cost: float = total * math.pi / (3.0 * rule.pixel_m * rule.pixel_m)
    return cost


@inline_kernel
def _blend_cost(
    a: Any, b: Any, m: Any, x: float, y: float, fi: float, opacities: Any, contrast2: float, contrast: float
) -> float:
    """Squared errors of coverage and of colour in one projection, over pi."""
    oi, oj, om = opacities
    fj = 1.0 - fi
    aa, bb, mm, ab = _root_det(a), _root_det(b), _root_det(m), _overlap(a, b, x, y, 1.0)
    am, bm = _overlap(a, m, fj * x, fj * y, 1.0), _overlap(b, m, fi * x, fi * y, 1.0)
    # Coverage: integral of (o_i G_a + o_j G_b - o_m G_m)^2. Colour, in parts of the contrast: that of
    # (f_j o_i G_a - f_i o_j G_b)^2, as each is drawn in the mean colour, f_j or f_i of the contrast away from its own.
    coverage = oi * oi * aa + oj * oj * bb + om * om * mm + 2.0 * (oi * oj * ab - om * (oi * am + oj * bm))
    colour = oi * oi * fj * fj * aa + oj * oj * fi * fi * bb - 2.0 * oi * oj * fi * fj * ab
    cost: float = contrast * max(coverage, 0.0) + contrast2 * max(colour, 0.0)
    return cost
