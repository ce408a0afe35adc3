"""Shoes: uppers on the feet, laces, and soles."""

import numpy as np
import numpy.typing as npt
from avatars_figure import FEET, Figure, shoe_field
from avatars_surface import Samples, hemmed, joined, new_samples, noise, scatter, smoothed, step, thinned, unit
from scipy.spatial import ConvexHull

Array = npt.NDArray[np.float64]

SHOE_SPACING_M = 0.005
SOLE_M = 0.018
"""Thickness of the soles: the body is lifted by it."""
SOLE_WALL_M = 0.004
"""How far a sole's wall covers the shoe."""
SOLE_ROW_M = 0.0042


def shoes(figure: Figure, rng: np.random.Generator) -> Samples:
    """Both shoes of a person."""
    person = figure.person
    surface = figure.tights.moved(smoothed(figure.tights, 6))
    surface = surface.moved(surface.vertices + surface.normals * 0.0055)
    feet = figure.tights.skin_weights[:, FEET].sum(1) > 0.2
    samples = scatter(surface, SHOE_SPACING_M, rng, where=feet)
    samples = samples.select((samples.position[:, 1] > 0.001) & (samples.normal[:, 1] > -0.75))
    samples, depth = hemmed(samples, lambda rest, weights: shoe_field(figure, rest, weights))
    grain = noise(samples.rest * 120, person.seed)
    shade = 1 + 0.04 * grain + 0.10 * (samples.normal[:, 1] - 0.3)
    samples = samples.changed(colour=np.asarray(person.shoes.colour) * shade[:, None])
    soles = [_sole(figure, samples, side) for side in (1, -1)]
    return joined([thinned(_laced(figure, samples, depth)), *soles])


def _laced(figure: Figure, samples: Samples, depth: Array) -> Samples:
    """A darker rim, a tongue and laces."""
    ankle, size = figure.joints[7], figure.size
    z = (samples.rest[:, 2] - ankle[2]) / size
    rim = np.exp(-((depth / 0.005) ** 2))
    samples = samples.changed(colour=samples.colour * (1 - 0.35 * rim)[:, None])
    if figure.person.bottom_kind == "skirt":
        return samples
    line = ankle[0] + (figure.joints[10, 0] - ankle[0]) * z / 0.16
    across = np.abs(np.abs(samples.rest[:, 0]) - line) / size
    tongue = (across < 0.019) & (z > 0.035) & (z < 0.115) & (samples.normal[:, 1] > 0.35)
    lace = tongue & (np.abs((z / 0.014) - np.floor(z / 0.014) - 0.5) < 0.22)
    light = 0.45 * np.asarray(figure.person.shoes.colour) + 0.5
    colour = np.where(tongue[:, None], 0.75 * samples.colour, samples.colour)
    return samples.changed(colour=np.where(lace[:, None], light, colour))


def _sole(figure: Figure, upper: Samples, side: int) -> Samples:
    """Wall and underside of one sole: the shoe's outline seen from above, slightly widened."""
    near = (upper.position[:, 0] * side > 0) & (upper.position[:, 1] < 0.035)
    points = upper.position[near][:, [0, 2]]
    corners = points[ConvexHull(points).vertices]
    middle = corners.mean(axis=0)
    outline, outward = _even_outline(corners + 0.002 * unit(corners - middle))
    heights = np.arange(0.4 * SOLE_ROW_M - SOLE_M, SOLE_WALL_M, 0.75 * SOLE_ROW_M)
    wall = np.concatenate([np.insert(outline, 1, height, axis=1) for height in heights])
    shares = np.sqrt((np.arange(14) + 0.5) / 14)
    rings = [middle + share * (outline[:: 1 if share > 0.7 else 2] - middle) for share in shares]
    flat = np.concatenate(rings)
    under = np.insert(flat, 1, 0.001 - SOLE_M, axis=1)
    rest = np.concatenate([wall, under])
    walls = np.tile(np.insert(outward, 1, 0.0, axis=1), (len(heights), 1))
    normal = np.concatenate([walls, np.broadcast_to((0.0, -1.0, 0.0), under.shape)])
    weights = np.zeros((len(rest), 24))
    bend = 0.025 * figure.size
    toes = step(figure.joints[10, 2] - bend, figure.joints[10, 2] + bend, rest[:, 2])
    ankle, ball = (7, 10) if side > 0 else (8, 11)
    weights[:, ankle], weights[:, ball] = 1 - toes, toes
    samples = new_samples(position=rest, rest=rest, normal=normal, skin_weights=weights, spacing_m=SOLE_ROW_M)
    around = np.tile(np.stack([outward[:, 1], 0 * outward[:, 0], -outward[:, 0]], axis=1), (len(heights), 1))
    tangent = np.concatenate([around, samples.tangent[len(wall) :]])
    stretch = np.where(np.arange(len(rest)) < len(wall), 2.0, 1.0)
    tread = 1 - 0.25 * (rest[:, 1] < 0.003 - SOLE_M)
    welt = 1 - 0.20 * (rest[:, 1] > SOLE_WALL_M - 0.004)
    colour = np.asarray(figure.person.sole) * (tread * welt)[:, None]
    return samples.changed(colour=colour, tangent=tangent, stretch=stretch)


def _even_outline(corners: Array) -> tuple[Array, Array]:
    """Points at even distances on a closed polygon that runs counter-clockwise, and its outward normals, (N, 2)."""
    ends = np.roll(corners, -1, axis=0)
    length = np.linalg.norm(ends - corners, axis=1)
    travelled = np.concatenate([[0.0], np.cumsum(length)])
    places = np.arange(0.0, travelled[-1], SOLE_ROW_M)
    edge = np.clip(np.searchsorted(travelled, places, side="right") - 1, 0, len(corners) - 1)
    share = ((places - travelled[edge]) / length[edge])[:, None]
    along = unit(ends - corners)
    outline = corners[edge] + share * (ends - corners)[edge]
    return outline, np.stack([along[edge, 1], -along[edge, 0]], axis=1)
