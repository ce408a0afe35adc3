"""Seats, tables and beds; fronts face -y, backs lie at y = 0 where a piece stands against a wall."""

import numpy as np

from readygo.common.scenes.embedded.surfaces import SIDES, Surfaces
from readygo.common.scenes.embedded.textures import Colour, fabric, plain, stripes, wood

_UPPER = ("front", "back", "left", "right", "top")
_DARK_WOOD = (0.36, 0.25, 0.17)


def sofa(
    build: Surfaces, colour: Colour, *, width_m: float = 2.1, seats: int = 3, accent: Colour = (0.85, 0.62, 0.25)
) -> None:
    """A sofa or, with one seat, an armchair: centred in x, back at y = 0."""
    cloth, half = fabric(colour, seed=11, variation=0.14), width_m / 2
    build.box((-half + 0.02, -0.86, 0.07), (half - 0.02, -0.02, 0.30), 0.10, cloth, faces=SIDES, radius_m=0.03)
    build.box((-half + 0.05, -0.24, 0.28), (half - 0.05, 0.0, 0.80), 0.08, cloth, radius_m=0.09)
    for x in (-half, half - 0.19):
        build.box((x, -0.88, 0.07), (x + 0.19, -0.02, 0.58), 0.08, cloth, faces=_UPPER, radius_m=0.07)
    seat = (width_m - 0.40) / seats
    for k in range(seats):
        x = -half + 0.20 + k * seat
        light = fabric((colour[0] * 1.08, colour[1] * 1.08, colour[2] * 1.08), seed=17 + k, variation=0.14)
        build.box(
            (x + 0.01, -0.88, 0.29), (x + seat - 0.01, -0.20, 0.46), 0.075, light, faces=("front", "top"), radius_m=0.07
        )
        build.box(
            (x + 0.02, -0.36, 0.44),
            (x + seat - 0.02, -0.18, 0.78),
            0.075,
            light,
            faces=("front", "left", "right", "top"),
            radius_m=0.08,
        )
    for side in (-1, 1) if seats > 1 else (1,):
        _cushion(build.at(side * (half - 0.40) * (seats > 1), -0.46, 0.60, yaw_deg=-18 * side), accent)
    for x in (-half + 0.1, half - 0.1):
        for y in (-0.78, -0.1):
            build.rod((x, y, 0.0), (x, y, 0.08), 0.022, _DARK_WOOD)


def _cushion(build: Surfaces, colour: Colour) -> None:
    pattern = stripes(colour, (0.93, 0.90, 0.84), 0.09)
    build.box((-0.21, -0.06, -0.17), (0.21, 0.06, 0.21), 0.05, pattern, radius_m=0.06, solid=False)


def chair(build: Surfaces, colour: Colour, *, padded: Colour | None = None) -> None:
    """A dining chair centred on its seat; it looks to -y."""
    timber = wood(colour, contrast=0.2)
    seat = fabric(padded, seed=5) if padded else timber
    build.box((-0.21, -0.21, 0.42), (0.21, 0.21, 0.46), 0.055, seat, faces=(*_UPPER, "bottom"), radius_m=0.02)
    for x in (-0.185, 0.185):
        build.rod((x, -0.185, 0.0), (x, -0.185, 0.43), 0.019, colour)
        build.rod((x, 0.185, 0.0), (x * 0.96, 0.225, 0.90), 0.019, colour)
    for z in (0.60, 0.72, 0.84):
        build.box(
            (-0.18, 0.19, z - 0.035),
            (0.18, 0.215, z + 0.035),
            (0.06, 0.04),
            timber,
            faces=("front", "back", "top"),
            solid=False,
        )
    build.solid((-0.18, 0.18, 0.56), (0.18, 0.22, 0.88))


def office_chair(build: Surfaces, colour: Colour) -> None:
    """A swivel chair centred on its post; it looks to -y."""
    cloth = fabric(colour, seed=9)
    for k in range(5):
        arm = build.at(0.0, 0.0, yaw_deg=72.0 * k + 20)
        arm.rod((0.0, 0.0, 0.09), (0.28, 0.0, 0.06), 0.022, (0.16, 0.16, 0.17))
        arm.blob((0.29, 0.0, 0.035), (0.03, 0.02, 0.035), 0.035, (0.10, 0.10, 0.10))
    build.rod((0, 0, 0.07), (0, 0, 0.45), 0.028, (0.35, 0.35, 0.36))
    build.box((-0.24, -0.23, 0.44), (0.24, 0.23, 0.53), 0.06, cloth, radius_m=0.04)
    build.box((-0.22, 0.19, 0.60), (0.22, 0.26, 1.08), 0.06, cloth, radius_m=0.035)
    for x in (-0.27, 0.27):
        build.box((x - 0.025, -0.12, 0.66), (x + 0.025, 0.14, 0.69), 0.05, (0.14, 0.14, 0.15), solid=False)
        build.rod((x, 0.05, 0.48), (x, 0.05, 0.66), 0.018, (0.16, 0.16, 0.17))


