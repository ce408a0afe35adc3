"""Plants, lamps, pictures, curtains and small things."""

import math

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.scenes.embedded.surfaces import Surfaces, fibonacci_sphere
from readygo.common.scenes.embedded.textures import (
    Colour,
    fabric,
    folds,
    mix_colours,
    painting,
    plain,
    rug_pattern,
    shade_colour,
    wood,
)

_WARM_LIGHT = (1.0, 0.93, 0.78)


def picture(
    build: Surfaces, motif: int, size_m: tuple[float, float], *, z_m: float = 1.45, frame: Colour = (0.14, 0.12, 0.11)
) -> None:
    """A framed canvas on the wall, centred at x = 0 and height `z_m`."""
    width, height = size_m
    x, z = width / 2, z_m - height / 2
    build.clear((-x, -0.005, z), (x, 0.005, z + height))
    build.patch(
        (-x, -0.025, z),
        (width, 0, 0),
        (0, 0, height),
        0.04,
        painting(motif, width, height, seed=motif * 7 + 1),
        softness=0.52,
    )
    bars = [(-x - 0.035, -x, z - 0.035, z + height + 0.035), (x, x + 0.035, z - 0.035, z + height + 0.035)]
    bars += [(-x, x, z - 0.035, z), (-x, x, z + height, z + height + 0.035)]
    for x0, x1, z0, z1 in bars:
        cell = (0.035, 0.1) if z1 - z0 > x1 - x0 else (0.1, 0.035)
        build.box(
            (x0, -0.035, z0), (x1, 0, z1), cell, frame, faces=("front", "left", "right", "top", "bottom"), solid=False
        )


def curtain(build: Surfaces, begin_m: float, end_m: float, colour: Colour, *, top_m: float = 2.4) -> None:
    """A curtain along the wall with soft folds and its rod's end."""
    width = end_m - begin_m
    build.patch((begin_m, -0.10, 0.03), (width, 0, 0), (0, 0, top_m - 0.03), (0.03, 0.16), folds(colour, pitch_m=0.115))
    build.patch((begin_m, -0.03, 0.03), (0, -0.07, 0), (0, 0, top_m - 0.03), (0.07, 0.2), _scale_colour(colour, 0.8))
    build.patch((end_m, -0.10, 0.03), (0, 0.07, 0), (0, 0, top_m - 0.03), (0.07, 0.2), _scale_colour(colour, 0.8))
    build.solid((begin_m, -0.09, 0.03), (end_m, -0.05, top_m))


def curtain_rod(build: Surfaces, begin_m: float, end_m: float) -> None:
    """The rod that curtains hang from."""
    build.rod((begin_m, -0.09, 2.42), (end_m, -0.09, 2.42), 0.016, (0.25, 0.22, 0.20))


def potted_plant(build: Surfaces, height_m: float, *, pot: Colour = (0.80, 0.46, 0.32), leaves: int = 170) -> None:
    """A bushy plant in a pot."""
    rng = build.rng
    build.tube((0, 0, 0), 0.30, 0.13, 0.17, 0.05, plain(pot, variation=0.1))
    build.disc((0, 0, 0.285), 0.155, 0.06, (0.20, 0.14, 0.10))
    for k in range(3):
        x = 0.05 * (k - 1)
        build.rod((x * 0.5, 0, 0.28), (x * 2, 0.03 * k, height_m * 0.72), 0.014, (0.35, 0.26, 0.16))
    radius = 0.19 + 0.13 * height_m
    direction = fibonacci_sphere(leaves)
    reach = 0.55 + 0.45 * rng.random(leaves)
    middle, half = 0.62 * height_m + 0.08, 0.40 * height_m
    position = direction * reach[:, None] * np.array([radius, radius, half]) + np.array([0, 0, middle])
    tangent = direction + 0.8 * (rng.random((leaves, 3)) - 0.5)
    normal = np.cross(tangent, rng.random((leaves, 3)) - 0.5)
    tone = (0.62 + 0.75 * rng.random(leaves)) * (0.75 + 0.35 * reach)
    colour = np.clip(np.array([0.24, 0.45, 0.18]) * tone[:, None], 0, 1)
    build.add(position, tangent, normal, [0.065, 0.028, 0.004], colour, facing=0.0)
    build.solid((-0.15, -0.15, middle - 0.1), (0.15, 0.15, middle + 0.2))


