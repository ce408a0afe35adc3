"""Clothes as layers of samples: how each garment hangs, is cut and is sewn."""

import numpy as np
import numpy.typing as npt
from avatars_fabric import bands, laid
from avatars_figure import (
    ARMS,
    FEET,
    LEGS,
    Figure,
    bottom_field,
    neck_field,
    opening_field,
    shoe_field,
    skirt_hem,
    top_field,
)
from avatars_people import Garment
from avatars_surface import (
    CANDIDATES,
    Samples,
    Surface,
    joined,
    mix,
    new_samples,
    noise,
    scatter,
    smoothed,
    step,
    thinned,
    unit,
)
from scipy.spatial import ConvexHull

Array = npt.NDArray[np.float64]

CLOTH_SPACING_M = 0.0065
PATTERN_SPACING_M = 0.0052
SHOE_SPACING_M = 0.005
SOLE_M = 0.018
"""Thickness of the soles: the body is lifted by it."""
SOLE_WALL_M = 0.010
"""How far a sole's wall covers the shoe."""


def dressed(figure: Figure, rng: np.random.Generator) -> list[Samples]:
    """All garments of a person as layers of samples."""
    layers = [_top(figure, rng), _shoes(figure, rng)]
    layers += [_skirt(figure, rng)] if figure.person.bottom_kind == "skirt" else [_trousers(figure, rng)]
    if figure.person.closure in ("shirt", "polo"):
        layers.append(_collar(figure, figure.person.top, rng))
    if figure.person.closure == "open":
        layers += [_inner(figure, rng), _collar(figure, figure.person.top, rng)]
    if figure.person.legs is not None:
        layers.append(_leggings(figure, figure.person.legs, rng))
    return layers


def _top(figure: Figure, rng: np.random.Generator) -> Samples:
    person = figure.person
    surface = hung(figure, figure.tights, person.top)
    spacing = PATTERN_SPACING_M if person.top.fabric in ("breton", "checks", "stripes") else CLOTH_SPACING_M
    samples = scatter(surface, spacing, rng)
    depth = top_field(figure, samples.rest, samples.skin_weights)
    if person.closure == "open":
        depth = np.minimum(depth, -opening_field(figure, samples.rest))
    keep = depth > 0
    samples, depth = samples.select(keep), depth[keep]
    flare = 0.004 * step(0.03, 0.0, depth)
    samples = samples.changed(position=samples.position + samples.normal * flare[:, None])
    samples = laid(figure, _along_stripes(figure, samples, person.top), person.top, person.seed * 10)
    samples = samples.changed(colour=samples.colour * _tailoring(figure, samples, depth)[:, None])
    return thinned(_buttoned(figure, samples))


def _along_stripes(figure: Figure, samples: Samples, garment: Garment) -> Samples:
    """Longer samples along horizontal stripes, which keeps their edges sharp."""
    if garment.fabric != "breton":
        return samples
    left = samples.rest[:, :1] > 0
    arm = unit(np.where(left, figure.joints[18] - figure.joints[16], figure.joints[19] - figure.joints[17]))
    on_arm = samples.skin_weights[:, ARMS].sum(1, keepdims=True) > 0.5
    up = np.where(on_arm, arm, np.array([0.0, 1.0, 0.0]))
    return samples.changed(tangent=unit(np.cross(up, samples.normal)), stretch=np.full(len(samples), 2.0))


def _tailoring(figure: Figure, samples: Samples, depth: Array) -> Array:
    """Darker lines where cloth is sewn: hems, armholes, the placket."""
    hem_line = np.exp(-(((depth - 0.018) / 0.0035) ** 2))
    armhole = samples.skin_weights[:, ARMS].sum(1)
    seam = np.exp(-(((armhole - 0.5) / 0.06) ** 2))
    shade = 1 - 0.13 * hem_line - 0.10 * seam
    if figure.person.closure == "shirt":
        x, z = samples.rest[:, 0], samples.rest[:, 2]
        shade -= 0.16 * np.exp(-(((np.abs(x) - 0.017) / 0.003) ** 2)) * (z > 0.02)
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
    inner = figure.person.inner
    samples = scatter(hung(figure, figure.tights, inner), CLOTH_SPACING_M, rng)
    depth = np.minimum(neck_field(figure, samples.rest, "crew"), samples.rest[:, 1] - (figure.joints[1, 1] - 0.03))
    depth = np.minimum(depth, opening_field(figure, samples.rest) + 0.035)
    return thinned(laid(figure, samples.select(depth > 0), inner, figure.person.seed * 10 + 5))


