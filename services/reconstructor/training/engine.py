"""What draws the Gaussians of a training and changes them: on the CPU (`cpu`), or on a GPU (`cuda`)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from readygo.common.arrays import Float32Array, Int64Array
from readygo.services.reconstructor.training.density import Sightings
from readygo.services.reconstructor.training.parameters import Change, Gaussians
from readygo.services.reconstructor.training.photos import PhotoStore


@dataclass(frozen=True, kw_only=True, eq=False)
class ViewTask:
    """One view of a training step."""

    number: int
    exposure: Float32Array
    """Logarithms of the image's gains, and offsets, shape (2, 3)."""
    rng: np.random.Generator | None
    """Chooses patches of surfaces; None: surfaces are not compared in this step."""
    neighbour: int | None
    """Number of the view that surfaces are compared with; None: there is none, only normals within the view count."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ViewLoss:
    """What a view says of the Gaussians."""

    loss: float
    exposure: Float32Array
    """Derivatives by the logarithms of the image's gains and by its offsets, shape (2, 3)."""


class Engine(Protocol):
    """Holds the Gaussians of a training, their optimiser's state, and how views have seen them."""

    def load(self, gaussians: Gaussians, seen: Sightings) -> None:
        """Continue with other Gaussians."""

    def arrays(self) -> tuple[Gaussians, Sightings]:
        """The Gaussians and what views have seen of them; call `load` after a change."""

    def shapes(self) -> tuple[dict[str, Float32Array], Sightings]:
        """What decides where Gaussians are added and removed: arrays by the names of `SHAPES`, to be read only."""

    def rebuild(self, change: Change) -> None:
        """Continue with the Gaussians after a change, which no view has seen yet."""

    def not_finite(self) -> str | None:
        """A parameter that has a number that is not finite."""

    def __len__(self) -> int:
        """Number of Gaussians."""

    def views(self, photos: PhotoStore, tasks: Sequence[ViewTask], sh_degree: int) -> list[ViewLoss]:
        """Losses of the views of a step; their gradients are kept for `change`."""

    def change(self, rates: dict[str, Float32Array]) -> None:
        """Take the step that the last views want, at these rates of the columns of each parameter."""

    def add_noise(self, size_m: float, rng: np.random.Generator) -> None:
        """Move faint Gaussians at random; see `density.add_noise`."""

    def seen_by(self, photos: PhotoStore, groups: Sequence[Sequence[int]], pixels_min: float) -> Int64Array:
        """In how many of these groups a view has each Gaussian on more than so many pixels, shape (N,)."""

    @property
    def gpu_bytes(self) -> int:
        """Most memory of a GPU that was used at once; 0 without one."""

    def close(self) -> None:
        """Give back threads and memory."""
