import numpy as np

from readygo.common.frames import matrix_from_quat
from readygo.common.gaussians.covariance import covariance_of, rotation_of


def test_rotation_is_that_of_the_normalised_quaternion():
    for q in np.random.default_rng(0).normal(scale=3.0, size=(20, 4)):
        R = np.array(rotation_of(*q)).reshape(3, 3)
        np.testing.assert_allclose(R, matrix_from_quat(q / np.linalg.norm(q)), atol=1e-12)


def test_covariance_is_rotated_squared_scales():
    rng = np.random.default_rng(1)
    for q, s in zip(rng.normal(size=(20, 4)), rng.uniform(0.1, 2.0, size=(20, 3)), strict=True):
        R = matrix_from_quat(q / np.linalg.norm(q))
        expected = (R * s**2) @ R.T
        np.testing.assert_allclose(covariance_of(*q, *s), expected[np.triu_indices(3)], atol=1e-12)
