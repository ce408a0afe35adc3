import numpy as np
import pytest
from numba import njit

from readygo.common.simd import memory
from readygo.common.simd import types as simd

A = np.linspace(-7.3, 9.1, 16).astype(np.float32)
B = np.linspace(5.5, -3.2, 16).astype(np.float32)


@njit
def _arithmetic(a, b, out):
    x, y = memory.load_f16(a, 0), memory.load_f16(b, 0)
    memory.store_f16(out, 0, x + y)
    memory.store_f16(out, 16, x - 2.0)
    memory.store_f16(out, 32, 1.0 / y)
    memory.store_f16(out, 48, x * y)
    memory.store_f16(out, 64, simd.minimum(x, y))
    memory.store_f16(out, 80, simd.maximum(x, 0.5))
    memory.store_f16(out, 96, simd.where(x > y, x, -1.0))
    memory.store_f16(out, 112, simd.sqrt(x * x) + simd.to_float(simd.truncate(y)))
    return simd.mask_bits((x > y) & (x <= 5.0))


def test_lanes_compute_what_numpy_computes() -> None:
    out = np.zeros(128, dtype=np.float32)
    bits = _arithmetic(A, B, out)
    one = np.float32(1)
    expected = [
        A + B, A - np.float32(2), one / B, A * B, np.minimum(A, B),
        np.maximum(A, np.float32(0.5)), np.where(A > B, A, -one),
        np.sqrt(A * A) + np.trunc(B),
    ]  # fmt: skip
    assert np.array_equal(out.reshape(8, 16), np.array(expected))
    assert bits == sum(1 << k for k in range(16) if A[k] > B[k] and A[k] <= 5)


@njit
def _products(a, b, c, out):
    x, y, z = memory.load_f16(a, 0), memory.load_f16(b, 0), memory.load_f16(c, 0)
    memory.store_f16(out, 0, simd.fma(x, y, z))
    memory.store_f16(out, 16, x * y + z)
    memory.store_f16(out, 32, simd.fms(x, y, z))
    memory.store_f16(out, 48, simd.fnma(x, y, z))


@pytest.mark.skipif(not simd.fuses_multiply_adds(), reason="this CPU has no fused multiply-add")
def test_fma_rounds_once_and_plain_products_are_never_fused() -> None:
    rng = np.random.default_rng(1)
    a, b = (rng.uniform(0.5, 2.0, 16).astype(np.float32) for _ in range(2))
    c = -(a * b)
    out = np.zeros(64, dtype=np.float32)
    _products(a, b, c, out)
    exact = a.astype(np.float64) * b.astype(np.float64)
    assert np.array_equal(out[:16], (exact + c).astype(np.float32))
    assert np.array_equal(out[16:32], np.zeros(16, dtype=np.float32))
    assert np.array_equal(out[32:48], (exact - c).astype(np.float32))
    assert np.array_equal(out[48:], (c - exact).astype(np.float32))
    assert np.abs(out[:16]).max() > 0


@njit
def _somewhere(x):
    values = memory.load_f16(x, 0)
    return simd.holds_somewhere(values > 14.0), simd.holds_somewhere(values > 15.0)


def test_mask_holds_somewhere_or_nowhere() -> None:
    assert _somewhere(np.arange(16, dtype=np.float32)) == (True, False)


@njit
def _with_bits(bits, out):
    out[0] = simd.float_with_bits(bits)
    return simd.float_bits(out[0])


def test_floats_keep_the_bits_that_they_are_made_of() -> None:
    out = np.zeros(1, dtype=np.float32)
    assert _with_bits(0x3F800000, out) == 0x3F800000
    assert out[0] == 1.0
    assert _with_bits(499_999, out) == 499_999


@njit
def _sharing(values, bits):
    return simd.mask_bits(simd.has_bit(memory.load_i16(values, 0), bits))


@pytest.mark.parametrize("bits", [0, 1, 4, 6, 9, -(2**31)])
def test_lanes_share_a_bit_with_a_number_or_do_not(bits) -> None:
    values = np.arange(16, dtype=np.int32) - np.int32(3)
    assert _sharing(values, np.int32(bits)) == sum(1 << k for k in range(16) if int(values[k]) & bits)
