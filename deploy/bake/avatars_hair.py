"""Hair of a person, as layers of samples, and the landmarks of a head."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from avatars_figure import Figure
from avatars_surface import Samples, masked, new_samples, noise, scatter, smoothed, step, thinned, unit

Array = npt.NDArray[np.float64]

HEAD = 15
HAIR_SPACING_M = 0.0042
ADULT_EYE_X_M = 0.0303
THICKNESS_M = {"short": 0.018, "cropped": 0.0045, "mop": 0.022, "bob": 0.017, "bun": 0.008, "ponytail": 0.010}


@dataclass(frozen=True, kw_only=True, eq=False)
class Face:
    """Landmarks of a head in rest coordinates [m]."""

    eyes: Array
    """Centres of the left and right eyeball, shape (2, 3)."""
    eye_radius_m: float
    bridge_z: float
    """Front of the nose between the eyes."""
    ear_x: float
    mouth: Array
    centre: Array
    """Middle of the skull at the height of the brow."""
    ear_z: float

    @property
    def size(self) -> float:
        """Size over that of a grown head."""
        return float(self.eyes[0, 0]) / ADULT_EYE_X_M


def hair_field(style: str, face: Face, rest: Array, ears: Array) -> Array:
    """Height above the hairline [m], positive on the scalp; ears lie outside."""
    offset = (rest - face.centre) / face.size
    turn = np.abs(np.arctan2(offset[:, 0], offset[:, 2]))
    ear_turn = np.arctan2(0.075, (face.ear_z - face.centre[2]) / face.size)
    front = (0.024 if style == "mop" else 0.046) + 0.004 * np.cos(6 * turn)
    temple = 0.014 if style == "mop" else 0.030
    sideburn, nape = -0.028, -0.105
    line = front + (temple - front) * step(0.45, 0.85, turn)
    line = line + (sideburn - temple) * step(0.95, ear_turn - 0.22, turn)
    line = line + (0.006 - sideburn) * step(ear_turn - 0.16, ear_turn - 0.02, turn)
    line = line + (nape - 0.006) * step(ear_turn + 0.05, ear_turn + 0.45, turn)
    return np.where(ears > 0.3, -0.05, (offset[:, 1] - line) * face.size)


def hair(figure: Figure, face: Face, masks: Mapping[str, Array], rng: np.random.Generator) -> list[Samples]:
    """The hair of a person's style."""
    style = figure.person.hair_style
    layers = [_cap(figure, face, masks, rng)]
    if style == "bob":
        layers.append(_curtain(figure, face, 0.135, rng))
    if style == "bun":
        layers.append(_bun(figure, face, rng))
    if style == "ponytail":
        layers.append(_ponytail(figure, face, rng))
    return layers


def _cap(figure: Figure, face: Face, masks: Mapping[str, Array], rng: np.random.Generator) -> Samples:
    style, seed = figure.person.hair_style, figure.person.seed
    body = figure.body
    samples = scatter(body.moved(smoothed(body, 4)), HAIR_SPACING_M, rng)
    samples = samples.select((samples.skin_weights[:, HEAD] > 0.2) & (samples.rest[:, 1] > face.eyes[0, 1] - 0.12))
    ragged = 0.004 * noise(samples.rest * np.array([160.0, 60.0, 160.0]), seed + 4)
    loose = style in ("short", "mop")
    ragged += (0.006 if loose else 0.0) * noise(samples.rest * np.array([70.0, 30.0, 50.0]), seed + 11)
    depth = hair_field(style, face, samples.rest, masked(masks["ears"], samples.texture)) + ragged
    samples, depth = samples.select(depth > 0), depth[depth > 0]
    top = 0.55 + 0.45 * step(0.0, 0.08, samples.rest[:, 1] - face.centre[1])
    rim = 0.30 if loose else 0.15
    height = THICKNESS_M[style] * top * (rim + (1 - rim) * step(0.0, 0.030, depth))
    tuft = noise(samples.rest * np.array([55.0, 25.0, 40.0]), seed + 5)
    lock = noise(samples.rest * np.array([130.0, 45.0, 90.0]), seed + 12)
    height *= 1 + (0.24 * tuft + 0.16 * lock) * (1.0 if loose else 0.6)
    samples = samples.changed(
        position=samples.position + samples.normal * height[:, None],
        tangent=_combed(face, samples, tied=style in ("bun", "ponytail")),
        stretch=np.full(len(samples), 1.0 if style == "cropped" else 2.2),
    )
    samples = _strands(figure, face, thinned(samples))
    return samples


def _combed(face: Face, samples: Samples, *, tied: bool) -> Array:
    """Direction of the strands: away from the crown, or back to a knot."""
    knot = face.centre + np.array([0.0, 0.02, -0.11])
    crown = face.centre + np.array([0.02, 0.10, -0.04])
    flow = knot - samples.rest if tied else samples.rest - crown
    flow = flow if tied else flow - np.array([0.0, 0.03, 0.0])
    return unit(flow - (flow * samples.normal).sum(1, keepdims=True) * samples.normal)


def _strands(figure: Figure, face: Face, samples: Samples) -> Samples:
    """Hair colour with streaks along the strands and a soft sheen."""
    across = np.cross(samples.normal, samples.tangent)
    offset = samples.rest - face.centre
    streak_place = np.stack(
        [
            (offset * across).sum(1) * 260,
            (offset * samples.tangent).sum(1) * 24,
            np.arctan2(offset[:, 0], offset[:, 2]) * 22,
        ],
        axis=1,
    )
    streak = noise(streak_place, figure.person.seed + 6) + 0.5 * noise(samples.rest * 75, figure.person.seed + 7)
    sheen = np.exp(-(((samples.normal[:, 1] - 0.62) / 0.22) ** 2))
    tone = np.asarray(figure.person.hair)
    colour = tone * (1 + 0.26 * streak)[:, None] + (0.05 + 0.20 * tone) * (sheen * (0.6 + 0.5 * streak))[:, None]
    return samples.changed(colour=np.clip(colour, 0.01, 1.0))


