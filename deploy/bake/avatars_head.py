"""Skin, face and hair of a person, as layers of samples."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from avatars_figure import Figure, covered_field
from avatars_surface import (
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

Array = npt.NDArray[np.float64]

HEAD = 15
HANDS = (20, 21, 22, 23)
SKIN_SPACING_M, HAND_SPACING_M, FACE_SPACING_M = 0.0065, 0.0042, 0.0027
FINE_SPACING_M = 0.0021
EYE_SPACING_M = 0.0012
HAIR_SPACING_M = 0.0042


@dataclass(frozen=True, kw_only=True, eq=False)
class Face:
    """Landmarks of a head in rest coordinates [m]."""

    eyes: Array
    """Centres of the left and right eyeball, shape (2, 3)."""
    mouth: Array
    centre: Array
    """Middle of the skull at the height of the brow."""
    ear_z: float


def face_of(figure: Figure, eyes: tuple[Surface, Surface], masks: Mapping[str, Array]) -> Face:
    """Landmarks from the eyeballs, the lip mask and the skull."""
    centres = np.array([0.5 * (eye.vertices.min(0) + eye.vertices.max(0)) for eye in eyes])
    body = figure.body
    corners = body.triangles.reshape(-1)
    lips = corners[masked(masks["lips"], body.texture.reshape(-1, 2)) > 0.5]
    ears = corners[masked(masks["ears"], body.texture.reshape(-1, 2)) > 0.5]
    skull = body.vertices[(body.vertices[:, 1] > centres[0, 1] + 0.02) & (body.skin_weights[:, HEAD] > 0.5)]
    middle_z = 0.5 * (skull[:, 2].min() + skull[:, 2].max())
    return Face(
        eyes=centres,
        mouth=body.vertices[lips].mean(axis=0),
        centre=np.array([0.0, centres[0, 1] + 0.025, middle_z]),
        ear_z=float(body.vertices[ears, 2].mean()),
    )


def masked(mask: Array, texture: Array) -> Array:
    """Values of a mask in texture space, 0..1, shape (N,)."""
    size = len(mask)
    column = np.clip((texture[:, 0] * size).astype(int), 0, size - 1)
    row = np.clip(((1 - texture[:, 1]) * size).astype(int), 0, size - 1)
    return mask[row, column] / 255.0


# --- skin ---------------------------------------------------------------------------------------------------------


def skin(figure: Figure, face: Face, masks: Mapping[str, Array], rng: np.random.Generator) -> Samples:
    """Skin that clothes leave bare, and a margin below their edges."""
    weights = figure.body.skin_weights
    head, hand = weights[:, HEAD] > 0.5, weights[:, HANDS].sum(1) > 0.5
    bare = covered_field(figure, figure.body.rest, weights) < 0.06
    zones = ((head, FACE_SPACING_M), (hand, HAND_SPACING_M), (bare & ~head & ~hand, SKIN_SPACING_M))
    parts = [scatter(figure.body, spacing, rng, where=where) for where, spacing in zones]
    candidates = joined([part.changed(spacing=_skin_spacing(face, part)) for part in parts])
    depth = covered_field(figure, candidates.rest, candidates.skin_weights)
    keep = (depth < 0.025) & (masked(masks["inside-mouth"], candidates.texture) < 0.5)
    samples, depth = candidates.select(keep), depth[keep]
    shrunk = samples.position - samples.normal * (0.006 * step(-0.004, 0.012, depth))[:, None]
    samples = thinned(samples.changed(position=shrunk))
    return samples.changed(colour=_skin_colour(figure, face, masks, samples))


def _skin_spacing(face: Face, samples: Samples) -> Array:
    rest, weights = samples.rest, samples.skin_weights
    low = step(-0.09, -0.07, rest[:, 1] - face.eyes[0, 1])
    front = step(-0.02, 0.02, rest[:, 2] - face.ear_z) * low
    spacing = np.where(weights[:, HEAD] > 0.5, FACE_SPACING_M + 0.0025 * (1 - front), SKIN_SPACING_M)
    eye = np.min([np.linalg.norm(rest - centre, axis=1) for centre in face.eyes], axis=0)
    mouth = np.linalg.norm(rest - face.mouth, axis=1)
    spacing = np.where((eye < 0.022) | (mouth < 0.028), FINE_SPACING_M, spacing)
    return np.where(weights[:, HANDS].sum(1) > 0.5, HAND_SPACING_M, spacing)


def _skin_colour(figure: Figure, face: Face, masks: Mapping[str, Array], samples: Samples) -> Array:
    person, rest = figure.person, samples.rest
    tone = np.asarray(person.skin)
    blotch = noise(rest * 28, person.seed) + 0.5 * noise(rest * 70, person.seed + 1)
    colour = tone * (1 + 0.02 * blotch)[:, None]
    warm = np.array([1.05, 0.90, 0.88])
    colour = mix(1, warm, _flush(face, samples)) * colour
    colour = _face_paint(figure, face, masks, samples, colour)
    return np.clip(colour, 0.0, 1.0)


def _flush(face: Face, samples: Samples) -> Array:
    """Where blood shows: cheeks, nose, ears, knuckles, elbows."""
    rest = samples.rest
    side = np.sign(rest[:, 0])[:, None]
    cheek = np.array([0.038, face.mouth[1] + 0.032, face.mouth[2] - 0.018]) * np.concatenate(
        [side, np.ones_like(side), np.ones_like(side)], axis=1
    )
    nose = np.array([0.0, face.eyes[0, 1] - 0.035, face.mouth[2] + 0.016])
    flush = 0.7 * np.exp(-((rest - cheek) ** 2).sum(1) / 0.018**2)
    flush += 0.6 * np.exp(-((rest - nose) ** 2).sum(1) / 0.014**2)
    flush += 0.5 * (samples.skin_weights[:, HANDS].sum(1) > 0.5)
    return np.clip(flush, 0.0, 1.0)


def _face_paint(figure: Figure, face: Face, masks: Mapping[str, Array], samples: Samples, colour: Array) -> Array:
    person, rest = figure.person, samples.rest
    lips = np.clip(1.6 * masked(masks["lips"], samples.texture), 0, 1)
    line = np.exp(-(((rest[:, 1] - face.mouth[1] - 0.0005) / 0.0016) ** 2)) * lips
    colour = _shadowed(colour, person.lips, 0.85 * lips)
    colour = colour * (1 - 0.45 * line)[:, None]
    colour = colour * (1 - 0.22 * masked(masks["eyelids"], samples.texture))[:, None]
    nails = masked(masks["fingernails"], samples.texture)
    colour = colour * (1 + 0.15 * nails)[:, None]
    colour = _shadowed(colour, person.hair, _brows(figure, face, samples))
    colour = _shadowed(colour, person.hair, _beard(figure, face, samples) * (1 - lips))
    cap = hair_field(face, rest, masked(masks["ears"], samples.texture))
    return _shadowed(colour, person.hair, 0.95 * step(-0.012, 0.004, cap))


def _shadowed(colour: Array, hair: tuple[float, float, float], share: Array) -> Array:
    return colour * (1 - share[:, None]) + np.asarray(hair) * share[:, None]


def _brows(figure: Figure, face: Face, samples: Samples) -> Array:
    rest = samples.rest
    eye = face.eyes[0]
    t = (np.abs(rest[:, 0]) - (eye[0] - 0.019)) / 0.046
    arch = eye[1] + 0.0205 + 0.0065 * np.sin(np.clip(t, 0, 1) * np.pi * 0.8) - 0.004 * np.clip(t - 0.6, 0, 1)
    female = figure.person.phenotype["gender"] > 0.5
    width = (0.0028 if female else 0.0040) * (1.15 - 0.55 * np.clip(t, 0, 1))
    body = np.exp(-(((rest[:, 1] - arch) / width) ** 2)) * step(-0.06, 0.05, t) * step(1.05, 0.85, t)
    hairs = 0.85 + 0.25 * noise(rest * np.array([900.0, 350.0, 350.0]), 3)
    return np.clip(0.85 * body * hairs * (rest[:, 2] > face.centre[2]), 0, 1)


def _beard(figure: Figure, face: Face, samples: Samples) -> Array:
    amount = figure.person.beard
    if amount == 0:
        return np.zeros(len(samples))
    rest = samples.rest
    x, y, z = np.abs(rest[:, 0]), rest[:, 1] - face.mouth[1], rest[:, 2]
    cheek_line = 0.012 + 0.9 * np.clip(x - 0.032, 0, 0.08)
    area = step(0.006, -0.006, y - np.minimum(cheek_line, 0.075)) * step(face.ear_z - 0.004, face.ear_z + 0.010, z)
    area *= step(-0.085, -0.055, y)
    moustache = step(0.020, 0.015, y) * step(0.036, 0.026, x)
    area = np.where(x < 0.032, np.minimum(area + moustache * (y > 0), 1.0), area)
    head = samples.skin_weights[:, HEAD] > 0.4
    grain = 0.8 + 0.35 * noise(rest * 420, 5)
    return np.clip(amount * 0.8 * area * head * grain, 0, 1)


def eyeballs(figure: Figure, face: Face, eyes: tuple[Surface, Surface], rng: np.random.Generator) -> list[Samples]:
    """Eyeballs with iris and pupil looking straight ahead."""
    layers = []
    for eye, centre in zip(eyes, face.eyes, strict=True):
        samples = scatter(eye, EYE_SPACING_M, rng)
        samples = thinned(samples.select(samples.rest[:, 2] > centre[2]))
        aside = np.hypot(samples.rest[:, 0] - centre[0], samples.rest[:, 1] - centre[1])
        colour = np.broadcast_to((0.80, 0.77, 0.74), (len(samples), 3))
        iris = np.asarray(figure.person.eyes) * (0.8 + 40 * aside)[:, None]
        colour = np.where((aside < 0.0060)[:, None], iris, colour)
        colour = np.where((np.abs(aside - 0.0060) < 0.0006)[:, None], 0.5 * np.asarray(figure.person.eyes), colour)
        colour = np.where((aside < 0.0022)[:, None], 0.03, colour)
        layers.append(samples.changed(colour=colour))
    return layers


# --- hair ---------------------------------------------------------------------------------------------------------


def hair_field(face: Face, rest: Array, ears: Array) -> Array:
    """Height above the hairline [m], positive on the scalp; ears lie outside."""
    offset = rest - face.centre
    turn = np.abs(np.arctan2(rest[:, 0], offset[:, 2]))
    ear_turn = np.arctan2(0.075, face.ear_z - face.centre[2])
    front = 0.046 + 0.004 * np.cos(6 * turn)
    temple = 0.030
    sideburn, nape = -0.028, -0.105
    line = front + (temple - front) * step(0.45, 0.85, turn)
    line = line + (sideburn - temple) * step(0.95, ear_turn - 0.22, turn)
    line = line + (0.006 - sideburn) * step(ear_turn - 0.16, ear_turn - 0.02, turn)
    line = line + (nape - 0.006) * step(ear_turn + 0.05, ear_turn + 0.45, turn)
    return np.where(ears > 0.3, -0.05, offset[:, 1] - line)


def hair(figure: Figure, face: Face, masks: Mapping[str, Array], rng: np.random.Generator) -> list[Samples]:
    """The hair of a person's style."""
    style = figure.person.hair_style
    thickness = {"short": 0.017, "cropped": 0.0045, "bob": 0.017, "bun": 0.008, "ponytail": 0.010, "long": 0.016}[style]
    layers = [_cap(figure, face, masks, thickness, rng)]
    if style in ("bob", "long"):
        layers.append(_curtain(figure, face, 0.135 if style == "bob" else 0.27, rng))
    if style == "bun":
        layers.append(_bun(figure, face, rng))
    if style == "ponytail":
        layers.append(_ponytail(figure, face, rng))
    return layers


