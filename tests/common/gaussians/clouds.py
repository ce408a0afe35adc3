"""Clouds of random Gaussians."""

import numpy as np

from readygo.common.gaussians import GaussianCloud


def cloud_of(count: int = 50, coefficients: int = 16, seed: int = 0) -> GaussianCloud:
    """Gaussians around the origin with spherical harmonics of so many coefficients."""
    rng = np.random.default_rng(seed)
    q = rng.normal(size=(count, 4))
    return GaussianCloud(
        means_m=rng.normal(size=(count, 3)).astype(np.float32),
        quats_wxyz=(q / np.linalg.norm(q, axis=1, keepdims=True)).astype(np.float32),
        scales_m=np.exp(rng.normal(-4, 1, (count, 3))).astype(np.float32),
        opacities=rng.random(count).astype(np.float32),
        sh=rng.normal(size=(count, coefficients, 3)).astype(np.float32),
    )
