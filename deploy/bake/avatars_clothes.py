"""Clothes as layers of samples: how each garment is cut and sewn."""

import numpy as np
import numpy.typing as npt
from avatars_drape import hung
from avatars_fabric import bands, laid, striped
from avatars_figure import (
    ARMS,
    OPEN,
    Figure,
    bottom_field,
    inner_field,
    neck_field,
    opening_field,
    shoe_field,
    skirt_hem,
    top_field,
)
from avatars_people import Garment
from avatars_shoes import shoes
from avatars_surface import Samples, hemmed, mix, new_samples, scatter, smoothed, step, thinned, unit

Array = npt.NDArray[np.float64]

CLOTH_SPACING_M = 0.0063
PATTERN_SPACING_M = 0.0052
COLLAR_SPACING_M = 0.0042
PATTERNED = ("breton", "checks", "stripes")


def dressed(figure: Figure, rng: np.random.Generator) -> list[Samples]:
    """All garments of a person as layers of samples."""
    layers = [_top(figure, rng), shoes(figure, rng)]
    layers += [_skirt(figure, rng)] if figure.person.bottom_kind == "skirt" else [_trousers(figure, rng)]
    if figure.person.closure in ("shirt", "polo", "open"):
        layers.append(_collar(figure, figure.person.top, rng))
    if figure.person.closure in OPEN:
        layers.append(_inner(figure, rng))
    if figure.person.legs is not None:
        layers.append(_leggings(figure, figure.person.legs, rng))
    return layers


def _top(figure: Figure, rng: np.random.Generator) -> Samples:
    person = figure.person
    surface = hung(figure, figure.tights, person.top, over_hips=True)
    spacing = PATTERN_SPACING_M if person.top.fabric in PATTERNED else CLOTH_SPACING_M
    samples = scatter(surface, figure.spacing(spacing), rng)
    samples = striped(figure, samples) if person.top.fabric == "breton" else samples
    samples, depth = hemmed(samples, lambda rest, weights: top_field(figure, rest, weights))
    flare = 0.003 * step(0.03, 0.0, depth)
    samples = samples.changed(position=samples.position + samples.normal * flare[:, None])
    samples = laid(figure, samples, person.top, person.seed * 10)
    samples = samples.changed(colour=samples.colour * _tailoring(figure, samples, depth)[:, None])
    return thinned(_buttoned(figure, samples))


def _tailoring(figure: Figure, samples: Samples, depth: Array) -> Array:
    """Darker lines where cloth is sewn: hems, armholes, the placket."""
    hem_line = np.exp(-(((depth - 0.018) / 0.0035) ** 2)) + 0.7 * step(0.004, 0.0, depth)
    armhole = samples.skin_weights[:, ARMS].sum(1)
    seam = np.exp(-(((armhole - 0.5) / 0.06) ** 2))
    shade = 1 - 0.13 * hem_line - 0.10 * seam
    if figure.person.closure == "shirt":
        x, z = samples.rest[:, 0], samples.rest[:, 2]
        shade -= 0.16 * np.exp(-(((np.abs(x) - 0.016 * figure.size) / 0.003) ** 2)) * (z > 0.02)
    return shade


def _buttoned(figure: Figure, samples: Samples) -> Samples:
    lowest = {"shirt": -1.0, "polo": figure.joints[12, 1] - 0.17}.get(figure.person.closure)
    if lowest is None:
        return samples
    x, y, z = samples.rest.T
    place = (figure.joints[12, 1] - 0.115 - y) / 0.085
    near = np.hypot(x, (place - np.rint(place)) * 0.085) < 0.0065
    button = near & (z > 0.02) & (samples.normal[:, 2] > 0.3) & (y > lowest)
    tone = np.array([0.88, 0.86, 0.80]) if sum(figure.person.top.colour) < 1.5 else np.array([0.30, 0.26, 0.22])
    return samples.changed(colour=np.where(button[:, None], tone, samples.colour))


