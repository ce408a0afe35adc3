import numpy as np
import pytest

from readygo.common.errors import ReadygoError
from readygo.common.gaussians import concatenate
from readygo.common.rasterizer.reference import rasterize_reference
from tests.common.rasterizer.drawing import (
    batch_of,
    images_of,
    rgb_of,
)

HEIGHT, WIDTH = 48, 64


def test_two_cameras_with_their_own_humans_look_as_in_the_reference(
    make_cloud, camera, small_avatar, human, posed, rasterizer
) -> None:
    near, sky = make_cloud(120, coefficients=4), make_cloud(30, low=(30, -20, -5), high=(50, 20, 25), scale_m=3.0)
    humans = [[human(-2.8, 0.4), human(-2.0, -0.5, seed=2)], [human(-3.0, 0.0, seed=3)]]
    poses = np.stack([camera(-4.5, 0.2, 0.1, WIDTH, HEIGHT)[0], camera(-5.0, -0.6, 0.0, WIDTH, HEIGHT)[0]])
    K = camera(0, 0, 0, WIDTH, HEIGHT)[1]
    images = rasterizer([near, sky], [small_avatar], K, HEIGHT, WIDTH).render(batch_of(poses, humans)).rgb
    for k in range(2):
        cloud = concatenate([posed(near, [small_avatar], humans[k]), sky])
        reference = rasterize_reference(cloud, poses[k], K, HEIGHT, WIDTH).rgb
        assert reference.max() > 0.3
        assert np.abs(images[k] - 255 * np.clip(reference, 0, 1)).max() < 2


def test_batch_in_passes_has_the_bytes_of_single_images(make_cloud, camera, small_avatar, human, rasterizer) -> None:
    cloud, K = make_cloud(25), camera(0, 0, 0, 24, 16)[1]
    poses = np.stack([camera(-4.0, 0.5 * k, 0.1 * k, 24, 16)[0] for k in range(3)])
    humans = [[human(-1.5, 0.0)], [], [human(-1.5, 0.4, seed=2)]]
    batch = rasterizer(cloud, [small_avatar], K, 16, 24, cameras_per_pass=2)
    single = rasterizer(cloud, [small_avatar], K, 16, 24, programs_per_processor=3)
    images = batch.render(batch_of(poses, humans)).rgb
    assert images.shape == (3, 16, 24, 3)
    assert images.max() > 80
    for k in range(3):
        assert np.array_equal(images[k], rgb_of(single, poses[k], humans[k]))


def test_image_of_more_rows_than_tiles_can_be_numbered_looks_as_in_the_reference(
    make_cloud, camera, rasterizer
) -> None:
    cloud, (T, K) = make_cloud(12), camera(-4.0, 0.0, 0.1, 16, 2048)
    K[1, 1] = 60.0
    image = rgb_of(rasterizer(cloud, [], K, 2048, 16, tile_height_px=8), T)
    assert np.array_equal(image, rgb_of(rasterizer(cloud, [], K, 2048, 16, tile_height_px=32), T))
    reference = rasterize_reference(cloud, T, K, 2048, 16).rgb
    assert reference.max() > 0.3
    assert np.abs(image - 255 * np.clip(reference, 0, 1)).max() < 2


def test_too_large_images_and_bad_requests_are_refused(make_cloud, camera, small_avatar, human, rasterizer) -> None:
    K = camera(0, 0, 0, 32, 24)[1]
    with pytest.raises(ReadygoError, match="up to 8160 px a side"):
        rasterizer(make_cloud(5), [], K, 24, 8192)
    small = rasterizer(make_cloud(5), [small_avatar], K, 24, 32)
    with pytest.raises(ValueError, match="outputs must be names"):
        images_of(small, np.eye(4), outputs=("colour",))
    with pytest.raises(ValueError, match="255 humans"):
        images_of(small, np.eye(4), [human(0, 0)] * 256, ("mask",))
    with pytest.raises(ValueError, match="T_world_camera"):
        rgb_of(small, np.full((4, 4), np.nan))