def palm(build: Surfaces, height_m: float, *, pot: Colour = (0.88, 0.87, 0.84), fronds: int = 13) -> None:
    """A plant of long arching leaves in a basket."""
    build.tube((0, 0, 0), 0.34, 0.16, 0.19, 0.05, fabric(pot, variation=0.2))
    build.disc((0, 0, 0.32), 0.17, 0.06, (0.20, 0.14, 0.10))
    for k in range(fronds):
        leaf = build.at(0, 0, 0.30, yaw_deg=137.5 * k)
        lean = 0.25 + 0.6 * float(build.rng.random())
        s = (np.arange(12) + 0.5) / 12
        x = lean * (0.25 * s + 0.40 * s * s)
        z = (height_m - 0.3) * (1.25 * s - 0.55 * lean * s * s)
        step = np.gradient(np.column_stack([x, np.zeros(12), z]), axis=0)
        width = 0.012 + 0.036 * 4 * s * (1 - s)
        tone = (0.7 + 0.5 * float(build.rng.random())) * (0.8 + 0.35 * s)
        colour = np.clip(np.array([0.27, 0.47, 0.20]) * tone[:, None], 0, 1)
        sigma = np.column_stack([np.full(12, 0.055 * height_m), width, np.full(12, 0.004)])
        normal = np.column_stack([-step[:, 2], np.full(12, 0.004), step[:, 0]])
        leaf.add(np.column_stack([x, np.zeros(12), z]), step, normal, sigma, colour, facing=0.0)


def floor_lamp(build: Surfaces, *, height_m: float = 1.6) -> None:
    """A standing lamp that is on."""
    build.tube((0, 0, 0), 0.03, 0.15, 0.14, 0.06, (0.18, 0.17, 0.16))
    build.rod((0, 0, 0.02), (0, 0, height_m - 0.2), 0.014, (0.20, 0.19, 0.18))
    _shade(build, height_m - 0.30, 0.30, 0.21, 0.15)


def table_lamp(build: Surfaces, z_m: float) -> None:
    """A small lamp that is on, standing at height `z_m`."""
    build.blob((0, 0, z_m + 0.10), (0.07, 0.07, 0.10), 0.04, plain((0.35, 0.50, 0.55)))
    _shade(build, z_m + 0.22, 0.18, 0.14, 0.10)


def pendant(build: Surfaces, z_m: float, *, radius_m: float = 0.22) -> None:
    """A hanging lamp that is on, its shade's lower rim at height `z_m`."""
    build.rod((0, 0, z_m + 0.2), (0, 0, 2.6), 0.007, (0.12, 0.12, 0.12), step_m=0.12)
    build.tube((0, 0, z_m), 0.2, radius_m, 0.06, 0.045, (0.16, 0.30, 0.33))
    build.disc((0, 0, z_m + 0.02), radius_m * 0.85, 0.05, _WARM_LIGHT, up=False, glows=True)


def ceiling_lamp(build: Surfaces) -> None:
    """A flat round lamp below the ceiling."""
    build.tube((0, 0, 2.52), 0.08, 0.20, 0.22, 0.06, _WARM_LIGHT, capped=False, glows=True)
    build.disc((0, 0, 2.52), 0.20, 0.06, (1.0, 0.97, 0.88), up=False, glows=True)


def _shade(build: Surfaces, z_m: float, height_m: float, low_m: float, high_m: float) -> None:
    build.tube((0, 0, z_m), height_m, low_m, high_m, 0.05, _shade_glow, capped=False, glows=True)
    build.disc((0, 0, z_m + 0.03), low_m * 0.9, 0.05, (1.0, 0.96, 0.82), up=False, glows=True)
    build.disc((0, 0, z_m + height_m - 0.01), high_m * 0.9, 0.05, (1.0, 0.96, 0.82), glows=True)


def _shade_glow(u: Float64Array, v: Float64Array) -> Float64Array:
    middle = 1 - np.abs(v - 0.12) * 1.3
    return shade_colour((0.98, 0.85, 0.62), 0.80 + 0.22 * middle)


def rug(
    build: Surfaces, width_m: float, depth_m: float, palette: tuple[Colour, Colour, Colour], *, cell_m: float = 0.055
) -> None:
    """A rug centred in x and y, lying on the floor."""
    texture = rug_pattern(width_m, depth_m, palette)
    build.clear((-width_m / 2, -depth_m / 2, -0.005), (width_m / 2, depth_m / 2, 0.005))
    build.patch((-width_m / 2, -depth_m / 2, 0.010), (width_m, 0, 0), (0, depth_m, 0), cell_m, texture, softness=0.60)


def television(build: Surfaces, z_m: float) -> None:
    """A flat screen on a foot, centred in x, its back towards y = 0."""
    build.box((-0.22, -0.30, z_m), (0.22, -0.12, z_m + 0.02), 0.07, (0.12, 0.12, 0.13), solid=False)
    build.rod((0, -0.2, z_m), (0, -0.2, z_m + 0.12), 0.03, (0.12, 0.12, 0.13))
    build.box((-0.56, -0.24, z_m + 0.08), (0.56, -0.20, z_m + 0.74), 0.07, (0.07, 0.07, 0.08))
    build.patch((-0.53, -0.243, z_m + 0.11), (1.06, 0, 0), (0, 0, 0.60), 0.06, _screen, glows=True)


def _screen(u: Float64Array, v: Float64Array) -> Float64Array:
    glare = np.clip(1 - np.abs(u - 0.5 * v - 0.45) * 2.2, 0, 1)
    return mix_colours((0.07, 0.08, 0.10), (0.17, 0.19, 0.23), glare)


