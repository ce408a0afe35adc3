"""How the embedded flats of other seeds differ from the first one: mirrored, in other colours, with more in the way."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.scenes.embedded import decor, seating
from readygo.common.scenes.embedded.free_floor import FreeFloor
from readygo.common.scenes.embedded.plan import FLAT
from readygo.common.scenes.embedded.surfaces import Surfaces
from readygo.common.scenes.embedded.textures import Colour

_HUE_RAD = 0.45
_SATURATION = (0.5, 1.4)
_LIGHTNESS = (0.65, 1.15)
_PIECES = 6
_DRAWS = 200
PIECE_RADIUS_M = 0.35
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
        return Surfaces(rng, mirror=self.mirror, tints=tints(self._rng("tints")))

    def add_pieces(self, build: Surfaces) -> None:
        """Stand up to six more pieces of furniture where robots still get everywhere."""
        if self.seed == 0:
            return
        rng = self._rng("pieces")
        floor = FreeFloor(FLAT, build.samples().position_m * [*self.mirror, 1.0])
        stood = 0
        for _ in range(_DRAWS):
            x, y = _place(rng).tolist()
            if floor.take_disc(x, y, PIECE_RADIUS_M):
                add_piece(build.at(x, y, yaw_deg=float(rng.integers(360))), rng)
                stood += 1
            if stood == _PIECES:
                return

    def _rng(self, purpose: str) -> np.random.Generator:
        return np.random.Generator(np.random.PCG64([self.seed, *purpose.encode()]))


def tints(rng: np.random.Generator) -> Iterator[Float64Array]:
    """Matrices on colours, shape (3, 3): another hue, saturation and lightness each."""
    while True:
        yield _tint(rng.uniform(-_HUE_RAD, _HUE_RAD), rng.uniform(*_SATURATION), rng.uniform(*_LIGHTNESS))


def _place(rng: np.random.Generator) -> Float64Array:
    """A place in a room, decimetres exact."""
    room = FLAT.rooms[int(rng.integers(len(FLAT.rooms)))]
    low, high = np.array([room.x_m[0], room.y_m[0]]), np.array([room.x_m[1], room.y_m[1]])
    return np.asarray(np.round(low + rng.random(2) * (high - low), 1))


def add_piece(build: Surfaces, rng: np.random.Generator) -> None:
    """A small piece of furniture within `PIECE_RADIUS_M` of the origin."""
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
