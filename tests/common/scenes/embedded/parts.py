"""What a part of the embedded scene is made of."""

from collections.abc import Callable

import numpy as np

from readygo.common.scenes.embedded.surfaces import Surfaces, UnlitPoints


def samples_of(draw: Callable[[Surfaces], None], *, seed: int = 0) -> UnlitPoints:
    """The samples that `draw` adds to an empty collection."""
    build = Surfaces(np.random.default_rng(seed))
    draw(build)
    return build.samples()


def extent(samples: UnlitPoints) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest coordinates of the samples' centres [m]."""
    return samples.position_m.min(axis=0), samples.position_m.max(axis=0)


def rows_of(samples: UnlitPoints) -> tuple[np.ndarray, ...]:
    """All that samples are, a row each."""
    return (
        samples.position_m,
        samples.tangent,
        samples.normal,
        30.0 * samples.sigma_m,
        3.0 * samples.colour,
        samples.facing,
        samples.glows,
    )
