"""Surfaces and the samples on them that become Gaussians: meshes, blue noise, procedural noise, visibility."""

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from readygo.common.kernels import kernel_with_cache

Array = npt.NDArray[np.float64]

TANGENT_SIGMA = 0.92
"""Standard deviation in the surface, in units of the samples' distance: less leaves pinholes, more blurs."""
CANDIDATES = 8.0
"""Random points per square of the spacing; fewer leave holes in the blue noise."""
NORMAL_SIGMA = 0.14
"""Standard deviation across the surface, in units of that in the surface."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Surface:
    """A triangle mesh; `rest` keeps the positions before clothes were widened, where patterns and cuts are defined."""

    vertices: Array
    rest: Array
    triangles: npt.NDArray[np.int32]
    texture: Array
    """Texture coordinates of the triangles' corners, shape (T, 3, 2)."""
    skin_weights: Array
    normals: Array

    def moved(self, vertices: Array) -> "Surface":
        """The surface with other positions and their normals."""
        return Surface(
            vertices=vertices,
            rest=self.rest,
            triangles=self.triangles,
            texture=self.texture,
            skin_weights=self.skin_weights,
            normals=vertex_normals(vertices, self.triangles),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """Points on a surface, on their way to Gaussians."""

    position: Array
    rest: Array
    normal: Array
    tangent: Array
    texture: Array
    skin_weights: Array
    spacing: Array
    """Distance to the neighbours [m], shape (N,)."""
    stretch: Array
    """Length along the tangent over the usual one, shape (N,)."""
    colour: Array
    opacity: Array

    def __len__(self) -> int:
        return len(self.position)

    def select(self, index: npt.NDArray[np.bool_] | npt.NDArray[np.intp]) -> "Samples":
        """The samples of a mask or an index."""
        return Samples(**{field.name: getattr(self, field.name)[index] for field in fields(self)})

    def changed(self, **values: Array) -> "Samples":
        """The samples with some fields replaced."""
        return Samples(**{field.name: values.get(field.name, getattr(self, field.name)) for field in fields(self)})


def joined(parts: list[Samples]) -> Samples:
    """All samples of several layers."""
    return Samples(**{f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Samples)})


def surface_of(
    vertices: Array,
    quads: npt.NDArray[np.int32],
    texture: Array,
    uv_quads: npt.NDArray[np.int32],
    skin_weights: Array,
) -> Surface:
    """The surface of some quads of a body; vertices that they do not use are left out."""
    used, local = np.unique(quads, return_inverse=True)
    local = local.reshape(quads.shape).astype(np.int32)
    triangles = np.concatenate([local[:, [0, 1, 2]], local[:, [0, 2, 3]]])
    corners = np.concatenate([uv_quads[:, [0, 1, 2]], uv_quads[:, [0, 2, 3]]])
    solid = triangles[:, 0] != triangles[:, 2]
    solid &= (triangles[:, 1] != triangles[:, 2]) & (triangles[:, 0] != triangles[:, 1])
    positions = vertices[used].astype(np.float64)
    return Surface(
        vertices=positions,
        rest=positions,
        triangles=triangles[solid],
        texture=texture[corners[solid]].astype(np.float64),
        skin_weights=skin_weights[used].astype(np.float64),
        normals=vertex_normals(positions, triangles[solid]),
    )


