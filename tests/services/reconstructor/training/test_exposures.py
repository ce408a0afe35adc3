import numpy as np

from readygo.services.reconstructor.training.exposures import Exposures


def test_photo_that_is_too_bright_is_darkened_beside_the_others() -> None:
    exposures = Exposures.none(4)
    gradient = np.zeros((2, 3), np.float32)
    gradient[0] = 0.5
    for _ in range(3):
        exposures.step([1], [gradient], 0.01, (0, 1, 2))
    assert (exposures.values[1, 0] < 0).all()
    assert (exposures.values[[0, 2], 0] > 0).all()
    assert (exposures.values[:, 1] == 0).all()


def test_those_that_are_trained_on_have_no_common_part_and_others_stay() -> None:
    exposures = Exposures.none(4)
    rng = np.random.default_rng(0)
    for _ in range(5):
        exposures.step([0, 2, 0], list(rng.normal(size=(3, 2, 3)).astype(np.float32)), 0.01, (0, 1, 2))
    np.testing.assert_allclose(exposures.values[:3].mean(axis=0), 0.0, atol=1e-7)
    assert (exposures.values[3] == 0).all()
    assert exposures.values.dtype == np.float32
