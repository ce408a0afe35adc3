import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from readygo.common.gaussians.irradiance import HARMONICS, add_radiance, irradiance, irradiance_matrix, rotate_forms

AXES = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])


def sphere(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Directions spread evenly over a sphere (a Fibonacci lattice), and the solid angle of each."""
    k = np.arange(count)
    z, azimuth = 1.0 - (2.0 * k + 1.0) / count, k * np.pi * (3.0 - np.sqrt(5.0))
    r = np.sqrt(1.0 - z * z)
    return np.stack([r * np.cos(azimuth), r * np.sin(azimuth), z], axis=1), np.full(count, 4.0 * np.pi / count)


def projected(radiance: np.ndarray, directions: np.ndarray, solid_angle: np.ndarray) -> np.ndarray:
    sh = np.zeros((HARMONICS, 3))
    add_radiance(radiance, directions, solid_angle, sh)
    return irradiance_matrix(sh)


def test_light_from_everywhere_is_the_same_for_every_normal() -> None:
    directions, solid_angle = sphere(4000)
    M = projected(np.tile([1.0, 0.5, 2.0], (4000, 1)), directions, solid_angle)
    assert irradiance(M, AXES) == pytest.approx(np.tile([1.0, 0.5, 2.0], (6, 1)), abs=2e-3)


def test_irradiance_is_the_integral_over_the_hemisphere_within_the_error_of_order_two() -> None:
    directions, solid_angle = sphere(8000)
    rng = np.random.default_rng(0)
    # A bright half sky of one colour, a dim ground, a lamp: of the paper's accuracy, some percent of the largest.
    radiance = np.where(directions[:, 2:] > 0.2, [0.8, 0.9, 1.0], [0.3, 0.25, 0.2])
    radiance = radiance + 2.0 * (directions @ Rotation.random(rng=rng).as_matrix()[:, :1] > 0.9)
    M = projected(radiance, directions, solid_angle)
    normals, _ = sphere(60)
    cosine = np.maximum(normals @ directions.T, 0.0)
    exact = (cosine * solid_angle) @ radiance / np.pi
    assert np.abs(irradiance(M, normals) - exact).max() < 0.06 * exact.max()


def test_terms_in_a_turned_frame_give_the_same_light() -> None:
    directions, solid_angle = sphere(500)
    M = projected(np.random.default_rng(1).uniform(0, 1, (500, 3)) * (1 + directions[:, :1]), directions, solid_angle)
    R = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
    terms = np.empty((3, 10), dtype=np.float32)
    rotate_forms(M, R, terms)
    x, y, z = (AXES @ R.T).T
    monomials = np.stack([np.ones(6), x, y, z, x * x, y * y, z * z, x * y, x * z, y * z], axis=1)
    assert monomials @ terms.T == pytest.approx(irradiance(M, AXES), abs=1e-5)
