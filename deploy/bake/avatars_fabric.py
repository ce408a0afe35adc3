"""What clothes are of: folds, their shading, and woven or printed patterns."""

import numpy as np
import numpy.typing as npt
from avatars_figure import ARMS, Figure
from avatars_people import Garment
from avatars_surface import Samples, mix, noise, slope_of, step, unit

Array = npt.NDArray[np.float64]

BRETON = (0.044, 0.40)
"""Distance of the stripes [m] and the share of it that they take."""


def folds(figure: Figure, samples: Samples, garment: Garment, seed: int) -> tuple[Array, Array]:
    """Height of the folds [m], shape (N,), and its gradient, shape (N, 3)."""

    def height(rest: Array) -> Array:
        x, y, z = rest.T
        drape = noise(np.stack([x * 16, y * 7, z * 16], axis=1), seed)
        rings = noise(np.stack([x * 9, y * 34 + 20 * z, z * 9], axis=1), seed + 1)
        arm = figure.arm(rest, samples.skin_weights)
        knee, ankle = figure.joints[4, 1], figure.joints[7, 1]
        bent = np.exp(-(((arm - 1.0) / 0.35) ** 2)) + 0.5 * np.exp(-(((arm - 1.85) / 0.15) ** 2))
        bent += 0.45 * np.exp(-(((y - knee) / 0.09) ** 2)) + 1.1 * np.exp(-(((y - ankle - 0.03) / 0.07) ** 2))
        bent += 0.4 * np.exp(-(((y - figure.joints[3, 1] - 0.02) / 0.07) ** 2))
        return (0.0016 + 0.0022 * garment.looseness) * (0.8 * drape + bent * rings)

    centre = height(samples.rest)
    slope = np.empty_like(samples.rest)
    for k in range(3):
        ahead = samples.rest.copy()
        ahead[:, k] += 0.003
        slope[:, k] = (height(ahead) - centre) / 0.003
    return centre, slope


def laid(figure: Figure, samples: Samples, garment: Garment, seed: int) -> Samples:
    """Samples lifted by folds, shaded by their slopes and coloured with the fabric."""
    height, slope = folds(figure, samples, garment, seed)
    tangential = slope - (slope * samples.normal).sum(1, keepdims=True) * samples.normal
    facing = unit(samples.normal - 2.2 * tangential)
    light = (facing - samples.normal) @ np.array([0.15, 0.75, 0.35])
    colour = fabric(figure, samples, garment, seed) * (1 + 0.55 * np.clip(light, -0.6, 0.5))[:, None]
    return samples.changed(
        position=samples.position + samples.normal * height[:, None], colour=np.clip(colour, 0.0, 1.0)
    )


def cloth_coordinates(figure: Figure, rest: Array, skin_weights: Array) -> tuple[Array, Array]:
    """Coordinates around and along the cloth [m], for patterns; they jump at the armholes, as cut cloth does."""
    on_arm = skin_weights[:, ARMS].sum(1) > 0.5
    leg_x = np.where(rest[:, 0] > 0, 0.5, -0.5) * (figure.joints[4, 0] + figure.joints[1, 0])
    below = step(figure.joints[1, 1], figure.joints[1, 1] - 0.10, rest[:, 1])
    around = np.arctan2(rest[:, 0] - below * leg_x, rest[:, 2]) * np.where(below > 0.5, 0.08, 0.145)
    arm_length = np.linalg.norm(figure.joints[18] - figure.joints[16])
    along_arm = figure.arm(rest, skin_weights) * arm_length
    u = np.where(on_arm, figure.arm_angle(rest) * 0.048, around)
    v = np.where(on_arm, -along_arm, rest[:, 1])
    return u, v


