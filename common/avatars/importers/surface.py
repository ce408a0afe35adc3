"""A coloured mesh as flat Gaussians: even samples, outer layer only, colours averaged over what each one covers."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from readygo.common.arrays import BoolArray, Float64Array, Int64Array
from readygo.common.frames import quat_from_matrix
from readygo.common.gaussians import GaussianCloud, sh_of_rgb

OVERSAMPLING = 6
"""Candidates per Gaussian: they carry the colours that a Gaussian averages."""
SIGMA_PER_SPACING = 0.52
"""Standard deviation along the surface, relative to the mean distance of a sample's six nearest."""
SIGMA_LIMITS = 0.65, 1.3
"""Least and greatest standard deviation along the surface, relative to the least distance of two samples."""
FLATNESS = 0.12
"""Standard deviation along the normal, relative to the one along the surface."""
OPACITY = 0.98
COVER_PROBES_M = ((0.003, 0.0024), (0.006, 0.0042), (0.010, 0.006), (0.016, 0.0096), (0.024, 0.0144), (0.034, 0.02))
"""Distances along the normal, and radii around them, at which a covering layer such as a shirt is looked for [m]."""
# A saturated set of random disks of diameter r covers 0.547 of an area (Feder, Random sequential adsorption, 1980);
# six candidates per sample fill about three quarters of that.
_SATURATION = 0.75 * 0.547 * 4.0 / np.pi


@dataclass(frozen=True, kw_only=True, eq=False)
class Mesh:
    """Triangles with what a sample needs, in metres."""

    corners_m: Float64Array
    """Corners of the triangles [m], shape (F, 3, 3)."""
    normals: Float64Array
    """Outward unit normals at the corners, shape (F, 3, 3)."""
    weights: Float64Array
    """Skinning weights at the corners, shape (F, 3, 24)."""
    density: Float64Array
    """How many more samples than average a triangle deserves per area, shape (F,)."""


Painter = Callable[[Int64Array, Float64Array], Float64Array]
"""Colours (sRGB and alpha in 0..1, shape (M, 4)) of points given by triangle (M,) and barycentrics (M, 3)."""


def gaussians_of_mesh(mesh: Mesh, paint: Painter, count: int) -> tuple[GaussianCloud, Float64Array]:
    """Cover a mesh with about `count` Gaussians.

    Args:
        mesh: The surface.
        paint: Its colours.
        count: Wanted number; hidden layers make it less.

    Returns:
        The Gaussians, and their skinning weights, shape (N, 24).

    Raises:
        ValueError: If the mesh has no area, or nothing of it can be seen.
    """
    face, bary = _candidates(mesh, OVERSAMPLING * count)
    colours = paint(face, bary)
    points = np.einsum("mk,mki->mi", bary, mesh.corners_m[face])
    normals = np.einsum("mk,mki->mi", bary, mesh.normals[face])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    outer = np.flatnonzero((colours[:, 3] > 0.05) & ~_is_covered(points, normals, colours[:, 3]))
    if len(outer) == 0:
        raise ValueError("nothing of the surface can be seen: it is transparent.")
    face, bary, points, normals, colours = face[outer], bary[outer], points[outer], normals[outer], colours[outer]
    area = float((_areas(mesh.corners_m) * mesh.density).sum()) * len(outer) / (OVERSAMPLING * count)
    radii = np.sqrt(_SATURATION * area / count / mesh.density[face])
    kept = _thin_points(points, radii)
    averaged = _mean_colours(points, normals, colours, kept)
    sigma = _sigma(points[kept], radii[kept])
    cloud = GaussianCloud(
        means_m=points[kept].astype(np.float32),
        quats_wxyz=quat_from_matrix(_frames(normals[kept])).astype(np.float32),
        scales_m=(sigma[:, None] * np.array([1.0, 1.0, FLATNESS])).astype(np.float32),
        opacities=(OPACITY * np.clip(averaged[:, 3], 0.0, 1.0)).astype(np.float32),
        sh=sh_of_rgb(averaged[:, None, :3]).astype(np.float32),
    )
    return cloud, np.einsum("mk,mkj->mj", bary[kept], mesh.weights[face[kept]])


