"""Baked light: windows, lamps and the sun with shadows, and one bounce gathered over the hemisphere.

Rays walk a voxel grid of the solids. Only IEEE-exact operations decide where a ray goes, so the bake is the same on
every machine.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from readygo.common.arrays import Float64Array, UInt8Array
from readygo.common.kernels import kernel_with_cache
from readygo.common.scenes.embedded.surfaces import UnlitPoints, fibonacci_sphere

VOXEL_M = 0.05
_START_M = 0.055
_GATHER_RAYS = 48
_CELL_VOXELS = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class Lights:
    """What shines on the scene; radiances are relative to a white wall in normal room light."""

    position_m: Float64Array
    """Points on windows and lamps, shape (L, 3)."""
    direction: Float64Array
    """Unit direction that a point shines to; zero shines everywhere, shape (L, 3)."""
    power: Float64Array
    """Linear rgb times area [m2], shape (L, 3)."""
    sun_direction: Float64Array
    """Unit vector to the sun, shape (3,)."""
    sun_power: Float64Array
    """Linear rgb irradiance of a surface that faces the sun, shape (3,)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ShadowGrid:
    """Solid voxels."""

    origin_m: Float64Array
    """Corner of the grid, shape (3,)."""
    solid: UInt8Array
    """1 where light is blocked, shape (X, Y, Z)."""


def voxelise(points_m: Float64Array, low_m: Float64Array, high_m: Float64Array) -> ShadowGrid:
    """Mark the voxels that hold a point.

    Args:
        points_m: Points inside solids, shape (M, 3).
        low_m: Corner of the grid, shape (3,).
        high_m: Opposite corner, shape (3,).
    """
    shape = np.ceil((high_m - low_m) / VOXEL_M - 1e-6).astype(np.int64)
    solid = np.zeros(shape, dtype=np.uint8)
    index = np.floor((points_m - low_m) / VOXEL_M).astype(np.int64)
    index = index[((index >= 0) & (index < shape)).all(axis=1)]
    solid[index[:, 0], index[:, 1], index[:, 2]] = 1
    return ShadowGrid(origin_m=low_m, solid=solid)


def lit_colours(samples: UnlitPoints, grid: ShadowGrid, lights: Lights) -> Float64Array:
    """Display colours of samples in the light of `lights`.

    Args:
        samples: Surfaces; glowing ones keep their colour.
        grid: What casts shadows.
        lights: What shines.

    Returns:
        Colours in 0..1, shape (N, 3).
    """
    albedo = samples.colour * samples.colour
    start = (samples.position_m + samples.normal * _START_M - grid.origin_m) / VOXEL_M
    # Rounding hides the last bits of matrix products; the shift keeps starts off the voxels' boundaries.
    start, normal = np.round(start, 6) + 3.7e-4, np.round(samples.normal, 9)
    direct = np.zeros_like(albedo)
    light_at = (lights.position_m - grid.origin_m) / VOXEL_M
    _direct(grid.solid, start, normal, samples.facing, light_at, lights.direction, lights.power, direct)
    _sun(grid.solid, start, samples, lights, direct)
    bounced = albedo * direct
    bounced[samples.glows] = albedo[samples.glows]
    radiance = _surface_radiance(samples, grid, bounced)
    gathered = np.zeros_like(albedo)
    share = np.zeros(len(albedo))
    rays = fibonacci_sphere(2 * _GATHER_RAYS)
    _gather(grid.solid, start, normal, samples.facing, rays, radiance, gathered, share)
    # One bounce is gathered; the factor stands for the later ones. `share` is how open the surroundings are.
    light = direct + 1.9 * gathered
    light *= (0.45 + 0.55 * np.minimum(1.0, share / 0.75))[:, None]
    return np.where(samples.glows[:, None], samples.colour, _display(albedo * light))


