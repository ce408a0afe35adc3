import numpy as np
import pytest

from readygo.common.gaussians.spherical_harmonics import (
    SH_C0,
    rgb_along,
    rgb_of_sh,
    sh_basis,
    sh_of_rgb,
    sh_polynomials,
)


def sphere(count: int = 4000) -> np.ndarray:
    k = np.arange(count) + 0.5
    z, angle = 1 - 2 * k / count, np.pi * (1 + np.sqrt(5)) * k
    ring = np.sqrt(1 - z * z)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)


def test_basis_is_orthonormal_on_the_sphere() -> None:
    basis = sh_basis(sphere(), 3)
    assert basis.shape == (4000, 16)
    assert np.abs(4 * np.pi * basis.T @ basis / len(basis) - np.eye(16)).max() < 2e-3


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_lower_degrees_come_first(degree: int) -> None:
    directions = sphere(50)
    assert np.array_equal(sh_basis(directions, degree), sh_basis(directions, 3)[:, : (degree + 1) ** 2])


def test_signs_are_those_of_3dgs() -> None:
    x, y, z = 0.36, 0.48, 0.8
    minus_y, plus_z, minus_x = sh_polynomials(x, y, z)[:3]
    assert minus_y < 0 < plus_z
    assert minus_x < 0
    assert sh_polynomials(x, y, z)[4] == pytest.approx(-np.sqrt(15 / (4 * np.pi)) * y * z)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_colours_along_directions_of_any_length_are_sums_of_the_basis(degree: int) -> None:
    directions, rng = sphere(40), np.random.default_rng(degree)
    sh = rng.normal(0.0, 2.0, (40, (degree + 1) ** 2, 3)).astype(np.float32)
    rgb = rgb_along(sh, directions * rng.uniform(0.1, 9.0, (40, 1)))
    sums = 0.5 + (sh_basis(directions, degree)[:, :, None] * sh).sum(axis=1)
    assert (sums < 0.0).any()
    assert (sums > 1.0).any()
    np.testing.assert_allclose(rgb, np.maximum(sums, 0.0), atol=1e-6)


def test_colours_and_coefficients_are_inverse() -> None:
    rgb = np.array([[0.0, 0.5, 1.0], [0.1, 0.2, 1.3]])
    assert np.allclose(rgb_of_sh(sh_of_rgb(rgb)), rgb)
    assert sh_of_rgb(np.array(1.0)) == pytest.approx(np.sqrt(np.pi))
    assert pytest.approx(0.5 / np.sqrt(np.pi)) == SH_C0
    assert sh_of_rgb(np.float32([0.3])).dtype == np.float32
