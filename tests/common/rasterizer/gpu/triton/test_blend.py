"""Images besides rgb of the Triton kernels."""

import numpy as np

from readygo.common.gaussians import GaussianCloud
from readygo.common.gaussians.spherical_harmonics import SH_C0
from readygo.common.rasterizer.reference import rasterize_reference
from tests.common.rasterizer.drawing import (
    images_of,
    with_arrays,
)


def median_images(cloud: GaussianCloud, T, K, owners) -> tuple[np.ndarray, np.ndarray]:
    """Depth and owner of the Gaussian with which the picture of the nearest ones becomes half opaque."""
    depth = (cloud.means_m.astype(np.float64) - T[:3, 3]) @ T[:3, 2]
    median, mask = np.full((24, 32), np.inf), np.zeros((24, 32), dtype=np.uint8)
    order = np.argsort(depth)
    for count in range(1, len(order) + 1):
        alpha = rasterize_reference(cloud.select(order[:count]), T, K, 24, 32).alpha
        new = (alpha > 0.5) & np.isinf(median)
        median[new], mask[new] = depth[order[count - 1]], owners[order[count - 1]]
    return median, mask


def normal_image(cloud: GaussianCloud, T, K) -> np.ndarray:
    """Sums of normals, drawn as colours 0.5 + 0.5 n, at length 1."""
    from readygo.common.frames import matrix_from_quat

    axes = matrix_from_quat(cloud.quats_wxyz)[np.arange(len(cloud)), :, cloud.scales_m.argmin(axis=1)]
    normal, mean = axes @ T[:3, :3], (cloud.means_m - T[:3, 3]) @ T[:3, :3]
    normal = np.where((normal * mean).sum(axis=1, keepdims=True) > 0, -normal, normal)
    images = rasterize_reference(
        with_arrays(cloud, sh=(0.5 * normal / SH_C0)[:, None].astype(np.float32)), T, K, 24, 32
    )
    sums = 2.0 * images.rgb - images.alpha[..., None]
    return sums / np.maximum(np.linalg.norm(sums, axis=2, keepdims=True), 1e-9)


def test_all_images_are_those_of_the_gaussians(make_cloud, camera, small_avatar, human, posed, rasterizer) -> None:
    scene = with_arrays(make_cloud(40, scale_m=0.15), opacities=np.full(40, 0.7, dtype=np.float32))
    body = small_avatar.cloud.select(np.arange(60))
    thin = type(small_avatar)(
        **{name: getattr(small_avatar, name) for name in ("name", "license", "height_m", "joints_canonical_m")},
        cloud=with_arrays(body, scales_m=2 * body.scales_m, opacities=np.full(60, 0.9, dtype=np.float32)),
        lbs_index=small_avatar.lbs_index[:60],
        lbs_weight=small_avatar.lbs_weight[:60],
        joints_tpose_m=small_avatar.joints_tpose_m,
        R_tpose_canonical=small_avatar.R_tpose_canonical,
    )
    humans = [human(-2.9, 0.3), human(-2.4, -0.3, seed=2)]
    T, K = camera(-4.0, 0.0, 0.1, 32, 24)
    outputs = ("rgb", "depth", "median_depth", "alpha", "mask", "normal")
    images = images_of(rasterizer(scene, [thin], K, 24, 32), T, humans, outputs)
    cloud = posed(scene, [thin], humans)
    reference = rasterize_reference(cloud, T, K, 24, 32)
    np.testing.assert_allclose(images.alpha, reference.alpha, atol=2e-4)
    seen = reference.alpha > 0.01
    np.testing.assert_allclose(images.depth_m[seen], reference.depth_m[seen], rtol=1e-3)
    assert np.isinf(images.depth_m[reference.alpha == 0]).all()
    owners = np.repeat([0, 1, 2], [40, 60, 60])
    median_depth, mask = median_images(cloud, T, K, owners)
    alike = np.isclose(images.median_depth_m, median_depth, rtol=1e-4)
    assert alike.mean() > 0.99
    assert (images.mask[alike] == mask[alike]).all()
    assert {0, 1, 2} == set(np.unique(mask[np.isfinite(median_depth)]))
    solid = reference.alpha > 0.3
    dots = (images.normal * normal_image(cloud, T, K)).sum(axis=2)
    assert solid.sum() > 50
    assert dots[solid].min() > 0.999
    assert not images.normal[reference.alpha == 0].any()


def test_a_far_sky_does_not_move_the_depth_of_finished_pixels(make_cloud, camera, rasterizer) -> None:
    """Half of the tile is a finished wall, so that the sky is blended on: at most 1e-4 of it could pass the wall."""
    wall = make_cloud(6, low=(-2.0, 2.0, 0.5), high=(-1.9, 2.0, 0.5))
    wall = with_arrays(
        wall,
        quats_wxyz=np.tile(np.array([1, 0, 0, 0], dtype=np.float32), (6, 1)),
        scales_m=np.tile(np.array([0.02, 0.5, 9.0], dtype=np.float32), (6, 1)),
        opacities=np.full(6, 0.99, dtype=np.float32),
    )
    sky = make_cloud(40, low=(1800.0, -900.0, -900.0), high=(1800.0, 900.0, 900.0), scale_m=300.0)
    T, K = camera(-4.0, 0.0, 0.0, 16, 16)
    depth = images_of(rasterizer([wall, sky], [], K, 16, 16, slab_shares=()), T, [], ("depth",)).depth_m
    alone = images_of(rasterizer(wall, [], K, 16, 16), T, [], ("depth", "alpha"))
    finished = alone.alpha > 1 - 0.9e-4
    assert 10 < finished.sum() < 200
    assert np.abs(depth - alone.depth_m)[finished].max() < 0.005
    assert depth[~finished].max() > 1000
