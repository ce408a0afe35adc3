import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from readygo.common.errors import SceneError
from readygo.common.frames import matrix_from_axis_angle, matrix_from_quat
from readygo.common.gaussians import R_from_up, concatenate, sh_basis, transform_cloud
from readygo.common.gaussians.spherical_harmonics import rotate_sh
from readygo.common.gaussians.transform import R_UP
from tests.common.gaussians.clouds import cloud_of

ANGLES = st.tuples(*[st.floats(-3.2, 3.2)] * 3).map(np.array)


def covariances(cloud):
    R = matrix_from_quat(cloud.quats_wxyz)
    return np.einsum("nij,nj,nkj->nik", R, cloud.scales_m.astype(np.float64) ** 2, R)


@settings(deadline=None)
@given(ANGLES)
def test_rotated_colour_along_a_rotated_direction_is_the_old_one(axis_angle):
    R = matrix_from_axis_angle(axis_angle)
    rng = np.random.default_rng(1)
    directions = rng.normal(size=(30, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    sh = rng.normal(size=(5, 16, 3)).astype(np.float32)
    before = np.einsum("dk,nkc->ndc", sh_basis(directions, 3), sh)
    after = np.einsum("dk,nkc->ndc", sh_basis(directions @ R.T, 3), rotate_sh(sh, R))
    np.testing.assert_allclose(after, before, atol=2e-5)


@pytest.mark.parametrize("coefficients", [1, 4, 9, 16])
def test_rotation_keeps_degrees_apart(coefficients):
    sh = np.zeros((1, coefficients, 3), np.float32)
    sh[:, -1] = 1
    turned = rotate_sh(sh, matrix_from_axis_angle([0.3, -1.0, 0.7]))
    first_of_degree = (round(np.sqrt(coefficients)) - 1) ** 2
    np.testing.assert_allclose(turned[:, :first_of_degree], 0, atol=1e-6)
    assert np.linalg.norm(turned) == pytest.approx(np.linalg.norm(sh), rel=1e-6)


def test_basis_is_orthonormal():
    rng = np.random.default_rng(0)
    d = rng.normal(size=(400_000, 3))
    values = sh_basis(d / np.linalg.norm(d, axis=1, keepdims=True), 3)
    np.testing.assert_allclose(4 * np.pi * values.T @ values / len(d), np.eye(16), atol=0.03)


@settings(deadline=None)
@given(ANGLES, st.floats(0.01, 100))
def test_means_and_covariances_follow_the_transform(axis_angle, scale):
    R, t, cloud = matrix_from_axis_angle(axis_angle), np.array([1.0, -2.0, 3.0]), cloud_of(coefficients=1)
    moved = transform_cloud(cloud, R, t, scale)
    np.testing.assert_allclose(moved.means_m, scale * cloud.means_m @ R.T + t, rtol=1e-4, atol=1e-4 * scale)
    expected = scale**2 * R @ covariances(cloud) @ R.T
    np.testing.assert_allclose(covariances(moved), expected, atol=1e-5 * np.abs(expected).max())


@pytest.mark.parametrize("axis_angle", [(0.4, 0.5, -2.0), (0.0, 0.0, np.pi / 2)])
def test_turned_cloud_has_its_colours_along_the_turned_directions(axis_angle):
    R, cloud = matrix_from_axis_angle(axis_angle), cloud_of(5)
    directions = np.eye(3)
    before = np.einsum("dk,nkc->ndc", sh_basis(directions, 3), cloud.sh)
    turned = transform_cloud(cloud, R).sh
    np.testing.assert_allclose(np.einsum("dk,nkc->ndc", sh_basis(directions @ R.T, 3), turned), before, atol=2e-5)
    np.testing.assert_array_equal(transform_cloud(cloud, np.eye(3), (1, 2, 3), 2.0).sh, cloud.sh)


def test_transform_and_its_inverse_give_the_cloud_back():
    R, t, cloud = matrix_from_axis_angle([0.4, 0.5, -2.0]), np.array([1.0, 2.0, 3.0]), cloud_of()
    back = transform_cloud(transform_cloud(cloud, R, t, 2.5), R.T, -R.T @ t / 2.5, 1 / 2.5)
    np.testing.assert_allclose(back.means_m, cloud.means_m, atol=1e-6)
    np.testing.assert_allclose(covariances(back), covariances(cloud), atol=1e-8)
    np.testing.assert_allclose(back.sh, cloud.sh, atol=1e-5)


def test_identity_changes_no_bit():
    cloud = cloud_of()
    same = transform_cloud(cloud, np.eye(3))
    for name in ("means_m", "quats_wxyz", "scales_m", "opacities", "sh"):
        np.testing.assert_array_equal(getattr(same, name), getattr(cloud, name))


@pytest.mark.parametrize("R", [np.eye(3) * 2, np.diag([1, 1, -1]), np.eye(4)])
def test_mirrors_and_shears_are_refused(R):
    with pytest.raises(ValueError, match="rotation matrix"):
        transform_cloud(cloud_of(1), R)


@pytest.mark.parametrize("up", sorted(R_UP))
def test_up_axis_becomes_plus_z(up):
    axis = np.zeros(3)
    axis["xyz".index(up[1])] = 1 if up[0] == "+" else -1
    R = R_from_up(up)
    np.testing.assert_allclose(R @ axis, [0, 0, 1])
    assert np.linalg.det(R) == pytest.approx(1)


def test_sign_of_the_up_axis_may_be_left_out_and_nonsense_is_refused():
    np.testing.assert_array_equal(R_from_up("Z"), np.eye(3))
    np.testing.assert_array_equal(R_from_up(" y "), R_from_up("+y"))
    for wrong in ("", "w", "+", "zz", "--z"):
        with pytest.raises(SceneError, match="Unknown up axis"):
            R_from_up(wrong)


def test_concatenate_pads_lower_degrees():
    low, high = cloud_of(3, 1), cloud_of(4, 9, seed=1)
    both = concatenate([low, high])
    assert both.sh.shape == (7, 9, 3)
    np.testing.assert_array_equal(both.sh[:3, :1], low.sh)
    np.testing.assert_array_equal(both.sh[:3, 1:], 0)
    np.testing.assert_array_equal(both.sh[3:], high.sh)
    with pytest.raises(ValueError, match="at least one"):
        concatenate([])


def test_up_may_be_any_direction_and_turns_no_further_than_it_must():
    up = np.array([0.1, -0.98, 0.05])
    R = R_from_up("0.1,-0.98,0.05")
    np.testing.assert_allclose(R @ (up / np.linalg.norm(up)), [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) > 0
    assert np.trace(R @ R_from_up("-y").T) > 2.9
    np.testing.assert_allclose(R_from_up("0,-1,0"), R_from_up("-y"), atol=1e-12)
    with pytest.raises(SceneError, match="three numbers"):
        R_from_up("0,0,0")