def _head_weights(rest: Array, figure: Figure) -> Array:
    weights = np.zeros((len(rest), 24))
    low = step(figure.joints[12, 1] + 0.05, figure.joints[12, 1] - 0.05, rest[:, 1])
    weights[:, HEAD], weights[:, 9] = 1 - 0.8 * low, 0.8 * low
    return weights


def _curtain(figure: Figure, face: Face, length: float, rng: np.random.Generator) -> Samples:
    """Hair that hangs around the head from the height of the temples, open over the face."""
    count = 40000
    turn = rng.uniform(0.0, 1.0, count)
    turn = np.where(rng.random(count) < 0.5, 1.0, -1.0) * (0.98 + (np.pi - 0.98) * turn)
    fall = rng.random(count)
    wide, deep = _skull_girth(figure, face)
    wave = 0.003 * noise(np.stack([turn * 7, fall * 4, turn * 0], axis=1), figure.person.seed + 8)
    swell = 0.010 * np.sin(np.pi * np.clip(fall * 1.05, 0, 1)) - 0.014 * step(0.75, 1.0, fall) + wave
    front = step(1.4, 0.98, np.abs(turn))
    level = 0.050 - 0.010 * front
    ends = length * (1 - 0.10 * front) + 0.004 * noise(np.stack([turn * 40, fall * 0, fall * 0], axis=1), 9)
    out = -0.020 * step(0.30, 0.0, fall) + 0.010 + swell - 0.004 * front
    rest = face.centre + np.stack(
        [np.sin(turn) * (wide + out), level - (level + ends) * fall, np.cos(turn) * (deep + out) + 0.004 * front],
        axis=1,
    )
    normal = unit(
        np.stack([np.sin(turn) / wide, 0.35 - 0.5 * fall, np.cos(turn) / deep * 0 + np.cos(turn) / deep], 1)
        * np.array([1.0, 4.0, 1.0])
    )
    samples = new_samples(
        position=rest, rest=rest, normal=normal, skin_weights=_head_weights(rest, figure), spacing_m=HAIR_SPACING_M
    )
    samples = samples.changed(stretch=np.full(count, 2.2))
    return _strands(figure, face, thinned(samples))


def _skull_girth(figure: Figure, face: Face) -> tuple[float, float]:
    """Half width and half depth of the head with its ears around the face's centre [m]."""
    near = np.abs(figure.body.vertices[:, 1] - face.centre[1]) < 0.03
    near &= figure.body.skin_weights[:, HEAD] > 0.5
    ring = figure.body.vertices[near] - face.centre
    return float(np.percentile(np.abs(ring[:, 0]), 99)), float(-np.percentile(ring[:, 2], 1))


def _blob(
    figure: Figure, face: Face, centre: Array, radii: tuple[float, float, float], rng: np.random.Generator
) -> Samples:
    direction = unit(rng.normal(size=(12000, 3)))
    twist = noise(direction * np.array([5.0, 5.0, 5.0]), figure.person.seed + 10)
    rest = centre + direction * np.asarray(radii) * (1 + 0.06 * twist)[:, None]
    samples = new_samples(
        position=rest,
        rest=rest,
        normal=unit(direction / np.asarray(radii)),
        skin_weights=_head_weights(rest, figure),
        spacing_m=HAIR_SPACING_M,
    )
    around = np.cross(samples.normal, np.broadcast_to((0.3, 0.2, 1.0), rest.shape))
    samples = samples.changed(tangent=unit(around), stretch=np.full(len(rest), 2.0))
    return _strands(figure, face, thinned(samples))


def _bun(figure: Figure, face: Face, rng: np.random.Generator) -> Samples:
    _, deep = _skull_girth(figure, face)
    return _blob(figure, face, face.centre + np.array([0.0, 0.045, -deep - 0.022]), (0.042, 0.040, 0.036), rng)


def _ponytail(figure: Figure, face: Face, rng: np.random.Generator) -> Samples:
    """A tail that leaves the back of the head and hangs to the shoulders."""
    _, deep = _skull_girth(figure, face)
    count = 20000
    along, turn = rng.random(count), rng.uniform(-np.pi, np.pi, count)
    start = face.centre + np.array([0.0, 0.035, -deep - 0.002])
    back = 0.055 * np.sin(np.clip(along * 2.2, 0, np.pi / 2)) - 0.020 * step(0.4, 1.0, along)
    spine = start + np.stack([0 * along, 0.02 * np.sin(along * 3.0) - 0.27 * along**1.25, -back], axis=1)
    girth = 0.012 + 0.020 * np.sin(np.pi * np.clip(along * 0.92 + 0.04, 0, 1)) ** 0.8
    ring = np.stack([np.sin(turn), 0 * turn, np.cos(turn)], axis=1)
    ring[:, 1] = -0.6 * (1 - step(0.0, 0.35, along)) * ring[:, 2]
    rest = spine + unit(ring) * girth[:, None] * np.array([1.0, 1.0, 0.75])
    samples = new_samples(
        position=rest, rest=rest, normal=unit(ring), skin_weights=_head_weights(rest, figure), spacing_m=HAIR_SPACING_M
    )
    samples = thinned(samples.changed(stretch=np.full(count, 2.2)))
    return _strands(figure, face, samples)
