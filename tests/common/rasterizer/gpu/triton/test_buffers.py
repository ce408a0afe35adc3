import numpy as np

from tests.common.rasterizer.drawing import (
    rgb_of,
)


def test_buffers_grow_until_everything_fits(make_cloud, camera, rasterizer) -> None:
    from readygo.common.rasterizer.gpu.triton.buffers import make_buffers

    T, K = camera(-4.0, 0.0, 0.0, 32, 24)
    roomy, tight = (rasterizer(make_cloud(280, scale_m=0.02), [], K, 24, 32, slab_shares=()) for _ in range(2))
    pipeline = tight._kernels._pipeline
    pipeline._buffers = make_buffers(1, 16, False, pipeline._device)
    assert np.array_equal(rgb_of(tight, T), rgb_of(roomy, T))
    assert pipeline._buffers.entry_capacity > 16
