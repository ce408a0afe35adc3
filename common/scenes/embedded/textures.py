"""Procedural colours: every texture is a function of surface coordinates, exact on every machine.

Colours are display values in 0..1. Only +, -, *, /, sqrt and integer hashes are used, so that results do not depend on
the machine's vectorised transcendental functions.
"""

from collections.abc import Callable

import numpy as np

from readygo.common.arrays import Float64Array

Colour = tuple[float, float, float]
Texture = Callable[[Float64Array, Float64Array], Float64Array]
"""Maps surface coordinates u, v [m] of shape (N,) to colours of shape (N, 3)."""


def lattice_noise(i: Float64Array, j: Float64Array, seed: int) -> Float64Array:
    """Independent uniform numbers in 0..1 for integer coordinates, shape of `i`."""
    a = i.astype(np.int64).astype(np.uint64)
    b = j.astype(np.int64).astype(np.uint64)
    h = (
        a * np.uint64(0x9E3779B97F4A7C15)
        + b * np.uint64(0xC2B2AE3D27D4EB4F)
        + np.uint64(seed * 0x165667B19E3779F9 % 2**64)
    )
    h = (h ^ (h >> np.uint64(31))) * np.uint64(0xBF58476D1CE4E5B9)
    h = (h ^ (h >> np.uint64(29))) * np.uint64(0x94D049BB133111EB)
    return (h >> np.uint64(40)).astype(np.float64) / float(2**24)


def value_noise(u: Float64Array, v: Float64Array, seed: int) -> Float64Array:
    """Smooth noise in 0..1 with one lattice point per unit."""
    i, j = np.floor(u), np.floor(v)
    a, b = u - i, v - j
    a, b = a * a * (3 - 2 * a), b * b * (3 - 2 * b)
    low = lattice_noise(i, j, seed) * (1 - a) + lattice_noise(i + 1, j, seed) * a
    high = lattice_noise(i, j + 1, seed) * (1 - a) + lattice_noise(i + 1, j + 1, seed) * a
    return low * (1 - b) + high * b


def shade_colour(colour: Colour, factor: Float64Array) -> Float64Array:
    """One colour times a factor per point, clipped to 0..1, shape (N, 3)."""
    return np.clip(np.asarray(colour) * factor[:, None], 0.0, 1.0)


def mix_colours(a: Float64Array | Colour, b: Float64Array | Colour, share: Float64Array) -> Float64Array:
    """`a` where `share` is 0, `b` where it is 1, shape (N, 3)."""
    t = np.clip(share, 0.0, 1.0)[:, None]
    return np.asarray(a) * (1 - t) + np.asarray(b) * t


def plain(colour: Colour, *, variation: float = 0.03, patch_m: float = 0.5, seed: int = 1) -> Texture:
    """Paint or plastic: soft, large-scale variation and a little fine grain."""

    def texture(u: Float64Array, v: Float64Array) -> Float64Array:
        noise = value_noise(u / patch_m, v / patch_m, seed) + 0.5 * value_noise(u / 0.09, v / 0.09, seed + 1) - 0.75
        return shade_colour(colour, 1 + variation * 1.5 * noise)

    return texture


def fabric(colour: Colour, *, seed: int = 1, variation: float = 0.10) -> Texture:
    """Woven cloth: speckle at the scale of the samples and faint folds."""

    def texture(u: Float64Array, v: Float64Array) -> Float64Array:
        fine = lattice_noise(np.floor(u / 0.03), np.floor(v / 0.03), seed) - 0.5
        broad = value_noise(u / 0.22, v / 0.22, seed + 3) - 0.5
        return shade_colour(colour, 1 + variation * (fine + broad))

    return texture


def wood(colour: Colour, *, seed: int = 1, along_u: bool = True, contrast: float = 0.30) -> Texture:
    """Wood with grain along one surface direction."""

    def texture(u: Float64Array, v: Float64Array) -> Float64Array:
        along, across = (u, v) if along_u else (v, u)
        grain = value_noise(along / 0.7, across / 0.035, seed) - 0.5
        broad = value_noise(along / 1.5, across / 0.2, seed + 7) - 0.5
        return shade_colour(colour, 1 + contrast * (0.6 * grain + 0.5 * broad))

    return texture