def _cap(figure: Figure, face: Face, masks: Mapping[str, Array], thickness: float, rng: np.random.Generator) -> Samples:
    style = figure.person.hair_style
    body = figure.body
    lift = smoothed(body, 4)
    samples = scatter(body.moved(lift), HAIR_SPACING_M, rng)
    samples = samples.select((samples.skin_weights[:, HEAD] > 0.2) & (samples.rest[:, 1] > face.eyes[0, 1] - 0.12))
    ragged = 0.004 * noise(samples.rest * np.array([160.0, 60.0, 160.0]), figure.person.seed + 4)
    depth = hair_field(face, samples.rest, masked(masks["ears"], samples.texture)) + ragged
    samples, depth = samples.select(depth > 0), depth[depth > 0]
    top = 0.55 + 0.45 * step(0.0, 0.08, samples.rest[:, 1] - face.centre[1])
    height = thickness * top * (0.18 + 0.82 * step(0.0, 0.035, depth))
    tuft = noise(samples.rest * np.array([55.0, 25.0, 40.0]), figure.person.seed + 5)
    height *= 1 + 0.22 * tuft
    tied = style in ("bun", "ponytail")
    tangent = _combed(face, samples, tied=tied)
    samples = samples.changed(
        position=samples.position + samples.normal * height[:, None],
        tangent=tangent,
        stretch=np.full(len(samples), 1.0 if style == "cropped" else 2.0),
    )
    return _strands(figure, face, thinned(samples))


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
