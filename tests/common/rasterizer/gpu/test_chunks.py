import numpy as np
import pytest

from readygo.common.gaussians import GaussianCloud
from readygo.common.rasterizer.constants import ALPHA_MIN
from readygo.common.rasterizer.gpu.chunks import chunk_avatar, chunk_cloud, morton_order
from readygo.common.rasterizer.packed.scene import CHUNK


def means_of(chunked) -> np.ndarray:
    return (chunked.geometry[:, :3].swapaxes(1, 2) + chunked.centre_m[:, None]).reshape(-1, 3)


def test_every_gaussian_that_can_be_seen_is_in_one_chunk(make_cloud) -> None:
    cloud = make_cloud(1000)
    chunked = chunk_cloud(cloud)
    drawn = chunked.geometry[:, 10].reshape(-1) >= 0
    wanted = cloud.means_m[cloud.opacities >= ALPHA_MIN]
    assert drawn.sum() == len(wanted)
    key = lambda means: means[np.lexsort(means.T)]  # noqa: E731
    np.testing.assert_allclose(key(means_of(chunked)[drawn].astype(np.float32)), key(wanted), atol=1e-6)


def test_boxes_hold_the_means_of_their_chunk(make_cloud) -> None:
    chunked = chunk_cloud(make_cloud(700))
    drawn = chunked.geometry[:, 10] >= 0
    outside = np.abs(chunked.geometry[:, :3].swapaxes(1, 2)) > chunked.half_m[:, None]
    assert chunked.chunk_count == -(-drawn.sum() // CHUNK) > 1
    assert not outside[drawn].any()


def test_neighbours_share_a_chunk(make_cloud) -> None:
    chunked = chunk_cloud(make_cloud(6000))
    assert chunked.half_m.max(axis=1).mean() < 2.0 < np.ptp(means_of(chunked), axis=0).max() / 2


@pytest.mark.parametrize("name", ["means_m", "quats_wxyz", "scales_m", "sh"])
def test_gaussians_that_are_not_finite_are_left_out(make_cloud, name: str) -> None:
    cloud = make_cloud(300)
    arrays = {field: getattr(cloud, field).copy() for field in ("means_m", "quats_wxyz", "scales_m", "opacities", "sh")}
    arrays[name][7] = np.nan
    arrays["quats_wxyz"][8] = 0.0
    arrays["opacities"][9:] = np.maximum(arrays["opacities"][9:], 0.1)
    arrays["opacities"][:9] = 0.5
    order = morton_order(GaussianCloud(**arrays))
    assert len(order) == 298
    assert not {7, 8} & set(order.tolist())


def test_empty_cloud_has_no_chunks(make_cloud) -> None:
    chunked = chunk_cloud(make_cloud(0, coefficients=4))
    assert chunked.chunk_count == 0
    assert chunked.sh.shape == (0, 3, 3, CHUNK)


def test_avatar_boxes_name_the_joints_that_move_their_chunk(avatar) -> None:
    chunked = chunk_avatar(avatar)
    for chunk in range(chunked.cloud.chunk_count):
        drawn = chunked.cloud.geometry[chunk, 10] >= 0
        moved = chunked.joint[chunk][:, drawn][chunked.weight[chunk][:, drawn] != 0]
        assert set(moved.tolist()) == set(chunked.box_joint[chunk].tolist()) - {-1}
