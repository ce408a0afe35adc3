import numpy as np

from tests.common.rasterizer.drawing import (
    float_rgb_of,
    with_arrays,
)


def test_what_stands_behind_finished_tiles_is_not_projected(make_cloud, camera, rasterizer) -> None:
    plates = make_cloud(8, low=(-2.0, 0.0, 1.0), high=(-1.9, 0.1, 1.1))
    wall = with_arrays(
        plates,
        quats_wxyz=np.tile(np.array([1, 0, 0, 0], dtype=np.float32), (8, 1)),
        scales_m=np.tile(np.array([0.02, 4.0, 4.0], dtype=np.float32), (8, 1)),
        opacities=np.full(8, 0.95, dtype=np.float32),
    )
    behind = make_cloud(1000, low=(2.0, -4.0, -1.0), high=(9.0, 4.0, 4.0))
    T, K = camera(-4.0, 0.0, 0.0, 16, 16)
    culling = rasterizer([wall, behind], [], K, 16, 16, slab_shares=(0.3,))
    full = rasterizer([wall, behind], [], K, 16, 16, slab_shares=())
    assert np.abs(float_rgb_of(culling, T) - float_rgb_of(full, T)).max() < 1e-3
    pairs = [int(kernels._kernels._pipeline._needed[0]) for kernels in (culling, full)]
    assert pairs == [1, 5]
