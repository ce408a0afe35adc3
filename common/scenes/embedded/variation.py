"""How the embedded flats of other seeds differ from the first one: mirrored, in other colours, with more in the way."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from readygo.common.arrays import BoolArray, Float64Array
from readygo.common.scenes.embedded import decor, seating
from readygo.common.scenes.embedded.plan import EAST_M, NORTH_M, ROOMS, SOUTH_M, WEST_M
from readygo.common.scenes.embedded.surfaces import Surfaces
from readygo.common.scenes.embedded.textures import Colour

_HUE_RAD = 0.45
_SATURATION = (0.5, 1.4)
_LIGHTNESS = (0.65, 1.15)
_PIECES = 6
_DRAWS = 200
_PIECE_RADIUS_M = 0.35
_ROBOT_RADIUS_M = 0.35
_LOST_M2 = 0.1
"""What a piece may cut off from the rest of the floor."""
_CELL_M = 0.05
_STANDING_M = (0.06, 1.8)
"""Heights between which something is in the way; rugs lie below."""
_GREY = np.array([0.30, 0.59, 0.11])


@dataclass(frozen=True, kw_only=True)
class Variation:
    """What a seed changes. Seed 0 changes nothing."""

    seed: int

    @property
    def mirror(self) -> Float64Array:
        """Signs of x and y: seeds of 0 to 3 modulo 4 are the four ways to mirror the plan, shape (2,)."""
        return np.array([-1.0 if self.seed & 1 else 1.0, -1.0 if self.seed & 2 else 1.0])

    def surfaces(self) -> Surfaces:
        """An empty collection to build the flat in."""
        rng = np.random.Generator(np.random.PCG64(self.seed))
        if self.seed == 0:
            return Surfaces(rng)
        return Surfaces(rng, mirror=self.mirror, tints=self._tints())

    def add_pieces(self, build: Surfaces) -> None:
        """Stand up to six more pieces of furniture where robots still get everywhere."""
        if self.seed == 0:
            return
        rng = self._rng("pieces")
        position = build.samples().position_m
        standing = (position[:, 2] > _STANDING_M[0]) & (position[:, 2] < _STANDING_M[1])
        floor = _Floor(position[standing, :2] * self.mirror)
        stood = 0
        for _ in range(_DRAWS):
            place = _place(rng)
            if floor.take(place):
                _piece(build.at(*place, yaw_deg=float(rng.integers(360))), rng)
                stood += 1
            if stood == _PIECES:
                return

    def _rng(self, purpose: str) -> np.random.Generator:
        return np.random.Generator(np.random.PCG64([self.seed, *purpose.encode()]))

    def _tints(self) -> Iterator[Float64Array]:
        rng = self._rng("tints")
        while True:
            yield _tint(rng.uniform(-_HUE_RAD, _HUE_RAD), rng.uniform(*_SATURATION), rng.uniform(*_LIGHTNESS))


class _Floor:
    """Where the middle of a robot may be, as one connected piece of floor."""

    def __init__(self, taken_m: Float64Array) -> None:
        low, high = np.array([WEST_M, SOUTH_M]), np.array([EAST_M, NORTH_M])
        shape = np.rint((high - low) / _CELL_M).astype(int)
        cells = np.floor((taken_m - low) / _CELL_M).astype(int)
        cells = cells[((cells >= 0) & (cells < shape)).all(axis=1)]
        clear = np.ones(shape, dtype=bool)
        clear[cells[:, 0], cells[:, 1]] = False
        self._distance_m = ndimage.distance_transform_edt(clear) * _CELL_M
        axes = [a + (np.arange(n) + 0.5) * _CELL_M for a, n in zip(low, shape, strict=True)]
        self._x, self._y = np.meshgrid(*axes, indexing="ij")
        self._free = _parts(self._distance_m > _ROBOT_RADIUS_M)[0]

    def take(self, place: Float64Array) -> bool:
        """Take a disc of `_PIECE_RADIUS_M` if it is free, and cuts nothing off; False if not."""
        away_m = np.hypot(self._x - place[0], self._y - place[1])
        if self._distance_m[np.unravel_index(away_m.argmin(), away_m.shape)] < _PIECE_RADIUS_M:
            return False
        left = _parts(self._free & (away_m > _PIECE_RADIUS_M + _ROBOT_RADIUS_M))
        if sum(part.sum() for part in left[1:]) * _CELL_M**2 > _LOST_M2:
            return False
        self._free, self._distance_m = left[0], np.minimum(self._distance_m, away_m - _PIECE_RADIUS_M)
        return True


def _parts(free: BoolArray) -> list[BoolArray]:
    """Connected parts, the largest first."""
    labels, count = ndimage.label(free)
    return sorted((labels == k for k in range(1, count + 1)), key=np.sum, reverse=True)


def _place(rng: np.random.Generator) -> Float64Array:
    """A place in a room, decimetres exact."""
    room = ROOMS[int(rng.integers(len(ROOMS)))]
    low, high = np.array([room.x_m[0], room.y_m[0]]), np.array([room.x_m[1], room.y_m[1]])
    return np.asarray(np.round(low + rng.random(2) * (high - low), 1))


def _piece(build: Surfaces, rng: np.random.Generator) -> None:
    """A piece within `_PIECE_RADIUS_M` of the origin."""
    colour: Colour = (0.70, 0.45, 0.32)
    kind = int(rng.integers(5))
    if kind == 0:
        seating.pouf(build, colour)
    elif kind == 1:
        seating.chair(build, colour, padded=(0.55, 0.40, 0.36))
    elif kind == 2:
        decor.potted_plant(build, 1.1)
    elif kind == 3:
        build.box((-0.25, -0.2, 0.0), (0.25, 0.2, 0.34), 0.07, (0.72, 0.56, 0.38))
        build.box((-0.2, -0.15, 0.34), (0.16, 0.17, 0.62), 0.07, (0.68, 0.52, 0.36))
    else:
        seating.round_table(build, 0.33, 0.55, colour)


def _tint(hue_rad: float, saturation: float, lightness: float) -> Float64Array:
    """A matrix on display colours: chroma turned about the grey axis and scaled, lightness scaled, shape (3, 3)."""
    c, s = round(math.cos(hue_rad), 9), round(math.sin(hue_rad), 9)
    grey = np.ones((3, 1)) / 3
    k = 1 / math.sqrt(3)
    cross = k * np.array([[0.0, -1.0, 1.0], [1.0, 0.0, -1.0], [-1.0, 1.0, 0.0]])
    turn = c * np.eye(3) + (1 - c) * (grey @ np.ones((1, 3))) + s * cross
    luma = np.ones((3, 1)) * _GREY
    # Chroma is what is left of a colour without its luma; a turn may change the luma, so it is put back.
    chroma = np.eye(3) - luma
    return np.asarray(lightness * (luma + saturation * chroma @ turn @ chroma))
