"""Training on the CPU: the views of a step side by side on as many cores."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np

from readygo.common.arrays import Float32Array, Int64Array
from readygo.common.cores import available_cores
from readygo.services.reconstructor.training.adam import Adam
from readygo.services.reconstructor.training.config import GaussiansConfig
from readygo.services.reconstructor.training.density import Sightings, add_noise, limit_stretch
from readygo.services.reconstructor.training.drawing import Geometry, ViewGradients, leaves_of, observe, view_gradients
from readygo.services.reconstructor.training.engine import ViewLoss, ViewTask
from readygo.services.reconstructor.training.parameters import Change, Gaussians
from readygo.services.reconstructor.training.photos import PhotoStore


class CpuEngine:
    """Trains with `readygo.services.reconstructor.differentiable`; see `engine.Engine`."""

    def __init__(self, settings: GaussiansConfig) -> None:
        self._settings = settings
        self._adam = Adam(settings.steps, settings.batch)
        self._cores = min(settings.batch, available_cores())
        self._pool = ThreadPoolExecutor(self._cores)
        self._views: list[ViewGradients] = []

    def load(self, gaussians: Gaussians, seen: Sightings) -> None:
        """Continue with other Gaussians."""
        self._gaussians, self._seen, self._views = gaussians, seen, []

    def arrays(self) -> tuple[Gaussians, Sightings]:
        """The Gaussians and what views have seen of them, not copies."""
        return self._gaussians, self._seen

    def shapes(self) -> tuple[dict[str, Float32Array], Sightings]:
        """All arrays of the parameters by name, and what views have seen of the Gaussians; not copies."""
        return self._gaussians.values, self._seen

    def rebuild(self, change: Change) -> None:
        """Continue with the Gaussians after a change, which no view has seen yet."""
        self.load(self._gaussians.apply(change), Sightings.none(len(change)))

    def not_finite(self) -> str | None:
        """A parameter that has a number that is not finite."""
        return next((name for name, value in self._gaussians.values.items() if not np.isfinite(value).all()), None)

    def __len__(self) -> int:
        """Number of Gaussians."""
        return len(self._gaussians)

    def views(self, photos: PhotoStore, tasks: Sequence[ViewTask], sh_degree: int) -> list[ViewLoss]:
        """Losses of the views of a step; their gradients are kept for `change`."""
        leaves = leaves_of(self._gaussians)

        def one(task: ViewTask) -> ViewGradients:
            geometry = None
            if task.rng is not None:
                neighbour = None if task.neighbour is None else photos[task.neighbour]
                geometry = Geometry(neighbour=neighbour, rng=task.rng)
            photo = photos[task.number]
            return view_gradients(leaves, photo, task.exposure, sh_degree, self._settings, geometry)

        self._views = list(self._pool.map(one, tasks))
        return [ViewLoss(loss=view.loss, exposure=view.exposure) for view in self._views]

    def change(self, rates: dict[str, Float32Array]) -> None:
        """Take the step that the last views want, at these rates of the columns of each parameter."""
        count = len(self._gaussians)
        places = np.full((len(self._views), count), -1, dtype=np.int32)
        for place, view in zip(places, self._views, strict=True):
            place[view.rows] = np.arange(len(view.rows), dtype=np.int32)
            self._seen.add(view.moved_rows, view.moved)
        ends = [count * part // self._cores for part in range(self._cores + 1)]
        gradients = [view.gradients for view in self._views]

        def one(part: slice) -> None:
            self._adam.step(self._gaussians, gradients, places, rates, part)

        list(self._pool.map(one, (slice(a, b) for a, b in pairwise(ends))))
        limit_stretch(self._gaussians)

    def add_noise(self, size_m: float, rng: np.random.Generator) -> None:
        """Move faint Gaussians at random; see `density.add_noise`."""
        add_noise(self._gaussians, size_m, rng)

    def seen_by(self, photos: PhotoStore, groups: Sequence[Sequence[int]], pixels_min: float) -> Int64Array:
        """In how many of these groups a view has each Gaussian on more than so many pixels, shape (N,)."""
        leaves, counts = leaves_of(self._gaussians), np.zeros(len(self._gaussians), dtype=np.int64)

        def shown(group: Sequence[int]) -> Int64Array:
            return np.unique(np.concatenate([observe(leaves, photos[number], pixels_min) for number in group]))

        for rows in self._pool.map(shown, groups):
            counts[rows] += 1
        return counts

    @property
    def gpu_bytes(self) -> int:
        """GPU memory that was used [bytes]: always 0."""
        return 0

    def close(self) -> None:
        """Stop the threads."""
        self._pool.shutdown()
