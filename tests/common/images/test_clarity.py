import cv2
import numpy as np
import pytest

from readygo.common.images.clarity import coverage, sharpness
from readygo.common.images.images import Images


def stripes(height_px: int, width_px: int, count: int = 9) -> np.ndarray:
    """Soft stripes, as many at every size."""
    wave = 127.5 + 120 * np.sin((np.arange(width_px) + 0.5) / width_px * count * 2 * np.pi)
    return np.broadcast_to(np.rint(wave).astype(np.uint8)[None, :, None], (height_px, width_px, 3)).copy()


def test_a_picture_of_one_colour_has_no_sharpness() -> None:
    assert sharpness(np.full((144, 256, 3), 90, np.uint8)) == 0.0


def test_a_lone_bright_pixel_has_the_variance_that_can_be_counted() -> None:
    picture = np.zeros((5, 5, 3), np.uint8)
    picture[2, 2] = 10
    # Of the nine inner pixels one is -40 and four are 10.
    assert sharpness(picture) == pytest.approx((1600 + 400) / 9)


def test_blur_makes_it_smaller() -> None:
    picture = np.random.default_rng(0).integers(0, 255, (144, 256, 3), dtype=np.uint8)
    assert sharpness(cv2.GaussianBlur(picture, (0, 0), 4.0)) < 0.05 * sharpness(picture)


def test_the_same_view_has_the_same_sharpness_at_any_size() -> None:
    values = [sharpness(stripes(72 * k, 128 * k)) for k in (1, 2, 3, 8)]
    assert values[0] > 100
    assert np.allclose(values, values[0], rtol=0.1)


def test_small_pictures_are_taken_as_they_are() -> None:
    assert sharpness(stripes(24, 32)) > 0
    assert sharpness(np.zeros((3, 9000, 3), np.uint8)) == 0.0


def view(mean_m: float, median_m: float, alpha: float) -> Images:
    shape = (4, 6)
    return Images(
        rgb=np.zeros((*shape, 3), np.uint8),
        depth_m=np.full(shape, mean_m, np.float32),
        median_depth_m=np.full(shape, median_m, np.float32),
        alpha=np.full(shape, alpha, np.float32),
    )


@pytest.mark.parametrize(
    ("mean_m", "median_m", "alpha", "share"),
    [(2.0, 2.1, 1.0, 1.0), (2.0, 3.0, 1.0, 0.0), (2.0, 2.1, 0.3, 0.0), (np.inf, np.inf, 0.0, 0.0)],
)
def test_surface_is_opaque_and_at_one_depth(mean_m: float, median_m: float, alpha: float, share: float) -> None:
    assert coverage(view(mean_m, median_m, alpha)) == share


def test_coverage_is_a_share_of_all_pixels() -> None:
    images = view(2.0, 2.0, 1.0)
    images.arrays()["alpha"][:1] = 0.0
    assert coverage(images) == 0.75
