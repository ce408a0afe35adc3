import numpy as np
import pytest
from numba import njit

from readygo.common.simd.memory import load_f16, store_f16
from readygo.services.reconstructor.differentiable import partial_sums as sums


@njit
def _sums(x, y, out):
    a, b, c = sums.no_sum(), sums.no_sum(), sums.no_sum()
    nothing = sums.no_sum()
    for k in range(0, len(x), 16):
        u, v = load_f16(x, k), load_f16(y, k)
        a, b, c = sums.add(a, u), sums.add_product(b, u, v), sums.add(c, v)
    d, e, f, g = sums.add(a, load_f16(x, 0)), sums.add(b, load_f16(x, 0)), sums.add(c, load_f16(x, 0)), nothing
    store_f16(out, 0, sums.totals(a, b, c, d, e, f, g, nothing, b, c, a))


def test_totals_are_sums_over_all_lanes_of_all_values() -> None:
    x, y = np.random.default_rng(0).normal(size=(2, 80)).astype(np.float32)
    out = np.full(16, np.nan, np.float32)
    _sums(x, y, out)
    a, b, c, first = x.sum(), (x * y).sum(), y.sum(), x[:16].sum()
    expected = [a, b, c, a + first, b + first, c + first, 0.0, 0.0, b, c, a]
    assert [out[sums.place_of(k)] for k in range(sums.SUMS)] == pytest.approx(expected, abs=1e-5)
    others = set(range(16)) - {sums.place_of(k) for k in range(sums.SUMS)}
    assert all(out[place] == 0.0 for place in others)
