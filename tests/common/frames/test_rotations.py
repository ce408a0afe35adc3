import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from readygo.common.frames import (
    axis_angle_from_matrix,
    matrix_from_axis_angle,
    matrix_from_quat,
    quat_from_matrix,
    quat_multiply,
    wrap_angle,
)

vectors = arrays(np.float64, 3, elements=st.floats(-1.8, 1.8))


@given(vectors)
def test_axis_angle_and_matrix_are_inverse(v: np.ndarray) -> None:
    R = matrix_from_axis_angle(v)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(R), 1.0)
    np.testing.assert_allclose(matrix_from_axis_angle(axis_angle_from_matrix(R)), R, atol=1e-9)


@given(vectors, vectors)
def test_quaternion_product_composes_rotations(a: np.ndarray, b: np.ndarray) -> None:
    A, B = matrix_from_axis_angle(a), matrix_from_axis_angle(b)
    product = quat_multiply(quat_from_matrix(A), quat_from_matrix(B))
    np.testing.assert_allclose(matrix_from_quat(product), A @ B, atol=1e-9)


@given(vectors)
def test_quaternion_of_a_matrix_is_a_unit_with_w_not_negative(v: np.ndarray) -> None:
    q = quat_from_matrix(matrix_from_axis_angle(v))
    assert q[0] >= 0
    np.testing.assert_allclose(np.linalg.norm(q), 1.0)
    half = np.linalg.norm(v) / 2
    np.testing.assert_allclose(q[0], abs(np.cos(half)), atol=1e-9)


def test_half_turns_about_each_axis_keep_their_axis() -> None:
    for axis in np.eye(3):
        R = matrix_from_axis_angle(np.pi * axis)
        np.testing.assert_allclose(matrix_from_quat(quat_from_matrix(R)), R, atol=1e-12)


def test_wrapped_angle_is_below_pi_and_equal_modulo_a_turn() -> None:
    angles = np.linspace(-20, 20, 101)
    wrapped = wrap_angle(angles)
    assert np.all((wrapped >= -np.pi) & (wrapped < np.pi))
    np.testing.assert_allclose(np.cos(wrapped), np.cos(angles), atol=1e-12)
