import numpy as np
import pytest
from numba import njit

from readygo.common.frames import matrix_from_axis_angle
from readygo.common.rasterizer.cpu.posing import nearest_rotation
from readygo.common.simd.memory import load_f16, store_f16


@njit
def _nearest(matrices, out):
    M = (
        load_f16(matrices, 0), load_f16(matrices, 16), load_f16(matrices, 32), load_f16(matrices, 48),
        load_f16(matrices, 64), load_f16(matrices, 80), load_f16(matrices, 96), load_f16(matrices, 112),
        load_f16(matrices, 128),
    )  # fmt: skip
    R = nearest_rotation(M)
    for k in range(9):
        store_f16(out, 16 * k, R[k])


def test_blend_of_rotations_goes_to_the_nearest_rotation() -> None:
    """Blends of two rotations up to 110 degrees apart."""
    rng = np.random.default_rng(0)
    axes = rng.normal(size=(16, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    first = matrix_from_axis_angle(rng.normal(size=(16, 3)))
    turn = matrix_from_axis_angle(axes * np.radians(np.linspace(0.0, 110.0, 16))[:, None])
    share = np.linspace(0.1, 0.9, 16)[:, None, None]
    blends = (1 - share) * first + share * (first @ turn)
    u, _, vt = np.linalg.svd(blends)
    out = np.empty(9 * 16, np.float32)
    _nearest(blends.reshape(16, 9).T.astype(np.float32).reshape(-1), out)
    assert out.reshape(9, 16).T.reshape(16, 3, 3) == pytest.approx(u @ vt, abs=3e-6)


def test_rotation_stays_as_it_is() -> None:
    rotations = matrix_from_axis_angle(np.random.default_rng(1).normal(size=(16, 3)))
    out = np.empty(9 * 16, np.float32)
    _nearest(rotations.reshape(16, 9).T.astype(np.float32).reshape(-1), out)
    assert out.reshape(9, 16).T.reshape(16, 3, 3) == pytest.approx(rotations, abs=1e-6)
