"""Balls among ellipsoids: whether they meet, and half-planes that keep them apart.

A ball of radius r at p and the ellipsoid of a Gaussian (mean m, axes R, half axes l_i) are apart exactly if

    K(s) = sum_i v_i^2 s (1 - s) / (r^2 + s (l_i^2 - r^2)) > 1 for some s in (0, 1),  v = R^T (m - p).

That is the generalised eigenproblem of both matrices, which for a ball the Gaussian's own axes solve. K is concave in s
and convex in p, so that the best s for the nearest point of a segment comes by bisection. With the s that was found,
E(s) = l^2 / (1 - s) + r^2 / s are half axes, squared, of an ellipsoid around the sum of both; where p is outside of it,
the tangent plane at right angles (in that metric) keeps a whole half-space of centres apart from the Gaussian.

Source: Gilitschenski & Hanebeck, A robust computational test for overlap of two arbitrary-dimensional ellipsoids, 2012;
Chen et al., Splat-Nav: Safe real-time robot navigation in Gaussian splatting maps, 2024, sections IV and V.
"""

import math

import numpy as np

from readygo.common.arrays import BoolArray, Float32Array, Float64Array
from readygo.common.gaussians.covariance import rotation_of
from readygo.common.kernels import kernel_with_cache

BISECTIONS = 16
"""Halvings of the interval of s; fewer only make the answer more careful."""


@kernel_with_cache
def separation(
    offset: tuple[float, float, float],
    along: tuple[float, float, float],
    squares: tuple[float, float, float],
    radius2: float,
    enough: float,
) -> tuple[float, float, float]:
    """The best s of a Gaussian and a ball anywhere on a segment.

    Args:
        offset: From the segment's begin to the mean, in the Gaussian's axes [m].
        along: The segment, in the Gaussian's axes [m]; nothing for a ball that stands.
        squares: The half axes, squared [m2].
        radius2: The ball's radius, squared [m2].
        enough: K at which the search may end.

    Returns:
        K, above 1 if they are apart everywhere; s; the share of the segment at which they are nearest.
    """
    low, high, best = 0.0, 1.0, (-1.0, 0.5, 0.0)
    for _ in range(BISECTIONS):
        s = 0.5 * (low + high)
        # Weights of v^2 in K, and their derivatives by s.
        over, under, t = 0.0, 0.0, 0.0
        for i in range(3):
            weight = 1.0 / (radius2 + s * (squares[i] - radius2))
            over += weight * offset[i] * along[i]
            under += weight * along[i] * along[i]
        if under > 0.0:
            t = min(max(over / under, 0.0), 1.0)
        value, slope = 0.0, 0.0
        for i in range(3):
            v = offset[i] - t * along[i]
            weight = 1.0 / (radius2 + s * (squares[i] - radius2))
            value += v * v * s * (1.0 - s) * weight
            slope += v * v * (radius2 * (1.0 - s) * (1.0 - s) - squares[i] * s * s) * weight * weight
        if value > best[0]:
            best = (value, s, t)
        if value > enough:
            break
        if slope > 0.0:
            low = s
        else:
            high = s
    return best


@kernel_with_cache(inline="always")
def _in_axes(R: tuple[float, ...], x: float, y: float, z: float) -> tuple[float, float, float]:
    """R^T (x, y, z)."""
    return R[0] * x + R[3] * y + R[6] * z, R[1] * x + R[4] * y + R[7] * z, R[2] * x + R[5] * y + R[8] * z


@kernel_with_cache
def _mark_blocked(
    means: Float32Array,
    quats: Float32Array,
    half_axes: Float64Array,
    centres_z: Float64Array,
    origin: tuple[float, float],
    cell_m: float,
    radius: float,
    blocked: BoolArray,
) -> None:
    """Cells at whose centres a stack of balls meets an ellipsoid; `centres_z` has shape (balls, rows, columns)."""
    balls, rows, columns = centres_z.shape
    for n in range(len(means)):
        x, y, z = float(means[n, 0]), float(means[n, 1]), float(means[n, 2])
        a, b, c = half_axes[n, 0], half_axes[n, 1], half_axes[n, 2]
        R = rotation_of(float(quats[n, 0]), float(quats[n, 1]), float(quats[n, 2]), float(quats[n, 3]))
        reach_x = radius + math.sqrt((a * R[0]) ** 2 + (b * R[1]) ** 2 + (c * R[2]) ** 2)
        reach_y = radius + math.sqrt((a * R[3]) ** 2 + (b * R[4]) ** 2 + (c * R[5]) ** 2)
        reach_z = radius + math.sqrt((a * R[6]) ** 2 + (b * R[7]) ** 2 + (c * R[8]) ** 2)
        i0 = max(math.floor((y - reach_y - origin[1]) / cell_m), 0)
        i1 = min(math.floor((y + reach_y - origin[1]) / cell_m), rows - 1)
        j0 = max(math.floor((x - reach_x - origin[0]) / cell_m), 0)
        j1 = min(math.floor((x + reach_x - origin[0]) / cell_m), columns - 1)
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                dx = x - (origin[0] + (j + 0.5) * cell_m)
                dy = y - (origin[1] + (i + 0.5) * cell_m)
                for ball in range(balls):
                    dz = z - centres_z[ball, i, j]
                    if blocked[i, j] or abs(dz) > reach_z:
                        continue
                    offset = _in_axes(R, dx, dy, dz)
                    found = separation(offset, (0.0, 0.0, 0.0), (a * a, b * b, c * c), radius * radius, 1.0)
                    blocked[i, j] = found[0] <= 1.0


