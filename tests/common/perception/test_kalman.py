import numpy as np
import pytest

from readygo.common.perception import kalman

F = np.array([[1, 0, 0.3, 0], [0, 1, 0, 0.3], [0, 0, 1, 0], [0, 0, 0, 1]])


def drawn_state(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    half = rng.standard_normal((4, 4))
    return rng.standard_normal(4), half @ half.T + np.eye(4)


def test_prediction_is_the_linear_one() -> None:
    mean, cov = drawn_state()
    q = 0.6 * np.kron(np.array([[0.3**3 / 3, 0.3**2 / 2], [0.3**2 / 2, 0.3]]), np.eye(2))
    wanted_mean, wanted_cov = F @ mean, F @ cov @ F.T + q
    kalman.predict(mean, cov, 0.3, 0.6)
    np.testing.assert_allclose(mean, wanted_mean, atol=1e-12)
    np.testing.assert_allclose(cov, wanted_cov, atol=1e-12)


@pytest.mark.parametrize(("fuse", "first"), [(kalman.update, 0), (kalman.update_velocity, 2)])
def test_update_is_the_textbooks(fuse: object, first: int) -> None:
    mean, cov = drawn_state(1)
    R = np.array([[0.3, 0.1], [0.1, 0.2]])
    H = np.eye(4)[first : first + 2]
    z = np.array([0.4, -1.2])
    S = H @ cov @ H.T + R
    K = cov @ H.T @ np.linalg.inv(S)
    wanted_mean, wanted_cov = mean + K @ (z - H @ mean), (np.eye(4) - K @ H) @ cov
    off = z - H @ mean
    distance = fuse(mean, cov, z, R)  # type: ignore[operator]
    assert distance == pytest.approx(off @ np.linalg.inv(S) @ off)
    np.testing.assert_allclose(mean, wanted_mean, atol=1e-12)
    np.testing.assert_allclose(cov, wanted_cov, atol=1e-12)


def test_velocity_of_a_walk_is_found() -> None:
    mean, cov = np.array([0.0, 0.0, 0.0, 0.0]), np.diag([0.1, 0.1, 1.0, 1.0])
    for step in range(1, 30):
        kalman.predict(mean, cov, 0.1, kalman.ACCELERATION_NOISE)
        kalman.update(mean, cov, np.array([0.1 * step, -0.05 * step]), 0.01 * np.eye(2))
    np.testing.assert_allclose(mean[2:], [1.0, -0.5], atol=0.02)
