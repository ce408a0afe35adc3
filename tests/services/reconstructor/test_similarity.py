import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from readygo.services.reconstructor.similarity import umeyama

R = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
T = np.array([3.0, -1.0, 2.0])


def test_similarity_is_found_to_rounding() -> None:
    a = np.random.default_rng(0).normal(size=(20, 3))
    fit = umeyama(a, 2.5 * a @ R.T + T)
    np.testing.assert_allclose(fit.scale, 2.5, rtol=1e-12)
    np.testing.assert_allclose(fit.R, R, atol=1e-12)
    np.testing.assert_allclose(fit.t, T, atol=1e-12)


def test_noisy_fit_is_the_minimum_that_a_general_solver_finds() -> None:
    from scipy.optimize import least_squares

    rng = np.random.default_rng(1)
    a = rng.normal(size=(15, 3))
    b = 0.7 * a @ R.T + T + 0.05 * rng.normal(size=a.shape)

    def errors(x: np.ndarray) -> np.ndarray:
        return (np.exp(x[0]) * a @ Rotation.from_rotvec(x[1:4]).as_matrix().T + x[4:] - b).ravel()

    begin = np.concatenate([[np.log(0.6)], [0.4, -1.0, 0.6], T])
    solved = least_squares(errors, begin, xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    fit = umeyama(a, b)
    np.testing.assert_allclose(fit.scale, np.exp(solved[0]), rtol=1e-6)
    np.testing.assert_allclose(fit.R, Rotation.from_rotvec(solved[1:4]).as_matrix(), atol=1e-6)


def test_corners_of_a_square_are_enough_and_never_mirrored() -> None:
    square = np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]], dtype=float)
    fit = umeyama(square, 0.2 * square @ R.T + T)
    np.testing.assert_allclose([fit.scale, np.linalg.det(fit.R)], [0.2, 1.0], rtol=1e-12)


def test_points_on_a_line_are_refused() -> None:
    line = np.outer(np.arange(5.0), [1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match="on a line"):
        umeyama(line, line)


def test_poses_move_with_the_points() -> None:
    fit = umeyama(np.eye(3), 2.0 * np.eye(3) @ R.T + T)
    pose = np.eye(4)
    pose[:3, 3] = [1.0, 0.0, 0.0]
    moved = fit.moved_poses(pose[None])[0]
    np.testing.assert_allclose(moved[:3, 3], 2.0 * R @ [1.0, 0.0, 0.0] + T, atol=1e-9)
    np.testing.assert_allclose(moved[:3, :3], R, atol=1e-9)