def _inner(figure: Figure, rng: np.random.Generator) -> Samples:
    """What an open jacket shows, tucked under its edges."""
    inner = figure.person.inner
    samples = scatter(hung(figure, figure.tights, inner, over_hips=True), figure.spacing(CLOTH_SPACING_M), rng)
    samples, _ = hemmed(samples, lambda rest, weights: inner_field(figure, rest, weights))
    tucked = 0.015 * step(0.006, -0.010, opening_field(figure, samples.rest))
    samples = laid(figure, samples, inner, figure.person.seed * 10 + 5)
    return thinned(samples.changed(position=samples.position - samples.normal * tucked[:, None]))


def _trousers(figure: Figure, rng: np.random.Generator) -> Samples:
    person = figure.person
    samples = scatter(hung(figure, figure.tights, person.bottom), figure.spacing(CLOTH_SPACING_M), rng)
    samples, depth = hemmed(samples, lambda rest, weights: bottom_field(figure, rest, weights))
    hidden = top_field(figure, samples.rest, samples.skin_weights)
    samples, depth, hidden = samples.select(hidden < 0.05), depth[hidden < 0.05], hidden[hidden < 0.05]
    samples = laid(figure, samples, person.bottom, person.seed * 10 + 7)
    cuff = np.exp(-(((depth - 0.02) / 0.004) ** 2)) + 0.7 * step(0.004, 0.0, depth)
    inside = 0.008 * step(0.0, 0.02, hidden)
    return thinned(
        samples.changed(
            position=samples.position - samples.normal * inside[:, None],
            colour=samples.colour * (1 - 0.15 * cuff)[:, None],
        )
    )


def _leggings(figure: Figure, garment: Garment, rng: np.random.Generator) -> Samples:
    samples = scatter(hung(figure, figure.tights, garment, rounds=0), figure.spacing(CLOTH_SPACING_M), rng)
    hem = skirt_hem(figure)
    high = samples.rest[:, 1] < hem + 0.10
    bare = shoe_field(figure, samples.rest, samples.skin_weights) < 0.015
    samples = samples.select(high & bare)
    inside = 0.003 * step(0.0, 0.02, shoe_field(figure, samples.rest, samples.skin_weights))
    inside += 0.012 * step(hem - 0.03, hem + 0.04, samples.rest[:, 1])
    samples = samples.changed(position=samples.position - samples.normal * inside[:, None])
    return thinned(laid(figure, samples, garment, figure.person.seed * 10 + 8))


def _skirt(figure: Figure, rng: np.random.Generator) -> Samples:
    person = figure.person
    y = figure.skirt.vertices[:, 1]
    flare = 0.042 * step(figure.joints[1, 1], skirt_hem(figure), y)
    surface = figure.skirt.moved(smoothed(figure.skirt, 3))
    surface = surface.moved(surface.vertices + surface.normals * (0.004 + flare)[:, None])
    samples = scatter(surface, figure.spacing(PATTERN_SPACING_M), rng)
    samples, depth = hemmed(samples, lambda rest, weights: rest[:, 1] - skirt_hem(figure))
    hidden = top_field(figure, samples.rest, samples.skin_weights)
    kept = (hidden < 0.05) & (samples.rest[:, 1] < figure.joints[3, 1] + 0.005)
    samples, depth, hidden = samples.select(kept), depth[kept], hidden[kept]
    samples = laid(figure, samples, person.bottom, person.seed * 10 + 7)
    hem = np.exp(-(((depth - 0.025) / 0.004) ** 2))
    return thinned(
        samples.changed(
            position=samples.position - samples.normal * (0.008 * step(0.0, 0.02, hidden))[:, None],
            colour=samples.colour * (1 - 0.2 * hem)[:, None],
            skin_weights=_skirt_weights(figure, samples.rest),
        )
    )


def _skirt_weights(figure: Figure, rest: Array) -> Array:
    """A skirt follows the pelvis at the waist and the nearer thigh below; between the legs it mostly hangs.

    The mean of two thighs that swing apart would be shorter than either: a skirt that followed both equally in the
    middle would gape there.
    """
    weights = np.zeros((len(rest), 24))
    apart = np.abs(figure.joints[4, 0])
    low = step(figure.joints[1, 1] + 0.06, skirt_hem(figure) + 0.08, rest[:, 1])
    legs = low * (0.6 + 0.37 * step(0.2 * apart, 1.1 * apart, np.abs(rest[:, 0])))
    left = step(-0.7 * apart, 0.7 * apart, rest[:, 0])
    weights[:, 0], weights[:, 1], weights[:, 2] = 1 - legs, legs * left, legs * (1 - left)
    return weights


