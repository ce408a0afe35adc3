import dataclasses

import numpy as np
import pytest

from readygo.common.robot import RobotConfig
from readygo.services.trainer.goals import hindsight_goals, own_goals
from readygo.services.trainer.samples import WindowTiming, episode_table, join_tables
from tests.services.trainer.conftest import make_one


def straight_drives(**fields):
    """Episodes that drive along +x while they look along +y."""
    tables = []
    for k in range(3):
        xyyaw = np.stack([np.arange(40) * 0.19, np.full(40, 100.0 * k), np.full(40, np.pi / 2)], axis=1)
        tables.append(
            episode_table(make_one(f"e{k}", xyyaw=xyyaw, **fields), RobotConfig(), WindowTiming(spacing_steps=10))
        )
    return join_tables(tables)


def test_hindsight_goal_is_a_place_that_the_robot_reached_later_in_its_episode():
    table, samples = straight_drives(), np.arange(120)
    goals = hindsight_goals(table, samples, 1.0, np.random.default_rng(0)).xy_m
    replaced = np.any(goals != table.goals_xy_m, axis=1)
    # Whatever comes later is to the right.
    np.testing.assert_allclose(goals[replaced, 0], 0.0, atol=1e-5)
    steps_later = -goals[replaced, 1] / 0.19
    np.testing.assert_allclose(steps_later, np.round(steps_later), atol=1e-4)
    assert np.all(steps_later <= (table.last - samples)[replaced] + 1e-4)
    assert np.all(-goals[replaced, 1] > 1.0)
    assert not replaced[(table.last - samples) * 0.19 <= 1.0].any()


def test_hindsight_goals_end_where_the_expert_was_disturbed():
    calm = make_one("e0")
    expert = np.repeat(calm.actions[:, None], 2, axis=1)
    expert[20, 0] += 0.3
    xyyaw = np.stack([np.arange(40) * 0.19, np.zeros(40), np.full(40, np.pi / 2)], axis=1)
    table = episode_table(
        dataclasses.replace(calm, xyyaw=xyyaw, expert=expert), RobotConfig(), WindowTiming(spacing_steps=10)
    )
    samples = np.arange(40)
    for seed in range(20):
        goals = hindsight_goals(table, samples, 1.0, np.random.default_rng(seed)).xy_m
        replaced = np.any(goals != table.goals_xy_m, axis=1)
        reached = np.round(-goals[:, 1] / 0.19) + samples
        assert not replaced[20]
        assert np.all(reached[:20][replaced[:20]] <= 20)


def test_hindsight_share_zero_keeps_every_goal():
    table = straight_drives()
    goals = hindsight_goals(table, np.arange(60), 0.0, np.random.default_rng(0)).xy_m
    np.testing.assert_array_equal(goals, table.goals_xy_m[:60])


def crooked_drives():
    """Two episodes that wind through the plane, with an image at every third step."""
    tables, rng = [], np.random.default_rng(2)
    for k in range(2):
        yaw_rad = 2.5 + np.cumsum(rng.uniform(-0.2, 0.3, 40))
        xy_m = np.array([-3.2, 7.1]) + np.cumsum(0.15 * np.stack([np.cos(yaw_rad), np.sin(yaw_rad)], axis=1), axis=0)
        images = tuple(b"image" if step % 3 == 0 else b"" for step in range(40))
        one = make_one(f"e{k}", xyyaw=np.column_stack([xy_m, yaw_rad]))
        one = dataclasses.replace(one, images=images)
        tables.append(episode_table(one, RobotConfig(), WindowTiming(spacing_steps=9)))
    return join_tables(tables)


@pytest.mark.parametrize("seen", [False, True])
def test_place_reached_later_is_where_that_sample_was(seen):
    table, samples = crooked_drives(), np.arange(80)
    found = set()
    for seed in range(10):
        goals = hindsight_goals(table, samples, 1.0, np.random.default_rng(seed), seen=seen)
        for sample, xy_m, later in zip(samples.tolist(), goals.xy_m.tolist(), goals.seen_from.tolist(), strict=True):
            if later < 0:
                assert later == -1 - table.episode[sample]
                assert xy_m == table.goals_xy_m[sample].tolist()
                continue
            found.add(later - sample)
            assert table.episode[later] == table.episode[sample]
            assert not seen or (later - table.first[later]) % 3 == 0
            x, y, yaw_rad = table.xyyaw[sample]
            ahead = (complex(*table.xyyaw[later, :2]) - complex(x, y)) * np.exp(-1j * yaw_rad)
            assert abs(ahead) > 1.0
            assert xy_m == pytest.approx((ahead.real, ahead.imag), abs=1e-5)
    assert {12, 30} <= found
    assert max(found) > 35


def test_every_later_place_may_be_a_goal_up_to_the_last_one():
    table = straight_drives()
    goals = hindsight_goals(table, np.full(4000, 30), 1.0, np.random.default_rng(0))
    # 0.19 m a step: six steps are the first that lead more than 1 m away.
    steps, counts = np.unique(goals.seen_from[goals.seen_from >= 0] - 30, return_counts=True)
    assert steps.tolist() == [6, 7, 8, 9]
    assert counts.min() > 0.8 * counts.max()


def test_half_of_the_goals_are_replaced_at_a_share_of_a_half():
    table, samples = straight_drives(), np.tile(np.arange(20), 60)
    goals = hindsight_goals(table, samples, 0.5, np.random.default_rng(0))
    all_of_them = hindsight_goals(table, samples, 1.0, np.random.default_rng(0))
    assert np.mean(goals.seen_from >= 0) / np.mean(all_of_them.seen_from >= 0) == pytest.approx(0.5, abs=0.06)


def test_goals_of_the_episodes_are_seen_from_their_own_images():
    table = straight_drives()
    goals = own_goals(table, np.array([0, 41, 119, 39]))
    assert goals.seen_from.tolist() == [-1, -2, -3, -1]
    assert np.array_equal(goals.xy_m, table.goals_xy_m[[0, 41, 119, 39]])