def _candidates(mesh: Mesh, count: int) -> tuple[Int64Array, Float64Array]:
    """Triangles and barycentrics of evenly spread points, in an order without pattern; the same for the same mesh."""
    share = _areas(mesh.corners_m) * mesh.density
    total = float(share.sum())
    if not total > 0.0:
        raise ValueError("the surface has no area.")
    place = (np.arange(count) + 0.5) / count * total
    face = np.minimum(np.searchsorted(np.cumsum(share), place), len(share) - 1)
    face = face[np.random.Generator(np.random.Philox(0)).permutation(count)]
    # Additive recurrence of low discrepancy: Roberts, The Unreasonable Effectiveness of Quasirandom Sequences, 2018.
    number = np.arange(1, count + 1)
    u, v = number * 0.7548776662466927 % 1.0, number * 0.5698402909980532 % 1.0
    root = np.sqrt(u)
    return face, np.stack([1.0 - root, root * (1.0 - v), root * v], axis=1)


def _areas(corners: Float64Array) -> Float64Array:
    area: Float64Array = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    return area


def _is_covered(points: Float64Array, normals: Float64Array, alpha: Float64Array) -> BoolArray:
    """Whether another opaque layer that faces the same way lies closely above each point."""
    opaque = np.flatnonzero(alpha > 0.5)
    covered = np.zeros(len(points), dtype=np.bool_)
    if len(opaque) == 0:
        return covered
    tree = cKDTree(points[opaque])
    for offset_m, reach_m in COVER_PROBES_M:
        distance, nearest = tree.query(points + offset_m * normals, distance_upper_bound=reach_m)
        found = np.isfinite(distance)
        other = opaque[nearest[found]]
        same_way = (normals[found] * normals[other]).sum(axis=1) > 0.5
        covered[np.flatnonzero(found)[same_way]] = True
    return covered


def _thin_points(points: Float64Array, radii: Float64Array) -> Int64Array:
    """Greedy choice, in order, of points that keep their distance from all chosen before them."""
    pairs = cKDTree(points).query_pairs(float(radii.max()), output_type="ndarray")
    first, second = pairs[:, 0], pairs[:, 1]
    close = ((points[first] - points[second]) ** 2).sum(axis=1) < np.minimum(radii[first], radii[second]) ** 2
    first, second = first[close], second[close]
    undecided = np.ones(len(points), dtype=np.bool_)
    chosen = np.zeros(len(points), dtype=np.bool_)
    while undecided.any():
        waiting = np.zeros(len(points), dtype=np.bool_)
        waiting[second] = True
        accepted = undecided & ~waiting
        chosen |= accepted
        undecided &= ~accepted
        undecided[second[accepted[first]]] = False
        both = undecided[first] & undecided[second]
        first, second = first[both], second[both]
    return np.flatnonzero(chosen)


def _sigma(points: Float64Array, radii: Float64Array) -> Float64Array:
    """Standard deviation along the surface: wider where samples happen to lie apart, so that no gap stays open."""
    count = min(7, len(points))
    distance, _ = cKDTree(points).query(points, k=count)
    spacing = distance.reshape(len(points), count)[:, 1:].sum(axis=1) / max(count - 1, 1)
    low, high = SIGMA_LIMITS
    sigma: Float64Array = np.clip(SIGMA_PER_SPACING * spacing, low * radii, high * radii)
    return sigma


def _mean_colours(points: Float64Array, normals: Float64Array, colours: Float64Array, kept: Int64Array) -> Float64Array:
    """Mean colour of the candidates nearest to each chosen point that face its way; its own where there is none."""
    _, nearest = cKDTree(points[kept]).query(points)
    agree = (normals * normals[kept][nearest]).sum(axis=1) > 0.3
    agree[kept] = True
    nearest = nearest[agree]
    number = np.bincount(nearest, minlength=len(kept)).astype(np.float64)
    channels = [np.bincount(nearest, weights=colours[agree, k], minlength=len(kept)) / number for k in range(4)]
    return np.stack(channels, axis=1)


def _frames(normals: Float64Array) -> Float64Array:
    """Rotation matrices whose third column is the normal, shape (N, 3, 3)."""
    reference = np.where(np.abs(normals[:, 1:2]) < 0.9, np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]))
    sideways = np.cross(reference, normals)
    sideways /= np.linalg.norm(sideways, axis=1, keepdims=True)
    return np.stack([sideways, np.cross(normals, sideways), normals], axis=2)