def _collar(figure: Figure, garment: Garment, rng: np.random.Generator) -> Samples:
    """A folded band that stands on the neckline, open at the front; its edges are rows of samples."""
    gap = 0.75 if figure.person.closure == "open" else 0.34
    rows = np.linspace(gap, np.pi, 400)
    fall = np.concatenate([np.full(400, 0.99), np.linspace(0.0, 1.0, 60), rng.random(8000)])
    turn = np.concatenate([rows, np.full(60, gap + 0.01), rng.uniform(gap, np.pi, 8000)])
    edge = np.arange(len(fall)) < 460
    fall, turn, edge = np.tile(fall, 2), np.concatenate([turn, -turn]), np.tile(edge, 2)
    order = np.argsort(~edge, kind="stable")
    fall, turn, edge = fall[order], turn[order], edge[order]
    rest = _collar_points(figure, turn, fall, gap)
    along = _collar_points(figure, turn + 0.02, fall, gap) - rest
    down = _collar_points(figure, turn, fall + 0.02, gap) - rest
    weights = np.zeros((len(rest), 24))
    weights[:, 12], weights[:, 9] = 0.35, 0.65
    normal = unit(np.cross(down, along))
    samples = new_samples(position=rest, rest=rest, normal=normal, skin_weights=weights, spacing_m=COLLAR_SPACING_M)
    front = edge & (np.abs(np.abs(turn) - gap - 0.01) < 1e-9)
    samples = samples.changed(
        tangent=unit(np.where(front[:, None], down, along)), stretch=np.where(edge, 2.2, samples.stretch)
    )
    colour = np.broadcast_to(garment.colour, rest.shape)
    if garment.fabric == "checks":
        colour = mix(colour, garment.second, 0.5 * bands(turn * 0.07, 0.05, 0.5) + 0.35 * bands(fall, 0.9, 0.4))
    edges = 1.03 - 0.10 * step(0.10, 0.0, fall) - 0.12 * step(0.90, 1.0, fall)
    return thinned(samples.changed(colour=np.clip(colour * edges[:, None], 0, 1)))


def _collar_points(figure: Figure, turn: Array, fall: Array, gap: float) -> Array:
    """The collar's surface by the direction around the neck [rad] and the place from its fold, 0, to its edge, 1."""
    base, outward = _neckline(figure, turn)
    up = np.array([0.0, 1.0, 0.0])
    size = figure.size
    stand = np.minimum(0.026, 0.013 + 0.02 * (np.abs(turn) - gap))
    tip = np.exp(-(((np.abs(turn) - gap) / 0.30) ** 2))
    top = base + size * (0.003 * outward + stand[:, None] * up)
    end = base + size * ((0.021 + 0.009 * tip)[:, None] * outward - (0.012 + 0.026 * tip)[:, None] * up)
    bulge = 0.006 * size * np.sin(np.pi * fall)[:, None] * (outward + 0.6 * up)
    return top + fall[:, None] * (end - top) + bulge


def _neckline(figure: Figure, turn: Array) -> tuple[Array, Array]:
    """Points of the body on the neckline in directions around the neck, and the directions, shapes (N, 3)."""
    body, size = figure.body, figure.size
    neck = figure.joints[12]
    near = np.abs(neck_field(figure, body.rest, "crew")) < 0.012 * size
    near &= np.abs(body.rest[:, 0]) < 0.14 * size
    ring = body.rest[near]
    centre = np.array([0.0, 0.5 * (ring[:, 2].min() + ring[:, 2].max())])
    angle = np.arctan2(ring[:, 0], ring[:, 2] - centre[1])
    radius = np.hypot(ring[:, 0], ring[:, 2] - centre[1])
    share = np.exp(-0.5 * ((np.abs(turn)[:, None] - np.abs(angle)[None]) / 0.16) ** 2)
    r = (share @ radius) / share.sum(1)
    z = centre[1] + r * np.cos(turn)
    y = neck[1] + 0.012 * size - 0.55 * (z - neck[2])
    outward = np.stack([np.sin(turn), np.zeros_like(turn), np.cos(turn)], axis=1)
    return np.stack([r * np.sin(turn), y, z], axis=1), outward
