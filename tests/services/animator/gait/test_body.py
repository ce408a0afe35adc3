import numpy as np
import pytest

from readygo.services.animator import skeleton_of
from readygo.services.animator.gait import walk as gait
from readygo.services.animator.gait.human import draw_style
from readygo.services.animator.gait.quality import joints_of
from tests.services.animator.bodies import make_avatar
from tests.services.animator.paths import floor, line

AVERAGE = draw_style(np.random.default_rng(0), 0.0, skeleton_of(make_avatar()).size)


@pytest.fixture
def walk_of(animate, avatar, monkeypatch):
    """Joints of somebody with given habits who walks along x, shape (T, 24, 3)."""

    def run(**habits):
        monkeypatch.setattr(gait, "draw_style", lambda *_: AVERAGE._replace(**habits))
        return joints_of(animate(line(1.2), floor()), avatar)[1][40:160]

    return run


def test_who_leans_carries_the_shoulders_further_ahead(walk_of):
    def lean_rad(**habits):
        P = walk_of(**habits)
        trunk = P[:, 12] - P[:, 0]
        return np.arctan2(trunk[:, 0], trunk[:, 2]).mean()

    assert lean_rad(lean_rad=0.1) - lean_rad() == pytest.approx(0.1, abs=0.03)


def test_arms_swing_by_the_factor_of_the_human(walk_of):
    def swing_m(**habits):
        P = walk_of(**habits)
        return np.ptp(P[:, 20, 0] - P[:, 16, 0])

    assert swing_m(arm_swing=1.3) > 1.15 * swing_m()
    assert swing_m(arm_swing=0.7) < 0.85 * swing_m()
