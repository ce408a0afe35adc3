"""Floors with a pattern: planks, tiles, carpet."""

from itertools import pairwise

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.scenes.embedded.plan import FloorPlan, Room
from readygo.common.scenes.embedded.surfaces import THICKNESS_M, Surfaces
from readygo.common.scenes.embedded.textures import Colour, lattice_noise, value_noise

_UP = np.array([0.0, 0.0, 1.0])
_X = np.array([1.0, 0.0, 0.0])
_OAK = (0.70, 0.52, 0.35)
_WALNUT = (0.48, 0.33, 0.22)


def build_floors(build: Surfaces, plan: FloorPlan) -> None:
    """The floors of all rooms."""
    for seed, room in enumerate(plan.rooms):
        floor = build.at(0, 0)
        if room.floor == "oak":
            _planks(floor, room, _OAK, seed)
        elif room.floor == "walnut":
            _planks(floor, room, _WALNUT, seed)
        elif room.floor == "tiles":
            _tiles(floor, room)
        else:
            _carpet(floor, room)


def _planks(
    build: Surfaces, room: Room, colour: Colour, seed: int, width_m: float = 0.17, length_m: float = 1.2
) -> None:
    """Boards along x in rows; each has its own tone and two samples across."""
    (x0, x1), (y0, y1) = room.x_m, room.y_m
    rows = round((y1 - y0) / width_m)
    width = (y1 - y0) / rows
    for row in range(rows):
        offset = float(lattice_noise(np.array([row]), np.array([seed]), 5)[0]) * length_m
        ends = np.concatenate([[x0], np.arange(x0 + offset, x1, length_m), [x1]])
        low = y0 + row * width
        for begin, end in pairwise(ends.tolist()):
            if end - begin > 0.02:
                _plank(build, (begin, end, low, width), colour, seed)


def _plank(build: Surfaces, plank: tuple[float, float, float, float], colour: Colour, seed: int) -> None:
    begin, end, low, width = plank
    count = max(1, round((end - begin) / 0.15))
    cell = (end - begin) / count
    x = np.repeat(begin + (np.arange(count) + 0.5) * cell, 2)
    y = np.tile(low + width * np.array([0.27, 0.73]), count)
    tone = 0.80 + 0.34 * float(lattice_noise(np.array([round(begin * 100)]), np.array([round(low * 100)]), seed)[0])
    grain = 1 + 0.22 * (value_noise(x / 0.3, y / 0.05, seed + 3) - 0.5)
    position = np.column_stack([x, y, np.zeros(len(x))])
    build.add(position, _X, _UP, [cell * 0.62, width * 0.32, THICKNESS_M], _tint(colour, tone * grain))
    seams = max(1, round((end - begin) / 0.3))
    step = (end - begin) / seams
    sx = begin + (np.arange(seams) + 0.5) * step
    seam = np.column_stack([sx, np.full(seams, low), np.full(seams, 0.002)])
    build.add(seam, _X, _UP, [step * 0.55, 0.004, 0.002], _tint(colour, np.full(seams, 0.42)))
    joint = np.array([[begin, low + width / 2, 0.002]])
    build.add(joint, np.array([0.0, 1.0, 0.0]), _UP, [width * 0.4, 0.004, 0.002], _tint(colour, np.array([0.42])))


def _tint(colour: Colour, tone: Float64Array) -> Float64Array:
    # Darker boards are also a little redder.
    tint = np.stack([np.ones_like(tone), 0.97 + 0.03 * tone, 0.93 + 0.07 * tone], axis=-1)
    return np.clip(np.asarray(colour) * tint * tone[:, None], 0, 1)


def _tiles(build: Surfaces, room: Room, size_m: float = 0.33) -> None:
    """Square tiles in two tones, laid like a chessboard, with light joints."""
    (x0, x1), (y0, y1) = room.x_m, room.y_m
    columns, rows = round((x1 - x0) / size_m), round((y1 - y0) / size_m)
    w, h = (x1 - x0) / columns, (y1 - y0) / rows
    i, j = (g.ravel() for g in np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij"))
    base = np.where(((i + j) % 2 == 0)[:, None], np.array([0.80, 0.78, 0.73]), np.array([0.52, 0.57, 0.58]))
    base = base * (0.93 + 0.14 * lattice_noise(i.astype(float), j.astype(float), 31))[:, None]
    part = np.array([1, 3, 5]) / 6
    for a in part:
        for b in part:
            x, y = x0 + (i + 0.02 + 0.96 * a) * w, y0 + (j + 0.02 + 0.96 * b) * h
            cloudy = 1 + 0.14 * (value_noise(x / 0.16, y / 0.16, 37) - 0.5)
            position = np.column_stack([x, y, np.zeros(len(x))])
            build.add(position, _X, _UP, [w / 3 * 0.55, h / 3 * 0.55, THICKNESS_M], base * cloudy[:, None])
    joint = np.array([0.70, 0.68, 0.64])
    along_x = np.column_stack([x0 + (i + 0.5) * w, y0 + j * h, np.full(len(i), 0.001)])
    build.add(along_x, _X, _UP, [w * 0.5, 0.005, 0.002], joint)
    along_y = np.column_stack([x0 + i * w, y0 + (j + 0.5) * h, np.full(len(i), 0.001)])
    build.add(along_y, np.array([0.0, 1.0, 0.0]), _UP, [h * 0.5, 0.005, 0.002], joint)


def _carpet(build: Surfaces, room: Room) -> None:
    """Cut pile: speckle and the broad marks of a vacuum cleaner."""
    (x0, x1), (y0, y1) = room.x_m, room.y_m

    def pile(u: Float64Array, v: Float64Array) -> Float64Array:
        speckle = lattice_noise(np.floor(u / 0.031), np.floor(v / 0.029), 41) - 0.5
        lane = value_noise(u / 0.45, v / 1.6, 43) - 0.5
        return np.clip(np.array([0.66, 0.61, 0.56]) * (1 + 0.22 * speckle + 0.14 * lane)[:, None], 0, 1)

    build.patch((x0, y0, 0), (x1 - x0, 0, 0), (0, y1 - y0, 0), 0.07, pile, jitter=0.4, softness=0.7)
