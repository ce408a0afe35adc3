"""The embedded scene: a small furnished flat that needs no download."""

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array
from readygo.common.gaussians import GaussianCloud, sh_of_rgb
from readygo.common.scenes.embedded.floors import build_floors
from readygo.common.scenes.embedded.furnishing import LAMP_HEIGHT_M, LAMPS_M, furnish
from readygo.common.scenes.embedded.lighting import Lights, lit_colours, voxelise
from readygo.common.scenes.embedded.outdoors import build_outdoors
from readygo.common.scenes.embedded.plan import CEILING_M, EAST_M, NORTH_M, OPENINGS, SOUTH_M, WALLS, WEST_M
from readygo.common.scenes.embedded.shell import build_shell
from readygo.common.scenes.embedded.surfaces import OPACITY, Surfaces, UnlitPoints
from readygo.common.scenes.embedded.textures import value_noise
from readygo.common.scenes.embedded.variation import Variation

_SKY_LIGHT = np.array([5.6, 6.3, 7.2])
_LAMP_LIGHT = np.array([1.15, 1.02, 0.80])
_SUN_LIGHT = np.array([5.2, 4.6, 3.6])
_SUN_DIRECTION = np.array([-0.45, -0.70, 0.55])


def embedded_scene_cloud(seed: int = 0) -> GaussianCloud:
    """The flat without its surroundings: four furnished rooms around a hall, 10.4 m x 9.6 m.

    World metres, z up, floor within 12 mm of z = 0, colours of SH degree 0. Takes a few seconds of CPU time.

    Args:
        seed: Other flats than that of seed 0 are mirrored in one of four ways, with other colours, books, leaves and
            bricks, and with more pieces of furniture in the way (`readygo.common.scenes.embedded.variation`).
    """
    variation = Variation(seed=seed)
    build = variation.surfaces()
    build_shell(build)
    build_floors(build)
    furnish(build)
    variation.add_pieces(build)
    samples = build.samples()
    low = np.array([WEST_M - 0.25, SOUTH_M - 0.25, -0.05])
    high = np.array([EAST_M + 0.25, NORTH_M + 0.25, CEILING_M + 0.05])
    grid = voxelise(build.solid_points_m(), low, high)
    return _cloud(samples, lit_colours(samples, grid, _lights(variation.mirror)), settle=True)


def embedded_sky() -> GaussianCloud:
    """What the flat's windows show: sky, garden and hills up to 90 m away."""
    build = Surfaces(np.random.Generator(np.random.PCG64(0)))
    build_outdoors(build)
    samples = build.samples()
    return _cloud(samples, samples.colour, settle=False)


def floor_height_m(x_m: Float64Array, y_m: Float64Array) -> Float64Array:
    """Height of the flat's floor: a tilt of 1 mm/m and bumps of a few millimetres, shape of `x_m`."""
    return 0.0010 * x_m - 0.0006 * y_m + 0.006 * (value_noise(x_m / 1.7, y_m / 1.7, 3) - 0.5)


def _cloud(samples: UnlitPoints, colour: Float64Array, *, settle: bool) -> GaussianCloud:
    position = samples.position_m.copy()
    if settle:
        # The whole house follows its floor, so that furniture neither floats nor sinks.
        position[:, 2] += floor_height_m(position[:, 0], position[:, 1])
    count = len(position)
    return GaussianCloud(
        means_m=_round_values(position),
        quats_wxyz=_round_values(samples.quats_wxyz()),
        scales_m=_round_values(np.maximum(samples.sigma_m, 0.001)),
        opacities=np.full(count, OPACITY, dtype=np.float32),
        sh=_round_values(sh_of_rgb(colour))[:, None, :],
    )


def _round_values(values: Float64Array) -> Float32Array:
    # The last bits of cos, sin and matrix products differ between machines. Five decimals do not, once a small shift
    # has moved round numbers off the ties.
    return np.round(values + 1.3e-7, 5).astype(np.float32)


def _lights(mirror: Float64Array) -> Lights:
    position, direction, power = [], [], []
    for opening in OPENINGS:
        wall = WALLS[opening.wall]
        if not opening.is_window:
            continue
        inward = np.array([1.0, 0, 0]) if wall.axis == "x" else np.array([0, 1.0, 0])
        inward = inward if opening.wall in ("west", "south") else -inward
        width, height = opening.end_m - opening.begin_m, opening.top_m - opening.bottom_m
        for a in (1 / 6, 1 / 2, 5 / 6):
            for b in (1 / 4, 3 / 4):
                along, z = opening.begin_m + a * width, opening.bottom_m + b * height
                across = (wall.low_m + wall.high_m) / 2
                position.append((across, along, z) if wall.axis == "x" else (along, across, z))
                direction.append(inward)
                power.append(_SKY_LIGHT * width * height / 6 / np.pi)
    for x, y in LAMPS_M:
        position.append((x, y, LAMP_HEIGHT_M if (x, y) != LAMPS_M[1] else 1.62))
        direction.append(np.zeros(3))
        power.append(_LAMP_LIGHT)
    sun = _SUN_DIRECTION / np.sqrt(_SUN_DIRECTION @ _SUN_DIRECTION)
    flip = np.array([*mirror, 1.0])
    return Lights(
        position_m=np.array(position) * flip,
        direction=np.array(direction) * flip,
        power=np.array(power),
        sun_direction=sun,
        sun_power=_SUN_LIGHT,
    )