def striped(figure: Figure, samples: Samples) -> Samples:
    """Samples drawn out along the horizontal stripes of a jersey, none across an edge: that keeps edges sharp."""

    def along(rest: Array, skin_weights: Array) -> Array:
        return cloth_coordinates(figure, rest, skin_weights)[1]

    period, share = BRETON
    v, slope = along(samples.rest, samples.skin_weights), slope_of(samples, along)
    steep = np.linalg.norm(slope, axis=1)
    phase = v / period - np.floor(v / period) - 0.5
    over = np.abs(phase) * period - 0.5 * share * period
    margin = 0.38 * samples.spacing
    wanted = np.where(np.abs(over) < margin, np.where(over > 0, margin, -margin) - over, 0.0) * np.sign(phase)
    fit = (steep > 0.4) & (steep < 2.0)
    moved = np.where(fit, wanted / np.where(fit, steep, 1.0), 0.0)[:, None] * unit(slope)
    return samples.changed(
        position=samples.position + moved,
        rest=samples.rest + moved,
        tangent=np.where(fit[:, None], unit(np.cross(samples.normal, slope)), samples.tangent),
        stretch=np.where(fit, 2.2, samples.stretch),
    )


def fabric(figure: Figure, samples: Samples, garment: Garment, seed: int) -> Array:
    """Colours of a garment, shape (N, 3)."""
    u, v = cloth_coordinates(figure, samples.rest, samples.skin_weights)
    base = np.broadcast_to(np.array(garment.colour), (len(samples), 3))
    grain = noise(samples.rest * 140, seed + 2)
    patch = noise(samples.rest * 11, seed + 3)
    shade = 1 + 0.035 * grain + 0.03 * patch
    if garment.fabric == "denim":
        shade, base = shade + 0.05 * grain, _faded(figure, samples, base, patch)
    elif garment.fabric == "knit":
        rib = np.sin(2 * np.pi * u / 0.024)
        purl = np.sin(2 * np.pi * v / 0.021 + np.sign(rib))
        base = mix(base, garment.second, 0.30 - 0.35 * rib + 0.15 * purl)
    elif garment.fabric == "stripes":
        base = mix(base, garment.second, bands(u, 0.036, 0.33))
    elif garment.fabric == "breton":
        base = mix(base, garment.second, bands(v, *BRETON))
    elif garment.fabric == "checks":
        across, along = bands(u, 0.075, 0.46), bands(v, 0.075, 0.46)
        base = mix(base, garment.second, 0.5 * across + 0.5 * along)
        base = mix(base, (0.88, 0.84, 0.74), 0.5 * np.maximum(_line(u, 0.075, 0.80), _line(v, 0.075, 0.80)))
    return base * shade[:, None]


def bands(x: Array, period_m: float, share: float) -> Array:
    """Soft-edged stripes: 1 on a share of every period, 0 between. Shape (N,)."""
    place = np.abs(x / period_m - np.floor(x / period_m) - 0.5) * period_m
    return 1 - step(0.5 * share * period_m - 0.002, 0.5 * share * period_m + 0.002, place)


def _line(x: Array, period_m: float, place: float) -> Array:
    return bands(x + (0.5 - place) * period_m, period_m, 0.07)


def _faded(figure: Figure, samples: Samples, base: Array, patch: Array) -> Array:
    y = samples.rest[:, 1]
    thigh = 0.5 * (figure.joints[1, 1] + figure.joints[4, 1])
    worn = step(-0.1, 0.8, samples.normal[:, 2]) * np.exp(-(((y - thigh) / 0.15) ** 2))
    worn += 0.5 * step(0.2, 0.9, -samples.normal[:, 2]) * np.exp(-(((y - figure.joints[1, 1]) / 0.1) ** 2))
    seam = np.exp(-(((np.abs(samples.normal[:, 2]) - 0.05) / 0.10) ** 2)) * (np.abs(samples.normal[:, 0]) > 0.9)
    return mix(base, 0.55 * base + 0.36, np.clip(0.55 * worn * (0.8 + 0.3 * patch), 0, 1)) * (1 - 0.16 * seam)[:, None]
