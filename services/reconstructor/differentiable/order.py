"""An order of Gaussians in memory that suits the rasterizer."""

import numpy as np

from readygo.common.arrays import Float32Array, Int64Array
from readygo.common.rasterizer.packed.scene import morton_codes


def spatial_order(means_m: Float32Array) -> Int64Array:
    """Order in which neighbours in space are neighbours in memory: along a Morton curve.

    Worth applying to all parameters (and to the state of an optimiser) after every densification; Gaussians move too
    little in between.

    Args:
        means_m: Centres [m], shape (N, 3).

    Returns:
        Index such that `means_m[index]` is sorted, shape (N,).
    """
    return np.argsort(morton_codes(means_m), kind="stable")
