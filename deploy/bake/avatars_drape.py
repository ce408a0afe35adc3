"""How cloth hangs on a body: over hollows, in tubes around limbs."""

import numpy as np
import numpy.typing as npt
from avatars_figure import ARMS, LEGS, Figure
from avatars_people import Garment
from avatars_surface import Surface, averaged, smoothed, step
from scipy.ndimage import map_coordinates
from scipy.spatial import ConvexHull

Array = npt.NDArray[np.float64]

# Radii that a wide sleeve or trouser leg keeps at its three joints [m], for a person of 1.72 m.
SLEEVE_RADII_M = (0.058, 0.053, 0.043)
LEG_RADII_M = (0.090, 0.073, 0.068)
SLACK_LIMIT_M = 0.03
BRIDGED_LIMIT_M = 0.035


def hung(figure: Figure, surface: Surface, garment: Garment, *, rounds: int = 24, over_hips: bool = False) -> Surface:
    """The surface widened to cloth: hollows bridged, bumps softened, sleeves and legs straightened, off the body.

    Args:
        figure: Who wears it.
        surface: Skin, or a suit that fits closely.
        garment: What it becomes.
        rounds: Width of the hollows that it bridges, in rounds of smoothing.
        over_hips: It hangs over the hips as a shirt does, not between the legs as trousers do.
    """
    size = figure.size
    if over_hips:
        surface = _over_hips(figure, surface)
    bridged = ((smoothed(surface, rounds) - surface.vertices) * surface.normals).sum(1)
    bridged = np.clip(bridged, -0.6 * garment.offset_m, BRIDGED_LIMIT_M * size)
    lift = garment.offset_m + bridged * (0.5 + 0.5 * garment.looseness)
    lift += garment.looseness * _slack(figure, surface)
    lift = averaged(surface, lift, 5)
    return surface.moved(surface.vertices + surface.normals * lift[:, None])


def _over_hips(figure: Figure, surface: Surface) -> Surface:
    """The surface, below the waist pushed out to the convex outline of the body: a shirt spans furrows."""
    waist, size = figure.joints[3, 1], figure.size
    trunk = surface.skin_weights[:, ARMS].sum(1) < 0.3
    x, y, z = surface.rest.T
    z_axis = float(figure.joints[0, 2])
    heights = np.arange(figure.joints[1, 1] - 0.12 * size, waist + 0.08 * size, 0.01)
    turns = np.linspace(-np.pi, np.pi, 73)
    rings = []
    for height in heights:
        near = trunk & (np.abs(y - height) < 0.015)
        edges = ConvexHull(np.stack([x[near], z[near] - z_axis], axis=1)).equations
        facing = np.maximum(np.sin(turns)[:, None] * edges[:, 0] + np.cos(turns)[:, None] * edges[:, 1], 1e-6)
        rings.append((-edges[:, 2] / facing).min(axis=1))
    place = (y - heights[0]) / 0.01
    turn = (np.arctan2(x, z - z_axis) + np.pi) / (2 * np.pi) * 72
    outline = map_coordinates(np.array(rings), [place, turn], order=1, mode="nearest")
    below = step(waist + 0.06 * size, waist - 0.06 * size, y) * trunk
    radius = np.hypot(x, z - z_axis)
    grown = 1 + below * np.maximum(outline - radius, 0.0) / np.maximum(radius, 0.02)
    return surface.moved(np.stack([x * grown, y, z_axis + (z - z_axis) * grown], axis=1))


def _slack(figure: Figure, surface: Surface) -> Array:
    """How far the tube of a wide sleeve or trouser leg is from the limb [m], shape (V,)."""
    left = surface.rest[:, :1] > 0
    slack = np.zeros(len(left))
    for chain, radii, members, begin in (
        ((16, 18, 20), SLEEVE_RADII_M, ARMS, (0.2, 0.6)),
        ((1, 4, 7), LEG_RADII_M, LEGS, (0.45, 0.85)),
    ):
        nodes = [np.where(left, figure.joints[k], figure.joints[k + 1]) for k in chain]
        along, distance = _along(surface.rest, nodes)
        wanted = np.interp(along, (0.0, 1.0, 2.0), radii) * figure.size
        share = step(0.3, 0.8, surface.skin_weights[:, members].sum(1)) * step(*begin, along)
        slack += share * np.clip(wanted - distance, 0.0, SLACK_LIMIT_M * figure.size)
    return slack


def _along(points: Array, nodes: list[Array]) -> tuple[Array, Array]:
    """Place on a limb of two bones, 0..2, and the distance to it [m], shapes (N,)."""
    place, nearest = np.zeros(len(points)), np.full(len(points), np.inf)
    for k in range(2):
        bone = nodes[k + 1] - nodes[k]
        share = np.clip(((points - nodes[k]) * bone).sum(1) / (bone * bone).sum(1), 0.0, 1.0)
        distance = np.linalg.norm(points - nodes[k] - share[:, None] * bone, axis=1)
        place = np.where(distance < nearest, k + share, place)
        nearest = np.minimum(distance, nearest)
    return place, nearest