def _trousers(figure: Figure, rng: np.random.Generator) -> Samples:
    person = figure.person
    samples = scatter(hung(figure, figure.tights, person.bottom), CLOTH_SPACING_M, rng)
    depth = bottom_field(figure, samples.rest, samples.skin_weights)
    hidden = top_field(figure, samples.rest, samples.skin_weights)
    samples = samples.select((depth > 0) & (hidden < 0.05))
    inside = step(0.0, 0.02, top_field(figure, samples.rest, samples.skin_weights))
    samples = laid(figure, samples, person.bottom, person.seed * 10 + 7)
    cuff = np.exp(-(((bottom_field(figure, samples.rest, samples.skin_weights) - 0.02) / 0.004) ** 2))
    return thinned(
        samples.changed(
            position=samples.position - samples.normal * (0.006 * inside)[:, None],
            colour=samples.colour * (1 - 0.15 * cuff)[:, None],
        )
    )


def _leggings(figure: Figure, garment: Garment, rng: np.random.Generator) -> Samples:
    samples = scatter(hung(figure, figure.tights, garment, rounds=0), CLOTH_SPACING_M, rng)
    high = samples.rest[:, 1] < skirt_hem(figure) + 0.14
    bare = shoe_field(figure, samples.rest, samples.skin_weights) < 0.015
    samples = samples.select(high & bare)
    inside = step(0.0, 0.02, shoe_field(figure, samples.rest, samples.skin_weights))
    samples = samples.changed(position=samples.position - samples.normal * (0.003 * inside)[:, None])
    return thinned(laid(figure, samples, garment, figure.person.seed * 10 + 8))


def _skirt(figure: Figure, rng: np.random.Generator) -> Samples:
    person = figure.person
    y = figure.skirt.vertices[:, 1]
    flare = 0.025 * step(figure.joints[1, 1], skirt_hem(figure), y)
    surface = figure.skirt.moved(smoothed(figure.skirt, 3))
    surface = surface.moved(surface.vertices + surface.normals * (0.004 + flare)[:, None])
    samples = scatter(surface, PATTERN_SPACING_M, rng)
    hidden = top_field(figure, samples.rest, samples.skin_weights)
    depth = samples.rest[:, 1] - skirt_hem(figure)
    samples = samples.select((depth > 0) & (hidden < 0.05) & (samples.rest[:, 1] < figure.joints[3, 1] + 0.005))
    samples = laid(figure, samples, person.bottom, person.seed * 10 + 7)
    inside = step(0.0, 0.02, top_field(figure, samples.rest, samples.skin_weights))
    hem = np.exp(-(((samples.rest[:, 1] - skirt_hem(figure) - 0.025) / 0.004) ** 2))
    return thinned(
        samples.changed(
            position=samples.position - samples.normal * (0.008 * inside)[:, None],
            colour=samples.colour * (1 - 0.2 * hem)[:, None],
            skin_weights=_skirt_weights(figure, samples.rest),
        )
    )


def _skirt_weights(figure: Figure, rest: Array) -> Array:
    """A skirt follows the pelvis at the waist and both thighs, smoothly shared, below."""
    weights = np.zeros((len(rest), 24))
    legs = 0.85 * step(figure.joints[1, 1] + 0.06, skirt_hem(figure) + 0.10, rest[:, 1])
    left = step(-0.11, 0.11, rest[:, 0])
    weights[:, 0], weights[:, 1], weights[:, 2] = 1 - legs, legs * left, legs * (1 - left)
    return weights


def _shoes(figure: Figure, rng: np.random.Generator) -> Samples:
    person = figure.person
    surface = figure.tights.moved(smoothed(figure.tights, 6))
    surface = surface.moved(surface.vertices + surface.normals * 0.0055)
    feet = figure.tights.skin_weights[:, FEET].sum(1) > 0.2
    samples = scatter(surface, SHOE_SPACING_M, rng, where=feet)
    depth = shoe_field(figure, samples.rest, samples.skin_weights)
    keep = (depth > 0) & (samples.position[:, 1] > 0.004) & (samples.normal[:, 1] > -0.75)
    samples, depth = samples.select(keep), depth[keep]
    grain = noise(samples.rest * 120, person.seed)
    shade = 1 + 0.05 * grain + 0.10 * (samples.normal[:, 1] - 0.3)
    samples = samples.changed(colour=np.asarray(person.shoes.colour) * shade[:, None])
    soles = [_sole(figure, samples, side, rng) for side in (1, -1)]
    return joined([thinned(_laced(figure, samples, depth)), *soles])


