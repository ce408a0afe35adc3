import numpy as np

from tests.common.rasterizer.drawing import (
    images_of,
    rgb_of,
)


def test_empty_scene_is_black(make_cloud, camera, rasterizer) -> None:
    T, K = camera(0.0, 0.0, 0.0, 40, 30)
    assert rgb_of(rasterizer(make_cloud(0), [], K, 30, 40), T).max() == 0
    behind = make_cloud(20, low=(-9, -1, 0), high=(-8, 1, 1))
    images = images_of(rasterizer(behind, [], K, 30, 40), T, outputs=("depth", "mask", "alpha"))
    assert np.isinf(images.depth_m).all()
    assert not images.alpha.any()
