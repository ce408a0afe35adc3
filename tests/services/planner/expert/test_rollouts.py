import numpy as np
import pytest

from readygo.services.planner.expert.rollouts import limited, nearest_ahead, slow_ahead

LIMITS = (1.0, 1.2, 0.8, 2.0)


@pytest.fixture
def path():
    """A winding path with points at uneven distances and speeds that jump: x, y, yaw, v."""
    rng = np.random.default_rng(4)
    steps = rng.uniform(0.02, 0.2, (60, 1)) * np.column_stack([np.ones(60), rng.uniform(-0.5, 0.5, 60)])
    xy = np.cumsum(steps, axis=0)
    speed = np.where(np.arange(60) % 17 == 16, 0.1, 1.0)
    speed[-1] = 0.0
    return np.column_stack([xy, np.zeros(60), speed])


def gaps_m(path):
    return np.hypot(*np.diff(path[:, :2], axis=0).T)


@pytest.mark.parametrize("deceleration_mps2", [0.4, 0.8])
def test_braking_at_the_deceleration_reaches_every_slower_stretch_in_time(path, deceleration_mps2):
    slowed = path.copy()
    slow_ahead(slowed, deceleration_mps2)
    v = slowed[:, 3]
    assert np.all(v[:-1] ** 2 <= v[1:] ** 2 + 2 * deceleration_mps2 * gaps_m(path) + 1e-12)
    braking = v < path[:, 3]
    assert braking.sum() > 10
    tight = v[1:] ** 2 + 2 * deceleration_mps2 * gaps_m(path)
    assert v[:-1][braking[:-1]] ** 2 == pytest.approx(tight[braking[:-1]])
    assert np.all(v <= path[:, 3])
    assert np.array_equal(slowed[:, :3], path[:, :3])


def test_nearest_point_is_searched_ahead_and_not_far(path):
    assert nearest_ahead(path, 5, *path[9, :2]) == 9
    assert nearest_ahead(path, 12, *path[9, :2]) == 12
    assert nearest_ahead(path, 5, *path[40, :2]) == 20


def test_command_changes_by_what_the_robot_can_do_in_a_step():
    assert limited(2.0, 5.0, (0.0, 0.0, 0.0, 0.5, 0.0), LIMITS) == pytest.approx((0.54, 0.1))
    assert limited(-1.0, -5.0, (0.0, 0.0, 0.0, 0.5, 0.0), LIMITS) == pytest.approx((0.46, -0.1))
    assert limited(2.0, 5.0, (0.0, 0.0, 0.0, 0.99, 1.19), LIMITS) == pytest.approx((1.0, 1.2))
