import numba

from readygo.benchmarks.planning.runs import timed


def test_compiling_is_not_timed():
    @numba.njit
    def kernel(x):
        return x + 1

    calls = []

    def call():
        calls.append(kernel(len(calls)))
        return calls[-1]

    assert timed(call)[0] == 2
    assert len(calls) == 2
