import numpy as np
import pytest

from readygo.services.reconstructor.metric.triangulate import intersect_rays, triangulate
from tests.services.reconstructor.synthetic import FOCAL_PX, projected, ring, undistorted

POINT = np.array([0.3, -0.2, 0.5])


def rays(poses: np.ndarray, noise_px: float = 0.0) -> np.ndarray:
    rng = np.random.default_rng(0)
    pixels = np.concatenate([projected(T, POINT[None]) for T in poses])
    return undistorted(0, pixels + noise_px * rng.normal(size=pixels.shape))


def test_point_seen_through_a_bent_lens_is_found_to_rounding() -> None:
    poses = ring(6)
    found = triangulate(rays(poses), poses, np.full(6, FOCAL_PX))
    np.testing.assert_allclose(found.point, POINT, atol=1e-9)
    assert found.residuals_px.max() < 1e-6


def test_noisy_point_is_the_minimum_that_a_general_solver_finds() -> None:
    from scipy.optimize import least_squares

    poses = ring(8)
    xy = rays(poses, 0.2)

    def errors(point: np.ndarray) -> np.ndarray:
        seen = np.einsum("vji,vj->vi", poses[:, :3, :3], point - poses[:, :3, 3])
        return (FOCAL_PX * (seen[:, :2] / seen[:, 2:] - xy)).ravel()

    solved = least_squares(errors, POINT, xtol=1e-15, ftol=1e-15, gtol=1e-15)
    found = triangulate(xy, poses, np.full(8, FOCAL_PX))
    np.testing.assert_allclose(found.point, solved.x, atol=1e-7)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(solved.jac.T @ solved.jac), rtol=1e-4)


def test_one_wrong_sighting_hardly_matters() -> None:
    poses = ring(12)
    xy = rays(poses)
    xy[3] += 60.0 / FOCAL_PX
    found = triangulate(xy, poses, np.full(12, FOCAL_PX))
    assert np.linalg.norm(found.point - POINT) < 0.005
    assert np.linalg.norm(intersect_rays(xy, poses) - POINT) > np.linalg.norm(found.point - POINT)


def test_parallel_rays_are_refused() -> None:
    poses = np.repeat(ring(1), 3, axis=0)
    with pytest.raises(ValueError, match="parallel"):
        triangulate(rays(poses), poses, np.full(3, FOCAL_PX))
