import numpy as np
import pytest

from readygo.common.episode import GridSearch
from readygo.common.episode.grid_search import FACTOR_MAX, FREE
from readygo.services.planner.humans.window_search import WindowSearch


def length(cells):
    return np.hypot(*np.diff(cells, axis=0).T).sum()


@pytest.mark.parametrize("seed", range(8))
def test_ways_are_those_of_the_whole_map(seed):
    """A way within the length is the same, cell by cell; without one there is none or a longer one."""
    rng = np.random.default_rng(seed)
    factor = (
        rng.integers(FREE, FACTOR_MAX, (160, 200)).astype(np.uint8) if seed % 2 else np.full((160, 200), 4, np.uint8)
    )
    for _ in range(40):
        i, j, rows, columns = rng.integers(0, 160), rng.integers(0, 200), *rng.integers(1, 40, 2)
        factor[i : i + rows, j : j + min(columns, 4)] = 0
    whole, windowed = GridSearch(factor.shape), WindowSearch(factor.shape)
    free = np.argwhere(factor > 0)
    same = 0
    for _ in range(60):
        a = tuple(free[rng.integers(len(free))].tolist())
        b = tuple(int(v) for v in np.clip(np.array(a) + rng.integers(-25, 26, 2), 0, (159, 199)))
        if factor[b] == 0 or a == b:
            continue
        longest = 1.5 * np.hypot(*np.subtract(a, b)) + 6
        expected, found = whole.path(factor, a, b), windowed.path(factor, a, b, longest=longest)
        if expected is not None and length(expected) <= longest:
            assert np.array_equal(found, expected)
            same += 1
        else:
            assert found is None or length(found) > longest
        assert windowed.connects(factor, a, b, margin=10) == (expected is not None)
    assert same >= 20
