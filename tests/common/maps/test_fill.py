import numpy as np
import pytest

from readygo.common.maps.fill import fill_smoothly


def test_known_cells_stay_and_unknown_ones_are_within_their_range():
    rng = np.random.default_rng(0)
    values = rng.normal(size=(17, 30))
    known = rng.random((17, 30)) < 0.1
    filled = fill_smoothly(np.where(known, values, np.nan), known)
    np.testing.assert_array_equal(filled[known], values[known])
    assert values[known].min() <= filled.min()
    assert filled.max() <= values[known].max()


def test_hole_in_a_ramp_is_filled_without_a_step():
    ramp = np.tile(0.1 * np.arange(40.0), (40, 1))
    known = np.ones((40, 40), np.bool_)
    known[15:25, 15:25] = False
    assert np.abs(fill_smoothly(ramp, known) - ramp).max() < 0.25


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (2, 3)])
def test_single_known_cell_fills_everything(shape):
    known = np.zeros(shape, np.bool_)
    known[0, -1] = True
    assert (fill_smoothly(np.full(shape, 2.5), known) == 2.5).all()


def test_holes_are_filled_as_they_were(golden_figures):
    rng = np.random.default_rng(2)
    known = rng.random((19, 33)) < 0.15
    golden_figures("maps/filled", fill_smoothly(rng.normal(size=(19, 33)), known).reshape(-1), np.arange(627) % 31)
