"""What shines into a flat: the sky through its windows, the sun, and lamps."""

import math
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.scenes.embedded.lighting import Lights
from readygo.common.scenes.embedded.plan import FloorPlan

_SKY = (5.6, 6.3, 7.2)
_LAMP = (1.15, 1.02, 0.80)
_SUN = (5.2, 4.6, 3.6)
_INWARD = {"west": (1.0, 0.0, 0.0), "east": (-1.0, 0.0, 0.0), "south": (0.0, 1.0, 0.0), "north": (0.0, -1.0, 0.0)}


@dataclass(frozen=True, kw_only=True)
class Light:
    """Light of a time of day, as factors on that of the embedded flat; `sun_to` points to the sun."""

    sky: float = 1.0
    lamps: float = 1.0
    sun: float = 1.0
    sun_to: tuple[float, float, float] = (-0.45, -0.70, 0.55)


def draw_light(rng: np.random.Generator) -> Light:
    """From a dull evening with bright lamps to a clear day."""
    turn, height = rng.uniform(0.0, math.tau), rng.uniform(0.35, 1.0)
    return Light(
        sky=rng.uniform(0.5, 1.3),
        lamps=rng.uniform(0.4, 1.6),
        sun=rng.uniform(0.0, 1.2),
        # Rounded, because the last bits of cos and sin differ between machines.
        sun_to=(round(math.cos(turn), 6), round(math.sin(turn), 6), round(height, 6)),
    )


def lights_of(plan: FloorPlan, light: Light, mirror: Float64Array) -> Lights:
    """Points that shine, on windows and lamps, and the sun.

    Args:
        plan: The flat's.
        light: How bright they are.
        mirror: Signs of x and y with which the flat is built, shape (2,).
    """
    position, direction, power = [], [], []
    for opening in plan.openings:
        wall = plan.walls[opening.wall]
        if not opening.is_window:
            continue
        width, height = opening.end_m - opening.begin_m, opening.top_m - opening.bottom_m
        for a in (1 / 6, 1 / 2, 5 / 6):
            for b in (1 / 4, 3 / 4):
                along, z = opening.begin_m + a * width, opening.bottom_m + b * height
                across = (wall.low_m + wall.high_m) / 2
                position.append((across, along, z) if wall.axis == "x" else (along, across, z))
                direction.append(_INWARD[opening.wall])
                power.append(light.sky * np.array(_SKY) * width * height / 6 / np.pi)
    for lamp in plan.lamps_m:
        position.append(lamp)
        direction.append((0.0, 0.0, 0.0))
        power.append(light.lamps * np.array(_LAMP))
    sun, flip = np.array(light.sun_to), np.array([*mirror, 1.0])
    return Lights(
        position_m=np.array(position) * flip,
        direction=np.array(direction) * flip,
        power=np.array(power),
        sun_direction=sun / np.sqrt(sun @ sun),
        sun_power=light.sun * np.array(_SUN),
    )