def table(
    build: Surfaces, size_m: tuple[float, float, float], colour: Colour, *, leg_m: float = 0.03, seed: int = 3
) -> None:
    """A table centred in x and y with four legs; `size_m` is width, depth, height."""
    width, depth, height = size_m
    timber = wood(colour, seed=seed)
    x, y = width / 2, depth / 2
    build.box((-x, -y, height - 0.04), (x, y, height), (0.085, 0.07), timber)
    build.box(
        (-x + 0.06, -y + 0.06, height - 0.11),
        (x - 0.06, y - 0.06, height - 0.04),
        (0.09, 0.07),
        timber,
        faces=SIDES,
        solid=False,
    )
    for a in (-x + 0.07, x - 0.07):
        for b in (-y + 0.07, y - 0.07):
            leg = (colour[0] * 0.9, colour[1] * 0.9, colour[2] * 0.9)
            build.box(
                (a - leg_m, b - leg_m, 0.0), (a + leg_m, b + leg_m, height - 0.04), (0.06, 0.12), leg, faces=SIDES
            )


def round_table(build: Surfaces, radius_m: float, height_m: float, colour: Colour) -> None:
    """A table on one foot."""
    timber = wood(colour, seed=8)
    build.tube((0, 0, height_m - 0.035), 0.035, radius_m, radius_m, 0.06, timber)
    build.disc((0, 0, height_m - 0.036), radius_m * 0.97, 0.10, _DARK_WOOD, up=False)
    build.tube((0, 0, 0.03), height_m - 0.06, 0.045, 0.045, 0.06, _DARK_WOOD, capped=False)
    build.tube((0, 0, 0.0), 0.03, 0.24, 0.20, 0.06, _DARK_WOOD)


def bed(build: Surfaces, cover: Colour, throw: Colour) -> None:
    """A double bed with its head at y = 0, centred in x, 1.7 m wide and 2.1 m long."""
    frame = wood((0.50, 0.36, 0.24), seed=4)
    build.box((-0.86, -0.06, 0.0), (0.86, 0.0, 1.05), 0.08, frame, faces=_UPPER, radius_m=0.02)
    build.box((-0.84, -2.10, 0.12), (0.84, -0.06, 0.30), (0.12, 0.08), frame, faces=SIDES)
    build.box(
        (-0.82, -2.08, 0.28),
        (0.82, -0.06, 0.52),
        0.10,
        fabric((0.93, 0.92, 0.89), seed=2, variation=0.05),
        faces=_UPPER,
        radius_m=0.07,
    )
    quilt = stripes(cover, (cover[0] * 0.82, cover[1] * 0.82, cover[2] * 0.85), 0.21, along_u=True)
    build.box(
        (-0.86, -2.12, 0.22),
        (0.86, -0.72, 0.56),
        0.08,
        quilt,
        faces=("front", "left", "right", "top"),
        radius_m=0.09,
        solid=False,
    )
    build.box(
        (-0.87, -1.95, 0.24),
        (0.87, -1.45, 0.57),
        0.065,
        fabric(throw, seed=6, variation=0.2),
        faces=("left", "right", "top"),
        radius_m=0.08,
        solid=False,
    )
    for x in (-0.42, 0.42):
        build.box(
            (x - 0.32, -0.50, 0.50),
            (x + 0.32, -0.10, 0.66),
            0.06,
            fabric((0.96, 0.95, 0.92), seed=7, variation=0.05),
            radius_m=0.08,
        )
        build.box(
            (x - 0.22, -0.62, 0.52), (x + 0.22, -0.42, 0.72), 0.06, fabric(throw, seed=12), radius_m=0.07, solid=False
        )
    for x in (-0.78, 0.78):
        for y in (-2.0, -0.15):
            build.rod((x, y, 0.0), (x, y, 0.14), 0.03, _DARK_WOOD)


def pouf(build: Surfaces, colour: Colour) -> None:
    """A round upholstered stool."""
    build.tube((0, 0, 0.02), 0.34, 0.27, 0.29, 0.06, fabric(colour, seed=15, variation=0.18))
    build.blob((0, 0, 0.35), (0.285, 0.285, 0.06), 0.06, fabric(colour, seed=16, variation=0.12))


def bench(build: Surfaces, colour: Colour, *, width_m: float = 1.1) -> None:
    """A shoe bench against a wall, with pairs of shoes on its lower board."""
    timber, half = wood(colour, seed=10), width_m / 2
    build.box((-half, -0.34, 0.40), (half, -0.02, 0.45), 0.08, timber)
    build.box((-half, -0.34, 0.10), (half, -0.02, 0.13), 0.08, timber)
    for x in (-half, half - 0.05):
        build.box((x, -0.34, 0.0), (x + 0.05, -0.02, 0.40), 0.06, timber, faces=SIDES)
    tones = [(0.14, 0.14, 0.16), (0.66, 0.22, 0.18), (0.86, 0.86, 0.84), (0.36, 0.24, 0.16)]
    for k, x in enumerate(np.linspace(-half + 0.2, half - 0.2, len(tones))):
        for shift in (-0.055, 0.055):
            build.blob((float(x) + shift, -0.17, 0.175), (0.045, 0.125, 0.045), 0.035, plain(tones[k]))
