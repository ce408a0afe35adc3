"""Shelves with books, cupboards and the kitchen; fronts face -y, backs lie at y = 0."""

import numpy as np

from readygo.common.scenes.embedded.surfaces import Surfaces
from readygo.common.scenes.embedded.textures import Colour, plain, tiles, wood

_SPINES: tuple[Colour, ...] = (
    (0.62, 0.15, 0.13),
    (0.16, 0.27, 0.45),
    (0.85, 0.78, 0.62),
    (0.18, 0.36, 0.27),
    (0.80, 0.52, 0.18),
    (0.30, 0.20, 0.30),
    (0.88, 0.86, 0.80),
    (0.10, 0.12, 0.15),
    (0.48, 0.62, 0.68),
    (0.72, 0.38, 0.28),
    (0.38, 0.42, 0.24),
    (0.93, 0.80, 0.40),
)
_STEEL = (0.72, 0.73, 0.74)
_FRONT_FACES = ("front", "left", "right", "top")


def bookshelf(
    build: Surfaces, width_m: float, height_m: float, colour: Colour, *, shelves: int = 5, depth_m: float = 0.28
) -> None:
    """An open shelf full of books and a few ornaments, centred in x."""
    timber, half = wood(colour, along_u=False, seed=13), width_m / 2
    build.clear((-half + 0.02, -0.02, 0.0), (half - 0.02, 0.005, height_m - 0.02))
    build.patch((-half, -0.01, 0), (width_m, 0, 0), (0, 0, height_m), 0.14, _darker(colour, 0.6), softness=0.7)
    for x in (-half, half - 0.03):
        build.box((x, -depth_m, 0), (x + 0.03, 0, height_m), (0.10, 0.12), timber, faces=_FRONT_FACES)
    step = (height_m - 0.08) / shelves
    for k in range(shelves + 1):
        z = 0.05 + k * step
        build.box(
            (-half, -depth_m, z - 0.025),
            (half, 0, z),
            (0.12, 0.10),
            wood(colour, seed=14),
            faces=("front", "top", "bottom"),
        )
        if k < shelves:
            _shelf_content(build.at(-half + 0.04, -depth_m + 0.03, z), width_m - 0.08, step - 0.03, depth_m - 0.05)
    build.solid((-half, -depth_m + 0.08, 0), (half, 0, height_m))


def _shelf_content(build: Surfaces, width_m: float, height_m: float, depth_m: float) -> None:
    rng, x = build.rng, 0.0
    while x < width_m - 0.05:
        pick = rng.random()
        if pick < 0.06 and x < width_m - 0.22:
            _ornament(build.at(x + 0.10, depth_m / 2), height_m)
            x += 0.21
            continue
        run = min(width_m, x + 0.12 + 0.35 * rng.random())
        x = _books(build, x, run, height_m, depth_m)
        x += 0.05 * rng.random() if pick < 0.6 else 0.0


def _books(build: Surfaces, begin_m: float, end_m: float, height_m: float, depth_m: float) -> float:
    rng, x = build.rng, begin_m
    series = _SPINES[int(rng.integers(len(_SPINES)))] if rng.random() < 0.3 else None
    series_height = height_m * (0.68 + 0.2 * rng.random())
    while x < end_m - 0.02:
        width = 0.022 + 0.030 * rng.random()
        tall = series_height if series else height_m * (0.62 + 0.32 * rng.random())
        tone = series or _SPINES[int(rng.integers(len(_SPINES)))]
        back = 0.035 * rng.random()
        _book(build.at(x, back), width, tall, depth_m - back, tone)
        x += width + 0.002
    return x


def _book(build: Surfaces, width_m: float, height_m: float, depth_m: float, colour: Colour) -> None:
    build.patch(
        (0, 0, 0), (width_m, 0, 0), (0, 0, height_m), (width_m, 0.085), plain(colour, variation=0.15), softness=0.5
    )
    build.patch((0, 0, height_m), (width_m, 0, 0), (0, depth_m, 0), (width_m, 0.2), (0.86, 0.83, 0.74), softness=0.5)
    band = (0.92, 0.85, 0.60) if sum(colour) < 1.5 else (0.30, 0.22, 0.18)
    build.patch((0, -0.003, height_m * 0.72), (width_m, 0, 0), (0, 0, 0.028), (width_m, 0.03), band, softness=0.42)


def _ornament(build: Surfaces, height_m: float) -> None:
    kind, tone = build.rng.random(), _SPINES[int(build.rng.integers(len(_SPINES)))]
    if kind < 0.5:
        build.tube((0, 0, 0), height_m * 0.45, 0.05, 0.035, 0.03, plain(tone))
        build.blob((0, 0, height_m * 0.25), (0.065, 0.065, height_m * 0.2), 0.03, plain(tone))
    else:
        build.box((-0.07, -0.01, 0.01), (0.07, 0.01, height_m * 0.62), 0.035, (0.90, 0.88, 0.83), solid=False)
        build.patch(
            (-0.05, -0.014, 0.03),
            (0.10, 0, 0),
            (0, 0, height_m * 0.62 - 0.05),
            0.035,
            plain(tone, variation=0.5, patch_m=0.05),
        )