def monitor_desk_set(build: Surfaces, z_m: float) -> None:
    """A screen, a keyboard, a mug and papers on a desk, seen from -y."""
    build.box((-0.30, -0.05, z_m + 0.12), (0.30, -0.02, z_m + 0.48), 0.05, (0.10, 0.10, 0.11))
    build.patch((-0.28, -0.053, z_m + 0.14), (0.56, 0, 0), (0, 0, 0.32), 0.045, painting(2, 0.56, 0.32), glows=True)
    build.rod((0, -0.03, z_m), (0, -0.03, z_m + 0.14), 0.025, (0.2, 0.2, 0.2))
    build.box(
        (-0.24, -0.32, z_m), (0.20, -0.18, z_m + 0.02), 0.045, (0.22, 0.22, 0.24), faces=("top", "front"), solid=False
    )
    build.tube((0.42, -0.22, z_m), 0.10, 0.04, 0.04, 0.03, (0.75, 0.25, 0.20))
    build.patch((-0.66, -0.34, z_m + 0.004), (0.21, 0.03, 0), (-0.03, 0.29, 0), 0.05, (0.93, 0.93, 0.90))


def vase(build: Surfaces, z_m: float, colour: Colour, *, flowers: Colour = (0.90, 0.45, 0.42)) -> None:
    """A vase with flowers standing at height `z_m`."""
    build.blob((0, 0, z_m + 0.10), (0.065, 0.065, 0.10), 0.035, plain(colour))
    for k, direction in enumerate(fibonacci_sphere(26)[:17]):
        tip = np.array([0.12, 0.12, 0.11]) * direction + np.array([0, 0, z_m + 0.30])
        tone = _scale_colour(flowers, 0.8 + 0.4 * (k % 3) / 2) if k % 3 else (0.30, 0.48, 0.22)
        build.blob((float(tip[0]), float(tip[1]), float(tip[2])), (0.032, 0.032, 0.026), 0.03, tone)
    build.rod((0, 0, z_m + 0.18), (0, 0, z_m + 0.30), 0.02, (0.30, 0.48, 0.22))


def fruit_bowl(build: Surfaces, z_m: float) -> None:
    """A bowl of fruit at height `z_m`."""
    build.tube((0, 0, z_m), 0.07, 0.07, 0.16, 0.045, (0.92, 0.90, 0.86), capped=False)
    for k, tone in enumerate(
        [(0.86, 0.25, 0.16), (0.95, 0.66, 0.16), (0.56, 0.68, 0.20), (0.90, 0.52, 0.14), (0.80, 0.22, 0.2)]
    ):
        turn = 2 * math.pi * k / 5
        x, y = round(0.07 * math.cos(turn), 9), round(0.07 * math.sin(turn), 9)
        build.blob((x, y, z_m + 0.085), (0.045, 0.045, 0.045), 0.035, plain(tone, variation=0.1))


def coat_rack(build: Surfaces) -> None:
    """Coats on hooks on the wall, centred in x."""
    build.box((-0.50, -0.03, 1.60), (0.50, 0, 1.70), 0.06, wood((0.52, 0.38, 0.25)))
    for x, tone, low in (
        (-0.32, (0.20, 0.26, 0.38), 0.72),
        (0.0, (0.72, 0.56, 0.36), 0.60),
        (0.32, (0.55, 0.18, 0.20), 0.85),
    ):
        build.box((x - 0.15, -0.16, low), (x + 0.15, -0.03, 1.60), 0.065, folds(tone, pitch_m=0.09), radius_m=0.06)


def radiator(build: Surfaces, width_m: float) -> None:
    """A ribbed radiator below a window, centred in x."""
    half = width_m / 2
    build.box(
        (-half, -0.10, 0.14),
        (half, -0.03, 0.66),
        (0.09, 0.13),
        (0.92, 0.92, 0.90),
        faces=("front", "left", "right", "top"),
    )
    ribs = round(width_m / 0.09)
    for k in range(ribs):
        x = -half + width_m * (k + 0.5) / ribs
        build.patch((x - 0.009, -0.103, 0.17), (0.018, 0, 0), (0, 0, 0.46), (0.018, 0.155), (0.66, 0.67, 0.67))


def front_door(build: Surfaces) -> None:
    """A closed entrance door on the wall, centred in x."""
    tone = (0.26, 0.36, 0.38)
    build.clear((-0.45, -0.03, 0.0), (0.45, 0.005, 2.05))
    build.box((-0.45, -0.03, 0.0), (0.45, 0.0, 2.05), 0.10, wood(tone, along_u=False), faces=("front",), solid=False)
    for z0, z1 in ((0.18, 0.90), (1.05, 1.90)):
        for x0 in (-0.36, 0.05):
            build.patch((x0, -0.034, z0), (0.31, 0, 0), (0, 0, z1 - z0), 0.08, _scale_colour(tone, 1.35), softness=0.5)
    build.rod((0.37, -0.07, 1.0), (0.26, -0.07, 1.0), 0.012, (0.80, 0.76, 0.62))


def _scale_colour(colour: Colour, factor: float) -> Colour:
    return (min(1.0, colour[0] * factor), min(1.0, colour[1] * factor), min(1.0, colour[2] * factor))
