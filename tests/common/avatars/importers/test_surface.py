import dataclasses

import numpy as np
import pytest
from scipy.spatial import cKDTree

from readygo.common.arrays import Float64Array, Int64Array
from readygo.common.avatars.importers.surface import FLATNESS, Mesh, gaussians_of_mesh
from readygo.common.frames import matrix_from_quat
from readygo.common.gaussians import rgb_of_sh

COUNT = 400


def square(z_m: float = 0.0, joint: int = 3) -> Mesh:
    """A piece of cloth that faces +z, moved by one joint."""
    a, b, c, d = (np.array([x, y, z_m]) for x, y in ((0, 0), (0.15, 0), (0.15, 0.15), (0, 0.15)))
    weights = np.zeros((2, 3, 24))
    weights[:, :, joint] = 1.0
    normals = np.tile(np.array([0.0, 0.0, 1.0]), (2, 3, 1))
    return Mesh(corners_m=np.array([[a, b, c], [a, c, d]]), normals=normals, weights=weights, density=np.ones(2))


def red(triangle: Int64Array, bary: Float64Array) -> Float64Array:
    return np.tile(np.array([0.8, 0.1, 0.1, 1.0]), (len(triangle), 1))


def both(first: Mesh, second: Mesh) -> Mesh:
    fields = dataclasses.fields(Mesh)
    return Mesh(**{f.name: np.concatenate([getattr(first, f.name), getattr(second, f.name)]) for f in fields})


def test_square_is_covered_evenly_by_flat_gaussians_of_its_colour() -> None:
    cloud, skin = gaussians_of_mesh(square(), red, COUNT)
    assert 0.8 * COUNT < len(cloud) < 1.25 * COUNT
    np.testing.assert_allclose(cloud.means_m[:, 2], 0.0, atol=1e-7)
    np.testing.assert_allclose(
        matrix_from_quat(cloud.quats_wxyz)[:, :, 2], np.tile((0, 0, 1), (len(cloud), 1)), atol=1e-6
    )
    np.testing.assert_allclose(cloud.scales_m[:, 2], FLATNESS * cloud.scales_m[:, 0], rtol=1e-5)
    np.testing.assert_allclose(rgb_of_sh(cloud.sh[:, 0]), np.tile((0.8, 0.1, 0.1), (len(cloud), 1)), atol=1e-6)
    np.testing.assert_allclose(skin[:, 3], 1.0)
    distance = cKDTree(cloud.means_m).query(cloud.means_m, k=2)[0][:, 1]
    assert distance.min() > 0.5 * np.median(distance)
    assert np.quantile(distance, 0.95) < 1.5 * np.median(distance)


def test_denser_triangle_gets_more_gaussians() -> None:
    mesh = dataclasses.replace(square(), density=np.array([1.0, 4.0]))
    x, y, _ = gaussians_of_mesh(mesh, red, COUNT)[0].means_m.T
    assert 3.0 < (y > x).sum() / (y < x).sum() < 5.0


def test_skin_below_a_shirt_is_left_out_and_a_transparent_layer_hides_nothing() -> None:
    layers = both(square(0.0, joint=3), square(0.008, joint=6))
    cloud, skin = gaussians_of_mesh(layers, red, COUNT)
    assert (cloud.means_m[:, 2] > 0.007).mean() > 0.95
    np.testing.assert_array_equal(skin[:, 6] > 0.5, cloud.means_m[:, 2] > 0.007)

    def glass(triangle: Int64Array, bary: Float64Array) -> Float64Array:
        return np.where((triangle >= 2)[:, None], (0.8, 0.1, 0.1, 0.0), (0.1, 0.1, 0.8, 1.0))

    cloud, _ = gaussians_of_mesh(layers, glass, COUNT)
    assert (cloud.means_m[:, 2] < 0.001).all()


def test_layer_that_faces_away_hides_nothing() -> None:
    back = square(0.008)
    turned = dataclasses.replace(back, corners_m=back.corners_m[:, ::-1], normals=-back.normals)
    cloud, _ = gaussians_of_mesh(both(square(), turned), red, COUNT)
    assert len(cloud) > 0.8 * COUNT
    assert 0.4 < (cloud.means_m[:, 2] < 0.001).mean() < 0.6


def test_gaussian_averages_the_colours_that_it_covers() -> None:
    def checks(triangle: Int64Array, bary: Float64Array) -> Float64Array:
        grain = np.random.default_rng(0).integers(0, 2, (len(triangle), 1))
        return np.concatenate([np.tile(grain, (1, 3)), np.ones_like(grain)], axis=1).astype(np.float64)

    grey = rgb_of_sh(gaussians_of_mesh(square(), checks, COUNT)[0].sh[:, 0])[:, 0]
    assert grey.std() < 0.3
    assert grey.mean() == pytest.approx(0.5, abs=0.05)


def test_surface_without_area_or_all_transparent_is_refused() -> None:
    flat = dataclasses.replace(square(), corners_m=np.zeros((2, 3, 3)))
    with pytest.raises(ValueError, match="no area"):
        gaussians_of_mesh(flat, red, COUNT)
    with pytest.raises(ValueError, match="transparent"):
        gaussians_of_mesh(square(), lambda triangle, bary: np.zeros((len(triangle), 4)), COUNT)


def test_gaussians_of_a_folded_cloth_are_as_they_were(golden_figures) -> None:
    upright = square(joint=5)
    upright = dataclasses.replace(
        upright, corners_m=upright.corners_m[..., [2, 1, 0]] * [1.0, 1.3, 0.7], density=np.array([0.5, 2.0])
    )
    cloud, skin = gaussians_of_mesh(both(square(0.03), upright), red, COUNT)
    golden_figures("avatars/cloth", 20.0 * cloud.means_m, cloud.quats_wxyz, 50.0 * cloud.scales_m, cloud.opacities)
    golden_figures("avatars/cloth skin", skin, cloud.sh[:, 0])