def _sole(figure: Figure, upper: Samples, side: int, rng: np.random.Generator) -> Samples:
    """Wall and underside of one sole: the shoe's outline seen from above, slightly widened."""
    near = (upper.position[:, 0] * side > 0) & (upper.position[:, 1] < 0.045)
    points = upper.position[near][:, [0, 2]]
    corners = points[ConvexHull(points).vertices]
    middle = corners.mean(axis=0)
    corners = corners + 0.0025 * unit(corners - middle)
    edges = np.roll(corners, -1, axis=0) - corners
    length = np.linalg.norm(edges, axis=1)
    count = int(CANDIDATES * length.sum() * (SOLE_M + SOLE_WALL_M) / SHOE_SPACING_M**2)
    edge = rng.choice(len(edges), count, p=length / length.sum())
    outline = corners[edge] + rng.random((count, 1)) * edges[edge]
    wall = np.stack([outline[:, 0], rng.uniform(-SOLE_M, SOLE_WALL_M, count), outline[:, 1]], axis=1)
    outward = unit(np.stack([edges[edge, 1], np.zeros(count), -edges[edge, 0]], axis=1))
    flat = middle + (outline - middle) * np.sqrt(rng.random((count, 1)))
    under = np.stack([flat[:, 0], np.full(count, 0.001 - SOLE_M), flat[:, 1]], axis=1)
    rest = np.concatenate([wall, under])
    normal = np.concatenate([outward, np.broadcast_to((0.0, -1.0, 0.0), under.shape)])
    weights = np.zeros((2 * count, 24))
    toes = step(figure.joints[10, 2] - 0.025, figure.joints[10, 2] + 0.025, rest[:, 2])
    ankle, ball = (7, 10) if side > 0 else (8, 11)
    weights[:, ankle], weights[:, ball] = 1 - toes, toes
    samples = new_samples(position=rest, rest=rest, normal=normal, skin_weights=weights, spacing_m=SHOE_SPACING_M)
    tread = 1 - 0.25 * (rest[:, 1] < 0.003 - SOLE_M)
    return thinned(samples.changed(colour=np.asarray(figure.person.sole) * tread[:, None]))


def _laced(figure: Figure, samples: Samples, depth: Array) -> Samples:
    ankle = figure.joints[7]
    z = samples.rest[:, 2] - ankle[2]
    rim = np.exp(-((depth / 0.006) ** 2))
    samples = samples.changed(colour=samples.colour * (1 - 0.3 * rim)[:, None])
    if figure.person.bottom_kind == "skirt":
        return samples
    across = np.abs(np.abs(samples.rest[:, 0]) - (ankle[0] + (figure.joints[10, 0] - ankle[0]) * z / 0.16))
    tongue = (across < 0.019) & (z > 0.035) & (z < 0.115) & (samples.normal[:, 1] > 0.35)
    lace = tongue & (np.abs((z / 0.014) - np.floor(z / 0.014) - 0.5) < 0.22)
    light = 0.45 * np.asarray(figure.person.shoes.colour) + 0.5
    colour = np.where(tongue[:, None], 0.75 * samples.colour, samples.colour)
    return samples.changed(colour=np.where(lace[:, None], light, colour))


def _collar(figure: Figure, garment: Garment, rng: np.random.Generator) -> Samples:
    """A folded band that stands on the neckline, open at the front."""
    lapel = figure.person.closure == "open"
    gap = 0.75 if lapel else 0.30
    count = 16000
    turn = rng.uniform(gap, np.pi, count) * np.where(rng.random(count) < 0.5, -1, 1)
    fall = rng.random(count)
    base, outward = _neckline(figure, turn)
    stand = np.minimum(0.024, 0.012 + 0.02 * (np.abs(turn) - gap))
    tip = np.exp(-(((np.abs(turn) - gap) / 0.28) ** 2))
    top = base + 0.004 * outward + stand[:, None] * np.array([0.0, 1.0, 0.0])
    end = base + (0.022 + 0.010 * tip)[:, None] * outward - (0.016 + 0.022 * tip)[:, None] * np.array([0.0, 1.0, 0.0])
    bulge = 0.010 * np.sin(np.pi * fall)[:, None] * (outward + np.array([0.0, 0.6, 0.0]))
    rest = top + fall[:, None] * (end - top) + bulge
    normal = unit(outward + np.array([0.0, 0.65, 0.0]))
    weights = np.zeros((count, 24))
    weights[:, 12], weights[:, 9] = 0.35, 0.65
    samples = new_samples(position=rest, rest=rest, normal=normal, skin_weights=weights, spacing_m=0.0045)
    colour = np.broadcast_to(garment.colour, (count, 3))
    if garment.fabric == "checks":
        colour = mix(colour, garment.second, 0.5 * bands(turn * 0.07, 0.05, 0.5) + 0.35 * bands(fall, 0.9, 0.4))
    edges = 1.03 - 0.14 * step(0.10, 0.0, fall) - 0.14 * step(0.92, 1.0, fall)
    return thinned(samples.changed(colour=np.clip(colour * edges[:, None], 0, 1)))


