import numpy as np

from readygo.common.frames import swap_opengl_axes, yup_from_zup, zup_from_yup


def test_up_of_smpl_becomes_up_of_the_world() -> None:
    np.testing.assert_array_equal(zup_from_yup([0, 1, 0]), [0, 0, 1])
    np.testing.assert_array_equal(zup_from_yup([1, 2, 3]), [1, -3, 2])


def test_axes_go_to_zup_and_back() -> None:
    points = np.random.default_rng(0).standard_normal((4, 5, 3))
    np.testing.assert_array_equal(zup_from_yup(yup_from_zup(points)), points)


def test_change_of_axes_keeps_the_hand() -> None:
    x, y, z = zup_from_yup(np.eye(3))
    np.testing.assert_array_equal(np.cross(x, y), z)


def test_opengls_camera_looks_against_its_z_and_has_y_up() -> None:
    T = np.eye(4)
    T[:3, 3] = 1.0, 2.0, 3.0
    swapped = swap_opengl_axes(np.stack([T, T]))
    right, down, forward = swapped[1, :3, :3].T
    np.testing.assert_array_equal([right, down, forward], [[1, 0, 0], [0, -1, 0], [0, 0, -1]])
    np.testing.assert_array_equal(swapped[1, :3, 3], [1, 2, 3])
    np.testing.assert_array_equal(swap_opengl_axes(swapped), np.stack([T, T]))
