import numpy as np

from readygo.services.reconstructor.differentiable.order import spatial_order


def test_spatial_order_brings_neighbours_together() -> None:
    means = np.random.default_rng(0).uniform(size=(4000, 3)).astype(np.float32)
    ordered = means[spatial_order(means)]
    assert (
        np.linalg.norm(np.diff(ordered, axis=0), axis=1).mean()
        < 0.2 * np.linalg.norm(np.diff(means, axis=0), axis=1).mean()
    )
