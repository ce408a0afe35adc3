import numpy as np
import pytest

from readygo.common.errors import SceneError
from readygo.common.gaussians import GaussianCloud, load_gaussians, save_ply
from readygo.common.gaussians.files import read_source
from tests.common.gaussians.clouds import cloud_of
from tests.common.gaussians.ply_files import FIELDS, good_row, write_ply


@pytest.mark.parametrize("coefficients", [1, 4, 9, 16])
def test_saved_cloud_loads_as_it_was(tmp_path, coefficients):
    cloud = cloud_of(coefficients=coefficients)
    save_ply(cloud, tmp_path / "a.ply")
    back = load_gaussians(tmp_path / "a.ply")
    np.testing.assert_array_equal(back.means_m, cloud.means_m)
    np.testing.assert_array_equal(back.sh, cloud.sh)
    np.testing.assert_allclose(back.quats_wxyz, cloud.quats_wxyz, atol=1e-7)
    np.testing.assert_allclose(back.scales_m, cloud.scales_m, rtol=1e-6)
    np.testing.assert_allclose(back.opacities, cloud.opacities, atol=1e-6)
    assert [p.name for p in tmp_path.iterdir()] == ["a.ply"]


def test_opacities_of_zero_and_one_survive(tmp_path):
    cloud = cloud_of(2, 1)
    whole = GaussianCloud(
        means_m=cloud.means_m,
        quats_wxyz=cloud.quats_wxyz,
        scales_m=cloud.scales_m,
        opacities=np.float32([0, 1]),
        sh=cloud.sh,
    )
    save_ply(whole, tmp_path / "a.ply")
    np.testing.assert_allclose(load_gaussians(tmp_path / "a.ply").opacities, [0, 1], atol=1e-12)


def test_stored_numbers_are_logits_logs_and_channel_by_channel_sh(tmp_path):
    fields = [*FIELDS, *(f"f_rest_{i}" for i in range(9)), "nx"]
    row = [1, 2, 3, 0.1, 0.2, 0.3, 0.0, np.log(0.5), 0, -1, 0, 0, 0, 2, *range(9), 7]
    cloud = load_gaussians(write_ply(tmp_path / "a.ply", fields, [row]))
    np.testing.assert_allclose(cloud.means_m, [[1, 2, 3]])
    np.testing.assert_allclose(cloud.opacities, [0.5])
    np.testing.assert_allclose(cloud.scales_m, [[0.5, 1, np.exp(-1)]], rtol=1e-6)
    np.testing.assert_allclose(cloud.quats_wxyz, [[0, 0, 0, 1]])
    np.testing.assert_allclose(cloud.sh[0], [[0.1, 0.2, 0.3], [0, 3, 6], [1, 4, 7], [2, 5, 8]], rtol=1e-6)


def test_point_cloud_lacks_a_named_property(tmp_path):
    with pytest.raises(SceneError, match="lacks the property 'f_dc_0'"):
        load_gaussians(write_ply(tmp_path / "a.ply", ["x", "y", "z"], [[0, 0, 0]]))


def test_wrong_number_of_sh_properties_is_refused(tmp_path):
    fields = [*FIELDS, *(f"f_rest_{i}" for i in range(8))]
    with pytest.raises(SceneError, match="8 f_rest properties"):
        load_gaussians(write_ply(tmp_path / "a.ply", fields, [good_row() + [0] * 8]))


def test_discs_of_2dgs_get_a_thin_third_axis(tmp_path):
    fields = [name for name in FIELDS if name != "scale_2"]
    row = [0, 0, 0, 0, 0, 0, 0, np.log(0.2), np.log(0.5), 1, 0, 0, 0]
    source = read_source(write_ply(tmp_path / "a.ply", fields, [row]))
    assert source.kind == ".ply of 2DGS"
    np.testing.assert_allclose(source.cloud.scales_m, [[0.2, 0.5, 0.002]], rtol=1e-5)


def test_one_scale_is_none_of_2dgs(tmp_path):
    fields = [name for name in FIELDS if name not in ("scale_1", "scale_2")]
    with pytest.raises(SceneError, match="lacks the property 'scale_1'"):
        load_gaussians(write_ply(tmp_path / "a.ply", fields, [[0.0] * 12]))