def _neckline(figure: Figure, turn: Array) -> tuple[Array, Array]:
    """Points of the body on the neckline in directions around the neck, and the directions, shapes (N, 3)."""
    body = figure.body
    neck = figure.joints[12]
    near = np.abs(neck_field(figure, body.rest, "crew")) < 0.012
    near &= np.abs(body.rest[:, 0]) < 0.14
    ring = body.rest[near]
    centre = np.array([0.0, 0.5 * (ring[:, 2].min() + ring[:, 2].max())])
    angle = np.arctan2(ring[:, 0], ring[:, 2] - centre[1])
    radius = np.hypot(ring[:, 0], ring[:, 2] - centre[1])
    share = np.exp(-0.5 * ((np.abs(turn)[:, None] - np.abs(angle)[None]) / 0.16) ** 2)
    r = (share @ radius) / share.sum(1)
    z = centre[1] + r * np.cos(turn)
    y = neck[1] + 0.012 - 0.55 * (z - neck[2])
    outward = np.stack([np.sin(turn), np.zeros_like(turn), np.cos(turn)], axis=1)
    return np.stack([r * np.sin(turn), y, z], axis=1), outward


def hung(figure: Figure, surface: Surface, garment: Garment, *, rounds: int = 24) -> Surface:
    """The surface widened to cloth: hollows bridged, sleeves and legs straightened, lifted off the body."""
    bridged = ((smoothed(surface, rounds) - surface.vertices) * surface.normals).sum(1)
    lift = garment.offset_m + np.clip(bridged, 0.0, 0.035) * (0.5 + 0.5 * garment.looseness)
    lift += garment.looseness * np.clip(_tube_radius(figure, surface) - _limb_radius(figure, surface), 0.0, 0.03)
    return surface.moved(surface.vertices + surface.normals * lift[:, None])


def _limb_axes(figure: Figure, surface: Surface) -> tuple[Array, Array, Array]:
    """Start and end of the limb that each vertex belongs to, and the share of its weight on that limb."""
    left = surface.rest[:, :1] > 0
    ends = {4: 7, 16: 18, 18: 20}
    start, end = np.zeros_like(surface.rest), np.zeros_like(surface.rest)
    share = np.zeros(len(start))
    for first, last in ends.items():
        weight = surface.skin_weights[:, [first, first + 1]].sum(1)
        weight += surface.skin_weights[:, [7, 8]].sum(1) if first == 4 else 0.0
        closer = weight > share
        start = np.where(closer[:, None], np.where(left, figure.joints[first], figure.joints[first + 1]), start)
        end = np.where(closer[:, None], np.where(left, figure.joints[last], figure.joints[last + 1]), end)
        share = np.maximum(weight, share)
    return start, end, share


def _limb_radius(figure: Figure, surface: Surface) -> Array:
    start, end, _ = _limb_axes(figure, surface)
    axis = unit(end - start)
    offset = surface.rest - start
    return np.linalg.norm(offset - (offset * axis).sum(1, keepdims=True) * axis, axis=1)


def _tube_radius(figure: Figure, surface: Surface) -> Array:
    """Radius that a loose sleeve or trouser leg keeps [m]."""
    start, end, share = _limb_axes(figure, surface)
    length = np.linalg.norm(end - start, axis=1)
    along = ((surface.rest - start) * unit(end - start)).sum(1) / np.maximum(length, 1e-9)
    leg = surface.skin_weights[:, LEGS].sum(1) > 0.5
    girth = np.where(leg, 0.086 - 0.012 * along, 0.056 - 0.010 * np.clip(along, 0, 1))
    return np.where(share > 0.0, girth * step(0.3, 0.8, share), 0.0)
