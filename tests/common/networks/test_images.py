import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")

from readygo.common.networks.images import normalise_images, small_image  # noqa: E402


def test_wide_images_lose_their_sides() -> None:
    image = np.zeros((72, 128, 3), np.uint8)
    image[:, 16:112] = 255
    assert float(small_image(image, 85, 64).min()) == pytest.approx(1.0)
    image[:, 112:] = 255
    assert small_image(image, 96, 96).shape == (3, 96, 96)


def test_narrow_images_keep_theirs() -> None:
    image = np.zeros((96, 96, 3), np.uint8)
    image[:, :10] = 255
    assert float(small_image(image, 96, 96)[:, :, 0].min()) == pytest.approx(1.0)


def test_images_are_normalised_channel_by_channel() -> None:
    mean = torch.tensor([0.485, 0.456, 0.406])[:, None, None].expand(2, 3, 4, 5)
    assert float(normalise_images(mean).abs().max()) < 1e-6
    assert normalise_images(torch.ones(3, 4, 5))[2, 0, 0].item() == pytest.approx((1 - 0.406) / 0.225)