def vertex_normals(vertices: Array, triangles: npt.NDArray[np.int32]) -> Array:
    """Area-weighted normals, shape (V, 3)."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    faces = np.cross(b - a, c - a)
    normals = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normals, triangles[:, k], faces)
    return unit(normals)


def smoothed(surface: Surface, rounds: int) -> Array:
    """Vertices after some rounds of averaging with their neighbours; open edges stay."""
    return averaged(surface, surface.vertices, rounds)


def averaged(surface: Surface, values: Array, rounds: int) -> Array:
    """Values at the vertices, shape (V, ...), after some rounds of averaging with their neighbours; open edges stay."""
    edges = np.concatenate([surface.triangles[:, [i, (i + 1) % 3]] for i in range(3)])
    pairs, counts = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    border = np.zeros(len(surface.vertices), dtype=bool)
    border[pairs[counts == 1]] = True
    both = np.concatenate([pairs, pairs[:, ::-1]])
    degree = np.bincount(both[:, 0], minlength=len(border))[:, None]
    points = values.reshape(len(border), -1)
    for _ in range(rounds):
        total = np.zeros_like(points)
        np.add.at(total, both[:, 0], points[both[:, 1]])
        points = np.where(border[:, None], points, 0.5 * points + 0.5 * total / np.maximum(degree, 1))
    return points.reshape(values.shape)


def scatter(
    surface: Surface, spacing_m: float, rng: np.random.Generator, *, where: npt.NDArray[np.bool_] | None = None
) -> Samples:
    """Random points, several per place that a sample of this spacing will take; thin them with `thinned`.

    Args:
        surface: Where.
        spacing_m: Distance that thinning will leave between samples.
        rng: Random numbers.
        where: Vertices whose triangles count, shape (V,); None for all.
    """
    a, b, c = (surface.vertices[surface.triangles[:, k]] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    if where is not None:
        area = area * where[surface.triangles].any(axis=1)
    count = int(CANDIDATES * area.sum() / spacing_m**2)
    face = rng.choice(len(area), count, p=area / area.sum())
    u, v = rng.random(count), rng.random(count)
    flip = u + v > 1
    u, v = np.where(flip, 1 - u, u), np.where(flip, 1 - v, v)
    shares = np.stack([1 - u - v, u, v], axis=1)
    corners = surface.triangles[face]

    def mixed(values: Array) -> Array:
        return np.einsum("nk,nkj->nj", shares, values[corners])

    normal = unit(mixed(surface.normals))
    return new_samples(
        position=_rounded(mixed(surface.vertices), surface, corners, shares),
        rest=mixed(surface.rest),
        normal=normal,
        texture=np.einsum("nk,nkj->nj", shares, surface.texture[face]),
        skin_weights=mixed(surface.skin_weights),
        spacing_m=spacing_m,
    )


def new_samples(
    *, position: Array, rest: Array, normal: Array, skin_weights: Array, spacing_m: float, texture: Array | None = None
) -> Samples:
    """Samples without colour whose tangent hangs down the surface."""
    count = len(position)
    down = np.broadcast_to((0.02, -1.0, 0.05), (count, 3))
    return Samples(
        position=position,
        rest=rest,
        normal=normal,
        tangent=unit(down - (down * normal).sum(1, keepdims=True) * normal),
        texture=np.full((count, 2), -1.0) if texture is None else texture,
        skin_weights=skin_weights,
        spacing=np.full(count, spacing_m),
        stretch=np.ones(count),
        colour=np.full((count, 3), 0.5),
        opacity=np.full(count, 0.99),
    )


def _rounded(points: Array, surface: Surface, corners: npt.NDArray[np.int32], shares: Array) -> Array:
    """Phong tessellation: points pulled onto the tangent planes of their triangle's corners.

    Source: Boubekeur and Alexa, Phong Tessellation, 2008.
    """
    pulled = np.zeros_like(points)
    for k in range(3):
        corner, normal = surface.vertices[corners[:, k]], surface.normals[corners[:, k]]
        distance = ((points - corner) * normal).sum(1, keepdims=True)
        pulled += shares[:, k : k + 1] * (points - distance * normal)
    return 0.4 * points + 0.6 * pulled


def masked(mask: Array, texture: Array) -> Array:
    """Values of a mask in texture space, 0..1, shape (N,)."""
    size = len(mask)
    column = np.clip((texture[:, 0] * size).astype(int), 0, size - 1)
    row = np.clip(((1 - texture[:, 1]) * size).astype(int), 0, size - 1)
    return mask[row, column] / 255.0


def thinned(samples: Samples) -> Samples:
    """Blue noise: no two samples are nearer than their spacing (the order of the samples decides)."""
    return samples.select(_dart_throw(samples.position, samples.spacing))


def hemmed(
    samples: Samples, field: Callable[[Array, Array], Array], *, row_share: float = 0.4, stretch: float = 2.4
) -> tuple[Samples, Array]:
    """Samples inside of a garment with a straight edge, and their depths [m], shape (N,).

    Samples near the edge move onto a row along it and are drawn out along the row: cut at random places, an edge frays.

    Args:
        samples: Candidates, before `thinned`.
        field: Depth inside of the garment [m] by rest positions, shape (N, 3), and skin weights, shape (N, 24).
        row_share: Depth of the row, in units of the samples' distance.
        stretch: Length of the row's samples over the usual one.
    """
    depth = field(samples.rest, samples.skin_weights)
    near = np.abs(depth - row_share * samples.spacing) < 0.75 * samples.spacing
    kept = (depth > 0) | near
    samples, depth, near = samples.select(kept), depth[kept], near[kept]
    slope = slope_of(samples, field)
    steep = np.linalg.norm(slope, axis=1)
    near &= (steep > 0.35) & (steep < 3.0)
    inward = unit(slope)
    row = row_share * samples.spacing
    moved = np.where(near, (row - depth) / np.maximum(steep, 0.35), 0.0)[:, None] * inward
    samples = samples.changed(
        position=samples.position + moved,
        rest=samples.rest + moved,
        tangent=np.where(near[:, None], unit(np.cross(samples.normal, inward)), samples.tangent),
        stretch=np.where(near, stretch, samples.stretch),
    )
    depth = np.where(near, row, depth)
    order = np.argsort(~near, kind="stable")
    order = order[depth[order] > 0]
    return samples.select(order), depth[order]


def slope_of(samples: Samples, field: Callable[[Array, Array], Array]) -> Array:
    """Gradient of a field along the surface, shape (N, 3); see `hemmed` for the field."""
    here, slope = field(samples.rest, samples.skin_weights), np.empty_like(samples.rest)
    for k in range(3):
        ahead = samples.rest.copy()
        ahead[:, k] += 0.001
        slope[:, k] = (field(ahead, samples.skin_weights) - here) / 0.001
    return slope - (slope * samples.normal).sum(1, keepdims=True) * samples.normal


def unit(vectors: Array) -> Array:
    """Vectors of length 1; zero stays zero."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)


