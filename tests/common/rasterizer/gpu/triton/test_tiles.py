"""Lists of tiles of the Triton kernels."""

import numpy as np
import pytest

from tests.common.rasterizer.drawing import (
    float_rgb_of,
    with_arrays,
)


@pytest.mark.parametrize("run", [2, 16])
def test_lists_of_any_length_are_sorted(triton_device: str, run: int) -> None:
    import torch

    from readygo.common.rasterizer.gpu.triton.tiles import sort_lists

    lengths = [0, 1, 2, 5, 16, 17, 70]
    rng = np.random.default_rng(0)
    keys = rng.permutation(sum(lengths)).astype(np.int64) << 32
    starts, counts = np.cumsum([0, *lengths[:-1]]), np.array(lengths, dtype=np.int32)
    entries, spare = (
        torch.tensor(keys, device=triton_device),
        torch.zeros(len(keys), dtype=torch.int64, device=triton_device),
    )
    flags = torch.zeros(len(lengths), dtype=torch.int32, device=triton_device)
    tensors = [torch.tensor(array, device=triton_device) for array in (starts, counts)]
    for least, most in ((2, 16), (17, 1000)):
        sort_lists[(len(lengths),)](entries, spare, *tensors, len(keys), flags, least, most, RUN=run)
    for start, length, flag in zip(starts, lengths, flags.tolist(), strict=True):
        found = (spare if flag else entries)[start : start + length].cpu().numpy()
        assert np.array_equal(found, np.sort(keys[start : start + length]))


def test_equal_depths_are_drawn_in_the_order_of_the_scene(make_cloud, camera, rasterizer) -> None:
    cloud = make_cloud(40, low=(0.0, -0.5, 0.8), high=(0.0, 0.5, 1.6), scale_m=0.3)
    cloud = with_arrays(cloud, means_m=np.round(cloud.means_m * 4) / np.float32(4))
    T, K = camera(-2.0, 0.0, 0.0, 32, 24, 0.0)
    images = [float_rgb_of(rasterizer(cloud, [], K, 24, 32, programs_per_processor=n), T) for n in (1, 2)]
    assert images[0].max() > 0.3
    assert np.array_equal(*images)