def sideboard(
    build: Surfaces, width_m: float, height_m: float, colour: Colour, *, depth_m: float = 0.42, doors: int = 3
) -> None:
    """A low cupboard on short legs with doors, centred in x."""
    half, legs = width_m / 2, 0.10
    build.fill((-half, -depth_m, legs), (half, 0, height_m), _darker(colour, 0.8))
    build.box((-half, -depth_m, legs), (half, 0, height_m), 0.08, wood(colour, seed=21), faces=_FRONT_FACES)
    for k in range(doors + 1):
        x = -half + width_m * k / doors
        x = min(max(x, -half + 0.008), half - 0.008)
        build.patch(
            (x - 0.006, -depth_m - 0.003, legs + 0.03),
            (0.012, 0, 0),
            (0, 0, height_m - legs - 0.06),
            (0.012, 0.12),
            _darker(colour, 0.45),
        )
    for k in range(doors):
        x = -half + width_m * (k + 0.5) / doors
        knob = (x - 0.06, -depth_m - 0.018, height_m - 0.10)
        build.rod(knob, (x + 0.06, knob[1], knob[2]), 0.011, _STEEL)
    for x in (-half + 0.06, half - 0.06):
        for y in (-depth_m + 0.05, -0.05):
            build.rod((x, y, 0), (x, y, legs), 0.02, (0.15, 0.13, 0.12))


def wardrobe(build: Surfaces, width_m: float, colour: Colour, *, height_m: float = 2.1, depth_m: float = 0.6) -> None:
    """A tall cupboard with panelled doors, centred in x."""
    half = width_m / 2
    build.fill((-half, -depth_m, 0.0), (half, 0, height_m), _darker(colour, 0.8))
    build.box(
        (-half, -depth_m, 0.0),
        (half, 0, height_m),
        0.11,
        wood(colour, along_u=False, seed=22, contrast=0.18),
        faces=_FRONT_FACES,
        softness=0.72,
    )
    doors = round(width_m / 0.5)
    for k in range(doors):
        a, b = -half + width_m * k / doors, -half + width_m * (k + 1) / doors
        for z0, z1 in ((0.12, 0.95), (1.02, height_m - 0.1)):
            _panel(build, a + 0.07, b - 0.07, z0, z1, -depth_m - 0.004, _darker(colour, 0.62))
        build.patch(
            (b - 0.006, -depth_m - 0.003, 0.06),
            (0.012, 0, 0),
            (0, 0, height_m - 0.1),
            (0.012, 0.15),
            _darker(colour, 0.4),
        )
        handle = a + 0.04 if k % 2 else b - 0.04
        build.rod((handle, -depth_m - 0.025, 0.92), (handle, -depth_m - 0.025, 1.10), 0.011, _STEEL)


def _panel(build: Surfaces, x0: float, x1: float, z0: float, z1: float, y: float, colour: Colour) -> None:
    width = 0.014
    for x in (x0, x1):
        build.patch((x - width / 2, y, z0), (width, 0, 0), (0, 0, z1 - z0), (width, 0.14), colour)
    for z in (z0, z1):
        build.patch((x0, y, z - width / 2), (x1 - x0, 0, 0), (0, 0, width), (0.14, width), colour)


def kitchen_counter(build: Surfaces, width_m: float, colour: Colour, *, modules: int, depth_m: float = 0.6) -> None:
    """Base cupboards with a worktop, from x = 0 to the right."""
    build.fill((0, -depth_m, 0.0), (width_m, 0, 0.9), _darker(colour, 0.8))
    build.box((0, -depth_m + 0.05, 0.0), (width_m, 0, 0.10), 0.1, (0.12, 0.12, 0.12), faces=("front", "left", "right"))
    build.box(
        (0, -depth_m, 0.10), (width_m, 0, 0.87), 0.09, plain(colour, variation=0.04), faces=("front", "left", "right")
    )
    build.box(
        (-0.01, -depth_m - 0.03, 0.87),
        (width_m + 0.01, 0, 0.91),
        (0.07, 0.06),
        plain((0.34, 0.32, 0.31), variation=0.5, patch_m=0.06),
    )
    step = width_m / modules
    for k in range(modules):
        a, b = k * step, (k + 1) * step
        heights = ((0.14, 0.60), (0.64, 0.84)) if k % 2 else ((0.14, 0.36), (0.39, 0.60), (0.63, 0.84))
        for z0, z1 in heights:
            _panel(build, a + 0.02, b - 0.02, z0, z1, -depth_m - 0.003, _darker(colour, 0.55))
            handle = ((a + b) / 2, -depth_m - 0.02, z1 - 0.05)
            build.rod((handle[0] - 0.09, *handle[1:]), (handle[0] + 0.09, *handle[1:]), 0.011, _STEEL)


