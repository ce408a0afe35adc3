import numpy as np
import pytest
from numba import njit

from readygo.common.frames import matrix_from_quat
from readygo.common.rasterizer.constants import DILATION_PX2
from readygo.common.simd.memory import load_f16, store_f16
from readygo.services.reconstructor.differentiable.ewa import (
    image_axes,
    image_covariance,
    image_rows,
    quaternion_matrix,
    to_camera,
)


@njit
def _project(numbers, R, out):
    """Rows of 16 lanes: offsets (3), quaternions (4), tangents (2); out: camera (3), Q (9), A (6), covariance (4)."""
    p = to_camera(R, (load_f16(numbers, 0), load_f16(numbers, 16), load_f16(numbers, 32)))
    Q = quaternion_matrix(load_f16(numbers, 48), load_f16(numbers, 64), load_f16(numbers, 80), load_f16(numbers, 96))
    A = image_axes(image_rows(R, load_f16(numbers, 112), load_f16(numbers, 128)), Q)
    S = image_covariance((A[0], A[1], A[2]), (A[3], A[4], A[5]))
    for k in range(3):
        store_f16(out, 16 * k, p[k])
    for k in range(9):
        store_f16(out, 48 + 16 * k, Q[k])
    for k in range(6):
        store_f16(out, 192 + 16 * k, A[k])
    for k in range(4):
        store_f16(out, 288 + 16 * k, S[k])


@pytest.fixture(scope="module")
def numbers() -> np.ndarray:
    return np.random.default_rng(0).normal(size=(9, 16)).astype(np.float32)


@pytest.fixture(scope="module")
def R() -> np.ndarray:
    return matrix_from_quat(np.array([0.4, -0.2, 0.7, 0.5]))


@pytest.fixture(scope="module")
def found(numbers: np.ndarray, R: np.ndarray) -> np.ndarray:
    out = np.empty(22 * 16, np.float32)
    # R is constant over the lanes: numbers of it are scalars.
    _project(numbers.reshape(-1), tuple(R.reshape(-1).astype(np.float32)), out)
    return out.reshape(22, 16).astype(np.float64)


def test_offsets_are_turned_into_the_camera(numbers: np.ndarray, R: np.ndarray, found: np.ndarray) -> None:
    assert found[:3] == pytest.approx(R @ numbers[:3], abs=1e-5)


def test_quaternions_of_any_length_are_rotations(numbers: np.ndarray, found: np.ndarray) -> None:
    expected = matrix_from_quat((numbers[3:7] / np.linalg.norm(numbers[3:7], axis=0)).T)
    assert found[3:12].T.reshape(16, 3, 3) == pytest.approx(expected, abs=1e-5)


def test_axes_and_covariance_are_those_of_the_linearised_camera(
    numbers: np.ndarray, R: np.ndarray, found: np.ndarray
) -> None:
    for lane in range(16):
        u, v = numbers[7:, lane]
        J = np.array([[1.0, 0.0, -u], [0.0, 1.0, -v]])
        axes = J @ R @ found[3:12, lane].reshape(3, 3)
        assert found[12:18, lane].reshape(2, 3) == pytest.approx(axes, abs=1e-5)
        covariance = axes @ axes.T + DILATION_PX2 * np.eye(2)
        xx, xy, yy, det = found[18:, lane]
        assert [[xx, xy], [xy, yy]] == [pytest.approx(row, rel=1e-4, abs=1e-5) for row in covariance]
        assert det == pytest.approx(np.linalg.det(covariance), rel=1e-4)


@njit
def _covariance(a, b, out):
    S = image_covariance(
        (load_f16(a, 0), load_f16(a, 16), load_f16(a, 32)), (load_f16(b, 0), load_f16(b, 16), load_f16(b, 32))
    )
    store_f16(out, 0, S[3])


def test_determinant_of_a_needle_does_not_cancel() -> None:
    """xx yy - xy^2 of 1e8 px2 each would have no correct digit in float32."""
    a, out = np.zeros(48, np.float32), np.empty(16, np.float32)
    a[:16] = 1e4
    _covariance(a, a, out)
    assert out == pytest.approx(np.full(16, DILATION_PX2 * 2e8 + DILATION_PX2**2), rel=1e-5)
