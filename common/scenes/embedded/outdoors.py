"""What the windows show: sky, lawn, hedges, trees and hills, bright and cheap."""

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.scenes.embedded.surfaces import Surfaces, fibonacci_sphere
from readygo.common.scenes.embedded.textures import lattice_noise, mix_colours, shade_colour, value_noise

_SKY_RADIUS_M = 90.0
_GROUND_Z_M = -0.35


def build_outdoors(build: Surfaces) -> None:
    """Everything outside of the flat; all of it glows, nothing casts shadows."""
    _sky(build)
    _hills(build)
    _lawn(build)
    _ground_below(build)
    for k, (x, y) in enumerate(_ring(13, 11.0, 3.0, 71)):
        _tree(build.at(float(x), float(y), _GROUND_Z_M), 3.2 + 0.35 * (k % 5), seed=k)
    for x, y in _ring(40, 8.7, 0.5, 73):
        _shrub(build.at(float(x), float(y), _GROUND_Z_M))


def _ring(count: int, radius_m: float, spread_m: float, seed: int) -> Float64Array:
    k = np.arange(count, dtype=np.float64)
    turn = (k + 0.7 * lattice_noise(k, k * 0, seed)) / count
    radius = radius_m + spread_m * lattice_noise(k, k * 0 + 1, seed)
    circle = np.round(np.column_stack([np.cos(2 * np.pi * turn), np.sin(2 * np.pi * turn)]), 9)
    return circle * radius[:, None]


def _sky(build: Surfaces) -> None:
    direction = fibonacci_sphere(2600)
    direction = direction[direction[:, 2] > -0.06]
    height = direction[:, 2]
    colour = mix_colours((0.93, 0.95, 0.97), (0.50, 0.70, 0.93), np.sqrt(np.clip(height, 0, 1)) * 1.15)
    cloud = value_noise(direction[:, 0] * 5, direction[:, 1] * 5 + height * 9, 81)
    cloud = cloud + 0.5 * value_noise(direction[:, 0] * 13, direction[:, 1] * 13 + height * 25, 82)
    colour = mix_colours(colour, (1.0, 1.0, 1.0), (cloud - 0.72) * 3.0 * np.clip(height * 8, 0, 1))
    tangent = np.column_stack([-direction[:, 1], direction[:, 0], np.zeros(len(direction))]) + 1e-9
    spacing = _SKY_RADIUS_M * 0.07
    sigma = [spacing * 0.72, spacing * 0.72, 0.3]
    build.add(direction * _SKY_RADIUS_M, tangent, -direction, sigma, colour, glows=True)


def _hills(build: Surfaces) -> None:
    for radius, top, colour, seed in ((70.0, 9.0, (0.66, 0.76, 0.80), 91), (45.0, 4.2, (0.52, 0.66, 0.53), 92)):
        count = 120
        k = np.arange(count, dtype=np.float64)
        ring = np.round(np.column_stack([np.cos(2 * np.pi * k / count), np.sin(2 * np.pi * k / count)]), 9)
        ridge = top * (0.35 + 0.65 * value_noise(k * 14 / count, k * 0, seed))
        for layer in range(2):
            z = ridge * (0.75 - 0.5 * layer) - 1.0
            tone = 0.95 + 0.10 * lattice_noise(k, k * 0 + layer, seed)
            step = 2 * np.pi * radius / count
            sigma = np.column_stack([np.full(count, step * 0.7), ridge * 0.30 + 0.4, np.full(count, 0.2)])
            tangent = np.column_stack([-ring[:, 1], ring[:, 0], np.zeros(count)])
            normal = -np.column_stack([ring, np.zeros(count)])
            build.add(
                np.column_stack([ring * radius, z]), tangent, normal, sigma, shade_colour(colour, tone), glows=True
            )


def _lawn(build: Surfaces) -> None:
    radii = 6.0 * 1.16 ** np.arange(16)
    for k, radius in enumerate(radii):
        count = 56
        n = np.arange(count, dtype=np.float64) + 0.5 * (k % 2)
        ring = np.round(np.column_stack([np.cos(2 * np.pi * n / count), np.sin(2 * np.pi * n / count)]), 9)
        tone = 0.85 + 0.25 * lattice_noise(n * 2, n * 0 + k, 95)
        colour = mix_colours(shade_colour((0.46, 0.62, 0.30), tone), (0.62, 0.72, 0.58), np.full(count, radius / 60.0))
        tangent = np.column_stack([-ring[:, 1], ring[:, 0], np.zeros(count)])
        sigma = [radius * 0.112 * 0.7, radius * 0.15 * 0.7, 0.02]
        position = np.column_stack([ring * radius, np.full(count, _GROUND_Z_M)])
        # The lawn must not reach below the house: it would shine through the floor.
        keep = (np.abs(position[:, 0]) > 5.4 + 2.5 * sigma[0]) | (np.abs(position[:, 1]) > 5.0 + 2.5 * sigma[0])
        build.add(position[keep], tangent[keep], np.array([0.0, 0.0, 1.0]), sigma, colour[keep], glows=True)


def _ground_below(build: Surfaces) -> None:
    """Earth that shows through gaps of the floor; nearer to it, it would also show through at grazing angles."""
    build.patch((-5.4, -5.0, -0.25), (10.8, 0, 0), (0, 10.0, 0), 0.25, (0.48, 0.37, 0.27), glows=True, softness=0.7)


def _tree(build: Surfaces, height_m: float, *, seed: int) -> None:
    trunk = np.column_stack([np.zeros(5), np.zeros(5), (np.arange(5) + 0.5) * height_m * 0.1])
    axis = np.array([0.0, 0.0, 1.0])
    build.add(trunk, axis, np.array([1.0, 0.0, 0.0]), [height_m * 0.07, 0.09, 0.09], (0.40, 0.33, 0.26), glows=True)
    direction = fibonacci_sphere(130)
    k = np.arange(130, dtype=np.float64)
    reach = 0.45 + 0.55 * lattice_noise(k, k * 0 + seed, 97)
    crown = direction * reach[:, None] * np.array([0.30, 0.30, 0.36]) * height_m + np.array([0, 0, height_m * 0.68])
    light = 0.72 + 0.35 * direction[:, 2] * reach + 0.3 * lattice_noise(k, k * 0 + seed, 98)
    base = ((0.42, 0.60, 0.28), (0.55, 0.64, 0.28), (0.34, 0.55, 0.34))[seed % 3]
    tangent = direction + np.array([0.3, 0.7, 0.2])
    normal = np.cross(tangent, direction + np.array([0.5, 0.1, -0.4]))
    sigma = [height_m * 0.055, height_m * 0.04, height_m * 0.02]
    build.add(crown, tangent, normal, sigma, np.clip(shade_colour(base, light), 0, 1), glows=True)


def _shrub(build: Surfaces) -> None:
    direction = fibonacci_sphere(34)
    direction = direction[direction[:, 2] > -0.3]
    k = np.arange(len(direction), dtype=np.float64)
    light = 0.8 + 0.4 * direction[:, 2] + 0.25 * lattice_noise(k, k * 0, 99)
    tangent = direction + np.array([0.3, 0.7, 0.2])
    normal = np.cross(tangent, np.array([0.5, 0.1, -0.4]))
    position = direction * np.array([0.65, 0.65, 0.55]) + np.array([0, 0, 0.35])
    build.add(position, tangent, normal, [0.17, 0.13, 0.06], shade_colour((0.36, 0.50, 0.26), light), glows=True)
