"""A body to be dressed, and where its garments lie: decided per sample, by smooth fields in metres.

A field is positive inside of a garment. Rest coordinates are SMPL axes with the bare soles at y = 0.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from avatars_people import Person
from avatars_surface import Surface, step, unit

Array = npt.NDArray[np.float64]

ARMS, LEGS, FEET = (16, 17, 18, 19, 20, 21, 22, 23), (1, 2, 4, 5, 7, 8, 10, 11), (7, 8, 10, 11)


@dataclass(frozen=True, kw_only=True, eq=False)
class Figure:
    """A body to be dressed."""

    person: Person
    joints: Array
    palms: Array
    """Where the palms face, left and right, shape (2, 3)."""
    body: Surface
    tights: Surface
    skirt: Surface

    @property
    def size(self) -> float:
        """Size over that of a person of 1.72 m, whom lengths in clothes are made for."""
        return self.person.stature_m / 1.72

    def spacing(self, grown_m: float) -> float:
        """Distance of samples [m] by that on a person of 1.72 m: a child has fewer samples, but finer ones."""
        return grown_m * float(np.sqrt(self.size))

    def arm(self, rest: Array, skin_weights: Array) -> Array:
        """Place along the arm: 0 at the shoulder, 1 at the elbow, 2 at the wrist; 0 off the arm. Shape (N,)."""
        left = rest[:, :1] > 0
        shoulder, elbow, wrist = (np.where(left, self.joints[k], self.joints[k + 1]) for k in (16, 18, 20))
        upper = ((rest - shoulder) * (elbow - shoulder)).sum(1) / ((elbow - shoulder) ** 2).sum(1)
        lower = ((rest - elbow) * (wrist - elbow)).sum(1) / ((wrist - elbow) ** 2).sum(1)
        along = np.where(upper < 1, np.maximum(upper, 0.0), 1 + np.maximum(lower, 0.0))
        return np.where(skin_weights[:, ARMS].sum(1) > 0.5, along, 0.0)

    def arm_angle(self, rest: Array) -> Array:
        """Angle around the arm's axis [rad], shape (N,)."""
        left = rest[:, :1] > 0
        shoulder, elbow, wrist = (np.where(left, self.joints[k], self.joints[k + 1]) for k in (16, 18, 20))
        upper = ((rest - shoulder) * (elbow - shoulder)).sum(1) < ((elbow - shoulder) ** 2).sum(1)
        start = np.where(upper[:, None], shoulder, elbow)
        axis = unit(np.where(upper[:, None], elbow - shoulder, wrist - elbow))
        across = unit(np.cross(axis, np.broadcast_to((0.0, 0.0, 1.0), axis.shape)))
        offset = rest - start
        return np.arctan2((offset * across).sum(1), (offset * np.cross(axis, across)).sum(1))


def top_field(figure: Figure, rest: Array, skin_weights: Array) -> Array:
    """Depth inside of the upper garment [m]."""
    person, joints = figure.person, figure.joints
    x, y, z = rest.T
    wave = 0.008 * np.cos(2 * np.arctan2(x, z)) if person.closure == "shirt" else 0.0
    hem = y - (joints[1, 1] + 0.005 - person.hem - wave)
    arm_length = np.linalg.norm(joints[18] - joints[16])
    arms = skin_weights[:, ARMS].sum(1) > 0.5
    sleeve = np.where(arms, (person.sleeve - figure.arm(rest, skin_weights)) * arm_length, 0.3)
    depth = np.minimum(np.minimum(np.where(arms, 0.3, hem), sleeve), neck_field(figure, rest, person.closure))
    return np.minimum(depth, -opening_field(figure, rest)) if person.closure in OPEN else depth


OPEN = ("open", "cardigan")
"""Closures that show what is worn below."""


def neck_field(figure: Figure, rest: Array, closure: str) -> Array:
    """Depth below the neckline [m]: a plane that drops to the front, with a notch for collars."""
    neck, size = figure.joints[12], figure.size
    x, y, z = rest.T
    line = neck[1] + 0.012 * size - 0.55 * (z - neck[2])
    notch = {"shirt": 0.085, "polo": 0.075}.get(closure, 0.0) * size
    front = step(0.0, 0.03 * size, z - neck[2])
    line = line - front * np.clip(notch - 1.7 * np.abs(x), 0.0, None)
    return np.where(np.abs(x) < 0.16 * size, line - y, 0.3)


def opening_field(figure: Figure, rest: Array) -> Array:
    """Depth inside of the front opening of a jacket [m], wider towards the neck."""
    x, y, z = rest.T
    low, high = figure.joints[1, 1], figure.joints[12, 1]
    height = np.clip((y - low) / (high - low), 0.0, 1.0)
    half = (0.030 + 0.045 * height**1.5) * figure.size
    return np.where(z > figure.joints[12, 2] - 0.02 * figure.size, half - np.abs(x), -0.3)


def bottom_field(figure: Figure, rest: Array, skin_weights: Array) -> Array:
    """Depth inside of trousers, shorts or a skirt [m]."""
    y, z = rest[:, 1], rest[:, 2]
    waist = figure.joints[3, 1] + 0.005 - y
    if figure.person.bottom_kind == "skirt":
        lower = y - skirt_hem(figure)
    elif figure.person.bottom_kind == "shorts":
        lower = y - (figure.joints[4, 1] + 0.05 * figure.size)
    else:
        lower = y - (0.052 + 0.45 * np.clip(z - figure.joints[7, 2] - 0.015, 0.0, None)) * figure.size
    arms = skin_weights[:, ARMS].sum(1)
    return np.where(arms > 0.5, -0.3, np.minimum(waist, lower))


def skirt_hem(figure: Figure) -> float:
    """Height of a skirt's hem [m]."""
    return float(figure.joints[4, 1]) + 0.045 * figure.size


def shoe_field(figure: Figure, rest: Array, skin_weights: Array) -> Array:
    """Depth inside of the shoes [m]."""
    y, z = rest[:, 1], rest[:, 2]
    ankle, size = figure.joints[7], figure.size
    low = figure.person.bottom_kind == "skirt"
    forward = step(-0.01 * size, 0.07 * size, z - ankle[2])
    line = ankle[1] + ((-0.014 if low else 0.002) - (0.008 if low else 0.0) * forward) * size
    return np.where(skin_weights[:, FEET].sum(1) > 0.3, line - y, -0.3)


def covered_field(figure: Figure, rest: Array, skin_weights: Array) -> Array:
    """Depth below any garment [m]: skin well inside is left out."""
    fields = [
        top_field(figure, rest, skin_weights),
        bottom_field(figure, rest, skin_weights),
        shoe_field(figure, rest, skin_weights),
    ]
    if figure.person.legs is not None:
        fields.append(np.where(skin_weights[:, LEGS].sum(1) > 0.5, 0.3, -0.3))
    if figure.person.closure in OPEN:
        fields.append(inner_field(figure, rest, skin_weights))
    return np.maximum.reduce(fields)


def inner_field(figure: Figure, rest: Array, skin_weights: Array) -> Array:
    """Depth inside of what an open jacket shows [m]."""
    below = rest[:, 1] - (figure.joints[1, 1] - 0.03 * figure.size)
    depth = np.minimum(neck_field(figure, rest, "crew"), below)
    shown = np.minimum(depth, opening_field(figure, rest) + 0.03 * figure.size)
    return np.where(skin_weights[:, ARMS].sum(1) > 0.5, -0.3, shown)
