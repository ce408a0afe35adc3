import numpy as np
import pytest
from numba import njit

from readygo.common.simd import memory
from readygo.common.simd import types as simd


@njit
def _move(matrix, transposed, integers, words, out):
    memory.transpose(matrix, 3, 20, transposed, 5, 17)
    lanes = memory.load_i16(integers, 0)
    memory.store_i16(out, 0, simd.integer_where(lanes > 7, lanes << 2, lanes * 3 - 1))
    memory.store_i16(out, 16, simd.integer_minimum(lanes, 9) | (simd.lane_number() & 1))
    memory.poke(out, 32, memory.peek(words, 3) + memory.peek(integers, 5))
    return memory.touching(words, 1, 1 << 15), simd.lowest_bit(40)


def test_shuffles_and_integer_lanes() -> None:
    matrix, transposed = np.arange(3 + 16 * 20, dtype=np.float32), np.full(5 + 16 * 17, -1.0, dtype=np.float32)
    integers = np.arange(16, dtype=np.int32)
    words = (np.arange(65) * 1009).astype(np.uint16)
    out = np.zeros(33, dtype=np.int32)
    touched, lowest = _move(matrix, transposed, integers, words, out)
    rows = transposed[5:].reshape(16, 17)
    assert np.array_equal(rows[:, :16], matrix[3:].reshape(16, 20)[:, :16].T)
    assert (transposed[:5] == -1.0).all()
    assert (rows[:, 16] == -1.0).all()
    assert np.array_equal(out[:16], np.where(integers > 7, integers * 4, integers * 3 - 1))
    assert np.array_equal(out[16:32], np.minimum(integers, 9) | (integers & 1))
    assert out[32] == 3 * 1009 + 5
    assert touched % 2**64 == sum(1 << k for k in range(64) if words[1 + k] & 0x8000)
    assert lowest == 3


@pytest.mark.parametrize("value", [-32767, -1, 0, 12345])
def test_shorts_are_loaded_with_their_sign(value: int) -> None:
    @njit
    def load(source, out):
        memory.store_f16(out, 0, memory.load_short(source, 0))

    out = np.zeros(16, dtype=np.float32)
    load(np.full(16, value, dtype=np.int16), out)
    assert (out == value).all()


@njit
def _mark(words):
    memory.forget(words, 2)
    memory.mark(words, 2, 0b1011, 1 << 15)
    memory.mark(words, 2, -(1 << 63) | 2, 3)


def test_words_are_forgotten_and_marked() -> None:
    words = np.full(70, 9, dtype=np.uint16)
    _mark(words)
    expected = np.full(70, 9, dtype=np.uint16)
    expected[2:66] = 0
    expected[[2, 3, 5]] = 1 << 15
    expected[[3, 65]] |= 3
    assert np.array_equal(words, expected)
