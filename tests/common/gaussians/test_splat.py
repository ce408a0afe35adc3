import struct

import numpy as np
import pytest

from readygo.common.errors import SceneError
from readygo.common.gaussians import rgb_of_sh
from readygo.common.gaussians.files import read_source
from readygo.common.gaussians.splat import is_splat
from tests.common.gaussians.other_formats import write_splat


def test_one_gaussian_of_known_bytes(tmp_path):
    row = struct.pack("<6f4B4B", 1.5, -2, 3, 0.1, 0.2, 0.3, 255, 0, 51, 102, 128, 128, 0, 128)
    (tmp_path / "a.splat").write_bytes(row)
    source = read_source(tmp_path / "a.splat")
    cloud = source.cloud
    assert source.kind == ".splat"
    np.testing.assert_array_equal(cloud.means_m, np.float32([[1.5, -2, 3]]))
    np.testing.assert_array_equal(cloud.scales_m, np.float32([[0.1, 0.2, 0.3]]))
    np.testing.assert_array_equal(cloud.quats_wxyz, [[0, 0, -1, 0]])
    np.testing.assert_allclose(rgb_of_sh(cloud.sh[0, 0]), [1.0, 0.0, 0.2], atol=1e-6)
    assert cloud.opacities[0] == pytest.approx(0.4)


@pytest.mark.parametrize("seed", range(5))
def test_written_cloud_comes_back_within_a_step(tmp_path, make_cloud, seed):
    cloud = make_cloud(300, seed=seed)
    read = read_source(write_splat(cloud, tmp_path / "any.name")).cloud
    np.testing.assert_array_equal(read.means_m, cloud.means_m)
    np.testing.assert_array_equal(read.scales_m, cloud.scales_m)
    assert np.abs(read.opacities - cloud.opacities).max() <= 1.01 / 255
    assert np.abs(rgb_of_sh(read.sh[:, 0]) - rgb_of_sh(cloud.sh[:, 0]).clip(0, 1)).max() <= 1.01 / 255
    assert np.abs(read.quats_wxyz - cloud.quats_wxyz).max() <= 1.01 / 128


def test_bytes_that_are_something_else_are_not_taken_for_it(make_cloud, tmp_path):
    rng = np.random.default_rng(0)
    assert not is_splat(rng.integers(0, 256, 32 * 256, np.uint8).tobytes())
    assert not is_splat(b"\0" * 3200)
    assert not is_splat(b"some text, and more of it. " * 100)
    assert not is_splat(rng.normal(size=4096).astype("<f4").tobytes())
    assert not is_splat(b"")
    assert is_splat(write_splat(make_cloud(100), tmp_path / "a").read_bytes())


def test_part_of_a_row_is_refused(tmp_path, make_cloud):
    path = write_splat(make_cloud(100), tmp_path / "a.splat")
    path.write_bytes(path.read_bytes()[:-5])
    with pytest.raises(SceneError, match="truncated: 3195 bytes are not a multiple of 32"):
        read_source(path)
