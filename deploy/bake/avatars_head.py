"""Skin, face, eyes and glasses of a person, as layers of samples."""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from avatars_figure import Figure, covered_field
from avatars_hair import HEAD, Face, hair_field
from avatars_surface import Samples, Surface, joined, masked, mix, new_samples, noise, scatter, step, thinned, unit

Array = npt.NDArray[np.float64]

HANDS = (20, 21, 22, 23)
SKIN_SPACING_M, HAND_SPACING_M, FACE_SPACING_M = 0.0065, 0.0045, 0.0030
FINE_SPACING_M = 0.0022
EYE_SPACING_M = 0.0012
EAR_SPACING_M = 0.0032
GLASSES_SPACING_M = 0.0011


def face_of(figure: Figure, eyes: tuple[Surface, Surface], masks: Mapping[str, Array]) -> Face:
    """Landmarks from the eyeballs, the lip mask and the skull."""
    centres = np.array([0.5 * (eye.vertices.min(0) + eye.vertices.max(0)) for eye in eyes])
    body = figure.body
    corners = body.triangles.reshape(-1)
    lips = corners[masked(masks["lips"], body.texture.reshape(-1, 2)) > 0.5]
    ears = corners[masked(masks["ears"], body.texture.reshape(-1, 2)) > 0.5]
    skull = body.vertices[(body.vertices[:, 1] > centres[0, 1] + 0.02) & (body.skin_weights[:, HEAD] > 0.5)]
    middle_z = 0.5 * (skull[:, 2].min() + skull[:, 2].max())
    nose = np.abs(body.vertices[:, 0]) < 0.012
    nose &= np.abs(body.vertices[:, 1] - centres[0, 1]) < 0.006
    return Face(
        eyes=centres,
        eye_radius_m=0.5 * float(np.ptp(eyes[0].vertices[:, 0])),
        bridge_z=float(body.vertices[nose, 2].max()),
        ear_x=float(np.abs(body.vertices[ears, 0]).mean()),
        mouth=body.vertices[lips].mean(axis=0),
        centre=np.array([0.0, centres[0, 1] + 0.025, middle_z]),
        ear_z=float(body.vertices[ears, 2].mean()),
    )


def skin(figure: Figure, face: Face, masks: Mapping[str, Array], rng: np.random.Generator) -> Samples:
    """Skin that clothes leave bare, and a margin below their edges."""
    weights = figure.body.skin_weights
    head, hand = weights[:, HEAD] > 0.5, weights[:, HANDS].sum(1) > 0.5
    bare = covered_field(figure, figure.body.rest, weights) < 0.06
    zones = ((head, FACE_SPACING_M), (hand, HAND_SPACING_M), (bare & ~head & ~hand, SKIN_SPACING_M))
    parts = [scatter(figure.body, spacing, rng, where=where) for where, spacing in zones]
    candidates = joined([part.changed(spacing=_skin_spacing(face, masks, part)) for part in parts])
    depth = covered_field(figure, candidates.rest, candidates.skin_weights)
    keep = (depth < 0.025) & (masked(masks["inside-mouth"], candidates.texture) < 0.5)
    samples, depth = candidates.select(keep), depth[keep]
    shrunk = samples.position - samples.normal * (0.006 * step(-0.004, 0.012, depth))[:, None]
    samples = thinned(samples.changed(position=shrunk))
    return samples.changed(colour=_skin_colour(figure, face, masks, samples))


def _skin_spacing(face: Face, masks: Mapping[str, Array], samples: Samples) -> Array:
    rest, weights = samples.rest, samples.skin_weights
    low = step(-0.09, -0.07, rest[:, 1] - face.eyes[0, 1])
    front = step(-0.02, 0.02, rest[:, 2] - face.ear_z) * low
    spacing = np.where(weights[:, HEAD] > 0.5, FACE_SPACING_M + 0.0025 * (1 - front), SKIN_SPACING_M)
    ears = masked(masks["ears"], samples.texture) > 0.2
    spacing = np.where(ears, EAR_SPACING_M, spacing)
    eye = np.min([np.linalg.norm(rest - centre, axis=1) for centre in face.eyes], axis=0)
    mouth = np.linalg.norm(rest - face.mouth, axis=1)
    spacing = np.where((eye < 0.022) | (mouth < 0.028), FINE_SPACING_M, spacing)
    return np.where(weights[:, HANDS].sum(1) > 0.5, HAND_SPACING_M, spacing)