def stripes(first: Colour, second: Colour, width_m: float, *, along_u: bool = False, seed: int = 1) -> Texture:
    """Two colours in bands of one width."""

    def texture(u: Float64Array, v: Float64Array) -> Float64Array:
        band = np.floor((v if along_u else u) / width_m) % 2
        colour = mix_colours(first, second, band)
        grain = 1 + 0.05 * (lattice_noise(np.floor(u / 0.04), np.floor(v / 0.04), seed) - 0.5)
        return colour * grain[:, None]

    return texture


def tiles(colour: Colour, grout: Colour, width_m: float, height_m: float, *, seed: int = 1) -> Texture:
    """Wall tiles in running bond; joints show where a sample falls onto one."""

    def texture(u: Float64Array, v: Float64Array) -> Float64Array:
        row = np.floor(v / height_m)
        shifted = u / width_m + 0.5 * (row % 2)
        tone = 1 + 0.16 * (lattice_noise(np.floor(shifted), row, seed) - 0.5)
        joint = np.minimum(1 - np.abs(2 * (shifted % 1) - 1), 1 - np.abs(2 * ((v / height_m) % 1) - 1)) < 0.12
        return np.where(joint[:, None], np.asarray(grout), shade_colour(colour, tone))

    return texture


def folds(colour: Colour, *, pitch_m: float = 0.12, seed: int = 1) -> Texture:
    """A hanging curtain: light and dark folds along u."""

    def texture(u: Float64Array, v: Float64Array) -> Float64Array:
        wobble = 0.35 * (value_noise(u / 0.3, v / 0.8, seed) - 0.5)
        phase = (u / pitch_m + wobble) % 1
        ridge = 1 - np.abs(2 * phase - 1)
        return shade_colour(colour, 0.72 + 0.36 * ridge)

    return texture


def rug_pattern(width_m: float, depth_m: float, palette: tuple[Colour, Colour, Colour], *, seed: int = 1) -> Texture:
    """A woven rug: border bands around a field of diamonds.

    Args:
        width_m: Extent along u.
        depth_m: Extent along v.
        palette: Field, diamonds, border.
        seed: Seed of the speckle.
    """
    field, figure, border = palette

    def texture(u: Float64Array, v: Float64Array) -> Float64Array:
        a, b = (u - width_m / 2) / 0.46, (v - depth_m / 2) / 0.46
        ring = (np.abs(a - np.floor(a + 0.5)) + np.abs(b - np.floor(b + 0.5))) * 2
        colour = mix_colours(field, figure, (ring < 0.55).astype(float))
        colour = mix_colours(colour, border, ((ring > 0.22) & (ring < 0.36)).astype(float))
        edge = np.minimum(np.minimum(u, width_m - u), np.minimum(v, depth_m - v))
        colour = mix_colours(colour, border, (edge < 0.20).astype(float))
        colour = mix_colours(colour, figure, ((edge > 0.08) & (edge < 0.13)).astype(float))
        grain = 1 + 0.14 * (lattice_noise(np.floor(u / 0.04), np.floor(v / 0.04), seed) - 0.5)
        return np.clip(colour * grain[:, None], 0, 1)

    return texture


def painting(motif: int, width_m: float, height_m: float, *, seed: int = 1) -> Texture:
    """A canvas; `motif` modulo 5 picks hills, abstract fields, a seascape, a still life or a geometric grid."""
    draw = (_hills, _fields, _sea, _still_life, _mosaic)[motif % 5]

    def texture(u: Float64Array, v: Float64Array) -> Float64Array:
        x, y = u / width_m, v / height_m
        brush = 1 + 0.16 * (value_noise(x * 14, y * 14, seed + 9) - 0.5)
        return np.clip(draw(x, y, seed) * brush[:, None], 0, 1)

    return texture


