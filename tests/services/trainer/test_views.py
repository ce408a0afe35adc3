import numpy as np

from readygo.services.trainer.config import SamplingConfig
from readygo.services.trainer.views import draw_views


def test_views_are_as_wide_as_asked_for_and_turn_only_who_may_be_turned():
    config = SamplingConfig(yaw_error_rad=0.1, shift_px=3)
    turnable = np.arange(4000) % 2 == 0
    view = draw_views(turnable, config, np.random.default_rng(0))
    assert not view.yaws_rad[~turnable].any()
    assert 0.09 < view.yaws_rad[turnable].std() < 0.1
    assert np.abs(view.yaws_rad).max() <= 0.25
    assert (view.shifts_px.min(), view.shifts_px.max()) == (-3, 3)
    assert 0.47 < view.mirrored.mean() < 0.53
    assert not draw_views(turnable, config, np.random.default_rng(0), mirrors=False).mirrored.any()
