import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")

from readygo.common.rasterizer.gpu.device_images import (  # noqa: E402
    DeviceImages,
    host_images,
    mean_depth,
    rgb_bytes,
    unit_normals,
)


def test_colours_are_rounded_and_clipped() -> None:
    colours = torch.tensor([-0.1, 0.0, 0.4 / 255, 0.6 / 255, 100.5 / 255, 1.0, 1.7])
    assert rgb_bytes(colours).tolist() == [0, 0, 0, 1, 101, 255, 255]
    assert rgb_bytes(colours).dtype == torch.uint8


def test_depth_is_a_mean_and_infinite_where_nothing_is() -> None:
    depth = mean_depth(torch.tensor([3.0, 0.0, 0.5]), torch.tensor([0.5, 0.0, 0.1]))
    assert depth.tolist() == pytest.approx([6.0, np.inf, 5.0])


def test_normals_have_length_one_or_none() -> None:
    normals = unit_normals(torch.tensor([[0.0, 0.3, -0.4], [0.0, 0.0, 0.0]]))
    assert normals.numpy() == pytest.approx(np.array([[0.0, 0.6, -0.8], [0.0, 0.0, 0.0]]))


def test_only_what_is_wanted_reaches_the_host() -> None:
    rgb, alpha = torch.full((1, 2, 3, 3), 0.5), torch.full((1, 2, 3), 0.25)
    drawn = DeviceImages(rgb=rgb, alpha=alpha, depth_m=torch.ones(1, 2, 3))
    images = host_images(drawn, frozenset({"rgb", "depth"}))
    assert images.arrays().keys() == {"rgb", "depth_m"}
    assert images.rgb.tolist() == np.full((1, 2, 3, 3), 128).tolist()
    assert host_images(drawn, frozenset({"rgb", "alpha", "mask"})).arrays().keys() == {"rgb", "alpha"}