def backsplash(build: Surfaces, begin_m: float, end_m: float, top_m: float) -> None:
    """Wall tiles above a worktop."""
    build.clear((begin_m, -0.004, 0.91), (end_m, 0.005, top_m))
    texture = tiles((0.62, 0.76, 0.76), (0.92, 0.92, 0.90), 0.16, 0.08)
    build.patch(
        (begin_m, -0.006, 0.91), (end_m - begin_m, 0, 0), (0, 0, top_m - 0.91), (0.053, 0.04), texture, softness=0.55
    )


def wall_cupboard(build: Surfaces, width_m: float, colour: Colour, *, modules: int) -> None:
    """Kitchen cupboards on the wall, from x = 0 to the right."""
    build.box(
        (0, -0.34, 1.42),
        (width_m, 0, 2.15),
        0.09,
        plain(colour, variation=0.04),
        faces=("front", "left", "right", "top", "bottom"),
    )
    step = width_m / modules
    for k in range(modules):
        _panel(build, k * step + 0.02, (k + 1) * step - 0.02, 1.46, 2.11, -0.343, _darker(colour, 0.55))
        build.rod((k * step + 0.07, -0.36, 1.48), (k * step + 0.07, -0.36, 1.62), 0.011, _STEEL)


def oven(build: Surfaces, x_m: float) -> None:
    """An oven front and a hob in a counter, around x."""
    build.patch((x_m - 0.29, -0.606, 0.14), (0.58, 0, 0), (0, 0, 0.68), 0.055, (0.16, 0.16, 0.17))
    build.patch((x_m - 0.22, -0.609, 0.24), (0.44, 0, 0), (0, 0, 0.34), 0.055, (0.06, 0.07, 0.09))
    build.rod((x_m - 0.22, -0.64, 0.64), (x_m + 0.22, -0.64, 0.64), 0.014, _STEEL)
    for k in range(4):
        build.blob((x_m - 0.18 + 0.12 * k, -0.615, 0.75), (0.022, 0.015, 0.022), 0.022, _STEEL)
        build.disc((x_m - 0.13 + 0.26 * (k % 2), -0.43 + 0.26 * (k // 2), 0.915), 0.09, 0.04, (0.08, 0.08, 0.09))
    build.tube((x_m - 0.13, -0.17, 0.92), 0.14, 0.10, 0.10, 0.045, _STEEL)


def fridge(build: Surfaces) -> None:
    """A tall fridge, centred in x."""
    build.fill((-0.33, -0.66, 0.0), (0.33, 0, 1.8), (0.66, 0.67, 0.68))
    build.box(
        (-0.33, -0.66, 0.03),
        (0.33, 0, 1.82),
        0.10,
        plain((0.80, 0.81, 0.82), variation=0.05),
        faces=_FRONT_FACES,
        radius_m=0.02,
    )
    build.patch((-0.33, -0.664, 1.18), (0.66, 0, 0), (0, 0, 0.014), (0.08, 0.014), (0.35, 0.36, 0.37))
    for z0, z1 in ((0.70, 1.10), (1.26, 1.60)):
        build.rod((-0.27, -0.69, z0), (-0.27, -0.69, z1), 0.013, (0.45, 0.46, 0.47))
    tones = np.asarray(_SPINES)[[0, 4, 8, 11]]
    for k, tone in enumerate(tones):
        x, z = -0.15 + 0.11 * k, 1.42 - 0.09 * (k % 2)
        build.patch((x, -0.668, z), (0.08, 0, 0), (0, 0, 0.10), 0.04, (float(tone[0]), float(tone[1]), float(tone[2])))


def sink(build: Surfaces, x_m: float) -> None:
    """A steel basin and a tap in a counter, around x."""
    build.patch((x_m - 0.26, -0.50, 0.913), (0.52, 0, 0), (0, 0.38, 0), 0.06, (0.62, 0.63, 0.65))
    build.patch((x_m - 0.21, -0.45, 0.915), (0.42, 0, 0), (0, 0.28, 0), 0.05, (0.30, 0.31, 0.33))
    build.rod((x_m, -0.10, 0.91), (x_m, -0.10, 1.18), 0.014, _STEEL)
    build.rod((x_m, -0.10, 1.18), (x_m, -0.28, 1.16), 0.012, _STEEL)


def _darker(colour: Colour, factor: float) -> Colour:
    return (colour[0] * factor, colour[1] * factor, colour[2] * factor)
