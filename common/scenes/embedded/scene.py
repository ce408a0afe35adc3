"""The embedded scene: a small furnished flat that needs no download."""

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array
from readygo.common.gaussians import GaussianCloud, sh_of_rgb
from readygo.common.scenes.embedded.drawn_furniture import furnish_drawn
from readygo.common.scenes.embedded.drawn_plan import draw_plan
from readygo.common.scenes.embedded.floors import build_floors
from readygo.common.scenes.embedded.furnishing import furnish
from readygo.common.scenes.embedded.light import Light, draw_light, lights_of
from readygo.common.scenes.embedded.lighting import Lights, lit_colours, voxelise
from readygo.common.scenes.embedded.outdoors import build_outdoors
from readygo.common.scenes.embedded.plan import CEILING_M, FLAT, FloorPlan
from readygo.common.scenes.embedded.shell import build_shell
from readygo.common.scenes.embedded.surfaces import OPACITY, Surfaces, UnlitPoints
from readygo.common.scenes.embedded.textures import value_noise
from readygo.common.scenes.embedded.variation import Variation, tints


def embedded_scene_cloud(seed: int = 0) -> GaussianCloud:
    """The flat without its surroundings: four furnished rooms around a hall, 10.4 m x 9.6 m.

    World metres, z up, floor within 12 mm of z = 0, colours of SH degree 0. Takes a few seconds of CPU time.

    Args:
        seed: Other flats than that of seed 0 are mirrored in one of four ways, with other colours, books, leaves and
            bricks, and with more pieces of furniture in the way (`readygo.common.scenes.embedded.variation`).
    """
    variation = Variation(seed=seed)
    build = variation.surfaces()
    build_shell(build, FLAT)
    build_floors(build, FLAT)
    furnish(build)
    variation.add_pieces(build)
    return _lit_cloud(build, FLAT, lights_of(FLAT, Light(), variation.mirror))


def drawn_scene_cloud(seed: int) -> GaussianCloud:
    """A flat whose plan, furniture, colours and light are drawn, up to 10.4 m x 9.6 m; as `embedded_scene_cloud`."""
    rng = np.random.Generator(np.random.PCG64([seed, *b"plan"]))
    build, plan = Surfaces(rng, tints=tints(rng)), draw_plan(rng)
    build_shell(build, plan)
    build_floors(build, plan)
    furnish_drawn(build, plan, rng)
    return _lit_cloud(build, plan, lights_of(plan, draw_light(rng), np.ones(2)))


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


def _lit_cloud(build: Surfaces, plan: FloorPlan, lights: Lights) -> GaussianCloud:
    samples, (low, high) = build.samples(), (np.array(plan.low_m), np.array(plan.high_m))
    grid = voxelise(build.solid_points_m(), np.append(low - 0.25, -0.05), np.append(high + 0.25, CEILING_M + 0.05))
    return _cloud(samples, lit_colours(samples, grid, lights), settle=True)