def _skin_colour(figure: Figure, face: Face, masks: Mapping[str, Array], samples: Samples) -> Array:
    person, rest = figure.person, samples.rest
    tone = np.asarray(person.skin)
    blotch = noise(rest * 28, person.seed) + 0.5 * noise(rest * 70, person.seed + 1)
    colour = tone * (1 + 0.012 * blotch)[:, None]
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
    flush = 0.5 * np.exp(-((rest - cheek) ** 2).sum(1) / 0.018**2)
    flush += 0.2 * np.exp(-((rest - nose) ** 2).sum(1) / 0.014**2)
    flush += 0.25 * (samples.skin_weights[:, HANDS].sum(1) > 0.5)
    return np.clip(flush, 0.0, 1.0)


def _face_paint(figure: Figure, face: Face, masks: Mapping[str, Array], samples: Samples, colour: Array) -> Array:
    person, rest = figure.person, samples.rest
    lips = np.clip(1.6 * masked(masks["lips"], samples.texture), 0, 1)
    line = np.exp(-(((rest[:, 1] - face.mouth[1] - 0.0005) / 0.0016) ** 2)) * lips
    colour = _shadowed(colour, person.lips, 0.85 * lips)
    colour = colour * (1 - 0.45 * line)[:, None]
    colour = colour * (1 - 0.15 * masked(masks["eyelids"], samples.texture))[:, None]
    colour = _shadowed(colour, (0.07, 0.05, 0.045), _lashes(figure, face, rest))
    nails = masked(masks["fingernails"], samples.texture)
    colour = colour * (1 + 0.15 * nails)[:, None]
    colour = _shadowed(colour, person.hair, _brows(figure, face, samples))
    colour = _shadowed(colour, person.hair, _beard(figure, face, samples) * (1 - lips))
    cap = hair_field(person.hair_style, face, rest, masked(masks["ears"], samples.texture))
    return _shadowed(colour, person.hair, 0.95 * step(-0.012, 0.004, cap))


def _shadowed(colour: Array, hair: tuple[float, float, float], share: Array) -> Array:
    return colour * (1 - share[:, None]) + np.asarray(hair) * share[:, None]


def _lashes(figure: Figure, face: Face, rest: Array) -> Array:
    """The rims of the lids, where they touch the eyeballs: dark above, a hint below."""
    female = figure.person.phenotype["gender"] > 0.5
    nearest = rest - np.where(rest[:, :1] > 0, face.eyes[:1], face.eyes[1:])
    gap = np.linalg.norm(nearest, axis=1) - face.eye_radius_m
    rim = step(0.0030, 0.0012, gap) * (nearest[:, 2] > 0.2 * face.eye_radius_m)
    above = step(-0.001, 0.002, nearest[:, 1])
    return rim * ((0.55 if female else 0.35) * above + 0.12)


def _brows(figure: Figure, face: Face, samples: Samples) -> Array:
    rest = samples.rest
    eye, size = face.eyes[0], face.size
    t = (np.abs(rest[:, 0]) - (eye[0] - 0.020 * size)) / (0.044 * size)
    female = figure.person.phenotype["gender"] > 0.5
    rise = (0.0040 if female else 0.0025) * np.sin(np.clip(t / 0.68, 0, 1) * 0.5 * np.pi)
    arch = eye[1] + size * ((0.0185 if female else 0.0170) + rise - 0.0065 * np.clip(t - 0.66, 0, 1))
    width = (0.0024 if female else 0.0034) * size * (1.15 - 0.6 * np.clip(t, 0, 1))
    body = np.exp(-(((rest[:, 1] - arch) / width) ** 2)) * step(-0.08, 0.08, t) * step(1.06, 0.85, t)
    hairs = 0.9 + 0.1 * noise(rest * np.array([900.0, 350.0, 350.0]), 3)
    return np.clip(0.92 * body * hairs * (rest[:, 2] > face.centre[2]), 0, 1)


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


