"""Surfaces as flat Gaussians: patches, boxes, tubes, blobs and rods that parts of the scene are made of.

Parts are modelled in their own frame: x to the right, y away from the viewer, z up, the front facing -y, the back at
y = 0 for what stands against a wall. `Surfaces.at` places them.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import BoolArray, Float64Array
from readygo.common.frames import quat_from_matrix
from readygo.common.scenes.embedded.textures import Colour, Texture, plain

Vector = tuple[float, float, float]
ALL_FACES = ("front", "back", "left", "right", "top", "bottom")
SIDES = ("front", "back", "left", "right")
THICKNESS_M = 0.004
OPACITY = 0.95
SOFTNESS = 0.6
"""Standard deviation over sample spacing: neighbours overlap enough to hide what is behind, edges stay crisp."""


@dataclass(frozen=True, kw_only=True, eq=False)
class UnlitPoints:
    """Points of surfaces, not yet lit."""

    position_m: Float64Array
    """Shape (N, 3)."""
    tangent: Float64Array
    """Unit vector of the first principal axis, shape (N, 3)."""
    normal: Float64Array
    """Unit normal, shape (N, 3)."""
    sigma_m: Float64Array
    """Standard deviations along tangent, bitangent and normal [m], shape (N, 3)."""
    colour: Float64Array
    """Albedo, or the colour itself where the sample glows, display values in 0..1, shape (N, 3)."""
    facing: Float64Array
    """1 for surfaces lit from their front, 0 for thin or small things lit from everywhere, shape (N,)."""
    glows: BoolArray
    """True where the colour is final, shape (N,)."""

    def quats_wxyz(self) -> Float64Array:
        """Rotations of the principal axes (tangent, bitangent, normal), shape (N, 4)."""
        bitangent = np.cross(self.normal, self.tangent)
        # Rounded: near ties of axis-aligned rotations must fall alike on all machines.
        return quat_from_matrix(np.round(np.stack([self.tangent, bitangent, self.normal], axis=-1), 9))


@dataclass(eq=False)
class _Store:
    parts: list[UnlitPoints] = field(default_factory=list)
    solid_points: list[Float64Array] = field(default_factory=list)
    clearings: list[tuple[int, Float64Array, Float64Array, Float64Array, Float64Array]] = field(default_factory=list)
    """Number of parts that a clearing touches, its R and t, its low and high corner."""


class Surfaces:
    """Collects samples, and the solids that cast shadows, in one placement."""

    def __init__(
        self,
        rng: np.random.Generator,
        *,
        spacing_factor: float = 1.0,
        mirror: npt.ArrayLike = (1.0, 1.0),
        tints: Iterator[Float64Array] | None = None,
    ) -> None:
        """An empty collection.

        Args:
            rng: For what parts leave to chance.
            spacing_factor: Scales all sample spacings (larger is coarser).
            mirror: Signs of x and y, shape (2,).
            tints: Matrices on colours, shape (3, 3): everything placed from here has the next one.
        """
        self.rng = rng
        self._factor = spacing_factor
        self._store = _Store()
        self._R = np.diag([*np.asarray(mirror), 1.0])
        self._t = np.zeros(3)
        self._tints = tints
        self._tint: Float64Array | None = None

    def at(self, x_m: float, y_m: float, z_m: float = 0.0, *, yaw_deg: float = 0.0) -> "Surfaces":
        """The surfaces with the origin moved to (x, y, z) and turned about z."""
        c, s = (round(f(math.radians(yaw_deg)), 12) for f in (math.cos, math.sin))
        placed = Surfaces(self.rng, spacing_factor=self._factor)
        placed._store = self._store
        placed._R = self._R @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        placed._t = self._R @ np.array([x_m, y_m, z_m]) + self._t
        placed._tint = next(self._tints) if self._tints is not None else self._tint
        return placed

    def samples(self) -> UnlitPoints:
        """All samples collected so far, in the order they were added."""
        parts, names = self._store.parts, UnlitPoints.__dataclass_fields__
        whole = {n: np.concatenate([getattr(part, n) for part in parts]) for n in names}
        begins = np.concatenate([[0], np.cumsum([len(part.position_m) for part in parts])])
        keep = np.ones(begins[-1], dtype=bool)
        for count, R, t, low, high in self._store.clearings:
            local = (whole["position_m"][: begins[count]] - t) @ R
            keep[: begins[count]] &= ~((local >= low) & (local <= high)).all(axis=1)
        return UnlitPoints(**{n: values[keep] for n, values in whole.items()})

    def solid_points_m(self) -> Float64Array:
        """Points that fill the solids densely enough for voxels of 5 cm, shape (M, 3)."""
        return np.concatenate(self._store.solid_points)

    def add(
        self,
        position_m: Float64Array,
        tangent: Float64Array,
        normal: Float64Array,
        sigma_m: npt.ArrayLike,
        colour: npt.ArrayLike,
        *,
        facing: float = 1.0,
        glows: bool = False,
    ) -> None:
        """Add samples given in this placement's frame; `sigma_m` and `colour` broadcast to (N, 3)."""
        count = len(position_m)
        rgb = np.asarray(colour, dtype=np.float64)
        if self._tint is not None and not glows:
            rgb = np.clip(rgb @ self._tint.T, 0.0, 1.0)
        self._store.parts.append(
            UnlitPoints(
                position_m=position_m @ self._R.T + self._t,
                tangent=_unit(np.broadcast_to(tangent, (count, 3))) @ self._R.T,
                normal=_unit(np.broadcast_to(normal, (count, 3))) @ self._R.T,
                sigma_m=np.broadcast_to(np.asarray(sigma_m, dtype=np.float64), (count, 3)),
                colour=np.broadcast_to(rgb, (count, 3)),
                facing=np.full(count, facing),
                glows=np.full(count, glows),
            )
        )

    def clear(self, low: Vector, high: Vector) -> None:
        """Drop the samples added so far whose centres lie in a box of this placement's frame.

        What lies flat on a surface needs it: Gaussians blend in the order of their centres, so that a large one
        behind a small one shines through at grazing angles.
        """
        box = (np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64))
        self._store.clearings.append((len(self._store.parts), self._R, self._t, *box))

    def solid(self, low: Vector, high: Vector) -> None:
        """Mark a box of this placement's frame as opaque to light."""
        axes = [np.linspace(a, b, max(2, math.ceil((b - a) / 0.04) + 1)) for a, b in zip(low, high, strict=True)]
        # Points stay inside, so that faces on voxel boundaries do not fill the next voxel.
        axes = [np.clip(axis, a + 0.004, b - 0.004) for axis, a, b in zip(axes, low, high, strict=True)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        self._store.solid_points.append(points @ self._R.T + self._t)

    def patch(
        self,
        origin: Vector,
        edge_u: Vector,
        edge_v: Vector,
        cell_m: float | tuple[float, float],
        texture: Texture | Colour,
        *,
        jitter: float = 0.0,
        glows: bool = False,
        softness: float = SOFTNESS,
    ) -> None:
        """A parallelogram from `origin`; its normal is edge_u x edge_v.

        Args:
            origin: A corner [m].
            edge_u: First edge [m]; textures see its length as u.
            edge_v: Second edge [m].
            cell_m: Sample spacing, or spacings along u and v.
            texture: Colours of the surface, or one colour.
            jitter: Random shift of each sample in cells, for surfaces without a regular pattern.
            glows: True keeps the texture's colour unlit.
            softness: Standard deviation over spacing.
        """
        grid = self._grid(np.asarray(origin), np.asarray(edge_u), np.asarray(edge_v), cell_m, jitter)
        colour = _paint(texture, grid.u_m, grid.v_m)
        sigma = [grid.cell_m[0] * softness, grid.cell_m[1] * softness, THICKNESS_M]
        self.add(grid.position_m, grid.tangent, grid.normal, sigma, colour, glows=glows)

    def _grid(
        self, origin: Float64Array, u: Float64Array, v: Float64Array, cell_m: float | tuple[float, float], jitter: float
    ) -> "_Grid":
        wanted = cell_m if isinstance(cell_m, tuple) else (cell_m, cell_m)
        lengths = (float(np.sqrt(u @ u)), float(np.sqrt(v @ v)))
        counts = [max(1, math.ceil(n / (c * self._factor) - 1e-6)) for n, c in zip(lengths, wanted, strict=True)]
        a, b = (((np.arange(n) + 0.5) / n) for n in counts)
        aa, bb = (grid.ravel() for grid in np.meshgrid(a, b, indexing="ij"))
        if jitter:
            aa = aa + (self.rng.random(len(aa)) - 0.5) * jitter / counts[0]
            bb = bb + (self.rng.random(len(bb)) - 0.5) * jitter / counts[1]
        return _Grid(
            position_m=origin + aa[:, None] * u + bb[:, None] * v,
            u_m=aa * lengths[0],
            v_m=bb * lengths[1],
            cell_m=(lengths[0] / counts[0], lengths[1] / counts[1]),
            tangent=u,
            normal=np.cross(u, v),
        )

    def box(
        self,
        low: Vector,
        high: Vector,
        cell_m: float | tuple[float, float],
        texture: Texture | Colour,
        *,
        faces: tuple[str, ...] = ALL_FACES,
        radius_m: float = 0.0,
        solid: bool = True,
        softness: float = SOFTNESS,
    ) -> None:
        """An axis-aligned box of this placement's frame with edges rounded by `radius_m`."""
        for face in faces:
            origin, u, v = _face(low, high, face)
            grid = self._grid(origin, u, v, cell_m, 0.0)
            position, normal, tangent = (
                grid.position_m,
                np.broadcast_to(grid.normal, grid.position_m.shape),
                grid.tangent,
            )
            if radius_m:
                position, normal = _round_corner(position, np.asarray(low), np.asarray(high), radius_m)
                tangent = _orthogonal(np.broadcast_to(_unit(tangent), position.shape), normal)
            sigma = [grid.cell_m[0] * softness, grid.cell_m[1] * softness, THICKNESS_M]
            self.add(position, tangent, normal, sigma, _paint(texture, grid.u_m, grid.v_m))
        if solid:
            self.solid(low, high)

    def fill(self, low: Vector, high: Vector, colour: Colour) -> None:
        """A hidden layer inside a hollow box: maps see no free floor in it, and views from above no hole."""
        (x0, y0, _), (x1, y1, _) = low, high
        inset = 0.06
        size = (x1 - x0 - 2 * inset, y1 - y0 - 2 * inset)
        self.patch((x0 + inset, y0 + inset, 0.3), (size[0], 0, 0), (0, size[1], 0), 0.09, colour, glows=True)

    def tube(
        self,
        centre: Vector,
        height_m: float,
        radius_low_m: float,
        radius_high_m: float,
        cell_m: float,
        texture: Texture | Colour,
        *,
        capped: bool = True,
        glows: bool = False,
    ) -> None:
        """An upright cylinder or cone standing on `centre`, closed by a disc on top."""
        rows = max(1, math.ceil(height_m / (cell_m * self._factor)))
        columns = max(6, math.ceil(2 * math.pi * max(radius_low_m, radius_high_m) / (cell_m * self._factor)))
        h, turn = np.meshgrid((np.arange(rows) + 0.5) / rows, (np.arange(columns) + 0.5) / columns, indexing="ij")
        ring = _circle(turn.ravel())
        radius = radius_low_m + (radius_high_m - radius_low_m) * h.ravel()
        position = np.asarray(centre) + np.column_stack([ring * radius[:, None], h.ravel() * height_m])
        slope = (radius_low_m - radius_high_m) / height_m
        normal = np.column_stack([ring, np.full(len(ring), slope)])
        tangent = np.column_stack([-ring[:, 1], ring[:, 0], np.zeros(len(ring))])
        around = 2 * math.pi * radius
        sigma = np.column_stack(
            [
                around / columns * SOFTNESS,
                np.full(len(h.ravel()), height_m / rows * SOFTNESS),
                np.full(len(ring), THICKNESS_M),
            ]
        )
        self.add(
            position, tangent, normal, sigma, _paint(texture, turn.ravel() * around, h.ravel() * height_m), glows=glows
        )
        if capped:
            top = (centre[0], centre[1], centre[2] + height_m)
            self.disc(top, radius_high_m * 0.95, cell_m, texture, glows=glows)
        reach = 0.7 * min(radius_low_m, radius_high_m)
        if not glows and reach > 0.02:
            self.solid(
                (centre[0] - reach, centre[1] - reach, centre[2]),
                (centre[0] + reach, centre[1] + reach, centre[2] + height_m),
            )

    def disc(
        self,
        centre: Vector,
        radius_m: float,
        cell_m: float,
        texture: Texture | Colour,
        *,
        up: bool = True,
        glows: bool = False,
    ) -> None:
        """A horizontal disc."""
        rings = max(1, math.ceil(radius_m / (cell_m * self._factor)))
        step = radius_m / rings
        counts = [max(1, round(2 * math.pi * (k + 0.5))) for k in range(rings)]
        turn = np.concatenate([(np.arange(n) + 0.5) / n for n in counts])
        radius = np.concatenate(
            [np.full(n, (k + 0.5) * step if rings > 1 or n > 1 else 0.0) for k, n in enumerate(counts)]
        )
        offset = _circle(turn) * radius[:, None]
        position = np.asarray(centre) + np.column_stack([offset, np.zeros(len(turn))])
        sigma = [step * 0.65, step * 0.65, THICKNESS_M]
        colour = _paint(texture, offset[:, 0] + radius_m, offset[:, 1] + radius_m)
        self.add(position, np.array([1.0, 0, 0]), np.array([0, 0, 1.0 if up else -1.0]), sigma, colour, glows=glows)

    def blob(
        self, centre: Vector, radii_m: Vector, cell_m: float, texture: Texture | Colour, *, glows: bool = False
    ) -> None:
        """An ellipsoid."""
        a, b, c = radii_m
        area = 4 * math.pi * ((a * b) ** 1.6 / 3 + (a * c) ** 1.6 / 3 + (b * c) ** 1.6 / 3) ** (1 / 1.6)
        count = max(12, round(area / (cell_m * self._factor) ** 2))
        direction = fibonacci_sphere(count)
        normal = _unit(direction / np.asarray(radii_m))
        tangent = _orthogonal(np.broadcast_to(np.array([0.31, 0.17, 0.93]), normal.shape), normal)
        spacing = math.sqrt(area / count)
        colour = _paint(texture, (direction[:, 0] + 1) * a, (direction[:, 2] + 1) * c)
        position = np.asarray(centre) + direction * np.asarray(radii_m)
        self.add(position, tangent, normal, [spacing * 0.65, spacing * 0.65, THICKNESS_M], colour, glows=glows)

    def rod(self, start: Vector, end: Vector, radius_m: float, colour: Colour, *, step_m: float = 0.0) -> None:
        """A thin round bar as a string of elongated Gaussians: legs, poles, stems."""
        a, b = np.asarray(start), np.asarray(end)
        length = float(np.sqrt((b - a) @ (b - a)))
        count = max(2, math.ceil(length / ((step_m or 5 * radius_m) * self._factor)))
        position = a + ((np.arange(count) + 0.5) / count)[:, None] * (b - a)
        direction = np.broadcast_to(_unit(b - a), position.shape)
        normal = _orthogonal(np.broadcast_to(np.array([0.37, -0.91, 0.19]), position.shape), direction)
        sigma = [length / count * SOFTNESS, radius_m * 0.75, radius_m * 0.75]
        self.add(position, direction, normal, sigma, plain(colour)(position[:, 0], position[:, 2]), facing=0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Grid:
    position_m: Float64Array
    u_m: Float64Array
    v_m: Float64Array
    cell_m: tuple[float, float]
    tangent: Float64Array
    normal: Float64Array


def fibonacci_sphere(count: int) -> Float64Array:
    """Evenly spread directions, shape (count, 3)."""
    k = np.arange(count, dtype=np.float64) + 0.5
    z = np.asarray(1 - 2 * k / count, dtype=np.float64)
    ring = _circle((k * 0.6180339887498949) % 1)
    sphere = np.round(np.column_stack([ring * np.sqrt(1 - z * z)[:, None], z]), 9)
    return np.asarray(sphere, dtype=np.float64)


def _circle(turn: Float64Array) -> Float64Array:
    # Rounded: cos and sin may differ in the last bit between machines.
    circle: Float64Array = np.round(np.stack([np.cos(2 * np.pi * turn), np.sin(2 * np.pi * turn)], axis=-1), 9)
    return circle


def _unit(vectors: Float64Array) -> Float64Array:
    unit: Float64Array = vectors / np.sqrt((vectors * vectors).sum(axis=-1, keepdims=True))
    return unit


def _orthogonal(vectors: Float64Array, normal: Float64Array) -> Float64Array:
    rest = vectors - (vectors * normal).sum(axis=-1, keepdims=True) * normal
    # A vector along the normal has no direction left: any other one will do.
    lost = (rest * rest).sum(axis=-1) < 1e-6
    spare = np.cross(normal, np.array([0.8, 0.5, 0.33]))
    return _unit(np.where(lost[:, None], spare, rest))


def _paint(texture: Texture | Colour, u_m: Float64Array, v_m: Float64Array) -> Float64Array:
    if callable(texture):
        return texture(u_m, v_m)
    return np.broadcast_to(np.asarray(texture, dtype=np.float64), (len(u_m), 3))


def _face(low: Vector, high: Vector, face: str) -> tuple[Float64Array, Float64Array, Float64Array]:
    (x0, y0, z0), (x1, y1, z1) = low, high
    dx, dy, dz = np.array([x1 - x0, 0, 0]), np.array([0, y1 - y0, 0]), np.array([0, 0, z1 - z0])
    return {
        "front": (np.array([x0, y0, z0]), dx, dz),
        "back": (np.array([x1, y1, z0]), -dx, dz),
        "right": (np.array([x1, y0, z0]), dy, dz),
        "left": (np.array([x0, y1, z0]), -dy, dz),
        "top": (np.array([x0, y0, z1]), dx, dy),
        "bottom": (np.array([x0, y1, z0]), dx, -dy),
    }[face]


def _round_corner(
    position: Float64Array, low: Float64Array, high: Float64Array, radius_m: float
) -> tuple[Float64Array, Float64Array]:
    reach = np.minimum(radius_m, (high - low) / 2 * 0.98)
    inner = np.clip(position, low + reach, high - reach)
    direction = (position - inner) / reach
    normal = _unit(direction)
    return inner + normal * reach, normal
