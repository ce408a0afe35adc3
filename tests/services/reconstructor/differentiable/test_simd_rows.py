import numpy as np
import pytest
from numba import njit

from readygo.common.simd.memory import load_f16, store_f16
from readygo.services.reconstructor.differentiable import simd_rows as rows

NUMBERS = np.arange(1.0, 257.0, dtype=np.float32)


@njit
def _columns(source, three, four, back):
    a, b, c, d = load_f16(source, 0), load_f16(source, 16), load_f16(source, 32), load_f16(source, 48)
    x = rows.columns_of_three(a, b, c)
    u = rows.rows_of_three(x[0], x[1], x[2])
    v = rows.rows_of_four(a, b, c, d)
    for k in range(3):
        store_f16(three, 16 * k, x[k])
        store_f16(back, 16 * k, u[k])
    for k in range(4):
        store_f16(four, 16 * k, v[k])


def test_rows_become_columns_and_back() -> None:
    three, four, back = np.empty(48, np.float32), np.empty(64, np.float32), np.empty(48, np.float32)
    _columns(NUMBERS, three, four, back)
    assert np.array_equal(three.reshape(3, 16), NUMBERS[:48].reshape(16, 3).T)
    assert np.array_equal(four.reshape(16, 4), NUMBERS[:64].reshape(4, 16).T)
    assert np.array_equal(back, NUMBERS[:48])


@njit
def _first(source, count, out):
    rows.store_first(out, 2, count, rows.load_first(source, 3, count))
    store_f16(out, 20, rows.load_first(source, 3, count))


@pytest.mark.parametrize("count", [-3, 0, 1, 15, 16, 40])
def test_lanes_beyond_the_count_are_neither_read_nor_written(count: int) -> None:
    out = np.full(36, -1.0, np.float32)
    _first(NUMBERS, count, out)
    used = min(max(count, 0), 16)
    assert np.array_equal(out[2 : 2 + used], NUMBERS[3 : 3 + used])
    assert (out[:2] == -1.0).all()
    assert (out[2 + used : 20] == -1.0).all()
    assert np.array_equal(out[20:], np.where(np.arange(16) < count, NUMBERS[3:19], 0.0))


@njit
def _block(image, index, stride, out):
    value = rows.load_block(image, index, stride)
    store_f16(out, 0, value)
    rows.store_block(image, 0, stride, value)


def test_blocks_are_four_pixels_of_four_rows() -> None:
    image, out = NUMBERS.copy(), np.empty(16, np.float32)
    _block(image, 32 + 5, 16, out)
    assert np.array_equal(out.reshape(4, 4), NUMBERS.reshape(16, 16)[2:6, 5:9])
    expected = NUMBERS.reshape(16, 16).copy()
    expected[:4, :4] = out.reshape(4, 4)
    assert np.array_equal(image.reshape(16, 16), expected)


@njit
def _sums(source, out):
    a, b, c, d = load_f16(source, 0), load_f16(source, 16), load_f16(source, 32), load_f16(source, 48)
    rows.add_block_sums(out, 1, a, b, c, d)


def test_sums_of_blocks_are_added() -> None:
    out, blocks = np.ones(8, np.float32), NUMBERS[:64].reshape(4, 16)
    _sums(NUMBERS, out)
    assert np.array_equal(out, [1.0, *(1.0 + blocks.sum(axis=1)), 1.0, 1.0, 1.0])


@njit
def _copies(source, out):
    rows.copy_three(out, 1, source, 7)
    rows.copy_four(out, 5, source, 20)


def test_rows_of_three_and_four_are_copied_alone() -> None:
    out = np.zeros(10, np.float32)
    _copies(NUMBERS, out)
    assert np.array_equal(out, [0.0, *NUMBERS[7:10], 0.0, *NUMBERS[20:24], 0.0])