def _display(radiance: Float64Array) -> Float64Array:
    # Extended Reinhard with white at 3, then gamma 2: both exact in IEEE arithmetic.
    bright = radiance * (1 + radiance / 9.0) / (1 + radiance)
    return np.sqrt(np.clip(bright * 1.25, 0.0, 1.0))


def _sun(solid: UInt8Array, start: Float64Array, samples: UnlitPoints, lights: Lights, direct: Float64Array) -> None:
    cosine = np.maximum((samples.normal * lights.sun_direction).sum(axis=1), 0.0)
    cosine = np.where(samples.facing > 0, cosine, 0.5)
    bitangent = np.cross(samples.normal, samples.tangent)
    seen = np.zeros(len(start))
    offsets = ((-0.6, -0.6), (-0.6, 0.6), (0.6, -0.6), (0.6, 0.6))
    for a, b in offsets:
        shift = a * samples.sigma_m[:, :1] * samples.tangent + b * samples.sigma_m[:, 1:2] * bitangent
        seen += _escapes(solid, start + shift / VOXEL_M, lights.sun_direction, cosine > 0)
    direct += (seen / len(offsets) * cosine)[:, None] * lights.sun_power


def _surface_radiance(samples: UnlitPoints, grid: ShadowGrid, radiance: Float64Array) -> Float64Array:
    """Mean radiance of coarse cells per face direction, shape (X, Y, Z, 6, 3); cells without samples take the mean."""
    shape = tuple(-(-n // _CELL_VOXELS) for n in grid.solid.shape)
    axis = np.argmax(np.abs(samples.normal), axis=1)
    sign = np.take_along_axis(samples.normal, axis[:, None], axis=1)[:, 0] > 0
    index = np.floor((samples.position_m + samples.normal * 0.01 - grid.origin_m) / (VOXEL_M * _CELL_VOXELS))
    i, j, k = (np.clip(index[:, n], 0, shape[n] - 1).astype(np.int64) for n in range(3))
    flat = (((i * shape[1] + j) * shape[2] + k) * 6) + axis * 2 + sign
    size = shape[0] * shape[1] * shape[2] * 6
    count = np.bincount(flat, minlength=size)
    total = np.stack([np.bincount(flat, weights=radiance[:, c], minlength=size) for c in range(3)], axis=1)
    mean: Float64Array = np.where(count[:, None] > 0, total / np.maximum(count, 1)[:, None], radiance.mean(axis=0))
    return mean.reshape(*shape, 6, 3)


@kernel_with_cache
def _walk(solid: Any, x: Any, y: Any, z: Any, dx: Any, dy: Any, dz: Any, reach: Any) -> Any:
    """First solid voxel along a ray: (distance, i, j, k, face), or distance -1 when nothing is hit within `reach`.

    Solid voxels around the start are passed through until the ray has been free once, so that surfaces which lie
    inside a voxel of the solid that they bound do not shade themselves.
    """
    nx, ny, nz = solid.shape
    i, j, k = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
    far = 1e30
    step_x, step_y, step_z = (1 if dx > 0 else -1), (1 if dy > 0 else -1), (1 if dz > 0 else -1)
    delta_x = abs(1.0 / dx) if dx != 0.0 else far
    delta_y = abs(1.0 / dy) if dy != 0.0 else far
    delta_z = abs(1.0 / dz) if dz != 0.0 else far
    next_x = ((i + 1 - x) if dx > 0 else (x - i)) * delta_x if dx != 0.0 else far
    next_y = ((j + 1 - y) if dy > 0 else (y - j)) * delta_y if dy != 0.0 else far
    next_z = ((k + 1 - z) if dz > 0 else (z - k)) * delta_z if dz != 0.0 else far
    t = 0.0
    face = 0
    was_free = False
    while t < reach:
        if i < 0 or j < 0 or k < 0 or i >= nx or j >= ny or k >= nz:
            return -1.0, i, j, k, face
        if solid[i, j, k] == 0:
            was_free = True
        elif was_free or t > 2.0:
            return t, i, j, k, face
        if next_x <= next_y and next_x <= next_z:
            t, i, next_x, face = next_x, i + step_x, next_x + delta_x, (0 if dx > 0 else 1)
        elif next_y <= next_z:
            t, j, next_y, face = next_y, j + step_y, next_y + delta_y, (2 if dy > 0 else 3)
        else:
            t, k, next_z, face = next_z, k + step_z, next_z + delta_z, (4 if dz > 0 else 5)
    return -1.0, i, j, k, face


@kernel_with_cache
def _is_blocked(solid: Any, x: float, y: float, z: float) -> Any:
    nx, ny, nz = solid.shape
    i, j, k = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
    return i < 0 or j < 0 or k < 0 or i >= nx or j >= ny or k >= nz or solid[i, j, k] != 0


@kernel_with_cache
def _direct(solid: Any, start: Any, normal: Any, facing: Any, light: Any, direction: Any, power: Any, out: Any) -> None:
    """Add the light that arrives straight from windows and lamps (positions in voxels)."""
    for n in range(len(start)):
        for m in range(len(light)):
            x, y, z = light[m, 0] - start[n, 0], light[m, 1] - start[n, 1], light[m, 2] - start[n, 2]
            square = x * x + y * y + z * z
            distance = np.sqrt(square)
            if distance < 1e-6:
                continue
            x, y, z = x / distance, y / distance, z / distance
            cosine = normal[n, 0] * x + normal[n, 1] * y + normal[n, 2] * z if facing[n] > 0 else 0.5
            if cosine <= 0.0:
                continue
            lx, ly, lz = direction[m, 0], direction[m, 1], direction[m, 2]
            if lx != 0.0 or ly != 0.0 or lz != 0.0:
                cosine *= max(0.0, -(lx * x + ly * y + lz * z))
            weight = cosine / (square * 0.0025 + 0.15)
            if weight * (power[m, 0] + power[m, 1] + power[m, 2]) < 3e-4:
                continue
            if _walk(solid, start[n, 0], start[n, 1], start[n, 2], x, y, z, distance - 0.5)[0] < 0.0:
                for c in range(3):
                    out[n, c] += weight * power[m, c]


@kernel_with_cache
def _escapes(solid: Any, start: Any, direction: Any, wanted: Any) -> Any:
    """1 for starts whose ray leaves the grid, shape (N,)."""
    free = np.zeros(len(start))
    for n in range(len(start)):
        x, y, z = start[n, 0], start[n, 1], start[n, 2]
        # A footprint that reaches into a solid there is in the dark, not behind it in the open.
        lit = wanted[n] and not _is_blocked(solid, x, y, z)
        if lit and _walk(solid, x, y, z, direction[0], direction[1], direction[2], 1e6)[0] < 0.0:
            free[n] = 1.0
    return free


@kernel_with_cache
def _gather(solid: Any, start: Any, normal: Any, facing: Any, rays: Any, radiance: Any, out: Any, share: Any) -> None:
    """Cosine-weighted mean of the radiance seen from each start, and the share of near rays that are free."""
    for n in range(len(start)):
        total = 0.0
        for m in range(len(rays)):
            x, y, z = rays[m, 0], rays[m, 1], rays[m, 2]
            cosine = normal[n, 0] * x + normal[n, 1] * y + normal[n, 2] * z if facing[n] > 0 else 0.5
            if cosine <= 0.0:
                continue
            total += cosine
            t, i, j, k, face = _walk(solid, start[n, 0], start[n, 1], start[n, 2], x, y, z, 140.0)
            share[n] += cosine * (1.0 if t < 0.0 else min(1.0, t / 8.0))
            if t >= 0.0:
                for c in range(3):
                    out[n, c] += cosine * radiance[i // 4, j // 4, k // 4, face, c]
        for c in range(3):
            out[n, c] /= max(total, 1e-9)
        share[n] /= max(total, 1e-9)
