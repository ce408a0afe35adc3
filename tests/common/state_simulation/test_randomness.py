import numpy as np

from readygo.common.state_simulation.randomness import next_index, next_normal, next_uniform


def test_numbers_are_those_of_splitmix() -> None:
    state = np.array([1234567], np.uint64)
    expected = [6457827717110365317, 3203168211198807973, 9817491932198370423]
    assert [next_uniform(state) for _ in range(3)] == [
        float(np.uint64(value) >> np.uint64(11)) / 2**53 for value in expected
    ]


def test_distributions_have_their_moments() -> None:
    state = np.array([7], np.uint64)
    normal = np.array([next_normal(state) for _ in range(20_000)])
    uniform = np.array([next_uniform(state) for _ in range(20_000)])
    indices = np.array([next_index(state, 5) for _ in range(20_000)])
    assert abs(normal.mean()) < 0.03
    assert abs(normal.std() - 1.0) < 0.03
    assert abs(uniform.mean() - 0.5) < 0.01
    assert np.bincount(indices, minlength=5).min() > 3700
    assert set(indices.tolist()) == set(range(5))