def glasses(figure: Figure, face: Face, colour: tuple[float, float, float]) -> Samples:
    """A frame around both eyes, a bridge and temples to the ears."""
    size, points, normals, tangents = face.size, [], [], []

    def wire(line: Array, normal: Array) -> None:
        points.append(line)
        normals.append(np.broadcast_to(normal, line.shape))
        tangents.append(unit(np.gradient(line, axis=0)))

    front = max(face.eyes[0, 2] + face.eye_radius_m + 0.009 * size, face.bridge_z + 0.001)
    turn = np.linspace(0.0, 2 * np.pi, 120, endpoint=False)
    for centre in face.eyes:
        rounded = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
        rounded = rounded / (np.abs(rounded) ** 3).sum(1, keepdims=True) ** (1 / 3)
        ring = rounded * np.array([0.0225, 0.0165, 0.0]) * size + (centre[0], centre[1] - 0.002 * size, front)
        wire(ring, np.array([0.0, 0.0, 1.0]))
        wire(ring - (0.0, 0.0, 0.001), unit(rounded))
        side = np.sign(centre[0])
        hinge = np.array([centre[0] + side * 0.0225 * size, centre[1] + 0.006 * size, front])
        ear = np.array([side * face.ear_x, centre[1] + 0.006 * size, face.ear_z])
        temple = hinge + np.linspace(0.0, 1.0, 100)[:, None] * (ear - hinge)
        wire(temple, np.array([side, 0.0, 0.0]))
        wire(temple, np.array([0.0, 1.0, 0.0]))
    inner = abs(face.eyes[0, 0]) - 0.0225 * size
    across = np.linspace(-inner, inner, 20)
    bridge = np.stack([across, np.full(20, face.eyes[0, 1] + 0.004 * size), np.full(20, front)], axis=1)
    wire(bridge, np.array([0.0, 0.0, 1.0]))
    position = np.concatenate(points)
    weights = np.zeros((len(position), 24))
    weights[:, HEAD] = 1.0
    samples = new_samples(
        position=position,
        rest=position,
        normal=np.concatenate(normals),
        skin_weights=weights,
        spacing_m=GLASSES_SPACING_M,
    )
    return samples.changed(
        colour=np.broadcast_to(colour, position.shape),
        tangent=np.concatenate(tangents),
        stretch=np.full(len(position), 2.0),
    )


def eyeballs(figure: Figure, face: Face, eyes: tuple[Surface, Surface], rng: np.random.Generator) -> list[Samples]:
    """Eyeballs with iris and pupil looking straight ahead."""
    layers = []
    for eye, centre in zip(eyes, face.eyes, strict=True):
        samples = scatter(eye, EYE_SPACING_M, rng)
        samples = thinned(samples.select(samples.rest[:, 2] > centre[2]))
        aside = np.hypot(samples.rest[:, 0] - centre[0], samples.rest[:, 1] - centre[1])
        colour = np.broadcast_to((0.80, 0.77, 0.74), (len(samples), 3))
        iris = np.asarray(figure.person.eyes) * (0.8 + 40 * aside)[:, None]
        colour = np.where((aside < 0.0058 * face.size)[:, None], iris, colour)
        colour = np.where(
            (np.abs(aside - 0.0058 * face.size) < 0.0006)[:, None], 0.5 * np.asarray(figure.person.eyes), colour
        )
        colour = np.where((aside < 0.0021 * face.size)[:, None], 0.03, colour)
        layers.append(samples.changed(colour=colour))
    return layers