def step(low: float | Array, high: float | Array, x: Array) -> Array:
    """Smooth step from 0 at `low` to 1 at `high`."""
    t = np.clip((x - low) / (np.asarray(high) - low), 0.0, 1.0)
    return t * t * (3 - 2 * t)


def mix(first: npt.ArrayLike, second: npt.ArrayLike, share: Array) -> Array:
    """Colours between two colours, shape (N, 3)."""
    return np.asarray(first) * (1 - share[:, None]) + np.asarray(second) * share[:, None]


@kernel_with_cache
def _dart_throw(points: Array, radius: Array) -> npt.NDArray[np.bool_]:
    cell = radius.max()
    low = np.array([points[:, 0].min(), points[:, 1].min(), points[:, 2].min()])
    size = np.array([int((points[:, k].max() - low[k]) / cell) + 1 for k in range(3)])
    first = np.full(size[0] * size[1] * size[2], -1, dtype=np.int32)
    following = np.full(len(points), -1, dtype=np.int32)
    kept = np.zeros(len(points), dtype=np.bool_)
    for n in range(len(points)):
        i, j, k = (
            int((points[n, 0] - low[0]) / cell),
            int((points[n, 1] - low[1]) / cell),
            int((points[n, 2] - low[2]) / cell),
        )
        free = True
        for a in range(max(i - 1, 0), min(i + 2, size[0])):
            for b in range(max(j - 1, 0), min(j + 2, size[1])):
                for c in range(max(k - 1, 0), min(k + 2, size[2])):
                    m = first[(a * size[1] + b) * size[2] + c]
                    while m >= 0 and free:
                        d = (
                            (points[n, 0] - points[m, 0]) ** 2
                            + (points[n, 1] - points[m, 1]) ** 2
                            + (points[n, 2] - points[m, 2]) ** 2
                        )
                        r = min(radius[n], radius[m])
                        free = d >= r * r
                        m = following[m]
        if free:
            place = (i * size[1] + j) * size[2] + k
            following[n] = first[place]
            first[place] = n
            kept[n] = True
    return kept


