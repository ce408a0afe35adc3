"""What of a photo is believed."""

import numpy as np

from readygo.services.reconstructor.training.robust import trusted_pixels


def pair() -> tuple[np.ndarray, np.ndarray]:
    """A drawn image and its photo, which has noise."""
    rng = np.random.default_rng(2)
    image = rng.uniform(0.3, 0.7, (3, 120, 160)).astype(np.float32)
    return image, np.clip(image + rng.normal(0.0, 0.03, image.shape), 0, 1).astype(np.float32)


def test_photo_with_noise_alone_is_believed_whole() -> None:
    assert trusted_pixels(*pair(), 0.2).all()


def test_what_passes_by_is_left_out_whatever_its_colours() -> None:
    image, photo = pair()
    photo[:, 40:90, 60:85] = np.random.default_rng(0).uniform(0.0, 1.0, (3, 50, 25))
    photo[0, 40:90, 60:85] = 1.0
    trusted = trusted_pixels(image, photo, 0.2)
    assert not trusted[45:85, 64:81].any()
    assert trusted.mean() > 0.9
    assert trusted[:30].all()


def test_no_more_than_the_share_is_left_out() -> None:
    image, photo = pair()
    photo[:, :, :60] = 1.0 - photo[:, :, :60]
    photo[:, :, :60] += 0.4
    assert 0.85 < trusted_pixels(image, photo, 0.1).mean() < 0.95


def test_what_is_masked_neither_counts_nor_sets_the_limit() -> None:
    image, photo = pair()
    mask = np.ones((120, 160), np.bool_)
    mask[:, :80] = False
    photo[:, :, :80] = 1.0
    trusted = trusted_pixels(image, photo, 0.2, mask)
    np.testing.assert_array_equal(trusted, mask)
    nothing = np.zeros((120, 160), np.bool_)
    np.testing.assert_array_equal(trusted_pixels(image, photo, 0.2, nothing), nothing)
