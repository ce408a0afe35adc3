import itertools

import numpy as np
import pytest

from readygo.services.animator.priormdm.windows import WINDOW, fade_weights, over_windows, window_starts


def test_windows_cover_everything_and_weights_sum_to_one():
    for count in (196, 197, 240, 352, 353, 600, 1000):
        starts = window_starts(count, 40)
        assert starts[0] == 0
        assert starts[-1] + WINDOW == count
        assert all(b - a <= WINDOW - 40 for a, b in itertools.pairwise(starts))
        total = np.zeros(count)
        for start, weight in zip(starts, fade_weights(count, starts, 40), strict=True):
            total[start : start + WINDOW] += weight
        assert total == pytest.approx(np.ones(count))
    with pytest.raises(ValueError, match="do not fill"):
        window_starts(100, 40)


def test_windows_that_disagree_fade_into_each_other():
    def predict(windows, step):
        return np.broadcast_to(np.arange(len(windows), dtype=np.float32)[:, None, None], windows.shape)

    whole = over_windows(predict, 600, 40)(np.zeros((600, 263), np.float32), 0)[:, 0]
    assert whole[0] == 0.0
    assert whole[-1] == 3.0
    assert np.abs(np.diff(whole)).max() < 0.06
    assert whole[50] == pytest.approx(0.0)
    assert whole[250] == pytest.approx(1.0)


def test_one_window_is_the_model_itself():
    x = np.random.default_rng(0).standard_normal((WINDOW, 263)).astype(np.float32)
    assert over_windows(lambda windows, step: windows * 2.0, WINDOW, 40)(x, 0) == pytest.approx(2.0 * x)


def test_windows_of_other_sizes_start_and_fade_as_they_did(golden_figures):
    assert window_starts(10, 2, 10) == [0]
    assert window_starts(11, 2, 10) == [0, 1]
    assert window_starts(26, 3, 10) == [0, 7, 14, 16]
    for wrong in ((9, 2, 10), (20, 0, 10), (20, 10, 10)):
        with pytest.raises(ValueError, match="do not fill"):
            window_starts(*wrong)
    golden_figures("priormdm/fades", fade_weights(26, [0, 7, 14, 16], 3, 10).T.reshape(10, 4))