@kernel_with_cache
def _lattice(i: int, j: int, k: int, seed: int) -> float:
    h = np.uint32(i * 374761393 + j * 668265263 + k * 2147483647 + seed * 974634777)
    h = np.uint32((h ^ (h >> np.uint32(13))) * np.uint32(1274126177))
    h = np.uint32((h ^ (h >> np.uint32(16))) * np.uint32(2246822519))
    return (h ^ (h >> np.uint32(15))) / 2147483648.0 - 1.0


@kernel_with_cache
def noise(points: Array, seed: int) -> Array:
    """Smooth value noise in -1..1 with features of size 1, shape (N,)."""
    out = np.empty(len(points))
    for n in range(len(points)):
        i, j, k = np.floor(points[n, 0]), np.floor(points[n, 1]), np.floor(points[n, 2])
        x, y, z = points[n, 0] - i, points[n, 1] - j, points[n, 2] - k
        x, y, z = x * x * (3 - 2 * x), y * y * (3 - 2 * y), z * z * (3 - 2 * z)
        total = 0.0
        for a in range(2):
            for b in range(2):
                for c in range(2):
                    share = (x if a else 1 - x) * (y if b else 1 - y) * (z if c else 1 - z)
                    total += share * _lattice(int(i) + a, int(j) + b, int(k) + c, seed)
        out[n] = total
    return out


def visibility(samples: Samples, *, directions: int = 96, cell_m: float = 0.006, bias_m: float = 0.012) -> Array:
    """Share of the light from around that reaches each sample, brighter from above, in 0..1; shape (N,)."""
    k = np.arange(directions) + 0.5
    y = 1 - 2 * k / directions
    turn = k * np.pi * (1 + 5**0.5)
    rays = np.stack([np.sqrt(1 - y * y) * np.cos(turn), y, np.sqrt(1 - y * y) * np.sin(turn)], axis=1)
    light, best = np.zeros(len(samples)), np.zeros(len(samples))
    for ray in rays:
        strength = (0.65 + 0.35 * ray[1]) * np.clip(samples.normal @ ray + 0.15, 0.0, None)
        best += strength
        light += strength * _seen(samples.position, ray, cell_m, bias_m)
    return light / np.maximum(best, 1e-9)


def _seen(points: Array, ray: Array, cell_m: float, bias_m: float) -> npt.NDArray[np.bool_]:
    right = unit(np.cross(ray, (0.13, 0.31, 0.94)))
    plane = np.stack([points @ right, points @ np.cross(ray, right)], axis=1)
    cells = ((plane - plane.min(axis=0)) / cell_m).astype(np.int64) + 1
    return _depth_test(cells, points @ ray, bias_m)


@kernel_with_cache
def _depth_test(cells: npt.NDArray[np.int64], height: Array, bias_m: float) -> npt.NDArray[np.bool_]:
    top = np.full((cells[:, 0].max() + 2, cells[:, 1].max() + 2), -1e9)
    for n in range(len(height)):
        for a in range(cells[n, 0] - 1, cells[n, 0] + 2):
            for b in range(cells[n, 1] - 1, cells[n, 1] + 2):
                top[a, b] = max(top[a, b], height[n])
    seen = np.empty(len(height), dtype=np.bool_)
    for n in range(len(height)):
        seen[n] = height[n] >= top[cells[n, 0], cells[n, 1]] - bias_m
    return seen