def _hills(x: Float64Array, y: Float64Array, seed: int) -> Float64Array:
    colour = mix_colours((0.98, 0.83, 0.55), (0.36, 0.56, 0.80), (y - 0.45) * 1.8)
    for k, tone in enumerate([(0.50, 0.55, 0.66), (0.36, 0.49, 0.42), (0.25, 0.36, 0.20), (0.55, 0.50, 0.18)]):
        ridge = 0.60 - 0.15 * k + 0.24 * (value_noise(x * (2.2 + k), x * 0, seed + k) - 0.5)
        colour = mix_colours(colour, tone, (y < ridge).astype(float))
    sun = (x - 0.7) ** 2 + ((y - 0.76) * 0.8) ** 2
    return mix_colours(colour, (1.0, 0.95, 0.80), (sun < 0.006).astype(float))


def _fields(x: Float64Array, y: Float64Array, seed: int) -> Float64Array:
    colour = np.broadcast_to(np.asarray((0.92, 0.88, 0.80)), (len(x), 3)).copy()
    tones = [(0.80, 0.25, 0.18), (0.13, 0.23, 0.42), (0.93, 0.69, 0.20), (0.20, 0.45, 0.44)]
    for k, tone in enumerate(tones):
        cx, cy = 0.25 + 0.5 * (k % 2), 0.28 + 0.44 * (k // 2)
        blot = value_noise(x * 3.1 + 7 * k, y * 3.1, seed + k) - 0.5
        reach = (x - cx) ** 2 + (y - cy) ** 2 + 0.12 * blot
        colour = mix_colours(colour, tone, (reach < 0.055).astype(float))
    return colour


def _sea(x: Float64Array, y: Float64Array, seed: int) -> Float64Array:
    sky = mix_colours((0.88, 0.90, 0.90), (0.35, 0.60, 0.82), (y - 0.5) * 2.2)
    cloud = value_noise(x * 4, y * 9, seed) > 0.66
    sky = mix_colours(sky, (0.98, 0.97, 0.95), cloud.astype(float) * 0.8)
    wave = value_noise(x * 9, y * 28, seed + 2)
    sea = mix_colours((0.05, 0.28, 0.42), (0.32, 0.62, 0.66), wave)
    colour = np.where((y < 0.46)[:, None], sea, sky)
    sail = (np.abs(x - 0.36) < (0.74 - y) * 0.34) & (y > 0.44) & (y < 0.74)
    return mix_colours(colour, (0.96, 0.94, 0.88), sail.astype(float))


def _still_life(x: Float64Array, y: Float64Array, seed: int) -> Float64Array:
    colour = mix_colours((0.30, 0.20, 0.15), (0.50, 0.42, 0.33), y + 0.4 * (value_noise(x * 3, y * 3, seed) - 0.5))
    colour = mix_colours(colour, (0.62, 0.44, 0.26), (y < 0.30).astype(float))
    fruits = [(0.28, 0.36, 0.15, (0.83, 0.24, 0.15)), (0.50, 0.32, 0.13, (0.92, 0.62, 0.15))]
    fruits += [(0.70, 0.36, 0.16, (0.48, 0.62, 0.20)), (0.48, 0.56, 0.12, (0.78, 0.40, 0.48))]
    for cx, cy, radius, tone in fruits:
        reach = np.sqrt((x - cx) ** 2 + ((y - cy) * 0.8) ** 2) / radius
        light = 1.2 - 0.5 * reach
        colour = np.where((reach < 1)[:, None], shade_colour(tone, light), colour)
    return colour


def _mosaic(x: Float64Array, y: Float64Array, seed: int) -> Float64Array:
    i, j = np.floor(x * 6), np.floor(y * 5)
    palette = np.array(
        [
            [0.88, 0.35, 0.22],
            [0.95, 0.78, 0.36],
            [0.20, 0.40, 0.55],
            [0.93, 0.91, 0.84],
            [0.33, 0.58, 0.48],
            [0.2, 0.2, 0.25],
        ]
    )
    return palette[np.floor(lattice_noise(i, j, seed) * 5.999).astype(np.int64)]
