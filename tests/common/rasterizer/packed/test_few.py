import numpy as np
import pytest

from readygo.common.gaussians import GaussianCloud
from readygo.common.rasterizer.constants import ALPHA_MIN
from readygo.common.rasterizer.packed.few import pack_few
from readygo.common.rasterizer.packed.scene import CHUNK, pack_sorted


@pytest.mark.parametrize("count", [1, 140, CHUNK, CHUNK + 30])
def test_pack_is_that_of_larger_clouds(make_cloud, count: int) -> None:
    cloud: GaussianCloud = make_cloud(count)
    cloud.opacities[:] = np.maximum(cloud.opacities, np.float32(ALPHA_MIN))
    few, expected = pack_few(cloud), pack_sorted(cloud)
    for name in ("centre_m", "half_m", "reach_m", "sh_step", "sh"):
        assert np.array_equal(getattr(few, name), getattr(expected, name)), name
    valid = expected.geometry[:, :, -1] >= 0.0
    assert valid.sum() == count
    assert np.array_equal(few.geometry[:, :, -1] >= 0.0, valid)
    for name in ("geometry", "colour"):
        rows, wanted = (np.moveaxis(getattr(pack, name), 2, 3)[valid] for pack in (few, expected))
        assert np.array_equal(rows, wanted), name


def test_nothing_is_no_chunk(make_cloud) -> None:
    assert pack_few(make_cloud(3).select(np.zeros(3, dtype=np.bool_))).chunk_count == 0