@kernel_with_cache
def _planes(
    means: Float32Array,
    quats: Float32Array,
    half_axes: Float64Array,
    begin: tuple[float, float, float],
    end: tuple[float, float, float],
    radius: float,
    planes: Float64Array,
) -> None:
    """Half-planes a x + b y <= c in which a ball is apart from each Gaussian, rows of `planes`, shape (N, 3)."""
    for n in range(len(means)):
        R = rotation_of(float(quats[n, 0]), float(quats[n, 1]), float(quats[n, 2]), float(quats[n, 3]))
        squares = (half_axes[n, 0] ** 2, half_axes[n, 1] ** 2, half_axes[n, 2] ** 2)
        x, y, z = float(means[n, 0]), float(means[n, 1]), float(means[n, 2])
        offset = _in_axes(R, x - begin[0], y - begin[1], z - begin[2])
        along = _in_axes(R, end[0] - begin[0], end[1] - begin[1], end[2] - begin[2])
        value, s, t = separation(offset, along, squares, radius * radius, math.inf)
        normal_x, normal_y, normal_z = 0.0, 0.0, 0.0
        for i in range(3):
            weighted = (offset[i] - t * along[i]) / (squares[i] / (1.0 - s) + radius * radius / s)
            normal_x += R[i] * weighted
            normal_y += R[3 + i] * weighted
            normal_z += R[6 + i] * weighted
        # The plane of centres at the height where the ball is nearest; a floor is level enough along one piece of way.
        height = z - (begin[2] + t * (end[2] - begin[2]))
        planes[n, 0], planes[n, 1] = normal_x, normal_y
        planes[n, 2] = normal_x * x + normal_y * y + normal_z * height - math.sqrt(max(value, 0.0))


class Ellipsoids:
    """Gaussians as ellipsoids."""

    def __init__(self, means_m: Float32Array, quats_wxyz: Float32Array, half_axes_m: Float64Array) -> None:
        """Keep them.

        Args:
            means_m: Centres in the world [m], shape (N, 3).
            quats_wxyz: What turns their axes into the world, shape (N, 4).
            half_axes_m: Half axes [m], shape (N, 3).
        """
        self._means, self._quats, self._half_axes = means_m, quats_wxyz, half_axes_m

    def __len__(self) -> int:
        return len(self._means)

    def blocked_cells(
        self, centres_z_m: Float64Array, origin_m: tuple[float, float], cell_m: float, radius_m: float
    ) -> BoolArray:
        """Cells of a grid at which a stack of balls meets an ellipsoid.

        Args:
            centres_z_m: Height of the balls above each cell's centre [m], shape (balls, rows, columns).
            origin_m: World x, y of the corner of cell (0, 0) [m].
            cell_m: Edge of a cell [m].
            radius_m: Of the balls [m].

        Returns:
            Shape (rows, columns).
        """
        blocked = np.zeros(centres_z_m.shape[1:], np.bool_)
        arrays = self._means, self._quats, self._half_axes
        _mark_blocked(*arrays, centres_z_m, origin_m, cell_m, radius_m, blocked)
        return blocked

    def near(self, begin_m: tuple[float, float], end_m: tuple[float, float], distance_m: float) -> "Ellipsoids":
        """Ellipsoids whose boxes meet the box around a segment, widened by a distance [m]."""
        low = np.minimum(begin_m, end_m) - distance_m
        high = np.maximum(begin_m, end_m) + distance_m
        # No ellipsoid is wider than its longest axis.
        far = self._half_axes.max(axis=1, initial=0.0)[:, None]
        near = ((self._means[:, :2] + far >= low) & (self._means[:, :2] - far <= high)).all(axis=1)
        return Ellipsoids(self._means[near], self._quats[near], self._half_axes[near])

    def half_planes(
        self, begin_m: tuple[float, float, float], end_m: tuple[float, float, float], radius_m: float
    ) -> Float64Array:
        """Where a ball that may move along a segment may move besides, at the height that it has there.

        Args:
            begin_m: World x, y, z of the ball's centre at one end [m].
            end_m: At the other end [m].
            radius_m: The ball's [m].

        Returns:
            Rows a, b, c: at x, y with a x + b y <= c the ball is apart from one of them; the segment itself is, where
            the ball meets none of them on it. Shape (N, 3), a and b of length 1, in their order.
        """
        planes = np.empty((len(self), 3))
        _planes(self._means, self._quats, self._half_axes, begin_m, end_m, radius_m, planes)
        length = np.hypot(planes[:, 0], planes[:, 1])
        # What is straight above or below says nothing about where to go.
        planes = planes[length > 1e-9]
        scaled: Float64Array = planes / length[length > 1e-9, None]
        return scaled
